"""Classical followers as drop-in policies: ``evaluate(CarrotPI(), config)`` drives the same robots
as a learned policy does.

A law runs inside the one follower (``formation.follower``): the same senses, noise, control period,
wheel range, firmware quantisation, terminals and reset manoeuvre as a learner. What differs is
declared: ``needs`` names the information it is given, and a sensing mode that lacks it is refused.
Noise is on distance and bearing, for learners and laws alike; what a law is told beyond that
(heading, speed, turning rate: over the last control period) is exact. Its commands are whole
steps/s, not the learner's few levels: ``quantised_carrot`` is a classical law within the learner's
own tiles and actions.

>>> from workbench.formation.config import ConvoyConfig
>>> CarrotPI(k_bearing=3.0).gains()
(2.0, 0.5, 3.0)
>>> LPsi().check(ConvoyConfig(sensing="truth-relative"))
Traceback (most recent call last):
    ...
ValueError: law 'l-psi' needs the predecessor's heading, speed, turning rate, which sensing =
'truth-relative' does not give (it gives: distance, bearing, odometry); use sensing = 'truth', or
a law that needs less: carrot, pursuit, path

Default gains are our choice: plain values with time constants of a quarter of a second to a second,
not optimised on any study's tracks. Equations: ``formation.steering``.

Contract: laws are immutable configurations; they have no weights and do not learn.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.fields import configuration, integer, real
from workbench.formation import steering
from workbench.formation.config import SENSING, ConvoyConfig
from workbench.formation.policy import Policy

SCHEMA = 1


class ControlLaw:
    """What all laws have in common.

    Attributes:
        name: the law's name on the command line and in files.
        number: the law in ``formation.steering``.
        needs: the information that it is given, words of ``formation.config.SENSING``.
    """

    name: ClassVar[str]
    number: ClassVar[int]
    needs: ClassVar[tuple[str, ...]]

    def gains(self) -> tuple[float, ...]:
        """Return the law's numbers in the order of its fields."""
        return tuple(float(value) for value in fields.to_dict(self).values())

    def check(self, config: ConvoyConfig) -> None:
        """Refuse a configuration whose sensing does not give what the law needs.

        Raises:
            ValueError: what is missing, what there is, and which laws would do.
        """
        given = SENSING[config.sensing]
        missing = [need for need in self.needs if need not in given]
        if missing:
            modes = [mode for mode, gives in SENSING.items() if set(self.needs) <= set(gives)]
            enough = [law.name for law in LAWS.values() if set(law.needs) <= set(given)]
            raise ValueError(
                f"law {self.name!r} needs the predecessor's {', '.join(missing)}, which "
                f"sensing = {config.sensing!r} does not "
                f"give (it gives: {', '.join(given)}); use sensing = "
                f"{' or '.join(map(repr, modes))}, "
                + (
                    f"or a law that needs less: {', '.join(enough)}"
                    if enough
                    else "no law does with less"
                )
            )

    def sha256(self) -> str:
        """Return a hash of the law and its gains."""
        return hashlib.sha256(json.dumps([self.name, fields.to_dict(self)]).encode()).hexdigest()

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the law as plain arrays, for a file."""
        return {
            "law_schema": np.array(SCHEMA),
            "law": np.array(self.name),
            "gains": np.array(json.dumps(fields.to_dict(self))),
        }


@configuration
class CarrotPI(ControlLaw):
    """Drive at the predecessor as at a carrot: PI control of the distance, P control of the
    bearing.
    """

    name: ClassVar[str] = "carrot"
    number: ClassVar[int] = steering.CARROT
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing")

    k_distance: float = real(0.0, 20.0, "1/s", "speed per distance error", default=2.0)
    k_integral: float = real(
        0.0, 20.0, "1/s²", "speed per integral of the distance error", default=0.5
    )
    k_bearing: float = real(0.0, 20.0, "1/s", "turning rate per bearing", default=4.0)


@configuration
class LeaderFrame(ControlLaw):
    """Input-output linearisation of distance and bearing, told the predecessor's heading and
    speed.
    """

    name: ClassVar[str] = "leader-frame"
    number: ClassVar[int] = steering.LEADER_FRAME
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "heading", "speed")

    k_distance: float = real(0.0, 20.0, "1/s", "decay rate of the distance error", default=2.0)
    k_bearing: float = real(0.0, 20.0, "1/s", "decay rate of the bearing", default=4.0)


@configuration
class LPsi(ControlLaw):
    """l-ψ (separation-bearing) control of Desai et al.

    2001 and Das et al. 2002: straight behind the predecessor's heading.
    """

    name: ClassVar[str] = "l-psi"
    number: ClassVar[int] = steering.L_PSI
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "heading", "speed", "turning rate")

    k_length: float = real(0.0, 20.0, "1/s", "decay rate α₁ of the separation error", default=1.0)
    k_angle: float = real(0.0, 20.0, "1/s", "decay rate α₂ of the angle error", default=1.0)
    ahead_m: float = real(
        0.001, 0.2, "m", "distance of the controlled point from the axle", default=0.03
    )

    def check(self, config: ConvoyConfig) -> None:
        """As ``ControlLaw.check``; the controlled point must also lie behind the predecessor."""
        super().check(config)
        if self.ahead_m >= config.middle_m:
            raise ValueError(
                f"LPsi.ahead_m = {self.ahead_m!r}; expected less than the wanted distance d* "
                f"= {config.middle_m:g} m"
            )


@configuration
class PurePursuit(ControlLaw):
    """Pure pursuit of the predecessor's breadcrumbs, in the follower's own odometry; speed by PI
    control of the distance.
    """

    name: ClassVar[str] = "pursuit"
    number: ClassVar[int] = steering.PURSUIT
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "odometry")

    k_distance: float = real(0.0, 20.0, "1/s", "speed per distance error", default=2.0)
    k_integral: float = real(
        0.0, 20.0, "1/s²", "speed per integral of the distance error", default=0.5
    )
    k_bearing: float = real(
        0.0, 20.0, "1/s", "turning rate per bearing, before there are breadcrumbs", default=4.0
    )
    look_ahead: float = real(0.1, 1.0, "of d*", "look-ahead on the breadcrumbs", default=0.6)


@configuration
class PathReconstruction(ControlLaw):
    """Follow the reconstructed path of the predecessor (after Klančar, Matko, Blažič 2009):
    distance, bearing, own odometry.
    """

    name: ClassVar[str] = "path"
    number: ClassVar[int] = steering.PATH
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "odometry")

    k_distance: float = real(
        0.0, 20.0, "1/s", "speed per distance error, before there are breadcrumbs", default=2.0
    )
    k_integral: float = real(
        0.0, 20.0, "1/s²", "speed per integral of it, before there are breadcrumbs", default=0.5
    )
    k_bearing: float = real(
        0.0, 20.0, "1/s", "turning rate per bearing, before there are breadcrumbs", default=4.0
    )
    k_along: float = real(0.0, 20.0, "1/s", "speed per longitudinal error", default=2.0)
    k_across: float = real(
        0.0, 5000.0, "1/m²", "turning rate per speed and lateral error", default=600.0
    )
    k_heading: float = real(0.0, 20.0, "1/s", "turning rate per heading error", default=3.0)
    half_window: int = integer(
        1, 100, "breadcrumbs", "fitted on each side of the reference point", default=8
    )


@configuration
class Outside(ControlLaw):
    """No law: followers do what they are told from outside, period by period
    (``Convoy.command_all``).
    """

    name: ClassVar[str] = "outside"
    number: ClassVar[int] = steering.OUTSIDE
    needs: ClassVar[tuple[str, ...]] = ()


LAWS: dict[str, type[ControlLaw]] = {
    law.name: law for law in (CarrotPI, LeaderFrame, LPsi, PurePursuit, PathReconstruction)
}
Controller = Policy | ControlLaw


def check_controller(policy: object) -> None:
    """Raise TypeError unless something can drive followers, with a hint for the likely mistakes."""
    if isinstance(policy, (Policy, ControlLaw)):
        return
    named = policy if isinstance(policy, str) else getattr(policy, "name", "carrot")
    raise TypeError(
        f"policy = {policy!r}; expected the policy of a run (run.policy), or a law with its "
        f"gains, such as LAWS[{named!r}]()"
    )


def controller_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Controller:
    """Read a policy or a law from what its ``arrays`` wrote.

    Raises:
        ValueError: it is neither, or of another schema.
    """
    if "law" not in arrays:
        return Policy.from_arrays(arrays)
    name = str(arrays["law"])
    if (
        name not in LAWS
        or int(arrays.get("law_schema", np.array(-1))) != SCHEMA
        or "gains" not in arrays
    ):
        raise ValueError(
            f"not a control law of schema {SCHEMA}: {name!r}; expected one of {', '.join(LAWS)}"
        )
    return fields.from_dict(LAWS[name], json.loads(str(arrays["gains"])))


def quantised_carrot(
    config: ConvoyConfig, *, k_distance: float = 2.0, k_bearing: float = 4.0
) -> Policy:
    """Return the carrot law as a table on a configuration's own tiles and actions.

    In the middle of every tile it takes the action whose wheel speeds are nearest to v = v_leader +
    k_d e_d, ω = k_φ φ. A table has no integral: the leader's constant speed is given instead. With
    several tilings: nearest to the mean of all active tiles.

    Args:
        config: tiles, levels and the leader's speed.
        k_distance, k_bearing: gains, 1/s.
    """
    left, right = (levels.astype(float) for levels in config.levels())
    rows = np.array(
        [grid.centre(cell) for grid in config.grids() for cell in range(grid.n)]
    )  # (rows, 2): e_d in m, φ in rad
    v, omega = config.leader_speed_mps + k_distance * rows[:, 0], k_bearing * rows[:, 1]
    wanted = (
        np.stack(
            [v - omega * config.robot.track_m / 2, v + omega * config.robot.track_m / 2], axis=1
        )
        / config.robot.step_m
    )
    gap = (wanted[:, 0, None, None] - left[:, None]) ** 2 + (
        wanted[:, 1, None, None] - right[None, :]
    ) ** 2
    return Policy.of(config, -gap.reshape(1, config.rows, config.actions))
