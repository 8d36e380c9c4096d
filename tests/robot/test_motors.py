"""Motors: the firmware's quantisation table, saturation and units."""

import pytest

from workbench.robot import geometry
from workbench.robot.motors import motor_speed, twist

# measured from the firmware's rule, gctronic/e-puck-library e_motors.c: period = int(10000 / |v|)
# ticks of 0.1 ms
FIRMWARE = {
    150: 151.5,
    300: 303,
    350: 357,
    450: 454.5,
    550: 555.6,
    600: 625,
    650: 667,
    700: 714,
    750: 769,
    800: 833,
    850: 909,
    900: 909,
    950: 1000,
    1000: 1000,
}


@pytest.mark.parametrize(("command", "real"), FIRMWARE.items())
def test_speeds_are_quantised_as_in_the_firmware(command, real):
    assert motor_speed(command) == pytest.approx(real, abs=0.5)
    assert motor_speed(-command) == -motor_speed(command)


def test_saturation_at_a_thousand_steps_and_zero_stands_still():
    assert motor_speed(1001) == motor_speed(30_000) == 1000.0
    assert motor_speed(-5000) == -1000.0
    assert motor_speed(0) == 0.0


def test_one_step_is_0_1288_mm_and_the_fastest_wheel_0_128_m_per_s():
    assert geometry.STEP == pytest.approx(0.1288e-3, rel=1e-3)


def test_twist_of_exact_rolling():
    # 300 steps/s apart from each other: ω = 2 · 300 · 0.1288 mm / 53 mm
    forward, turn = twist(-300, 300)
    assert forward == 0.0
    assert turn == pytest.approx(2 * 300 * geometry.STEP / 0.053)
