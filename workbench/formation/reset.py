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

from workbench.compiled import compiled
from workbench.robot.description import EPUCK, RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD

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
    """Return how a robot searches, as fields of TASK: steps/s, control periods of one turn, steps/s
    per rad.

    With ``deadbeat`` it turns by a bearing in one control period.
    """
    speed = round(SEARCH_SPEED * robot.most_steps / EPUCK.most_steps)
    turn = 2 * speed * robot.step_m / robot.track_m
    return {
        "search_speed": speed,
        "search_periods": math.ceil(2 * math.pi / turn / CONTROL_PERIOD),
        "deadbeat": robot.track_m / 2 / CONTROL_PERIOD / robot.step_m,
    }


@compiled
def begin_reset(follower: Any, distance: float, near: float) -> None:
    """Enter the manoeuvre at a terminal."""
    follower.phase = BACK_OFF if distance < near else TURN
    follower.timer = 0


@compiled
def manoeuvre(task: Any, follower: Any, distance: float, bearing: float) -> tuple[int, int]:
    """Advance the state machine by one control period and return the wheel commands in steps/s.

    Args:
        task: TASK record: d* ``middle`` and ``half_range`` in m, terminal bearing ``limit`` in rad,
            ``sight`` in m; ``infrared`` where the robot has only its own senses to search with, see
            ``drive_on``; ``haste``, what share of a bearing it turns
            away per control period: 1, less where its commands are known to come late; and what the
                robot is.
        follower: record with ``phase`` and ``timer``, which are updated; phase FOLLOW means: start
            a new episode now.
        distance, bearing: of the predecessor, m and rad.
    """
    half_range = task.half_range
    most = task.most
    search = task.search_speed
    seen = distance <= task.sight
    error = distance - task.middle
    follower.timer += 1
    if follower.phase == LOST or follower.phase == SEARCH:
        if seen:
            begin_reset(follower, distance, task.middle - half_range / 3)
        elif follower.phase == LOST or follower.timer > (
            DRIVE_ON_PERIODS if task.infrared else task.search_periods
        ):
            follower.phase = LOST
            return 0, 0
        elif task.infrared:
            return drive_on(task, follower.timer, bearing)
        else:
            return -search, search
    if abs(error) < half_range / 3 and abs(bearing) < task.limit:
        follower.phase = FOLLOW
        return 0, 0
    if not seen or follower.timer > TIME_OUT:
        follower.phase = SEARCH
        follower.timer = 0
        if task.infrared:
            return drive_on(task, 0, bearing)
        return -search, search
    away = -most if abs(bearing) < math.pi / 2 else most
    if follower.phase == BACK_OFF and error < 0:
        return away, away
    if follower.phase == APPROACH and abs(bearing) < 2 * TOLERANCE and error > 0:
        return most, most
    if abs(bearing) >= TOLERANCE:
        follower.phase = TURN
        return _turn_to(task, bearing)
    if error > 0:
        follower.phase = APPROACH
        return most, most
    follower.phase = BACK_OFF
    return away, away


@compiled
def _turn_to(task: Any, bearing: float) -> tuple[int, int]:
    turn = int(max(-task.most, min(task.most, round(bearing * task.haste * task.deadbeat))))
    return -turn, turn


@compiled
def drive_on(task: Any, timer: int, sought: float) -> tuple[int, int]:
    """Return commands of the search with own senses: to where the predecessor was seen last, then
    on, swinging.
    """
    if timer < _HALF_SWING and abs(sought) >= TOLERANCE:
        return _turn_to(task, sought)
    if timer < 2 * _HALF_SWING:
        return task.most, task.most
    swing = _SWING if (timer + _HALF_SWING // 2) // _HALF_SWING % 2 else -_SWING
    return _DRIVE_ON - swing, _DRIVE_ON + swing
