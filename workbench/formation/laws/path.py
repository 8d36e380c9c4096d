"""Path reconstruction (after Klančar, Matko, Blažič 2009): a parabola in time, fitted by least
squares to the breadcrumbs around the point d* behind the predecessor, gives reference, feed-forward
and curvature; state feedback of the longitudinal, lateral and heading error.
"""

import math
from typing import Any, ClassVar

from workbench.compiled import compiled
from workbench.fields import configuration, integer, real
from workbench.formation.angles import wrap
from workbench.formation.laws.breadcrumbs import KEPT, drop
from workbench.formation.laws.law import ControlLaw, pace
from workbench.robot.geometry import CONTROL_PERIOD


@compiled
def _follow_path(way: Any, middle: float, gain: Any) -> tuple[bool, float, float]:
    """Return (found, v, ω) from the reconstructed path; not found while the breadcrumbs do not
    reach d* back.
    """
    trail = way.trail
    newest = way.count - 1
    oldest = max(0, way.count - KEPT)
    x, y = trail[newest % KEPT, 0], trail[newest % KEPT, 1]
    place = newest
    nearer = 0.0
    while place >= oldest:
        gap = math.hypot(trail[place % KEPT, 0] - x, trail[place % KEPT, 1] - y)
        if gap >= middle:
            break
        nearer = gap
        place -= 1
    half = int(gain[6])
    if place < oldest + 1 or newest - oldest < 2:
        return False, 0.0, 0.0
    part = (gap - middle) / (gap - nearer)  # between this breadcrumb and the next one
    first, last = max(oldest, place - half), min(newest, place + half)
    rx, vx, ax = _parabola(trail, 0, first, last, place, part)
    ry, vy, ay = _parabola(trail, 1, first, last, place, part)
    speed = math.hypot(vx, vy)
    if speed < 1e-6:
        return False, 0.0, 0.0
    c, s = math.cos(way.heading), math.sin(way.heading)
    dx, dy = rx - way.x, ry - way.y
    along = c * dx + s * dy
    across = c * dy - s * dx
    heading = wrap(math.atan2(vy, vx) - way.heading)
    turn = (vx * ay - vy * ax) / (speed * speed)
    slope = math.sin(heading) / heading if abs(heading) > 1e-9 else 1.0
    v = speed * math.cos(heading) + gain[3] * along
    return True, v, turn + gain[4] * speed * slope * across + gain[5] * heading


@compiled
def _parabola(
    trail: Any, axis: int, first: int, last: int, place: int, part: float
) -> tuple[float, float, float]:
    """Return value, velocity and acceleration (per s) at place + part of a least-squares parabola
    through breadcrumbs.
    """
    n = last - first + 1
    centre = (n - 1) / 2.0  # times around the middle of the window: odd moments vanish
    s2 = s4 = b0 = b1 = b2 = 0.0
    for k in range(n):
        t = k - centre
        y = trail[(first + k) % KEPT, axis]
        s2 += t * t
        s4 += t * t * t * t
        b0 += y
        b1 += t * y
        b2 += t * t * y
    curve = (n * b2 - s2 * b0) / (n * s4 - s2 * s2) if n > 2 else 0.0
    slope = b1 / s2
    level = (b0 - curve * s2) / n
    t = place + part - first - centre
    value = level + slope * t + curve * t * t
    return value, (slope + 2.0 * curve * t) / CONTROL_PERIOD, 2.0 * curve / CONTROL_PERIOD**2


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω): on the reconstructed path, or the carrot's while there is none."""
    drop(task, follower, distance, bearing)
    v = pace(task, follower, distance - task.bounds.middle)
    found, v_path, omega_path = _follow_path(follower.law.way, task.bounds.middle, task.law.gain)
    if found:
        return v_path, omega_path
    return v, task.law.gain[2] * bearing


@configuration
class PathReconstruction(ControlLaw):
    """Follow the reconstructed path of the predecessor: distance, bearing, own odometry."""

    name: ClassVar[str] = "path"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing", "odometry")
    steer: ClassVar[Any] = staticmethod(steer)

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
