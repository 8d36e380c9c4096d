"""However a program ends, its robot stands: it ends without ``with``, fails, is told to end, or is
interrupted once or twice at any moment.
"""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot import ends
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)
BEGIN = """
import workbench as wb
robot = wb.open_robot({url!r})
robot.connect()
robot.enable("proximity")
for _ in range(3):
    robot.step()
    robot.set_motors_speed(300, 300)
"""
FOREVER = """
import workbench as wb
print("begun", flush=True)
with wb.open_robot({url!r}) as robot:
    robot.enable("proximity")
    print("go", flush=True)
    while True:
        robot.step()
        robot.set_motors_speed(300, 300)
"""


@pytest.fixture(scope="module", autouse=True)
def interruptible():
    """Programs in the background of a shell inherit that SIGINT is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def emulator():
    with Emulator(SimulatedRobot(CONFIG), "epuck2") as emulator:
        yield emulator


def _stands(emulator):
    """Whether the body was told to stand within a second after the program's end."""
    until = time.monotonic() + 1.0
    while emulator.robot._speed != (0, 0) and time.monotonic() < until:
        time.sleep(0.02)
    return emulator.robot._speed == (0, 0)


def _drove(emulator):
    return any(data[3:7] != bytes(4) for _, data in emulator.heard)


@pytest.mark.parametrize("end", ["", "1 / 0", "import sys; sys.exit(3)", "del robot"])
def test_a_program_that_ends_without_with_leaves_a_robot_that_stands(emulator, end):
    emulator.heard.clear()
    program = BEGIN.format(url=emulator.url) + end
    subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert _drove(emulator) and emulator.robot._speed == (0, 0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_program_that_is_told_to_end_stops_its_robot(emulator, number):
    emulator.heard.clear()
    program = subprocess.Popen(
        [sys.executable, "-c", FOREVER.format(url=emulator.url)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert program.stdout.readline() == b"begun\n" and program.stdout.readline() == b"go\n"
    time.sleep(0.3)
    assert emulator.robot._speed == (300, 300)
    program.send_signal(number)
    program.communicate(timeout=20)
    assert emulator.robot._speed == (0, 0)


def interrupt(emulator, moments):
    """Interrupt programs after so many seconds, every second one twice; return how many left the
    robot driving.
    """
    driving = 0
    for number, seconds in enumerate(moments):
        program = subprocess.Popen(
            [sys.executable, "-c", FOREVER.format(url=emulator.url)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        time.sleep(seconds)
        program.send_signal(signal.SIGINT)
        if number % 2:
            time.sleep(1e-4)
            program.send_signal(signal.SIGINT)
        try:
            program.wait(5)
        except subprocess.TimeoutExpired:  # it drives on
            program.kill()
            program.wait()
            driving += 1
            continue
        driving += not _stands(emulator)
    return driving


@pytest.mark.slow
def test_an_interrupt_at_any_moment_once_or_twice_stops_the_robot(emulator):
    moments = np.random.default_rng(1).uniform(0.0, 0.9, 12)
    assert interrupt(emulator, moments.tolist()) == 0


def test_what_comes_while_a_robot_is_being_stopped_waits_until_it_stands():
    done = []
    with pytest.raises(KeyboardInterrupt):
        ends.hold()
        try:
            with ends.undisturbed():
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.01)
                done.append("stopped")
        finally:
            ends.release()
    assert done == ["stopped"]


def test_a_signal_that_a_compiler_swallowed_is_looked_at_before_a_robot_moves(emulator):
    with open_robot(emulator.url) as robot:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
        except KeyboardInterrupt:
            pass  # as numba does while it compiles
        with pytest.raises(KeyboardInterrupt):
            robot.set_motors_speed(300, 300)
        assert emulator.robot._speed == (0, 0)
        robot.set_motors_speed(200, 200)  # whoever goes on knows of it
        assert emulator.robot._speed == (200, 200)


def test_handlers_of_others_are_left_alone_and_ours_go_with_the_last_robot(emulator):
    usual = signal.getsignal(signal.SIGTERM)

    def own(number, frame):
        pass

    kept = signal.signal(signal.SIGHUP, own)
    try:
        with open_robot(emulator.url):
            assert signal.getsignal(signal.SIGHUP) is own
            assert signal.getsignal(signal.SIGTERM) is not usual
        assert signal.getsignal(signal.SIGTERM) is usual
    finally:
        signal.signal(signal.SIGHUP, kept)


def test_whoever_catches_an_interruption_can_be_interrupted_again(emulator):
    with open_robot(emulator.url) as robot:
        robot.enable("proximity")
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.01)
            robot.step()
            time.sleep(ends.ON_ITS_WAY_S)
