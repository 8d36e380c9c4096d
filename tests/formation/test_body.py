"""Bodies that are not nominal, late commands and readings that do not arrive."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import workbench as wb
from workbench.formation.body import BodyConfig, draw_bodies
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.logs.driving import drive
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK
from workbench.robot.motors import motor_speed
from workbench.robot.wire.emulator import Emulator

BASE = wb.ConvoyConfig(followers=1, drive="planar")
WORN = BodyConfig(wheel_spread=0.02, axle_spread=0.03, slip=0.05, delay=2, missed=0.2)
PATIENT = 30.0


def _block(config, periods=300, policy=None):
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(1, config.rows, config.action_count)) if policy is None else policy
    block = wb.Convoy(config, [config.seed], periods=periods, policy=theta).run_block()[0]
    return block[block["phase"][:, 0] >= 0].copy(), theta


@pytest.mark.parametrize("sensing", ["truth", "camera", "ir-raw"])
def test_a_nominal_body_changes_nothing_and_is_the_default(sensing):
    assert BASE.body.nominal and BodyConfig(delay=0).nominal and not WORN.nominal
    config = replace(
        wb.SETTINGS["infrared"] if sensing == "ir-raw" else BASE,
        followers=2,
        drive="planar",
        sensing=sensing,
    )
    plain, _ = _block(config)
    late = BodyConfig(missed=1e-12)  # everything switched on, nothing of it in effect
    same, _ = _block(replace(config, body=late))
    for name in ("left", "right", "state", "phase"):
        assert_array_equal(plain[name], same[name])
    assert_allclose(plain["x"], same["x"], atol=1e-6)


@pytest.mark.parametrize("name", ["planar", "wheels"])
def test_wheels_and_axles_do_what_geometry_says(name):
    config = replace(BASE, drive=name, body=BodyConfig(wheel_spread=0.1, axle_spread=0.1))
    with SimulatedRobot(config.with_seed(4)) as robot:
        robot.step()
        record = robot.convoy.robots[0, 1]
        wheel = float(record["body"]["wheel"])
        axle = float(record["body"]["axle"])
        assert abs(wheel - 1) > 0.01 and abs(axle - 1) > 0.01
        robot.set_motors_speed(200, 350)
        for _ in range(10):  # out of the first acceleration
            robot.step()
        x0, y0, h0 = robot.pose()
        for _ in range(20):
            robot.step()
        x1, y1, h1 = robot.pose()
    turned = (h1 - h0) % (2 * math.pi)
    left, right = motor_speed(200) * STEP, motor_speed(350) * STEP
    assert turned == pytest.approx(
        wheel * (right - left) / (TRACK * axle) * 20 * CONTROL_PERIOD, rel=0.02
    )
    chord = math.hypot(x1 - x0, y1 - y0) * (turned / 2) / math.sin(turned / 2)  # length of the arc
    assert chord == pytest.approx(wheel * (left + right) / 2 * 20 * CONTROL_PERIOD, rel=0.02)


@pytest.mark.parametrize("delay", [0, 1, 2, 3])
def test_commands_arrive_as_many_periods_late_as_asked(delay):
    with SimulatedRobot(replace(BASE, body=BodyConfig(delay=delay, missed=1e-12))) as robot:
        robot.step()
        x, y, _ = robot.pose()
        robot.set_motors_speed(400, 400)
        moved = []
        for _ in range(6):
            robot.step()
            moved.append(math.dist(robot.pose()[:2], (x, y)))
    assert all(distance < 1e-4 for distance in moved[:delay]) and all(
        distance > 1e-3 for distance in moved[delay:]
    )


def test_slip_only_ever_takes_speed_and_as_much_as_asked():
    lengths = {}
    for slip in (0.0, 0.1):
        with SimulatedRobot(replace(BASE, body=BodyConfig(slip=slip, missed=1e-12))) as robot:
            robot.step()
            start = robot.pose()[:2]
            robot.set_motors_speed(300, 300)
            for _ in range(200):
                robot.step()
                if slip == 0:
                    continue
            lengths[slip] = math.dist(robot.pose()[:2], start)
    assert 0.85 < lengths[0.1] / lengths[0.0] < 1 - 0.8 * 0.1 * math.sqrt(2 / math.pi)


@pytest.mark.parametrize("sensing", ["truth", "ir-metric", "ir-raw", "camera"])
def test_where_no_reading_arrives_the_last_one_counts(sensing):
    base = wb.SETTINGS["infrared"] if sensing.startswith("ir") else BASE
    config = replace(
        base, followers=1, drive="planar", sensing=sensing, body=BodyConfig(missed=0.5)
    )
    block, _ = _block(config, 600)
    followed = block[block["state"][:, 1] >= 0][:, 1]
    again = np.mean(followed["distance_error"][1:] == followed["distance_error"][:-1])
    assert 0.35 < again < 0.65
    whole, _ = _block(replace(config, body=BodyConfig()), 600)
    followed = whole[whole["state"][:, 1] >= 0][:, 1]
    assert np.mean(followed["distance_error"][1:] == followed["distance_error"][:-1]) < 0.1


@pytest.mark.parametrize("sensing", ["ir-raw", "ir-metric"])
@pytest.mark.parametrize("protocol", [None, "overo"])
def test_through_the_api_a_worn_robot_does_what_it_does_in_the_convoy(sensing, protocol):
    config = replace(
        wb.SETTINGS["infrared"], followers=1, drive="planar", sensing=sensing, body=WORN, seed=5
    )
    block, theta = _block(config, 200)
    follower = SoloFollower(config, wb.Policy.of(config, theta))
    commands = []

    def run(robot):
        robot.calibrate_proximity_sensors()
        drive(robot, follower, seconds=20, watch=lambda f, r, t: commands.append(r.commanded))

    if protocol is None:
        with SimulatedRobot(config) as robot:
            run(robot)
    else:
        with (
            Emulator(SimulatedRobot(config), protocol, rate=0) as emulator,
            wb.open_robot(emulator.url, period_s=0.0, timeout_s=PATIENT) as robot,
        ):
            run(robot)
    assert commands == list(
        zip(block["left"][:, 1].tolist(), block["right"][:, 1].tolist(), strict=True)
    )


def test_bodies_are_drawn_within_their_spread_and_from_the_seed():
    wheel, axle = draw_bodies(
        np.random.default_rng(1), BodyConfig(wheel_spread=0.02, axle_spread=0.05), 1000
    )
    assert 0.98 <= wheel.min() < 0.981 and 1.019 < wheel.max() <= 1.02 and axle.max() > 1.045
    assert_array_equal(
        wheel, draw_bodies(np.random.default_rng(1), BodyConfig(wheel_spread=0.02), 1000)[0]
    )


def test_two_kinds_of_delay_are_not_mixed():
    slow = replace(BASE, compute_time_s=0.04, learner=replace(BASE.learner, buffer=False))
    with pytest.raises(ValueError, match="body.delay = 1 with compute_time_s = 0.04 and no buffer"):
        replace(slow, body=BodyConfig(delay=1))
    with pytest.raises(ValueError, match="BodyConfig.delay = 5; expected"):
        BodyConfig(delay=5)


def test_a_fleet_is_the_same_robots_whatever_the_seed_and_zero_those_of_the_run():
    infrared = replace(
        wb.SETTINGS["infrared"],
        drive="planar",
        followers=2,
        body=BodyConfig(wheel_spread=0.02, axle_spread=0.03),
    )
    camera = replace(wb.ConvoyConfig(drive="planar", followers=1, sensing="camera"))

    def who(config, seed):
        robots = wb.Convoy(config, [seed], periods=1, threads=1).robots[0]
        kinds = {"infrared": ("gain", "offset", "bias"), "body": ("wheel", "axle")}
        return [robots[part][name].copy() for part, names in kinds.items() for name in names]

    def lens(config, seed):
        return wb.Convoy(config, [seed], periods=1, threads=1).lens.copy()

    for one, other in zip(
        who(replace(infrared, fleet=7), 1), who(replace(infrared, fleet=7), 2), strict=True
    ):
        assert_array_equal(one, other)
    for one, other in zip(who(replace(infrared, fleet=7), 1), who(infrared, 7), strict=True):
        assert_array_equal(one, other)
    for one, other in zip(who(infrared, 1), who(infrared, 2), strict=True):
        assert not np.array_equal(one, other)
    assert_array_equal(lens(replace(camera, fleet=7), 1), lens(replace(camera, fleet=7), 2))
    assert not np.array_equal(lens(camera, 1), lens(camera, 2))


def test_a_robot_behind_the_api_belongs_to_the_fleet_too():
    config = replace(wb.SETTINGS["infrared"], drive="planar", followers=1, fleet=7)
    readings = []
    for seed in (1, 2):
        with SimulatedRobot(config.with_seed(seed)) as robot:
            robot.calibrate_proximity_sensors()
            readings.append(robot.convoy.robots[0, 1]["infrared"]["bias"].copy())
    assert_array_equal(*readings)
