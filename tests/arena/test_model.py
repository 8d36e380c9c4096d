"""The simulated robot against exact rolling, and contact between robots.

The limits stated here are the README's.
"""

import math

import mujoco
import numpy as np
import pytest

from workbench.arena.drives.table import DRIVE_NUMBERS, DRIVES
from workbench.arena.model import build_model
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World, read_pose
from workbench.robot import geometry
from workbench.robot.motors import motor_speed, twist

STRAIGHT = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
LIMITS = {  # drive: 100 ms travel, 1 s line, 1 s spin (relative), end of a 3 s arc (m, rad)
    "wheels": (0.03, 0.005, 0.008, 0.003, math.radians(1.2)),
    "planar": (0.02, 0.002, 0.002, 0.003, math.radians(0.3)),
}


def _world(drive, robots=2):
    world = World(robots - 1, [STRAIGHT], drive=drive, spacing_m=0.15)
    for robot in range(robots):
        world.place(0, robot, 0.5 * robot, 0.0, 0.0)
    for _ in range(3):
        world.step()
    return world


def _drive(world, left, right, periods, robot=0):
    world.command(0, robot, left, right)
    start = np.array(world.pose(0, robot))
    for _ in range(periods):
        world.step()
    return start, np.array(world.pose(0, robot))


@pytest.mark.parametrize("drive", LIMITS)
def test_step_response_straight_line_and_spin_against_exact_rolling(drive):
    first, line, spin, _, _ = LIMITS[drive]
    speed, _ = twist(motor_speed(466), motor_speed(466))
    start, end = _drive(_world(drive), 466, 466, 1)
    assert (end[0] - start[0]) / (0.1 * speed) == pytest.approx(1, abs=first)
    start, end = _drive(_world(drive), 466, 466, 10)
    assert (end[0] - start[0]) / speed == pytest.approx(1, abs=line)
    assert abs(end[1] - start[1]) < 2e-4 and abs(end[2] - start[2]) < 2e-3
    _, turn = twist(motor_speed(-300), motor_speed(300))
    start, end = _drive(_world(drive), -300, 300, 10)
    assert (end[2] - start[2]) / turn == pytest.approx(1, abs=spin)
    assert math.dist(start[:2], end[:2]) < 2e-3


@pytest.mark.parametrize("drive", LIMITS)
@pytest.mark.parametrize(("left", "right"), [(300, 500), (600, 400), (466, 500)])
def test_arcs_end_where_exact_rolling_ends(drive, left, right):
    *_, place, heading = LIMITS[drive]
    speed, turn = twist(motor_speed(left), motor_speed(right))
    start, end = _drive(_world(drive), left, right, 30)
    angle = 3 * turn
    wanted = start + [speed / turn * math.sin(angle), speed / turn * (1 - math.cos(angle)), angle]
    assert math.dist(end[:2], wanted[:2]) < place
    assert abs(math.remainder(end[2] - wanted[2], 2 * math.pi)) < heading


@pytest.mark.parametrize("drive", LIMITS)
def test_a_robot_pushes_another_and_does_not_pass_through_it(drive):
    world = _world(drive)
    world.place(0, 1, 0.10, 0.0, 0.0)
    world.command(0, 0, 600, 600)
    gaps = []
    for _ in range(40):
        world.step()
        (x0, y0, _) = world.pose(0, 0)
        (x1, y1, _) = world.pose(0, 1)
        gaps.append(math.hypot(x1 - x0, y1 - y0))
    overlap = 2 * geometry.BODY_RADIUS - min(gaps)
    assert overlap < {"wheels": 0.002, "planar": 0.009}[drive]
    assert gaps[-1] < 0.075  # they touch to the end: the first did not drive around or through


def test_wheels_slip_where_the_planar_drive_cannot():
    # pushing against a robot that holds still: the wheels keep turning, the body does not
    world = _world("wheels", robots=3)
    world.place(0, 1, 0.071, 0.0, 0.0)
    world.place(0, 2, 0.142, 0.0, 0.0)
    for robot in (1, 2):
        world.command(0, robot, -900, -900)
    world.command(0, 0, 900, 900)
    angle = world.qpos[0, 7]
    x = world.pose(0, 0)[0]
    for _ in range(20):
        world.step()
    rolled = (world.qpos[0, 7] - angle) * geometry.WHEEL_RADIUS
    assert rolled - (world.pose(0, 0)[0] - x) > 0.05


def test_full_speed_reversals_do_not_tip_the_robot():
    world = _world("wheels", robots=1)
    rng = np.random.default_rng(0)
    lowest = 1.0
    for _ in range(400):
        left, right = rng.choice([-1000, 0, 1000], 2)
        world.command(0, 0, int(left), int(right))
        world.step()
        q = world.qpos[0, 3:7]
        lowest = min(lowest, 1 - 2 * (q[1] ** 2 + q[2] ** 2))
    assert math.degrees(math.acos(lowest)) < 5


@pytest.mark.parametrize("drive", LIMITS)
def test_model_has_the_cited_masses_and_no_mujoco_warning(drive):
    model = build_model(5, drive)
    assert model.body_mass.sum() == pytest.approx(5 * geometry.BODY_MASS)
    assert model.opt.timestep == DRIVES[drive].timestep_s
    data = mujoco.MjData(model)
    data.qpos[:] = World(4, [STRAIGHT], drive=drive, spacing_m=0.15).qpos[0]
    data.ctrl[:] = 0.05
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert all(warning.number == 0 for warning in data.warning)


def test_heading_is_read_back_from_any_quaternion():
    world = _world("wheels", robots=1)
    for heading in np.linspace(-3.1, 3.1, 13):
        world.place(0, 0, 0.1, -0.2, heading)
        x, y, c, s = read_pose(world.qpos[0], 0, DRIVE_NUMBERS["wheels"])
        assert (x, y) == (0.1, -0.2) and math.atan2(s, c) == pytest.approx(heading)


def test_bad_models_are_refused():
    with pytest.raises(ValueError, match="robots = 0"):
        build_model(0, "wheels")
    with pytest.raises(ValueError, match="drive = 'hover'; expected one of 'wheels', 'planar'"):
        build_model(1, "hover")
