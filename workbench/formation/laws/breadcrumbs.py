"""Breadcrumbs: places of the predecessor in the follower's own odometry (its commanded, quantised
wheel speeds), one per control period, the last 25.6 s of them.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.motors import wheel_speed

KEPT = 256

BREADCRUMBS = np.dtype(  # own odometry, m and rad; how many were dropped; the last ones, m
    [
        ("x", "f8"),
        ("y", "f8"),
        ("heading", "f8"),
        ("count", "i8"),
        ("trail", "f8", (KEPT, 2)),
    ]
)


@compiled
def drop(task: Any, follower: Any, distance: float, bearing: float) -> None:
    """Move the odometry by the last command and note where the predecessor is in it."""
    law = follower.law
    way = law.way
    if way.count > 0:
        motors = task.motors
        left = wheel_speed(law.left, motors.most, motors.ticks) * motors.step_m
        right = wheel_speed(law.right, motors.most, motors.ticks) * motors.step_m
        v = (left + right) / 2
        turn = (right - left) / task.motors.track_m * CONTROL_PERIOD
        middle = way.heading + turn / 2
        way.x += v * CONTROL_PERIOD * math.cos(middle)
        way.y += v * CONTROL_PERIOD * math.sin(middle)
        way.heading += turn
    crumb = way.trail[way.count % KEPT]
    crumb[0] = way.x + distance * math.cos(way.heading + bearing)
    crumb[1] = way.y + distance * math.sin(way.heading + bearing)
    way.count += 1
