"""The reset manoeuvre (paper II-C): a follower that lost its leader finds back by itself, without learning.

"The follower then turns towards the leader and moves forward at maximum speed until it reaches its optimal working range
again and can restart learning in a new episode." As a state machine, in phases:

    FOLLOW ──terminal──▶ BACK_OFF  too near: straight away from it, backwards where it is in front
                     └─▶ TURN      on the spot until |bearing| < 10°
                           └─▶ APPROACH  straight on at full speed; back to TURN beyond 20°
    BACK_OFF, TURN, APPROACH ──|e_d| within a third of the half range, bearing inside its bounds──▶ FOLLOW
    any of them ──5 s, or out of sight──▶ SEARCH  turn on the spot, up to one turn, until it is in sight, then start again
    SEARCH ──no sight──▶ LOST    stand still; start again when the predecessor is in sight

With sensing "truth" the predecessor is known anywhere, as with the paper's camera; ``sight_m`` bounds it. A robot that has
nothing but its own infrared sees 15 cm far. It then searches where it saw its predecessor last: it turns there, drives on at
full speed for half a second or more, then more slowly while it swings its nose by 30° to both sides, and after six seconds gives
up (our choice: the paper says nothing). One search never turns far enough to look back at the robot behind; several can, and
infrared cannot tell who is in front.

Contract: ``manoeuvre`` reads and writes one follower's record; counts are in control periods.
"""

import math
from typing import Any

from workbench.compiled import compiled
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK
from workbench.robot.motors import MAX_STEPS

FOLLOW, BACK_OFF, TURN, APPROACH, SEARCH, LOST = range(6)
PHASES = ("follow", "back off", "turn", "approach", "search", "lost")

TOLERANCE = math.radians(10)  # bearing at which turning is done
TIME_OUT = round(5.0 / CONTROL_PERIOD)  # control periods
SEARCH_SPEED = 300  # steps/s of each wheel, opposed: 1.46 rad/s
SEARCH_PERIODS = math.ceil(2 * math.pi / (2 * SEARCH_SPEED * STEP / TRACK) / CONTROL_PERIOD)
DRIVE_ON_PERIODS = round(6.0 / CONTROL_PERIOD)
_DRIVE_ON, _SWING, _HALF_SWING = 650, 350, 6  # steps/s, steps/s, control periods
_DEADBEAT = TRACK / 2 / CONTROL_PERIOD / STEP  # steps/s per rad: turns by a bearing in one control period


@compiled
def begin_reset(follower: Any, distance: float, near: float) -> None:
    """Enter the manoeuvre at a terminal."""
    follower.phase = BACK_OFF if distance < near else TURN
    follower.timer = 0


@compiled
def manoeuvre(
    follower: Any, distance: float, bearing: float, middle: float, half_range: float, limit: float, sight: float,
    own_senses: int, haste: float,
) -> tuple[int, int]:  # fmt: skip
    """Advance the state machine by one control period and return the wheel commands in steps/s.

    Args:
        follower: record with ``phase`` and ``timer``, which are updated; phase FOLLOW means: start a new episode now.
        distance, bearing: of the predecessor, m and rad.
        middle, half_range: d* and (d_max - d_min) / 2 in m.
        limit: terminal bearing in rad.
        sight: distance in m beyond which the predecessor is out of sight.
        own_senses: 1 where the robot has only its own infrared to search with, see ``drive_on``.
        haste: what share of a bearing it turns away per control period: 1, less where its commands are known to come late.
    """
    seen = distance <= sight
    error = distance - middle
    follower.timer += 1
    if follower.phase == LOST or follower.phase == SEARCH:
        if seen:
            begin_reset(follower, distance, middle - half_range / 3)
        elif follower.phase == LOST or follower.timer > (DRIVE_ON_PERIODS if own_senses else SEARCH_PERIODS):
            follower.phase = LOST
            return 0, 0
        elif own_senses:
            return drive_on(follower.timer, bearing, haste)
        else:
            return -SEARCH_SPEED, SEARCH_SPEED
    if abs(error) < half_range / 3 and abs(bearing) < limit:
        follower.phase = FOLLOW
        return 0, 0
    if not seen or follower.timer > TIME_OUT:
        follower.phase = SEARCH
        follower.timer = 0
        if own_senses:
            return drive_on(0, bearing, haste)
        return -SEARCH_SPEED, SEARCH_SPEED
    away = -MAX_STEPS if abs(bearing) < math.pi / 2 else MAX_STEPS
    if follower.phase == BACK_OFF and error < 0:
        return away, away
    if follower.phase == APPROACH and abs(bearing) < 2 * TOLERANCE and error > 0:
        return MAX_STEPS, MAX_STEPS
    if abs(bearing) >= TOLERANCE:
        follower.phase = TURN
        return _turn_to(bearing * haste)
    if error > 0:
        follower.phase = APPROACH
        return MAX_STEPS, MAX_STEPS
    follower.phase = BACK_OFF
    return away, away


@compiled
def _turn_to(bearing: float) -> tuple[int, int]:
    turn = int(max(-MAX_STEPS, min(MAX_STEPS, round(bearing * _DEADBEAT))))
    return -turn, turn


@compiled
def drive_on(timer: int, sought: float, haste: float) -> tuple[int, int]:
    """Return commands of the search with own senses: to where the predecessor was seen last, then on, swinging."""
    if timer < _HALF_SWING and abs(sought) >= TOLERANCE:
        return _turn_to(sought * haste)
    if timer < 2 * _HALF_SWING:
        return MAX_STEPS, MAX_STEPS
    swing = _SWING if (timer + _HALF_SWING // 2) // _HALF_SWING % 2 else -_SWING
    return _DRIVE_ON - swing, _DRIVE_ON + swing
