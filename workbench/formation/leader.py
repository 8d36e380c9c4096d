"""The leader: a static line follower that knows nothing but its three ground sensors (requirement M2, N6).

It drives at constant speed and steers in proportion to the difference of the calibrated darkness under its left and right
sensor. When no sensor sees the line any more it turns, at the same forward speed, to the side where it saw it last.

Contract: ``follow_line`` reads and writes the leader's record (its ``memory``: -1 line last seen right, +1 left).
"""

from typing import Any

from workbench.compiled import compiled
from workbench.robot.ground import darkness

GAIN = 170.0  # steps/s of each wheel per unit of darkness difference; our choice
LOST_TURN = 250.0  # steps/s of each wheel while no sensor sees the line
VISIBLE = 0.1  # darkness above which a sensor sees the line


@compiled
def follow_line(leader: Any, left: float, centre: float, right: float, speed: float) -> tuple[int, int]:
    """Return wheel commands in whole steps/s for three ground readings in counts and a forward speed in steps/s."""
    dark_left, dark_centre, dark_right = darkness(left, 0), darkness(centre, 1), darkness(right, 2)
    side = dark_left - dark_right
    if max(dark_left, dark_centre, dark_right) < VISIBLE:
        steer = LOST_TURN * leader.memory
    else:
        steer = GAIN * side
        if abs(side) > VISIBLE:
            leader.memory = 1.0 if side > 0 else -1.0
    return int(round(speed - steer)), int(round(speed + steer))
