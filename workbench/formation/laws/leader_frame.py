"""Input-output linearisation of (d, φ), with β = θ1 - θ2 - φ:

v = (k_d e_d + v1 cos β) / cos φ, ω = k_φ φ + (v sin φ + v1 sin β) / d
"""

import math
from typing import Any, ClassVar

from workbench.compiled import compiled
from workbench.fields import configuration, real
from workbench.formation.laws.law import ControlLaw


@compiled
def leader_frame(
    distance: float,
    bearing: float,
    heading: float,
    v1: float,
    error: float,
    k_distance: float,
    k_bearing: float,
) -> tuple[float, float]:
    """Return (v, ω) that make d and φ decay exponentially; singular at |φ| = 90°.

    ``heading`` is θ1 - θ2.
    """
    beta = heading - bearing
    v = (k_distance * error + v1 * math.cos(beta)) / max(math.cos(bearing), 0.05)
    return v, k_bearing * bearing + (v * math.sin(bearing) + v1 * math.sin(beta)) / distance


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω): see ``leader_frame``."""
    law = follower.law
    gain = task.law.gain
    error = distance - task.bounds.middle
    return leader_frame(
        distance, bearing, law.ahead_heading, law.ahead_speed, error, gain[0], gain[1]
    )


@configuration
class LeaderFrame(ControlLaw):
    """Input-output linearisation of distance and bearing, told the predecessor's heading and
    speed.
    """

    name: ClassVar[str] = "leader-frame"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "heading", "speed")
    steer: ClassVar[Any] = staticmethod(steer)

    k_distance: float = real(0.0, 20.0, "1/s", "decay rate of the distance error", default=2.0)
    k_bearing: float = real(0.0, 20.0, "1/s", "decay rate of the bearing", default=4.0)
