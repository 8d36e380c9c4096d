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

import numpy as np

from workbench.compiled import compiled

TRACK = np.dtype(  # pose in m, its motion, the pose when last found, periods since, whether any
    [
        ("x", "f8"),
        ("y", "f8"),
        ("cos", "f8"),
        ("sin", "f8"),
        ("speed", "f8"),
        ("turn", "f8"),
        ("found_x", "f8"),
        ("found_y", "f8"),
        ("found_cos", "f8"),
        ("found_sin", "f8"),
        ("missed", "i8"),
        ("tracked", "i8"),
    ]
)

LONGEST_GAP = 5  # control periods


@compiled
def follow_marker(track: Any, found: bool, x: float, y: float, heading: float, dt: float) -> None:
    """Advance a robot's track by one control period of dt s, with its marker found at x, y (m),
    heading (rad), or not.
    """
    if found:
        c, s = math.cos(heading), math.sin(heading)
        track.speed = track.turn = 0.0
        if track.tracked:
            span = dt * (track.missed + 1)
            turned = math.atan2(
                s * track.found_cos - c * track.found_sin, c * track.found_cos + s * track.found_sin
            )
            middle = heading - turned / 2
            track.speed = (
                (x - track.found_x) * math.cos(middle) + (y - track.found_y) * math.sin(middle)
            ) / span
            track.turn = turned / span
        track.found_x = x
        track.found_y = y
        track.found_cos = c
        track.found_sin = s
        track.x = x
        track.y = y
        track.cos = c
        track.sin = s
        track.missed = 0
        track.tracked = 1
        return
    track.missed += 1
    if track.missed > LONGEST_GAP:
        track.tracked = 0
        return
    heading = math.atan2(track.sin, track.cos)
    turned = track.turn * dt
    track.x += track.speed * math.cos(heading + turned / 2) * dt  # along the arc's chord
    track.y += track.speed * math.sin(heading + turned / 2) * dt
    track.cos = math.cos(heading + turned)
    track.sin = math.sin(heading + turned)


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
