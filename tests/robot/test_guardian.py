"""The guardian stops the robot of a program that is killed, stopped or silent."""

import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.faults import LinkLost
from workbench.robot.guardian import GuardedLink
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator
from workbench.robot.wire.epuck2 import COMMAND_BYTES, ENTRY, command

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


@pytest.fixture
def talker():
    """A peer that talks without being asked and never stops; what it heard is kept."""
    server = socket.create_server(("127.0.0.1", 0))
    heard = bytearray()
    leave = threading.Event()

    def talk():
        client, _ = server.accept()
        with client:
            client.setblocking(False)
            while not leave.is_set():
                try:
                    client.send(b"\x55" * 4096)
                except BlockingIOError:
                    time.sleep(1e-3)
                except OSError:
                    return
                try:
                    heard.extend(client.recv(4096))
                except BlockingIOError:
                    pass
                except OSError:
                    return

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    yield f"127.0.0.1:{server.getsockname()[1]}", heard
    leave.set()
    thread.join()
    server.close()


def test_a_peer_that_talks_at_once_and_a_program_that_does_not_read_do_not_keep_it_from_stopping(
    talker,
):
    address, heard = talker
    link = GuardedLink(ENTRY, address, {}, silence_s=0.5, timeout_s=0.2)  # it could be opened
    link.write(command(300, 300, sensors=False))
    stop = bytes(COMMAND_BYTES) + command(0, 0, sensors=False)
    until = time.monotonic() + 2.0
    while stop not in heard and time.monotonic() < until:
        time.sleep(0.02)  # the program reads nothing, its buffer is full long before
    assert stop in heard
    link._wire.close()
    link._child.kill()  # nobody can be told by such a peer that the robot stands
    link._child.wait()
