"""The infrared model (N3, N4, N7): distance, angle, shape, saturation, noise, ambient light;
inversion and its limits (N2).
"""

import math

import numpy as np
import pytest

from workbench.arena.proximity import RayProximity
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World
from workbench.robot import infrared as ir
from workbench.robot.infrared import TARGETS, WARPS, InfraredConfig, front_pair, mean_light
from workbench.robot.inversion import WIDEST, inversion_table, invert, uncertainty
from workbench.studies.validation.infrared import wall_light

CONFIG = InfraredConfig()


def test_readings_fall_with_distance_for_every_target():
    for target in TARGETS:
        light = [
            mean_light(d, 0.0, InfraredConfig(target=target))[0]
            for d in np.linspace(0.08, 0.29, 60)
        ]
        assert np.all(np.diff(light) < 0)


def test_a_sensor_sees_best_what_stands_in_its_axis():
    for k, bearing in enumerate(ir.BEARINGS):
        angles = np.linspace(-math.pi, math.pi, 361)
        light = [mean_light(0.1, angle, CONFIG)[k] for angle in angles]
        assert abs(
            math.remainder(angles[int(np.argmax(light))] - bearing, 2 * math.pi)
        ) < math.radians(2)


def test_left_and_right_are_mirror_images():
    for bearing in np.radians([0, 7, 20, 50]):
        np.testing.assert_allclose(
            mean_light(0.1, bearing, CONFIG), mean_light(0.1, -bearing, CONFIG)[::-1], rtol=1e-12
        )


def test_a_cylinder_reads_about_half_of_a_wall_at_the_same_distance():
    # public measurements at 19 mm: a big round target reads 0.57 of a wall's peak; the gap here is
    # 19 mm too
    wall = float(wall_light(np.array(19.0), np.array(0.0)))
    bearing = ir.BEARINGS[7]
    centre = 0.035 + 0.019 + TARGETS["cup"][0]
    assert 0.45 < mean_light(centre, bearing, CONFIG)[7] / wall < 0.55


def test_contact_saturates_where_real_sensors_do():
    assert 3600 <= ir.saturate(1e5, ir.DARK) <= 3900
    assert ir.saturate(100.0, ir.DARK) == pytest.approx(100.0, rel=1e-4)


def test_noise_grows_as_measured_in_two_labs():
    def spread(low, high, share=1.0):
        return share * np.mean([ir.noise_sd(float(lit)) for lit in np.linspace(low, high, 50)])

    # a weighted mean of four sensors: three quarters of one
    assert 2.2 < spread(60, 250, 0.75) < 2.7
    assert spread(250, 400, 0.75) == pytest.approx(4.2, rel=0.1)
    # one sensor of a moving robot
    assert spread(800, 3200) == pytest.approx(220, rel=0.15)
    assert 10 < spread(200, 800) < 21


def test_readings_are_whole_counts_of_twelve_bits_with_the_stated_noise():
    z = np.random.default_rng(0).standard_normal(20_000)
    readings = np.array(
        [ir.raw_reading(100.0, 1.0, 100.0, ir.DARK, n, 1 / math.sqrt(6)) for n in z]
    )
    assert np.all(readings == np.round(readings)) and readings.min() >= 0
    assert readings.std() == pytest.approx(
        math.hypot(ir.noise_sd(100.0) / math.sqrt(6), 1 / math.sqrt(12)), rel=0.03
    )
    assert ir.raw_reading(1e9, 1.0, 700.0, ir.DARK, 0.0, 1.0) == 4095


def test_light_from_the_side_takes_more_from_the_sensor_that_faces_it_and_blinds_it():
    facing = ir.headroom(0, 1.0, 0.0, 3900.0, math.cos(ir.BEARINGS[0]), math.sin(ir.BEARINGS[0]))
    away = ir.headroom(4, 1.0, 0.0, 3900.0, math.cos(ir.BEARINGS[0]), math.sin(ir.BEARINGS[0]))
    assert facing < ir.BLINDED < away
    assert ir.saturate(2000.0, facing) <= facing < 2000 * 0.9


def test_the_beacon_is_seen_farther_than_any_reflection():
    threshold = 12.0
    reach = {}
    for target in TARGETS:
        distances = np.linspace(0.08, 1.5, 600)
        seen = [front_pair(d, 0.0, InfraredConfig(target=target))[0] > threshold for d in distances]
        reach[target] = distances[np.flatnonzero(seen)[-1]]
    assert reach["shell"] < reach["tape"] < reach["cup"] < 0.2 < 0.4 < reach["beacon"]


