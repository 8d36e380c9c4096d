"""Robots by description: the default is the e-puck to the last bit, others drive and are followed,
wrong ones are refused.
"""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.robot import geometry
from workbench.robot.description import EPUCK, RobotConfig, load_robot

LARGE = load_robot("large")


def test_the_default_is_the_e_puck():
    assert load_robot("epuck") == EPUCK == RobotConfig()
    assert (
        EPUCK.step_m == geometry.STEP
        and EPUCK.ground_y == geometry.GROUND_SENSOR_Y
        and EPUCK.size == 1.0
    )


@pytest.mark.parametrize("drive", ["wheels", "planar"])
def test_a_large_robot_drives_and_turns_as_its_numbers_say(drive):
    track = wb.make_track(wb.TrackConfig(judder="none", radius_m=3.0), np.random.default_rng(0))
    world = wb.World(0, [track], drive=drive, spacing_m=1.0, robot=LARGE)
    world.place(0, 0, 0.0, 0.0, 0.0)
    world.command(0, 0, 800, 800)
    x = [0.0]
    for _ in range(20):
        world.step()
        x.append(world.pose(0, 0)[0])
    assert x[-1] - x[10] == pytest.approx(
        800 * LARGE.step_m, rel=0.01
    )  # after the first second, in which it speeds up
    assert (
        x[-1] == pytest.approx(2.0 * 800 * LARGE.step_m, rel=0.03)
        and abs(world.pose(0, 0)[1]) < 0.01
    )
    world.place(0, 0, 0.0, 0.0, 0.0)
    world.command(0, 0, -200, 200)
    for _ in range(10):
        world.step()
    turn = 2 * 200 * LARGE.step_m / LARGE.track_m
    assert world.pose(0, 0)[2] == pytest.approx(turn, rel=0.05)


def test_speeds_are_clamped_at_the_robots_own_limit():
    track = wb.make_track(wb.TrackConfig(judder="none", radius_m=3.0), np.random.default_rng(0))
    world = wb.World(0, [track], drive="planar", spacing_m=1.0, robot=LARGE)
    world.command(0, 0, 9000, 700)
    assert world.ctrl[0, 0] == pytest.approx(LARGE.most_mps) and world.ctrl[0, 1] == pytest.approx(
        700 * LARGE.step_m
    )


@pytest.mark.parametrize("drive", ["wheels", "planar"])
def test_the_same_task_is_learned_by_large_robots(drive):
    config = replace(wb.ConvoyConfig(drive=drive).with_robot(LARGE), seed=1)
    run = wb.learn(config, steps=60_000, progress=False)
    assert run.summary["losses_last_third"] < run.summary["losses"] / 3
    motion = wb.follow(run.policy, config, minutes=3)
    distance, bearing = motion.errors()
    together = motion.following[:, 1:]
    assert np.sqrt(np.mean((distance[together] - config.middle_m) ** 2)) < config.half_range_m / 4
    assert np.degrees(np.std(bearing[together])) < 15
    assert motion.gaps_m().min() > -0.05 * LARGE.body_radius_m


def test_scaling_there_and_back_gives_the_same_task():
    config = wb.ConvoyConfig(distance_tiling="logarithmic")
    large = config.with_robot(LARGE)
    assert large.middle_m / config.middle_m == pytest.approx(LARGE.size)
    assert large.leader_speed_mps / LARGE.most_mps == pytest.approx(
        config.leader_speed_mps / EPUCK.most_mps
    )
    back = large.with_robot(EPUCK)
    assert back.middle_m == pytest.approx(config.middle_m) and back.track.radius_m == pytest.approx(
        config.track.radius_m
    )


def test_a_description_of_ones_own_is_read_from_a_path(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(
        json.dumps(
            {
                "source": "measured",
                "body_radius_m": 0.05,
                "track_m": 0.08,
                "most_steps": 500,
                "timer_hz": 0,
            }
        )
    )
    robot = load_robot(path)
    size = 0.05 / EPUCK.body_radius_m  # the wheels grow with the body
    assert robot.body_radius_m == 0.05
    assert robot.wheel_radius_m == pytest.approx(EPUCK.wheel_radius_m * size)
    assert robot.steps(0.03) == round(0.03 / (EPUCK.step_m * size))


@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        (
            '{"body_radius": 0.1}',
            TypeError,
            "mine.json: RobotConfig has no field 'body_radius'.*did you mean 'body_radius_m'",
        ),
        (
            '{"mass_kg": -1}',
            ValueError,
            "mine.json: RobotConfig.mass_kg = -1; expected a number from 0.001 to 5000 kg",
        ),
        ('{"track_m": 0.2}', ValueError, "expected wheels within the body"),
        ('{"wheel_mass_kg": 0.08}', ValueError, "expected less than half of it"),
        (
            '{"inertia_kg_m2": [1e-4, 1e-4, 1.0]}',
            ValueError,
            "no body has a moment larger than the sum of the other two",
        ),
        ('{"most_steps": 20000}', ValueError, "expected a faster timer, or 0"),
        ("[1]", ValueError, "holds a list; expected an object"),
        ("{", ValueError, "is no JSON"),
    ],
)
def test_wrong_descriptions_are_refused_with_the_file_and_the_remedy(
    tmp_path, content, error, message
):
    (tmp_path / "mine.json").write_text(content)
    with pytest.raises(error, match=message):
        load_robot(tmp_path / "mine.json")


