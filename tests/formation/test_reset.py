"""The reset manoeuvre as a state machine (X1, X3): every transition, and success from any pose."""

import math

import numpy as np
import pytest
from numba import njit

from workbench.formation.config import ConvoyConfig
from workbench.formation.records import ROBOT
from workbench.formation.reset import (
    APPROACH,
    BACK_OFF,
    FOLLOW,
    LOST,
    PHASES,
    SEARCH,
    TIME_OUT,
    TURN,
    begin_reset,
    manoeuvre,
)
from workbench.formation.task import fill_task
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK

MIDDLE = 0.15
HALF = 0.07
LIMIT = math.pi / 4
SIGHT = 2.0


def _follower(phase=FOLLOW, timer=0):
    follower = np.zeros(1, ROBOT)
    follower["reset"]["phase"] = phase
    follower["reset"]["timer"] = timer
    return follower


TASK = fill_task(ConvoyConfig(), 0)
SEARCH_PERIODS = int(TASK["search"]["periods"][0])


@njit
def _manoeuvre(task, follower, distance, bearing):
    return manoeuvre(task[0], follower[0], distance, bearing)


@njit
def _begin(follower, distance):
    begin_reset(follower[0], distance, MIDDLE - HALF)


def _move(follower, distance, bearing, sight=SIGHT):
    task = TASK.copy()
    task["bounds"]["sight"] = sight
    return _manoeuvre(task, follower, float(distance), float(bearing))


def _phase(follower):
    return int(follower["reset"]["phase"][0])


@pytest.mark.parametrize(("distance", "phase"), [(0.079, BACK_OFF), (0.23, TURN), (0.15, TURN)])
def test_a_terminal_starts_the_fitting_phase(distance, phase):
    follower = _follower()
    follower["reset"]["timer"] = 17
    _begin(follower, distance)
    assert _phase(follower) == phase and follower["reset"]["timer"][0] == 0


def test_too_near_backs_off_straight_and_forward_where_the_robot_is_behind():
    assert _move(_follower(BACK_OFF), 0.075, 0.2) == (-1000, -1000)
    assert _move(_follower(BACK_OFF), 0.075, 3.0) == (1000, 1000)


def test_turns_on_the_spot_towards_the_predecessor_then_drives_at_full_speed():
    follower = _follower(TURN)
    left, right = _move(follower, 0.3, 1.2)
    assert left == -right and right > 0 and _phase(follower) == TURN
    assert _move(follower, 0.3, 0.1) == (1000, 1000) and _phase(follower) == APPROACH
    assert _move(follower, 0.3, 0.3) == (1000, 1000)  # 17°: still straight on
    assert _move(follower, 0.3, 0.4)[0] < 0 and _phase(follower) == TURN  # 23°: turn again
    # a small bearing is turned away within one control period
    left, right = _move(_follower(TURN), 0.3, 0.2)
    assert (right - left) * STEP / TRACK * CONTROL_PERIOD == pytest.approx(0.2, abs=0.01)


def test_a_new_episode_starts_within_a_third_of_the_half_range():
    for e_d, done in ((HALF / 3 + 1e-6, False), (HALF / 3 - 1e-6, True), (-HALF / 3 + 1e-6, True)):
        follower = _follower(APPROACH)
        _move(follower, MIDDLE + e_d, 0.0)
        assert (_phase(follower) == FOLLOW) is done
    follower = _follower(TURN)
    _move(follower, MIDDLE, LIMIT + 0.01)  # at the right distance, but it would be lost at once
    assert _phase(follower) == TURN


def test_time_out_search_lost_and_back():
    follower = _follower(APPROACH, timer=TIME_OUT)
    assert _move(follower, 0.6, 0.0) == (-300, 300) and _phase(follower) == SEARCH
    assert _move(follower, 0.6, 0.0) != (0, 0) and _phase(follower) in (
        TURN,
        APPROACH,
    )  # in sight: start again
    follower = _follower(APPROACH)
    _move(follower, 0.6, 0.0, sight=0.5)
    assert _phase(follower) == SEARCH  # out of sight: search at once
    for _ in range(SEARCH_PERIODS):
        assert _move(follower, 0.6, 0.0, sight=0.5) == (-300, 300)
    assert _move(follower, 0.6, 0.0, sight=0.5) == (0, 0) and _phase(follower) == LOST
    for _ in range(100):
        assert _move(follower, 0.6, 0.0, sight=0.5) == (0, 0)  # lost stands still
    _move(follower, 0.4, 0.0, sight=0.5)
    assert _phase(follower) in (TURN, APPROACH)
    assert PHASES[LOST] == "lost"


def test_the_search_sees_every_direction():
    turned = SEARCH_PERIODS * CONTROL_PERIOD * 2 * 300 * STEP / TRACK
    assert 2 * math.pi <= turned < 2 * math.pi * 1.1


@pytest.mark.parametrize("seed", range(30))
def test_from_any_pose_it_catches_up_with_a_moving_leader(seed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-math.pi, math.pi)
    distance = rng.choice([rng.uniform(0.072, 0.08), rng.uniform(0.22, 0.45)])
    x = 0.0
    y = 0.0
    heading = rng.uniform(-math.pi, math.pi)
    lx = distance * math.cos(angle)
    ly = distance * math.sin(angle)
    direction = rng.uniform(-math.pi, math.pi)
    follower = _follower(BACK_OFF if distance < 0.08 else TURN)
    for _ in range(300):
        gap = math.hypot(lx - x, ly - y)
        bearing = math.remainder(math.atan2(ly - y, lx - x) - heading, 2 * math.pi)
        left, right = _move(follower, gap, bearing)
        if _phase(follower) == FOLLOW:
            break
        forward = (left + right) * STEP / 2
        turn = (right - left) * STEP / TRACK
        x, y = x + 0.1 * forward * math.cos(heading), y + 0.1 * forward * math.sin(heading)
        heading += 0.1 * turn
        lx, ly = lx + 0.006 * math.cos(direction), ly + 0.006 * math.sin(direction)
    assert _phase(follower) == FOLLOW, f"still in {PHASES[_phase(follower)]} after 30 s"
    assert abs(gap - MIDDLE) < HALF / 3