@pytest.mark.parametrize("warp", range(len(WARPS)))
def test_distortions_rise_strictly(warp):
    assert np.all(np.diff([ir.warped(float(count), warp) for count in range(4000)]) > 0)


def test_calibration_is_the_mean_of_a_hundred_readings():
    rng = np.random.default_rng(5)
    _, offsets = ir.draw_units(rng, CONFIG)
    assert np.all((70 <= offsets) & (offsets <= 170))
    bias = np.array([ir.calibrate(rng, CONFIG, offsets) for _ in range(200)])
    assert np.abs(bias.mean(axis=0) - offsets).max() < 0.2 and bias.std() < 50
    assert np.abs(bias - offsets).max() <= 3  # 6 counts over √100, rounded


def test_inversion_returns_distance_and_bearing_inside_the_working_range():
    table = inversion_table(CONFIG)
    for distance in np.linspace(0.08, 0.13, 11):
        for bearing in np.radians(np.linspace(-25, 25, 11)):
            d, b = invert(table, *front_pair(distance, bearing, CONFIG))
            assert d == pytest.approx(distance, abs=0.6e-3) and b == pytest.approx(
                bearing, abs=math.radians(0.6)
            )


def test_inversion_gives_finite_numbers_for_any_readings():
    table = inversion_table(CONFIG)
    for left in (0.0, 3.0, 4095.0):
        for right in (0.0, 3.0, 4095.0):
            distance, bearing = invert(table, left, right)
            assert 0.07 < distance <= 0.25 and abs(bearing) <= WIDEST + 1e-9


def test_two_readings_determine_the_place_worse_farther_off_and_aside():
    spread = uncertainty(np.array([0.08, 0.105, 0.13, 0.16]), np.radians([0.0, 15.0, 34.0]), CONFIG)
    assert np.all(np.diff(spread[0, :, 0]) > 0) and spread[0, 1, 0] < 1e-3 < spread[0, 3, 0]
    assert spread[1, 1, 0] < math.radians(1) < math.radians(4) < spread[1, 1, 2]


@pytest.mark.parametrize("target", ["cup", "shell"])
def test_the_compiled_formula_is_what_rays_see(target):
    rng = np.random.default_rng(1)
    line = make_track(TrackConfig(judder="none"), rng)
    world = World(2, [line], drive="planar", spacing_m=0.15)
    config = InfraredConfig(target=target)
    rays = RayProximity(world, config)
    radius, strength, beacon = ir.strength_of(config)
    seen = 0
    for _ in range(60):
        heading = rng.uniform(-3, 3)
        world.place(0, 0, 0.01, -0.02, heading)
        centres = []
        for robot in (1, 2):  # they may hide each other
            angle = rng.uniform(-math.pi, math.pi)
            distance = rng.uniform(0.08, 0.25)
            centres.append((0.01 + distance * math.cos(angle), -0.02 + distance * math.sin(angle)))
            world.place(0, robot, *centres[-1], rng.uniform(-3, 3))
        cx, cy = np.array(centres).T.copy()
        formula = [
            ir.circles_light(
                k,
                0.01,
                -0.02,
                math.cos(heading),
                math.sin(heading),
                ir.Circles(cx, cy, 2, radius, strength, beacon, np.zeros(ir.RAYS)),
            )
            for k in range(8)
        ]
        np.testing.assert_allclose(rays.light(0, 0), formula, rtol=1e-9, atol=1e-9)
        seen += np.count_nonzero(np.array(formula) > 5)
    assert seen > 60


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"offset_counts": (200.0, 100.0)}, "low <= high"),
        ({"target": "mirror"}, "one of 'cup', 'shell', 'tape', 'beacon'"),
        ({"samples": 0}, "a whole number from 1 to 64"),
    ],
)
def test_impossible_sensors_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        InfraredConfig(**values)


def test_without_noise_two_readings_determine_a_place_exactly():
    config = InfraredConfig(noise=0.0)
    bound = uncertainty(np.array([0.09, 0.11]), np.radians([0.0, 10.0]), config)
    assert np.all(bound == 0)
    noisy = uncertainty(np.array([0.09, 0.11]), np.radians([0.0, 10.0]), InfraredConfig(noise=2.0))
    once = uncertainty(np.array([0.09, 0.11]), np.radians([0.0, 10.0]), InfraredConfig())
    np.testing.assert_allclose(noisy, 2 * once)
