"""The reset manoeuvre (paper II-C): a follower that lost its leader finds back by itself, without learning.

"The follower then turns towards the leader and moves forward at maximum speed until it reaches its optimal working range
again and can restart learning in a new episode." As a state machine, in phases:

    FOLLOW ──terminal──▶ BACK_OFF  too near: straight away from it, backwards where it is in front
                     └─▶ TURN      on the spot until |bearing| < 10°
                           └─▶ APPROACH  straight on at full speed; back to TURN beyond 20°
    BACK_OFF, TURN, APPROACH ──|e_d| within a third of the half range, bearing inside its bounds──▶ FOLLOW
    any of them ──5 s──▶ SEARCH  turn on the spot, up to one turn, until the predecessor is in sight, then start again
    SEARCH ──no sight──▶ LOST    stand still; start again when the predecessor is in sight

With sensing "truth" the predecessor is known anywhere, as with the paper's camera; ``sight_m`` bounds it.

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
_DEADBEAT = TRACK / 2 / CONTROL_PERIOD / STEP  # steps/s per rad: turns by a bearing in one control period


@compiled
def begin_reset(follower: Any, distance: float, near: float) -> None:
    """Enter the manoeuvre at a terminal."""
    follower.phase = BACK_OFF if distance < near else TURN
    follower.timer = 0


@compiled
def manoeuvre(
    follower: Any, distance: float, bearing: float, middle: float, half_range: float, limit: float, sight: float
) -> tuple[int, int]:
    """Advance the state machine by one control period and return the wheel commands in steps/s.

    Args:
        follower: record with ``phase`` and ``timer``, which are updated; phase FOLLOW means: start a new episode now.
        distance, bearing: of the predecessor, m and rad.
        middle, half_range: d* and (d_max - d_min) / 2 in m.
        limit: terminal bearing in rad.
        sight: distance in m beyond which the predecessor is out of sight.
    """
    seen = distance <= sight
    error = distance - middle
    follower.timer += 1
    if follower.phase == LOST or follower.phase == SEARCH:
        if seen:
            begin_reset(follower, distance, middle - half_range / 3)
        elif follower.phase == LOST or follower.timer > SEARCH_PERIODS:
            follower.phase = LOST
            return 0, 0
        else:
            return -SEARCH_SPEED, SEARCH_SPEED
    if abs(error) < half_range / 3 and abs(bearing) < limit:
        follower.phase = FOLLOW
        return 0, 0
    if not seen or follower.timer > TIME_OUT:
        follower.phase = SEARCH
        follower.timer = 0
        return -SEARCH_SPEED, SEARCH_SPEED
    away = -MAX_STEPS if abs(bearing) < math.pi / 2 else MAX_STEPS
    if follower.phase == BACK_OFF and error < 0:
        return away, away
    if follower.phase == APPROACH and abs(bearing) < 2 * TOLERANCE and error > 0:
        return MAX_STEPS, MAX_STEPS
    if abs(bearing) >= TOLERANCE:
        follower.phase = TURN
        turn = int(max(-MAX_STEPS, min(MAX_STEPS, round(bearing * _DEADBEAT))))
        return -turn, turn
    if error > 0:
        follower.phase = APPROACH
        return MAX_STEPS, MAX_STEPS
    follower.phase = BACK_OFF
    return away, away
