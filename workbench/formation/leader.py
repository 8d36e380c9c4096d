"""The leader: a static line follower that knows nothing but its three ground sensors (requirement
M2, N6).

It drives at constant speed and steers in proportion to the difference of the calibrated darkness
under its left and right sensor. When no sensor sees the line any more it turns, at the same forward
speed, to the side where it saw it last; after two seconds without a line it stops, and drives on
when it sees one. What is white and black is the leader's own knowledge (``knows_white``,
``knows_black`` of its record), right only if it has calibrated on its own sensors.

Contract: ``follow_line`` reads and writes the leader's record: ``ground.line_side`` -1
line last seen right, +1 left; ``reset.timer`` control periods without a line.
"""

from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.ground import darkness

GROUND = np.dtype(  # readings on white and black, and what the robot takes them for; line last seen
    [
        ("white", "f8", (3,)),
        ("black", "f8", (3,)),
        ("knows_white", "f8", (3,)),
        ("knows_black", "f8", (3,)),
        ("line_side", "f8"),
    ]
)
LEADER = np.dtype(  # steps/s; fastest command against an e-puck's; the floor's origin; sensors in m
    [
        ("speed", "f8"),
        ("vigour", "f8"),
        ("column0", "i8"),
        ("row0", "i8"),
        ("ground_x", "f8"),
        ("ground_y", "f8", (3,)),
    ]
)

GAIN = 170.0  # steps/s of each wheel per unit of darkness difference, of an e-puck; our choice
LOST_TURN = 250.0  # steps/s of each wheel while no sensor sees the line, of an e-puck
GONE = round(2.0 / CONTROL_PERIOD)  # control periods
VISIBLE = 0.1  # darkness above which a sensor sees the line


@compiled
def follow_line(
    leader: Any, left: float, centre: float, right: float, speed: float, vigour: float
) -> tuple[int, int]:
    """Return wheel commands in whole steps/s for three ground readings in counts and a forward
    speed in steps/s.

    ``vigour`` is the robot's fastest command against an e-puck's: turns are made with the same
    share of it.
    """
    white = leader.ground.knows_white
    black = leader.ground.knows_black
    dark_left, dark_right = darkness(left, white[0], black[0]), darkness(right, white[2], black[2])
    dark_centre = darkness(centre, white[1], black[1])
    side = dark_left - dark_right
    if max(dark_left, dark_centre, dark_right) < VISIBLE:
        leader.reset.timer += 1
        if leader.reset.timer > GONE:
            return 0, 0
        steer = vigour * LOST_TURN * leader.ground.line_side
    else:
        leader.reset.timer = 0
        steer = vigour * GAIN * side
        if abs(side) > VISIBLE:
            leader.ground.line_side = 1.0 if side > 0 else -1.0
    return int(round(speed - steer)), int(round(speed + steer))
