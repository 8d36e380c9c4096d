"""The drive that needs no engine: its arcs, its pushing, and that everything works on it."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from workbench.arena.drives import rolling
from workbench.arena.picture import picture
from workbench.arena.proximity import RayProximity, add_box
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.laws.table import LAWS
from workbench.formation.senses.table import SENSES
from workbench.learning.config import RULES, LearnerConfig
from workbench.measures.drives import MARGINS, fidelity, fit_rolling
from workbench.measures.motion import Motion
from workbench.robot.description import EPUCK, load_robot
from workbench.robot.infrared import InfraredConfig
from workbench.robot.motors import motor_speed, twist

ROLLING = ConvoyConfig(drive="rolling")


def _world(robots=1, drive="rolling", robot=EPUCK):
    track = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
    return World(robots - 1, [track], drive=drive, spacing_m=0.15, robot=robot)


def test_the_constants_are_what_wheels_do():
    found = fit_rolling()
    assert found["speed_gain"] == pytest.approx(rolling.SPEED_GAIN, abs=2e-4)
    assert found["turn_gain"] == pytest.approx(rolling.TURN_GAIN, abs=2e-4)
    assert found["speed_lag"] == pytest.approx(rolling.SPEED_LAG, abs=5e-5)
    assert found["turn_lag"] == pytest.approx(rolling.TURN_LAG, abs=5e-5)
    assert found["rest_mm"] < 0.01 and found["rest_deg"] < 0.02


def test_an_arc_is_the_closed_form_through_the_firmware_s_speeds():
    world = _world()
    world.place(0, 0, 0.1, -0.2, 0.3)
    world.command(0, 0, 300, 550)
    speed, turn = twist(motor_speed(300), motor_speed(550))
    s = rolling.SPEED_GAIN * 0.1 * speed - rolling.SPEED_LAG * speed
    a = rolling.TURN_GAIN * 0.1 * turn - rolling.TURN_LAG * turn
    chord = 2 * s / a * math.sin(a / 2)  # what the series in the file is of
    world.step()
    x, y, heading = world.pose(0, 0)
    assert heading == pytest.approx(0.3 + a)
    assert x == pytest.approx(0.1 + chord * math.cos(0.3 + a / 2), abs=1e-9)
    assert y == pytest.approx(-0.2 + chord * math.sin(0.3 + a / 2), abs=1e-9)
    # from the second period on nothing lags
    world.step()
    assert world.pose(0, 0)[2] - heading == pytest.approx(rolling.TURN_GAIN * 0.1 * turn)


def test_manoeuvres_are_within_their_margins_of_wheels_but_for_one():
    lines = fidelity()
    assert list(lines.index) == list(MARGINS)
    off = lines["rolling"].abs() > lines["margin"]
    assert list(lines.index[off]) in ([], ["bump 20 mm aside, pushed in 3 s"])
    assert lines.loc["bump 20 mm aside, pushed in 3 s", "rolling"] > -7  # planar: -10
    assert np.isnan(lines.loc["bump head-on, overlap", "exact rolling"])


@pytest.mark.parametrize("seed", range(5))
def test_a_crowd_is_pushed_apart_to_where_records_show_contact(seed):
    robots = 24
    world = _world(robots)
    rng = np.random.default_rng(seed)
    for robot in range(robots):
        at = rng.uniform(-0.25, 0.25, 2)
        world.place(0, robot, *at, math.atan2(-at[1], -at[0]))  # they look to the middle
    nearest = []
    for _ in range(40):
        for robot in range(robots):
            world.command(0, robot, 500, 500)
        world.step()
        places = np.array([world.pose(0, robot)[:2] for robot in range(robots)])
        gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        nearest.append(gaps[np.triu_indices(robots, 1)].min())
        order = world.qpos[0, 5 : rolling.WIDTH * robots : rolling.WIDTH].astype(int)
        assert sorted(order) == list(range(robots))
    # four passes leave a crowd a little overlap, never a heap
    assert min(nearest[5:]) > 0.060 and nearest[-1] < 0.070
    assert rolling.apart_m(EPUCK) == pytest.approx(0.0698)


def test_two_robots_in_one_place_part():
    world = _world(2)
    for robot in range(2):
        world.place(0, robot, 0.0, 0.0, 0.0)
    world.step()
    assert math.dist(world.pose(0, 0)[:2], world.pose(0, 1)[:2]) == pytest.approx(0.0698)


def test_contacts_are_counted_as_on_other_drives():
    share = {}
    for drive in ("rolling", "planar"):
        close = replace(ROLLING, drive=drive, distance_m=(0.0702, 0.09))
        block = Convoy(close, [1, 2, 3, 4, 5], steps=10**6).run_block()
        share[drive] = np.mean([Motion.of_steps(steps).gaps_m() < 0 for steps in block])
    assert share["rolling"] == pytest.approx(share["planar"], rel=0.15)


def test_robots_that_would_drive_through_each_other_are_refused():
    fast = replace(EPUCK, most_steps=3000)
    with pytest.raises(ValueError, match="close in by up to 0.08 m in a control period"):
        _world(2, robot=fast)


def test_a_robot_that_is_nowhere_is_an_error():
    world = _world(2)
    world.place(0, 1, math.nan, 0.0, 0.0)
    world.step([0])
    with pytest.raises(RuntimeError, match="formation 0 has a robot whose place is not a number"):
        world.check(0, 1)
    with pytest.raises(ValueError, match="name = 'x'; expected one of qpos, time, ctrl, qvel"):
        world.batch.bind("x")


def test_what_fails_in_one_thread_leaves_no_other_running():
    convoy = Convoy(replace(ROLLING, followers=16), [1, 2, 3, 4], steps=10**7, threads=2)
    convoy.run_block()
    convoy.weights[1] = np.inf
    with pytest.raises(FloatingPointError, match="seed 2"):
        convoy.run_block()
    before = convoy.periods.copy()
    time.sleep(0.2)
    np.testing.assert_array_equal(convoy.periods, before)


def test_furniture_is_refused():
    with pytest.raises(ValueError, match="'rolling' with furniture; nothing stops a robot"):
        Convoy(ROLLING, [1], steps=10, furnish=lambda spec: add_box(spec, "b", (0, 0), (0.1, 0.1)))


def test_pictures_and_rays_are_of_a_model_posed_as_the_robots_stand():
    worlds = [_world(3, drive) for drive in ("rolling", "planar")]
    for world in worlds:
        for robot, place in enumerate(((0.1, 0.0, 0.1), (0.0, 0.01, 0.0), (-0.1, 0.0, -0.1))):
            world.place(0, robot, *place)
    pictures = [picture(world, width=96, height=64) for world in worlds]
    np.testing.assert_array_equal(*pictures)
    light = [RayProximity(world, InfraredConfig()).light(0, 1) for world in worlds]
    np.testing.assert_array_equal(*light)
    assert max(light[0]) > 20


@pytest.mark.parametrize("sensing", SENSES)
def test_every_sensing_mode_works(sensing):
    base = SETTINGS["infrared"] if SENSES[sensing].epuck else ConvoyConfig(followers=2)
    config = replace(base, drive="rolling", sensing=sensing)
    convoy = Convoy(config, [1], steps=10**6, periods=25 if sensing == "pixels" else 2000)
    block = convoy.run_block()[0, : int(convoy.periods[0])]
    assert convoy.updates[0] > 0 and np.isfinite(block["x"]).all()
    assert np.mean(block["phase"][:, 1:] == 0) > 0.3


@pytest.mark.parametrize("law", LAWS)
def test_every_law_follows(law):
    convoy = Convoy(ROLLING, [1], periods=2000, policy=LAWS[law]())
    motion = Motion.of_steps(convoy.run_block()[0, :2000])
    assert np.abs(motion.errors()[0][500:] - 0.15).max() < 0.07


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_learns(rule):
    config = replace(ROLLING, learner=LearnerConfig(rule=rule))
    convoy = Convoy(config, [1, 2], steps=5000)
    convoy.run_block()
    assert convoy.updates.tolist() == [5000, 5000] and np.abs(convoy.weights).max() > 1


def test_another_robot_rolls_with_its_own_sizes():
    robot = load_robot("large")
    world = _world(2, robot=robot)
    assert rolling.apart_m(robot) == pytest.approx(0.0698 * robot.body_radius_m / 0.035)
    world.place(0, 0, 0.0, 0.0, 0.0)
    world.command(0, 0, 100, 100)
    world.step()
    world.step()
    x, _, _ = world.pose(0, 0)
    assert x == pytest.approx(2 * 0.1 * 100 * robot.step_m, rel=0.05)
