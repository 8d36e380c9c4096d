"""The smoothness protocol on synthetic paths whose answers are known."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from workbench.arena.tracks import TrackConfig, make_track
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.carrot import CarrotPI
from workbench.lab.records import sampled_blocks
from workbench.lab.runs import evaluate
from workbench.measures.judder import deviations, judder, tractrix_gain, tractrix_line, transfer
from workbench.measures.motion import Motion, follow

TRACK = make_track(TrackConfig(judder="none", direction="anticlockwise"), np.random.default_rng(0))
LOOP = TRACK.length_m
ORACLE = json.loads((Path(__file__).parents[1] / "data" / "smoothness.json").read_text())


def _on_the_circle(offsets, loops=6.0, speed=0.06, fs=10.0):
    """Robots that drive a circle of 0.5 m anticlockwise with lateral offsets(s), left positive, one
    function per robot.
    """
    along = np.arange(0, (loops + 0.5) * LOOP, speed / fs)
    angle = along / 0.5
    radii = np.stack([0.5 - offset(along) for offset in offsets], axis=1)
    return Motion.of_path(
        np.stack([radii * np.cos(angle)[:, None], radii * np.sin(angle)[:, None]], axis=-1),
        fs,
        TRACK,
    )


def _wave(harmonic, mm, phase=0.0):
    return lambda s: 1e-3 * mm * math.sqrt(2) * np.sin(2 * np.pi * harmonic * s / LOOP + phase)


def test_judder_is_the_rms_in_the_band_and_what_lies_outside_is_told_apart():
    # harmonic 16 of 3.14 m is 0.196 m, in the band; 4 is 0.785 m, the way; 8 is 0.39 m, neither
    both = lambda s: _wave(16, 2.0)(s) + _wave(4, 3.0)(s) + _wave(8, 5.0)(s) + 0.004  # noqa: E731
    line = judder(_on_the_circle([both])).iloc[0]
    assert line["judder_mm"] == pytest.approx(2.0, rel=0.01)
    assert line["low_band_mm"] == pytest.approx(3.0, rel=0.01)
    assert line["offset_mm"] == pytest.approx(4.0, abs=0.02)
    assert line["loops"] == 6


@pytest.mark.parametrize("gain", [0.3, 1.0, 1.8])
def test_attenuation_and_amplification_come_out_as_gain_product_and_coherence(gain):
    robots = [_wave(16, 2.0), _wave(16, 2.0 * gain), _wave(16, 2.0 * gain**2)]
    table = judder(_on_the_circle(robots))
    np.testing.assert_allclose(table["gain"][1:], gain, rtol=1e-3)
    np.testing.assert_allclose(table["transmitted"][1:], gain, rtol=1e-3)
    np.testing.assert_allclose(table["product"][1:], [gain, gain**2], rtol=1e-3)
    np.testing.assert_allclose(table["coherence"][1:], 1.0, atol=1e-6)


def test_a_pure_delay_in_space_changes_neither_gain_nor_coherence():
    table = judder(_on_the_circle([_wave(16, 2.0), _wave(16, 2.0, phase=-1.3)]))
    assert table["gain"][1] == pytest.approx(1.0, rel=1e-3) and table["coherence"][
        1
    ] == pytest.approx(1.0, abs=1e-6)


def test_white_noise_is_found_with_its_power_and_is_not_coherent():
    rng = np.random.default_rng(1)
    before, after = rng.normal(size=(2, 200 * 628)) * 1e-3
    found = transfer(before, after, 628, 0.005)
    band = (found.frequency >= 1 / 0.3) & (found.frequency <= 1 / 0.1)
    # white noise of σ² spreads evenly up to 1 / (2 · 5 mm) = 100 cycles/m: σ²/100 each
    np.testing.assert_allclose(found.before[band].mean(), 1e-6 / 100, rtol=0.05)
    assert found.coherence[band].mean() == pytest.approx(1 / 200, abs=0.004)  # bias of 200 averages
    assert (
        np.median(found.gain[band]) < 0.15
    )  # H1 is not fooled by what is not transmitted, though both are as strong


def test_coherence_is_the_transmitted_part_of_the_power():
    # output = 0.5 · input + noise of the same power as what is transmitted: γ² = 1/2, H1 = 0.5, G =
    # 0.5 · √2
    rng = np.random.default_rng(2)
    before = rng.normal(size=300 * 628)
    after = 0.5 * before + 0.5 * rng.normal(size=before.size)
    found = transfer(before, after, 628, 0.005)
    assert found.coherence.mean() == pytest.approx(0.5, abs=0.02)
    assert np.median(found.gain) == pytest.approx(0.5, abs=0.02)
    assert math.sqrt(found.after.sum() / found.before.sum()) == pytest.approx(
        0.5 * math.sqrt(2), rel=0.01
    )


@pytest.mark.parametrize("case", ORACLE["tractrix_gain_sinusoid"]["values"])
def test_tractrix_gain_by_wavelength(case):
    """Formula and pulled rods against an independent integration."""
    values = ORACLE["tractrix_gain_sinusoid"]["values"][case]
    distance, wavelength = (float(part.split("=")[1]) for part in case.split(","))
    assert tractrix_gain(distance, wavelength) == pytest.approx(
        values["amplitude_ratio_linear_1/sqrt(1+(2pi d/L)^2)"], abs=1e-12
    )
    x = np.arange(0, 2 + 10 * wavelength, 0.002)
    path = np.stack([x, 0.001 * np.sin(2 * np.pi * x / wavelength)], axis=1)
    rod = tractrix_line(path, distance, 1)[:, 1]
    late = rod[rod[:, 0] > 2]
    assert np.abs(late[:, 1]).max() / 0.001 == pytest.approx(
        values["amplitude_ratio_ode"], abs=2e-3
    )
    np.testing.assert_allclose(np.linalg.norm(rod - path, axis=1), distance, atol=1e-9)


@pytest.mark.parametrize("case", ORACLE["circle_steady_state"]["values"])
def test_rods_on_a_circle_cut_in_to_the_steady_radius(case):
    values = ORACLE["circle_steady_state"]["values"][case]
    radius, distance = (float(part.split("=")[1]) for part in case.split(","))
    angle = np.arange(0, 60, 0.004)
    line = tractrix_line(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), distance, 4)
    found = np.linalg.norm(line[-1], axis=1)
    steady = np.array(values["radii_leader_to_F4"])
    settled = steady > 0.05  # a circle that the last rod's end collapses to is reached slowly
    np.testing.assert_allclose(found[settled], steady[settled], atol=1e-3)


def test_the_ideal_follower_has_no_excess_on_a_real_leader_s_path():
    config = ConvoyConfig(followers=1, drive="planar", seed=3)
    leader = follow(CarrotPI(), config, minutes=10)
    ideal = Motion.of_path(tractrix_line(leader.position[:, 0], 0.15, 2), 10.0, leader.track)
    table = judder(ideal)
    assert table["excess"][1] == pytest.approx(1.0, abs=0.02) and table["coherence"][1] > 0.99
    assert table["excess"][2] == pytest.approx(
        0.96, abs=0.04
    )  # on a smaller circle waves are shorter than along the loop
    assert judder(leader)["excess"][1] == pytest.approx(1.0, abs=0.05)  # a carrot is nearly a rod


def test_added_judder_is_excess():
    driven = follow(CarrotPI(), ConvoyConfig(followers=1, drive="planar", seed=3), minutes=10)
    line = tractrix_line(driven.position[:, 0], 0.15, 1)
    ideal = judder(Motion.of_path(line, 10.0, driven.track))["judder_mm"][1]
    angle = np.unwrap(np.arctan2(line[:, 1, 1], line[:, 1, 0]))
    shaken = line.copy()
    radius = np.linalg.norm(line[:, 1], axis=1) + 0.001 * math.sqrt(2) * np.sin(
        0.5 * angle * 2 * np.pi / 0.17
    )
    shaken[:, 1] = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    table = judder(Motion.of_path(shaken, 10.0, driven.track))
    assert table["judder_mm"][1] == pytest.approx(math.hypot(ideal, 1.0), rel=0.1)  # powers add
    assert table["excess"][1] > 1.5 and table["coherence"][1] < 0.8


def test_the_branches_of_a_figure_eight_are_told_apart():
    track = make_track(TrackConfig(shape="eight", judder="none"), np.random.default_rng(0))
    path = np.concatenate([track.nominal] * 3)[::6]
    found = deviations(Motion.of_path(path, 10.0, track), track)
    assert (
        found.loops == 2 and np.abs(found.lateral).max() < 1e-4
    )  # a jump to the other branch would be centimetres


def test_a_robot_that_turns_where_the_eight_crosses_itself_loses_no_lap():
    track = make_track(TrackConfig(shape="eight", judder="none"), np.random.default_rng(0))
    path = np.concatenate([track.nominal] * 4)[::6]
    motion = Motion.of_path(path, 10.0, track)
    centre = np.flatnonzero(np.hypot(*path.T) < 0.01)[2]
    heading = motion.heading.copy()
    heading[centre : centre + 8, 0] += np.linspace(
        0, np.pi / 2, 8
    )  # looks along the other branch for a moment
    turned = deviations(replace(motion, heading=heading), track)
    quiet = deviations(motion, track)
    assert turned.loops == quiet.loops == 3
    assert np.abs(turned.lateral - quiet.lateral).max() < 0.01


def test_convoys_longer_than_half_a_loop_keep_their_order():
    config = ConvoyConfig(followers=14, drive="planar", seed=1)
    table = judder(follow(CarrotPI(), config, minutes=6))
    assert (
        0.5 * config.followers * 0.15
        < make_track(config.track, np.random.default_rng(0), convoy_length_m=2.1).length_m
    )
    assert (table["gain"][1:] < 5).all() and (table["coherence"][1:3] > 0.9).all()


def test_coherence_of_few_loops_is_not_told_and_unrelated_motion_shows_its_bias():
    few = judder(_on_the_circle([_wave(16, 2.0), _wave(17, 2.0)], loops=3.0))
    assert (
        few["loops"][1] == 3 and np.isnan(few["coherence"][1]) and np.isnan(few["transmitted"][1])
    )
    rng = np.random.default_rng(3)
    for loops in (4, 22):
        found = transfer(*rng.normal(size=(2, loops * 628)), 628, 0.005)
        assert found.coherence.mean() == pytest.approx(1 / loops, rel=0.15)


def test_on_a_stadium_geometry_itself_is_in_the_band():
    # the limit that the module's manual states: X says nothing there, as ideal rods already have
    # 1.1 and 1.6
    track = make_track(TrackConfig(shape="stadium"), np.random.default_rng(3))
    path = np.concatenate([track.line] * 8)[::6]
    table = judder(Motion.of_path(tractrix_line(path, 0.15, 2), 10.0, track))
    np.testing.assert_allclose(table["excess"][1:], [1.06, 1.64], atol=0.05)


def test_driving_back_over_the_same_place_counts_once():
    offsets = [_wave(16, 2.0)]
    smooth = _on_the_circle(offsets)
    path = smooth.position[:, 0]
    detour = np.concatenate(
        [path[:700], path[700:600:-1], path[600:]]
    )  # turns round, and comes again
    headings = np.concatenate(
        [smooth.heading[:700], smooth.heading[700:600:-1], smooth.heading[600:]]
    )
    motion = Motion.of_path(detour, 10.0, TRACK)
    motion = replace(motion, heading=headings)
    assert judder(motion)["judder_mm"][0] == pytest.approx(judder(smooth)["judder_mm"][0], rel=0.02)


def test_a_run_a_motion_and_a_recording_give_the_same_numbers():
    config = ConvoyConfig(followers=1, drive="planar", seed=4)
    run = evaluate(CarrotPI(), config, minutes=4.1, progress=False)
    motion = follow(CarrotPI(), config, minutes=4.1)
    assert judder(run).equals(judder(motion))
    _, block = sampled_blocks(run.records)[-1]
    table = judder(_as_table(block), motion.track)
    np.testing.assert_allclose(table["judder_mm"], judder(run)["judder_mm"], rtol=1e-6)


def _as_table(samples):
    lines = []
    for robot in range(samples.shape[1]):
        at = samples[:, robot]
        lines.append(
            pd.DataFrame(
                {
                    "time_s": np.arange(len(at)) / 10,
                    "robot": robot,
                    "x_m": at["x"].astype(float),
                    "y_m": at["y"].astype(float),
                    "heading_rad": at["heading"].astype(float),
                    "left_steps": at["left"],
                    "right_steps": at["right"],
                }
            )
        )
    return pd.concat(lines)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: judder(Motion.of_path(np.ones((5, 2)), 10.0)),
            "does not know its track; give track=",
        ),
        (
            lambda: judder(_on_the_circle([_wave(4, 1.0)], loops=0.7)),
            r"expected at least one loop of 3\.14 m: drive longer",
        ),
        (
            lambda: judder(_on_the_circle([_wave(4, 1.0)]), band_m=(0.3, 0.1)),
            r"band_m = \(0.3, 0.1\); expected \(shortest, longest\)",
        ),
        (
            lambda: judder(_on_the_circle([_wave(4, 1.0)]), band_m=(0.0, 0.1)),
            "the shortest at least 0.01",
        ),
        (
            lambda: judder(_on_the_circle([_wave(4, 1.0)], fs=1.5)),
            "samples are 0.040 m apart; expected a quarter",
        ),
        (
            lambda: tractrix_line(np.full((5, 2), np.nan), 0.1, 1),
            "leader has numbers that are not finite",
        ),
        (
            lambda: tractrix_line(np.eye(2), 0.1, 2, start=[[0, 0]]),
            r"start has shape \(1, 2\); expected \(2, 2\)",
        ),
        (lambda: transfer(np.zeros(5), np.zeros(6), 5, 0.005), r"expected two of \(loops \* 5,\)"),
        (lambda: tractrix_line(np.zeros((5, 3)), 0.1, 1), r"leader has shape \(5, 3\)"),
        (lambda: tractrix_line(np.zeros((5, 2)), 0.0, 1), "distance_m = 0.0; expected"),
    ],
)
def test_bad_input_is_refused_with_the_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
