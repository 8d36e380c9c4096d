"""Tracks: closed, of the stated curvature and direction, and with judder of the stated spectrum."""

import math
from dataclasses import replace

import numpy as np
import pytest

from workbench.arena.tracks import TrackConfig, make_track

SHAPES = ("circle", "stadium", "eight")


def _track(seed=0, **kinds):
    return make_track(TrackConfig(**kinds), np.random.default_rng(seed))


def _curvature(points):
    ahead = np.roll(points, -1, 0) - points
    behind = points - np.roll(points, 1, 0)
    turn = np.arctan2(
        behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], (behind * ahead).sum(1)
    )
    return turn / np.hypot(*ahead.T), turn.sum()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("direction", ["clockwise", "anticlockwise"])
def test_nominal_loops_are_closed_evenly_sampled_and_turn_as_stated(shape, direction):
    track = _track(shape=shape, direction=direction, judder="none")
    gaps = np.hypot(*(np.roll(track.nominal, -1, 0) - track.nominal).T)
    np.testing.assert_allclose(gaps, track.length_m / len(gaps), rtol=1e-3)
    curvature, total = _curvature(track.nominal)
    sign = -1 if direction == "clockwise" else 1
    assert total == pytest.approx(0 if shape == "eight" else sign * 2 * math.pi, abs=1e-6)
    smooth = np.convolve(np.tile(curvature, 3), np.ones(41) / 41, "same")[
        len(curvature) : -len(curvature)
    ]
    assert np.abs(smooth).max() == pytest.approx(1 / track.radius_m, rel=0.01)
    if shape == "eight":
        half = len(track.nominal) // 2
        assert (
            np.sign(_curvature(track.nominal[:half])[0][100:-100].mean()) == sign
        )  # the first lobe


def test_eight_crosses_itself_at_a_right_angle():
    track = _track(shape="eight", judder="none")
    _, _, first = track.pose(0.0)
    _, _, second = track.pose(track.length_m / 2)
    assert abs(math.cos(first - second)) < 1e-3


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("judder", ["spectrum", "replan"])
def test_judder_has_the_stated_rms_and_is_continuous_around_the_loop(shape, judder):
    track = _track(shape=shape, judder=judder, seed=3)
    assert math.sqrt(np.mean(track.offset**2)) == pytest.approx(0.004, rel=1e-9)
    jumps = np.abs(np.roll(track.offset, -1) - track.offset)
    assert jumps.max() < 0.002


def test_spectrum_judder_lies_in_its_band_only():
    track = _track(judder="spectrum", seed=2)
    power = np.abs(np.fft.rfft(track.offset)) ** 2
    wavelength = track.length_m / np.maximum(np.arange(power.size), 1e-9)
    inside = (wavelength >= 0.1 - 1e-9) & (wavelength <= 0.3 + 1e-9)
    assert power[~inside].sum() < 1e-20 * power[inside].sum()
    np.testing.assert_allclose(power[inside], power[inside].mean(), rtol=1e-6)  # flat


def test_a_band_without_a_harmonic_is_refused():
    with pytest.raises(
        ValueError,
        match=r"wavelengths_m = \(1.6, 2.0\): no harmonic of a loop of 3.14 m lies in this band",
    ):
        _track(wavelengths_m=(1.6, 2.0))


def test_replanned_judder_is_made_of_plateaus():
    track = _track(judder="replan", seed=2)
    flat = np.abs(np.roll(track.offset, -1) - track.offset) < 1e-9
    assert 0.75 < flat.mean() < 0.95  # a ramp of 20 mm every 0.1 to 0.3 m


def test_judder_depends_on_the_seed_and_only_on_it():
    np.testing.assert_array_equal(_track(seed=5).line, _track(seed=5).line)
    assert not np.array_equal(_track(seed=5).line, _track(seed=6).line)


@pytest.mark.parametrize("shape", SHAPES)
def test_deviation_measures_the_lateral_offset_left_positive(shape):
    track = _track(shape=shape, seed=1)
    every = slice(0, None, 25)
    np.testing.assert_allclose(track.deviation(track.line[every]), 0, atol=1e-12)
    measured = track.deviation(track.line[every], nominal=True)
    np.testing.assert_allclose(measured, track.offset[every], atol=3e-4)


def test_a_long_convoy_gets_a_larger_loop():
    config = replace(TrackConfig(), shape="eight")
    rng = np.random.default_rng(0)
    small = make_track(config, rng, convoy_length_m=0.6)
    large = make_track(config, rng, convoy_length_m=64 * 0.15)
    assert small.radius_m == 0.5
    assert large.length_m / 2 * 0.6 == pytest.approx(64 * 0.15, rel=1e-3)


@pytest.mark.parametrize("shape", ["circle", "stadium", "eight"])
def test_places_on_the_loop_and_deviations_are_found_in_both_branches(shape):
    track = make_track(TrackConfig(shape=shape, judder="none"), np.random.default_rng(0))
    at = np.linspace(0, track.length_m, 57, endpoint=False)
    poses = np.array([track.pose(s) for s in at])
    left = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
    along, away = track.lateral(poses[:, :2] + 0.01 * left, poses[:, 2])
    gap = (along - at + track.length_m / 2) % track.length_m - track.length_m / 2
    assert np.abs(gap).max() < 0.003 and away == pytest.approx(0.01, abs=2e-4)
    assert track.nearest(poses[:, :2], poses[:, 2]).shape == (57,)
