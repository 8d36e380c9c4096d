"""Separation-bearing control of a point ahead of the axle (Desai et al. 2001, Das et al. 2002)."""

import math
from typing import Any, ClassVar

from workbench.compiled import compiled
from workbench.fields import configuration, flag, real
from workbench.formation.angles import wrap
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.law import ControlLaw


@compiled
def l_psi(
    distance: float,
    bearing: float,
    heading: float,
    v1: float,
    omega1: float,
    l_wanted: float,
    psi_wanted: float,
    ahead: float,
    alpha1: float,
    alpha2: float,
) -> tuple[float, float]:
    """Return (v, ω) of l-ψ control: l from the leader's axle to a point ``ahead`` of the own one, ψ
    its angle seen by the leader.

    γ = θ1 + ψ - θ2; ρ = (α1 (l_d - l) + v1 cos ψ) / cos γ; ω = (cos γ / a) (α2 l (ψ_d - ψ) - v1 sin
    ψ + l ω1 + ρ sin γ); v = ρ - a ω tan γ, with a = ``ahead``.
    """
    # from the leader to the point, in the follower's frame
    x = ahead - distance * math.cos(bearing)
    y = -distance * math.sin(bearing)
    length = math.sqrt(x * x + y * y)
    gamma = math.atan2(y, x)
    psi = gamma - heading
    rho = (alpha1 * (l_wanted - length) + v1 * math.cos(psi)) / math.cos(gamma)
    turn = (
        alpha2 * length * wrap(psi_wanted - psi)
        - v1 * math.sin(psi)
        + length * omega1
        + rho * math.sin(gamma)
    )
    omega = math.cos(gamma) / ahead * turn
    return rho - ahead * omega * math.tan(gamma), omega


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω): see ``l_psi``."""
    law = follower.law
    gain = task.law.gain
    if gain[3] != 0.0 and task.shape.any:
        told = law.leader
        place = follower.place
        x, y = place.x + gain[2], place.y  # where the point is to be, in the leader's frame
        return l_psi(
            told.distance,
            told.bearing,
            told.heading,
            told.speed,
            told.turn,
            math.sqrt(x * x + y * y),
            math.atan2(y, x),
            gain[2],
            gain[0],
            gain[1],
        )
    return l_psi(
        distance,
        bearing,
        law.ahead_heading,
        law.ahead_speed,
        law.ahead_turn,
        task.bounds.middle - gain[2],
        math.pi,
        gain[2],
        gain[0],
        gain[1],
    )


@configuration
class LPsi(ControlLaw):
    """l-ψ (separation-bearing) control: straight behind the predecessor's heading.

    In a shape it steers at the virtual leader of its place or, as its authors have it, at the
    leader itself, with the place as separation and angle (places by the leader's heading).
    """

    name: ClassVar[str] = "l-psi"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "heading", "speed", "turning rate")
    steer: ClassVar[Any] = staticmethod(steer)

    k_length: float = real(0.0, 20.0, "1/s", "decay rate α₁ of the separation error", default=1.0)
    k_angle: float = real(0.0, 20.0, "1/s", "decay rate α₂ of the angle error", default=1.0)
    ahead_m: float = real(
        0.001, 0.2, "m", "distance of the controlled point from the axle", default=0.03
    )

    leader: bool = flag("in a shape: steer at the leader itself", default=False)

    def check(self, config: ConvoyConfig) -> None:
        """Refuse a controlled point that does not lie behind the predecessor, and places that are
        not by its heading where the leader itself is steered at.
        """
        if self.leader and config.formation.relative_to != "heading":
            raise ValueError(
                f"LPsi.leader = True with formation.frame = {config.formation.relative_to!r}; "
                "separation and angle are by the leader's heading: expected frame = 'heading'"
            )
        if self.leader and (config.noisy or config.estimates or config.sensing != "truth"):
            raise ValueError(
                f"LPsi.leader = True with sensing = {config.sensing!r} and noise of "
                f"{config.noise_distance_m!r} m, {config.noise_bearing_rad!r} rad; it is told "
                "where the leader truly is: expected sensing = 'truth' without noise or filter"
            )
        if self.ahead_m >= config.middle_m:
            raise ValueError(
                f"LPsi.ahead_m = {self.ahead_m!r}; expected less than the wanted distance d* "
                f"= {config.middle_m:g} m"
            )
