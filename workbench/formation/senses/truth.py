"""The two error measures of the paper (section II-A, Fig. 1), from the poses of a follower and its
predecessor.

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

from workbench.compiled import compiled


@compiled
def observe(
    x: float, y: float, c: float, s: float, ahead_x: float, ahead_y: float
) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the point ahead, seen from x, y with heading
    cosine c and sine s.
    """
    dx, dy = ahead_x - x, ahead_y - y
    return math.sqrt(dx * dx + dy * dy), math.atan2(c * dy - s * dx, c * dx + s * dy)
