"""The e-puck's stepper motors: whole steps per second in, firmware quantisation and saturation.

The firmware (gctronic/e-puck-library, advance_one_timer/e_motors.c) clamps a command to ±1000
steps/s and waits int(10000 / |v|) ticks of 0.1 ms between steps, so that the wheel turns at 10000 /
int(10000 / |v|) steps/s. Above 500 the grid is coarse: 625, 667, 714, 769, 833, 909, 1000.

>>> motor_speed(550), round(motor_speed(-350), 1), motor_speed(2000)
(555.5555555555555, -357.1, 1000.0)
"""

from workbench.compiled import compiled
from workbench.robot.geometry import MAX_STEPS, MAX_STEPS_EPUCK2, STEP, TICKS, TRACK


@compiled
def wheel_speed(command: int, most: int, ticks: int) -> float:
    """Return the steps/s at which a wheel really turns: at most ``most``, each step a whole number
    of ticks (0: any speed).
    """
    speed = min(abs(command), most)
    if speed == 0:
        return 0.0
    real = ticks / (ticks // speed) if ticks else float(speed)
    return real if command > 0 else -real


@compiled
def motor_speed(command: int) -> float:
    """Return the steps/s at which an e-puck's wheel really turns for a commanded whole number of
    steps/s.
    """
    return wheel_speed(command, MAX_STEPS, TICKS)


def motor_speed_epuck2(command: int) -> float:
    """Return the steps/s of an e-puck2 for the same command: half steps of a timer of 10 µs, at
    most ±1100 (its src/motors.c).
    """
    speed = min(abs(command), MAX_STEPS_EPUCK2)
    if speed == 0:
        return 0.0
    real = 100_000 / (2 * int(100_000 / (2 * speed)))
    return real if command > 0 else -real


def twist(left_steps: float, right_steps: float) -> tuple[float, float]:
    """Return forward speed in m/s and turning rate in rad/s of exact rolling at two wheel speeds in
    steps/s.
    """
    return (left_steps + right_steps) * STEP / 2, (right_steps - left_steps) * STEP / TRACK
