"""Ground sensors: range, calibration and noise."""

import numpy as np
import pytest

from workbench.robot.ground import (
    MODULES,
    NOISE,
    WHITE,
    darkness,
    ground_reading,
)


@pytest.mark.parametrize("module", MODULES)
@pytest.mark.parametrize("sensor", [0, 1, 2])
def test_white_and_black_read_what_real_sensors_read(module, sensor):
    black = MODULES[module][sensor]
    assert 930 <= ground_reading(0.0, WHITE[sensor], black, 0.0) == WHITE[sensor] <= 965
    assert 247 <= ground_reading(1.0, WHITE[sensor], black, 0.0) == black <= 485


@pytest.mark.parametrize("dark", [0.0, 0.25, 0.5, 1.0])
def test_calibration_inverts_the_reading_within_a_count(dark):
    for white, black in zip(WHITE, MODULES["a"], strict=True):
        assert darkness(ground_reading(dark, white, black, 0.0), white, black) == pytest.approx(
            dark, abs=1 / 600
        )


def test_readings_are_whole_clipped_and_as_noisy_as_stated():
    noise = np.random.default_rng(0).standard_normal(20_000)
    readings = np.array([ground_reading(0.5, 948.0, 287.0, n) for n in noise])
    assert np.all(readings == np.round(readings))
    assert readings.std() == pytest.approx(np.hypot(NOISE, 1 / np.sqrt(12)), rel=0.03)
    assert (
        ground_reading(0.0, 948.0, 338.0, 1e6) == 1023
        and ground_reading(1.0, 948.0, 338.0, -1e6) == 0
    )
    assert darkness(2000.0, 948.0, 338.0) == 0.0 and darkness(0.0, 948.0, 338.0) == 1.0
