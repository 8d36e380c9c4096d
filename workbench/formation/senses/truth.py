"""What a follower is told by the simulator: the two error measures of the paper (section II-A,
Fig. 1), from the poses of a follower and its predecessor, with white noise where asked for.

* distance error e_d = d - d*, where d is the distance between the robots' centres and d* the middle
  of [d_min, d_max];
* angular error o_err: the bearing of the predecessor in the follower's frame, positive to the left.

Both together place the follower behind its predecessor. Beyond [d_min, d_max) or ±limit the leader
is lost: a terminal.

>>> distance, bearing = observe(0.0, 0.0, 1.0, 0.0, 0.1, 0.1)
>>> round(distance, 4), round(math.degrees(bearing), 1)
(0.1414, 45.0)
"""

import math
from typing import Any

from workbench.compiled import compiled
from workbench.formation.angles import wrap


@compiled
def observe(
    x: float, y: float, c: float, s: float, ahead_x: float, ahead_y: float
) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the point ahead, seen from x, y with heading
    cosine c and sine s.
    """
    dx, dy = ahead_x - x, ahead_y - y
    return math.sqrt(dx * dx + dy * dy), math.atan2(c * dy - s * dx, c * dx + s * dy)


@compiled
def see(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write where the predecessor of follower i truly is, with noise."""
    ahead = robots[robots[i].ahead].pose
    tell(task, robots[i], ahead.x, ahead.y, chance)


@compiled
def tell(task: Any, robot: Any, x: float, y: float, chance: Any) -> None:
    """Write where a point is, seen by a robot, with noise."""
    if robot.seen.silent:
        return
    pose = robot.pose
    distance, bearing = observe(pose.x, pose.y, pose.cos, pose.sin, x, y)
    if task.noise.any:
        distance = abs(distance + task.noise.distance * chance.noise[0])
        bearing = wrap(bearing + task.noise.bearing * chance.noise[1])
    robot.seen.distance = distance
    robot.seen.bearing = bearing
