"""The guardian stops the robot of a program that is killed, stopped or silent."""

import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.faults import LinkLost
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)
DRIVING = """
import workbench as wb
with wb.open_robot({url!r}, guardian=True) as robot:
    robot.enable("proximity")
    print("go", flush=True)
    while True:
        robot.step()
        robot.set_motors_speed(300, 300)
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="guardians are for POSIX systems")


def _emulator(protocol):
    return Emulator(SimulatedRobot(CONFIG), protocol)


def _until_it_stands(emulator, seconds=1.0):
    """Seconds until the body was told to stand, or None."""
    begun = time.monotonic()
    while time.monotonic() - begun < seconds:
        if emulator.robot._speed == (0, 0):
            return time.monotonic() - begun
        time.sleep(0.01)
    return None


def kill(protocol, number, moments):
    """Send a signal to programs some seconds after they began to drive; return how many robots
    stood within a second.
    """
    stopped = 0
    with _emulator(protocol) as emulator:
        for seconds in moments:
            program = subprocess.Popen(
                [sys.executable, "-c", DRIVING.format(url=emulator.url)], stdout=subprocess.PIPE
            )
            assert program.stdout.readline() == b"go\n"
            time.sleep(seconds)
            program.send_signal(number)
            stopped += _until_it_stands(emulator) is not None
            program.kill()
            program.communicate()
            time.sleep(0.1)  # the guardian hangs up
    return stopped


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("protocol", ["epuck1", "overo", "epuck2"])
def test_a_killed_or_stopped_program_leaves_a_robot_that_stands(protocol, number):
    moments = np.random.default_rng(1).uniform(0.05, 0.5, 3).tolist()
    assert kill(protocol, number, moments) == len(moments)


@pytest.mark.parametrize("protocol", ["epuck1", "epuck2"])
def test_a_robot_behind_a_guardian_is_driven_as_any_other(protocol):
    with (
        _emulator(protocol) as emulator,
        open_robot(emulator.url, guardian=True, timeout_s=1.0) as robot,
    ):
        robot.enable("proximity", "motor_position")
        robot.calibrate_proximity_sensors()
        robot.set_motors_speed(300, 300)
        for _ in range(5):
            robot.step()
        assert len(robot.get_proximity()) == 8 and robot.get_motor_position()[0] > 50
        assert emulator.robot._speed == (300, 300)
    assert emulator.robot._speed == (0, 0)


def test_a_wire_that_cannot_be_opened_is_said_as_without_a_guardian():
    with pytest.raises(LinkLost, match="nothing answers at 127.0.0.1:1"):
        open_robot("tcp:127.0.0.1:1", guardian=True).connect()
    with pytest.raises(LinkLost, match="cannot be opened"):
        open_robot("serial:/dev/does-not-exist", guardian=True).connect()
