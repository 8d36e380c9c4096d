"""The reset manoeuvre (paper II-C): a follower that lost its leader finds back by itself, without
learning.

"The follower then turns towards the leader and moves forward at maximum speed until it reaches its
optimal working range again and can restart learning in a new episode." As a state machine, in
phases:

    FOLLOW ──terminal──▶ BACK_OFF  too near: straight away from it, backwards where it is in front
                     └─▶ TURN      on the spot until |bearing| < 10°
                           └─▶ APPROACH  straight on at full speed; back to TURN beyond 20°
    BACK_OFF, TURN, APPROACH ──|e_d| within a third of the half range, bearing inside its bounds──▶
    FOLLOW
    any of them ──5 s, or out of sight──▶ SEARCH  turn on the spot, up to one turn, until it is in
                                                  sight, then start again
    SEARCH ──no sight──▶ LOST    stand still; start again when the predecessor is in sight

With sensing "truth" the predecessor is known anywhere, as with the paper's camera; ``sight_m``
bounds it. A robot that has nothing but its own infrared sees 15 cm far. It then searches where it
saw its predecessor last: it turns there, drives on at full speed for half a second or more, then
more slowly while it swings its nose by 30° to both sides, and after six seconds gives up (our
choice: the paper says nothing). One search never turns far enough to look back at the robot behind;
several can, and infrared cannot tell who is in front.

Contract: ``manoeuvre`` reads and writes one follower's record; counts are in control periods.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.robot.description import EPUCK, RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD

RESET = np.dtype([("phase", "i8"), ("timer", "i8")])  # timer in control periods
SEARCHING = np.dtype(
    [
        ("speed", "i8"),  # steps/s
        ("periods", "i8"),  # control periods before it gives up
        ("deadbeat", "f8"),  # steps/s per rad
        ("haste", "f8"),  # share of a bearing
        ("short_sighted", "i8"),
    ]
)

FOLLOW, BACK_OFF, TURN, APPROACH, SEARCH, LOST = range(6)
PHASES = ("follow", "back off", "turn", "approach", "search", "lost")

TOLERANCE = math.radians(10)  # bearing at which turning is done
TIME_OUT = round(5.0 / CONTROL_PERIOD)  # control periods
SEARCH_SPEED = 300  # steps/s of each wheel of an e-puck, opposed: 1.46 rad/s
DRIVE_ON_PERIODS = round(6.0 / CONTROL_PERIOD)
# steps/s, steps/s (of an e-puck), control periods
_DRIVE_ON = 650
_SWING = 350
_HALF_SWING = 6


def search_numbers(robot: RobotConfig) -> dict[str, float]:
    """Return how a robot searches, as fields of SEARCHING: steps/s, control periods of one turn,
    steps/s per rad.

    With ``deadbeat`` it turns by a bearing in one control period.
    """
    speed = round(SEARCH_SPEED * robot.most_steps / EPUCK.most_steps)
    turn = 2 * speed * robot.step_m / robot.track_m
    return {
        "speed": speed,
        "periods": math.ceil(2 * math.pi / turn / CONTROL_PERIOD),
        "deadbeat": robot.track_m / 2 / CONTROL_PERIOD / robot.step_m,
    }


@compiled
def begin_reset(follower: Any, distance: float, near: float) -> None:
    """Enter the manoeuvre at a terminal."""
    follower.reset.phase = BACK_OFF if distance < near else TURN
    follower.reset.timer = 0


@compiled
def manoeuvre(task: Any, follower: Any, distance: float, bearing: float) -> tuple[int, int]:
    """Advance the state machine by one control period and return the wheel commands in steps/s.

    Args:
        task: TASK record: ``bounds``; ``search.short_sighted`` where the robot cannot find its
            predecessor by turning round, see ``drive_on``; ``search.haste``, what share of a
            bearing it turns away per control period: 1, less where its commands are known to come
            late; ``motors``.
        follower: ROBOT record, whose ``reset`` is updated; phase FOLLOW means: start a new episode
            now.
        distance, bearing: of the predecessor, m and rad.
    """
    half_range = task.bounds.half_range
    most = task.motors.most
    search = task.search.speed
    seen = distance <= task.bounds.sight
    error = distance - task.bounds.middle
    follower.reset.timer += 1
    if follower.reset.phase == LOST or follower.reset.phase == SEARCH:
        if seen:
            begin_reset(follower, distance, task.bounds.middle - half_range / 3)
        elif follower.reset.phase == LOST or follower.reset.timer > task.search.periods:
            follower.reset.phase = LOST
            return 0, 0
        elif task.search.short_sighted:
            return drive_on(task, follower.reset.timer, bearing)
        else:
            return -search, search
    if abs(error) < half_range / 3 and abs(bearing) < task.bounds.bearing:
        follower.reset.phase = FOLLOW
        return 0, 0
    if not seen or follower.reset.timer > TIME_OUT:
        follower.reset.phase = SEARCH
        follower.reset.timer = 0
        if task.search.short_sighted:
            return drive_on(task, 0, bearing)
        return -search, search
    away = -most if abs(bearing) < math.pi / 2 else most
    if follower.reset.phase == BACK_OFF and error < 0:
        return away, away
    if follower.reset.phase == APPROACH and abs(bearing) < 2 * TOLERANCE and error > 0:
        return most, most
    if abs(bearing) >= TOLERANCE:
        follower.reset.phase = TURN
        return _turn_to(task, bearing)
    if error > 0:
        follower.reset.phase = APPROACH
        return most, most
    follower.reset.phase = BACK_OFF
    return away, away


@compiled
def _turn_to(task: Any, bearing: float) -> tuple[int, int]:
    turn = int(
        max(
            -task.motors.most,
            min(task.motors.most, round(bearing * task.search.haste * task.search.deadbeat)),
        )
    )
    return -turn, turn


@compiled
def drive_on(task: Any, timer: int, sought: float) -> tuple[int, int]:
    """Return commands of the search with own senses: to where the predecessor was seen last, then
    on, swinging.
    """
    if timer < _HALF_SWING and abs(sought) >= TOLERANCE:
        return _turn_to(task, sought)
    if timer < 2 * _HALF_SWING:
        return task.motors.most, task.motors.most
    swing = _SWING if (timer + _HALF_SWING // 2) // _HALF_SWING % 2 else -_SWING
    return _DRIVE_ON - swing, _DRIVE_ON + swing
