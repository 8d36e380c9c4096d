"""The tracker: keeps every robot's pose from picture to picture, and fills short gaps with its
motion.

A found marker is believed as it is. Between two findings a robot's forward speed and turning rate
follow; while its marker is missing it is moved on with them, for half a second at most, and the
pose is marked as predicted (``missed`` > 0). After that it is nowhere until it is found again.

Contract: compiled; writes the robot's record: ``mx, my, mc, ms`` the pose, ``mv, mw`` its motion,
``missed`` pictures since it was found, ``tracked`` whether there is a pose at all.
"""

import math
from typing import Any

from workbench.compiled import compiled

LONGEST_GAP = 5  # control periods


@compiled
def track(robot: Any, found: bool, x: float, y: float, heading: float, dt: float) -> None:
    """Advance a robot's track by one control period of dt s, with its marker found at x, y (m),
    heading (rad), or not.
    """
    if found:
        c, s = math.cos(heading), math.sin(heading)
        robot.mv = robot.mw = 0.0
        if robot.tracked:
            span = dt * (robot.missed + 1)
            turned = math.atan2(s * robot.sc - c * robot.ss, c * robot.sc + s * robot.ss)
            middle = heading - turned / 2
            robot.mv = (
                (x - robot.sx) * math.cos(middle) + (y - robot.sy) * math.sin(middle)
            ) / span
            robot.mw = turned / span
        robot.sx = x
        robot.sy = y
        robot.sc = c
        robot.ss = s
        robot.mx = x
        robot.my = y
        robot.mc = c
        robot.ms = s
        robot.missed = 0
        robot.tracked = 1
        return
    robot.missed += 1
    if robot.missed > LONGEST_GAP:
        robot.tracked = 0
        return
    heading = math.atan2(robot.ms, robot.mc)
    turned = robot.mw * dt
    robot.mx += robot.mv * math.cos(heading + turned / 2) * dt  # along the arc's chord
    robot.my += robot.mv * math.sin(heading + turned / 2) * dt
    robot.mc = math.cos(heading + turned)
    robot.ms = math.sin(heading + turned)


@compiled
def bias_at(table: Any, view: Any, x: float, y: float) -> tuple[float, float, float]:
    """Return the bilinear x, y, heading of a bias table (3, n, n) over view = x0, x1, y0, y1."""
    n = table.shape[1]
    a = min(max((y - view[2]) / (view[3] - view[2]), 0.0), 1.0) * (n - 1)
    b = min(max((x - view[0]) / (view[1] - view[0]), 0.0), 1.0) * (n - 1)
    i, j = min(int(a), n - 2), min(int(b), n - 2)
    p, q = a - i, b - j
    w00 = (1 - p) * (1 - q)
    w01 = (1 - p) * q
    w10 = p * (1 - q)
    w11 = p * q
    dx: float = (
        w00 * table[0, i, j]
        + w01 * table[0, i, j + 1]
        + w10 * table[0, i + 1, j]
        + w11 * table[0, i + 1, j + 1]
    )
    dy: float = (
        w00 * table[1, i, j]
        + w01 * table[1, i, j + 1]
        + w10 * table[1, i + 1, j]
        + w11 * table[1, i + 1, j + 1]
    )
    turn: float = (
        w00 * table[2, i, j]
        + w01 * table[2, i, j + 1]
        + w10 * table[2, i + 1, j]
        + w11 * table[2, i + 1, j + 1]
    )
    return dx, dy, turn
