"""SPARC and LDLJ: values of the authors' own code, guards, and invariances."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from workbench.measures.smoothness import ldlj, ldlj_vector, sparc

ORACLE = json.loads((Path(__file__).parents[1] / "data" / "smoothness.json").read_text())


def _ripple(depth):
    return lambda: 0.06 * (1 + depth * np.sin(2 * np.pi * 2 * np.arange(1000) / 50))


def _minimum_jerk():
    t = np.arange(1001) / 1000
    return 30 * t**2 - 60 * t**3 + 30 * t**4


def _judder():
    t = np.arange(1000) / 50
    i = np.arange(40)
    golden = (math.sqrt(5) - 1) / 2
    waves = np.sin(2 * np.pi * (np.outer(t, 0.3 + 5.7 * i / 39) + (i * golden) % 1))
    return 0.06 * (1 + 0.2 * waves.sum(axis=1) / math.sqrt(20))


SPEEDS = {
    "G1_doctest_gaussian": lambda: np.exp(-5 * np.arange(-1, 1, 0.01) ** 2),
    "MJ_1000Hz": _minimum_jerk,
    "G5_five_bells": lambda: sum(
        np.exp(-25 * (np.arange(401) / 100 - 0.5 - 0.75 * m) ** 2) for m in range(5)
    ),
    "C_ripple_05": _ripple(0.05),
    "C_ripple_11": _ripple(0.11),
    "C_ripple_50": _ripple(0.5),
    "J_judder20": _judder,
}


def _velocity(heading):
    return 0.06 * np.stack([-np.sin(heading), np.cos(heading)], axis=1)


T = np.arange(1000) / 50
VELOCITIES = {
    "circle_R0.5": _velocity(0.12 * T),
    "circle_heading_judder": _velocity(0.12 * T + 0.3 * np.sin(2 * np.pi * T)),
}


def test_every_signal_of_the_oracle_is_tested():
    assert set(SPEEDS) == set(ORACLE["speed_signals"]) and set(VELOCITIES) == set(
        ORACLE["vector_signals"]
    )


@pytest.mark.parametrize("name", SPEEDS)
def test_speed_measures_equal_the_authors_code(name):
    case = ORACLE["speed_signals"][name]
    speed = SPEEDS[name]()
    assert speed.sum() == pytest.approx(case["check"]["sum"], abs=1e-9)  # it is the oracle's signal
    for fc in (10, 20):
        assert sparc(speed, case["fs"], float(fc)) == pytest.approx(
            case["sparc"][f"fc={fc}"]["value"], abs=1e-9
        )
    assert ldlj(speed, case["fs"]) == pytest.approx(case["ldlj"], abs=1e-9)


@pytest.mark.parametrize("name", VELOCITIES)
def test_the_vector_measure_equals_the_authors_code(name):
    case = ORACLE["vector_signals"][name]
    velocity = VELOCITIES[name]
    assert ldlj_vector(velocity, case["fs"]) == pytest.approx(case["ldlj_vec"], abs=1e-9)
    speed = np.linalg.norm(velocity, axis=1)
    assert sparc(speed, case["fs"]) == pytest.approx(case["sparc_of_speed_fc10"], abs=1e-9)


@pytest.mark.parametrize("fs", [8, 10])
def test_the_spectrum_is_not_counted_twice_above_half_the_sampling_rate(fs):
    speed = 0.06 * (1 + 0.2 * np.sin(2 * np.pi * np.arange(20 * fs) / fs))
    case = ORACLE["sampling_traps"][f"fs={fs}"]
    assert sparc(speed, fs) == pytest.approx(case["fc=min(10,fs/2)"], abs=1e-9)
    assert abs(sparc(speed, fs) - case["default fc=10"]) > 4  # what the unguarded definition gives


def test_sparc_of_speed_is_blind_to_judder_at_constant_speed_and_the_vector_jerk_is_not():
    quiet, restless = VELOCITIES.values()
    assert sparc(np.linalg.norm(quiet, axis=1), 50) == pytest.approx(
        sparc(np.linalg.norm(restless, axis=1), 50), abs=1e-9
    )
    assert ldlj_vector(quiet, 50) > ldlj_vector(restless, 50) + 10


def test_constant_speed_has_no_jerk_and_gives_infinity_instead_of_round_off():
    assert ldlj(np.linalg.norm(VELOCITIES["circle_R0.5"], axis=1), 50) == math.inf
    assert ldlj_vector(np.tile([0.3, -0.1], (50, 1)), 10) == math.inf


@given(scale=st.floats(1e-3, 1e3), rate=st.floats(1.0, 1000.0))
def test_neither_unit_nor_duration_changes_the_measures_of_one_shape(scale, rate):
    shape = SPEEDS["G5_five_bells"]()
    wide = 1e9  # so that the same part of the spectrum counts at every rate
    assert sparc(scale * shape, rate, wide) == pytest.approx(sparc(shape, 100.0, wide), rel=1e-9)
    assert ldlj(scale * shape, rate) == pytest.approx(ldlj(shape, 100.0), rel=1e-9)
    vector = np.stack([shape, np.roll(shape, 50)], axis=1)
    assert ldlj_vector(scale * vector, rate) == pytest.approx(ldlj_vector(vector, 100.0), rel=1e-9)


def test_the_vector_measure_does_not_depend_on_the_direction():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    velocity = VELOCITIES["circle_heading_judder"]
    assert ldlj_vector(velocity @ turn.T, 50) == pytest.approx(ldlj_vector(velocity, 50), abs=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: sparc([1.0], 10),
            r"speed has shape \(1,\); expected \(T,\) with at least 2 samples",
        ),
        (lambda: sparc(np.ones((5, 2)), 10), r"speed has shape \(5, 2\)"),
        (lambda: sparc([1.0, np.nan, 2.0], 10), "1 numbers of speed are not finite"),
        (lambda: sparc(np.zeros(50), 10), "speed is 0 in all of 50 samples"),
        (lambda: sparc(np.ones(50), 0.0), "fs = 0.0; expected samples per second, above 0"),
        (lambda: sparc(np.ones(50), 10, 0.0), "fc = 0.0; expected a frequency above 0 Hz"),
        (lambda: sparc(np.ones(50), 100, 0.01), "has fewer than two lines above 0.05; raise fc"),
        (
            lambda: sparc(np.sin(2 * np.pi * 20 * np.arange(500) / 100), 100, 1.0),
            "has fewer than two lines",
        ),
        (lambda: ldlj([1.0, 2.0], 10), "at least 3 samples"),
        (lambda: ldlj(np.zeros(9), 10), "the velocity is 0 in all of 9 samples"),
        (lambda: ldlj_vector(np.ones(9), 10), r"velocity has shape \(9,\); expected \(T, d\)"),
    ],
)
def test_bad_input_is_refused_with_the_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
