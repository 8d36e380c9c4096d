"""Pure pursuit of the predecessor's breadcrumbs. While they do not reach back far enough (a young
episode, a very slow predecessor), the follower steers at the predecessor.
"""

import math
from typing import Any, ClassVar

from workbench.compiled import compiled
from workbench.fields import configuration, real
from workbench.formation.laws.breadcrumbs import KEPT, drop
from workbench.formation.laws.law import ControlLaw, pace


@compiled
def pursuit_turn(x: float, y: float, v: float) -> float:
    """Return ω of the arc through a target at x, y (m) in the robot's frame: v κ with κ = 2 sin α /
    L = 2 y / L².
    """
    return v * 2.0 * y / (x * x + y * y)


@compiled
def _pursue(way: Any, distance: float, bearing: float, look_ahead: float, v: float) -> float:
    """Return ω towards the newest breadcrumb within the look-ahead, or towards the predecessor if
    there is none yet.
    """
    c, s = math.cos(way.heading), math.sin(way.heading)
    for k in range(way.count - 1, max(0, way.count - KEPT) - 1, -1):
        dx = way.trail[k % KEPT, 0] - way.x
        dy = way.trail[k % KEPT, 1] - way.y
        if dx * dx + dy * dy <= look_ahead * look_ahead:
            return pursuit_turn(c * dx + s * dy, c * dy - s * dx, v)
    return pursuit_turn(distance * math.cos(bearing), distance * math.sin(bearing), v)


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω): v as the carrot's, ω = v 2 sin α / L to a breadcrumb at a look-ahead L."""
    drop(task, follower, distance, bearing)
    v = pace(task, follower, distance - task.bounds.middle)
    look_ahead = task.law.gain[3] * task.bounds.middle
    return v, _pursue(follower.law.way, distance, bearing, look_ahead, v)


@configuration
class PurePursuit(ControlLaw):
    """Pure pursuit of the predecessor's breadcrumbs, in the follower's own odometry; speed by PI
    control of the distance.
    """

    name: ClassVar[str] = "pursuit"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "odometry")
    steer: ClassVar[Any] = staticmethod(steer)

    k_distance: float = real(0.0, 20.0, "1/s", "speed per distance error", default=2.0)
    k_integral: float = real(
        0.0, 20.0, "1/s²", "speed per integral of the distance error", default=0.5
    )
    k_bearing: float = real(
        0.0, 20.0, "1/s", "turning rate per bearing, before there are breadcrumbs", default=4.0
    )
    look_ahead: float = real(0.1, 1.0, "of d*", "look-ahead on the breadcrumbs", default=0.6)