def test_a_large_robot_has_no_infrared_to_be_read():
    with wb.open_robot(
        "sim:", config=replace(wb.ConvoyConfig(drive="planar", followers=1).with_robot(LARGE))
    ) as robot:
        assert "proximity" not in robot.capabilities and "floor" in robot.capabilities
    with pytest.raises(TypeError, match="expected a RobotConfig, as load_robot"):
        wb.ConvoyConfig().with_robot("large")


def test_unknown_names_list_the_known_ones():
    with pytest.raises(FileNotFoundError, match="or one of: epuck, large"):
        load_robot("wheelchair")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"sensing": "ir-metric"},
            "with a robot that is no e-puck.*expected 'truth', 'truth-relative'",
        ),
        (
            {"distance_m": (0.4, 1.0)},
            "two robots touch at 0.44 m: expected a near bound above that",
        ),
        (
            {"wheel_speed_mps": (0.2, 0.9)},
            "expected at most 0.7964 m/s, what this robot's wheels do",
        ),
    ],
)
def test_a_task_that_the_robot_cannot_do_is_refused(change, message):
    config = wb.ConvoyConfig(drive="planar").with_robot(LARGE)
    with pytest.raises(ValueError, match=message):
        replace(config, **change)
    with pytest.raises(ValueError, match="this robot's wheels do at most"):
        LARGE.steps(math.inf)


@pytest.mark.parametrize("size", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("drive", ["wheels", "rolling"])
def test_four_numbers_make_a_robot_that_a_carrot_drives(tmp_path, size, drive):
    """What a description leaves out grows with the body."""
    place = tmp_path / "mine.json"
    numbers = {"body_radius_m": 0.035 * size, "wheel_radius_m": 0.02 * size}
    place.write_text(json.dumps(numbers | {"mass_kg": 0.15 * size**2.5, "most_steps": 900}))
    robot = load_robot(place)
    assert robot.track_m == pytest.approx(RobotConfig().track_m * size)
    growth = robot.mass_kg / RobotConfig().mass_kg * size**2
    grown = [growth * each for each in RobotConfig().inertia_kg_m2]
    assert robot.inertia_kg_m2 == pytest.approx(grown)
    config = wb.ConvoyConfig(drive=drive, sensing="truth-relative").with_robot(robot)
    summary = wb.evaluate(wb.LAWS["carrot"](), config, minutes=4, progress=False).summary
    assert summary["losses"] == summary["collisions"] == 0
    assert summary["rms_distance_error_mm"] < 5 * size


def test_a_leader_that_cannot_follow_its_line_is_told():
    """Wheels of an e-puck under a body three times as wide, on curves for that body."""
    wide = RobotConfig(body_radius_m=0.1, track_m=0.15)
    config = wb.ConvoyConfig(drive="rolling", sensing="truth-relative").with_robot(wide)
    with pytest.raises(
        RuntimeError, match=r"the leader has lost its line and stopped, .* m from it, within 250 s"
    ):
        wb.evaluate(wb.LAWS["carrot"](), config, minutes=10, progress=False)


def test_a_leader_that_comes_back_to_its_line_by_itself_is_left_alone():
    """Beyond its sensors' reach now and then, and never for two seconds."""
    rough = wb.TrackConfig(judder="replan", judder_rms_m=0.02)
    config = wb.ConvoyConfig(drive="planar", followers=1, seed=2, track=rough)
    config = replace(config, leader_speed_mps=0.1, wheel_speed_mps=(0.0, 0.128))
    wb.evaluate(wb.LAWS["carrot"](), config, minutes=0.325, progress=False)


@pytest.mark.parametrize("name", ["wheel_radius_m", "slider_x_m", "ground_x_m", "ground_y_m"])
def test_every_part_is_within_the_body(name):
    with pytest.raises(ValueError, match=f"RobotConfig.{name} = 0.4 .*expected every part within"):
        RobotConfig(**{name: 0.4})


def test_the_fastest_speed_may_be_given_in_metres_a_second(tmp_path):
    place = tmp_path / "mine.json"
    place.write_text(json.dumps({"body_radius_m": 0.07, "most_mps": 0.3}))
    robot = load_robot(place)
    assert robot.most_mps == pytest.approx(0.3, rel=1e-3)
    place.write_text(json.dumps({"most_mps": 0.3, "most_steps": 900}))
    with pytest.raises(ValueError, match=r"most_mps = 0.3 with most_steps = 900; expected one of"):
        load_robot(place)


@pytest.mark.parametrize("radius", [1e200, -1e200, 0, 5])
def test_a_radius_out_of_range_is_refused_by_its_own_name(tmp_path, radius):
    place = tmp_path / "mine.json"
    place.write_text(json.dumps({"body_radius_m": radius}))
    with pytest.raises(ValueError, match=r"RobotConfig.body_radius_m = .*; expected a number"):
        load_robot(place)


@pytest.mark.parametrize("radius", [0.01, 1.0])
def test_the_smallest_and_the_largest_body_grow_into_a_robot(tmp_path, radius):
    place = tmp_path / "mine.json"
    place.write_text(json.dumps({"body_radius_m": radius}))
    assert load_robot(place).body_radius_m == radius
