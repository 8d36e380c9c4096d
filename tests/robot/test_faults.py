"""Links that fail (R2, R4): a robot is stopped where a channel is alive, first on reconnect, and nothing hangs."""

import struct
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from workbench.arena.emulator import FAULTS, Emulator
from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.epuck1 import SerComRobot
from workbench.robot.epuck2 import EPuck2Robot
from workbench.robot.faults import BadReply, LinkLost, LinkTimeout, RobotError
from workbench.robots import open_robot

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)
TIMEOUT = 0.15  # a busy machine answers late
LONGEST = 1.0  # s


def _emulator(protocol):
    return Emulator(SimulatedRobot(CONFIG), protocol, rate=0)


def _speed(emulator):
    """The wheel speeds that the body was told last."""
    return emulator.robot._speed


def _is_stop(data, protocol):
    if protocol == "epuck2":
        return len(data) >= 7 and struct.unpack_from("<hh", data, 3) == (0, 0)
    return b"D,0,0\r" in data or b"\xbc\x00\x00\x00\x00" in data


@pytest.mark.slow
def test_a_thousand_injected_faults_leave_a_stopped_robot_and_documented_errors_only():
    wires = [("epuck1", False), ("overo", True), ("epuck2", False)]
    with ThreadPoolExecutor(len(wires)) as pool:  # mostly waiting
        injected = sum(pool.map(lambda wire: _inject(*wire), wires))
    assert injected >= 1000


def _inject(protocol, binary):
    """Inject faults into one kind of link; return how many."""
    chance = np.random.default_rng(sum(protocol.encode()))
    # late replies take half a second and closed terminals a new one: seldom
    kinds = [kind for kind in FAULTS if not (protocol != "epuck2" and kind in ("hang up", "half open"))]
    weights = np.array([0.02 if kind == "late" else 1.0 for kind in kinds])
    slowest, raised, stopped, injected = 0.0, 0, 0, 0
    with _emulator(protocol) as emulator:
        options = {} if protocol == "epuck2" else {"binary": binary}
        robot = open_robot(emulator.url, period_s=0.0, timeout_s=TIMEOUT, watchdog_s=None, **options)
        robot.enable("proximity")
        for _ in range(150):
            if not robot.is_connected():
                emulator.heal()
                before = len(emulator.heard)
                robot.connect()
                assert _is_stop(emulator.heard[before][1], protocol), emulator.heard[before]
            robot.step()
            robot.set_motors_speed(400, 300)
            assert _speed(emulator) == (400, 300)
            count = int(chance.choice([1, 2, 4]))  # one bad reply; both; so many that stop has no reply either
            injected += count
            chosen = [str(kind) for kind in chance.choice(kinds, count, p=weights / weights.sum())]
            for kind in chosen:
                emulator.fault(kind)
            begun = time.monotonic()
            try:
                robot.step()
            except (LinkTimeout, BadReply) as error:
                raised += 1
                assert any("stop" in note for note in error.__notes__)
            except LinkLost as error:
                raised += 1
                assert "may still be moving" in error.__notes__[0]
            slowest = max(slowest, time.monotonic() - begun)
            if robot.is_connected() and robot._speed == (0, 0):
                stopped += 1
                assert _speed(emulator) == (0, 0)  # the channel was alive: the robot stands
            if emulator._mute:
                assert _speed(emulator) == (0, 0)  # the robot hears but cannot answer: it stands, too
            emulator.heal()
            if "late" in chosen:
                time.sleep(0.6)  # until the emulator listens again
        robot.disconnect()
    assert slowest < LONGEST
    assert raised > 50 and stopped > 10
    return injected


@pytest.mark.parametrize("protocol", ["epuck1", "epuck2"])
def test_one_bad_reply_is_asked_for_again(protocol):
    with _emulator(protocol) as emulator, open_robot(emulator.url, period_s=0.0, timeout_s=0.1) as robot:
        robot.enable("proximity")
        robot.step()
        for kind in ("silent", "short"):
            emulator.fault(kind)
            robot.step()
            assert len(robot.get_proximity()) == 8


def test_a_terminal_that_vanishes_is_a_lost_link_and_a_new_one_hears_stop_first():
    with _emulator("epuck1") as emulator:
        robot = SerComRobot(emulator.address, period_s=0.0, timeout_s=0.1)
        robot.connect()
        robot.enable("proximity")
        robot.step()
        robot.set_motors_speed(500, 500)
        emulator.replug()
        with pytest.raises(LinkLost) as caught:
            robot.step()
        assert "may still be moving; stop is the first thing sent on reconnect" in caught.value.__notes__[0]
        assert not robot.is_connected()
        robot.address = emulator.address
        before = len(emulator.heard)
        robot.connect()
        assert _is_stop(emulator.heard[before][1], "epuck1") and _speed(emulator) == (0, 0)
        robot.disconnect()


def test_a_half_open_socket_ends_in_a_time_out_that_says_the_robot_may_move():
    with _emulator("epuck2") as emulator:
        robot = EPuck2Robot(emulator.address, period_s=0.0, timeout_s=0.1)
        robot.connect()
        robot.enable("proximity")
        robot.set_motors_speed(300, 300)
        emulator.fault("half open")
        begun = time.monotonic()
        with pytest.raises(LinkTimeout, match="expected 1 bytes within 0.1 s") as caught:
            robot.step()
        assert time.monotonic() - begun < LONGEST
        assert "was not confirmed: the robot may still be moving" in caught.value.__notes__[0]
        before = len(emulator.heard)
        robot.connect()
        assert _is_stop(emulator.heard[before][1], "epuck2") and _speed(emulator) == (0, 0)
        robot.disconnect()


def test_an_exception_in_the_controller_stops_the_robot():
    with _emulator("epuck1") as emulator:
        with pytest.raises(KeyError), open_robot(emulator.url, period_s=0.0) as robot:
            robot.set_motors_speed(600, 600)
            raise KeyError("a mistake in the controller")
        assert _speed(emulator) == (0, 0)


@pytest.mark.parametrize("protocol", ["epuck1", "overo", "epuck2"])
def test_the_watchdog_stops_a_robot_whose_program_hangs(protocol):
    with _emulator(protocol) as emulator, open_robot(emulator.url, period_s=0.05, watchdog_s=0.2) as robot:
        robot.enable("proximity")
        robot.step()
        robot.set_motors_speed(500, 500)
        assert _speed(emulator) == (500, 500)
        time.sleep(0.5)  # the program hangs
        assert _speed(emulator) == (0, 0) and robot.watchdog_stops == 1
        robot.step()
        assert robot.missed_deadlines == 1 and 0.4 < robot.worst_latency_s < 1.0
        robot.set_motors_speed(200, 200)  # and it may drive on
        assert _speed(emulator) == (200, 200)


def test_the_watchdog_acts_while_compiled_code_computes():
    def burn(n):
        total = 0.0
        for k in range(n):
            total += (k % 7) ** 0.5
        return total

    slow = njit(nogil=True)(burn)
    slow(10)
    with _emulator("epuck1") as emulator, open_robot(emulator.url, period_s=0.0, watchdog_s=0.15) as robot:
        robot.set_motors_speed(500, 500)
        begun = time.monotonic()
        while time.monotonic() - begun < 0.6:
            slow(20_000_000)
        assert _speed(emulator) == (0, 0) and robot.watchdog_stops >= 1


def test_late_steps_are_counted_with_the_longest_delay():
    with _emulator("epuck1") as emulator, open_robot(emulator.url, period_s=0.05) as robot:
        for pause in (0.0, 0.0, 0.12, 0.0, 0.09):
            robot.step()
            time.sleep(pause)
        robot.step()
        assert robot.missed_deadlines == 2 and 0.06 < robot.worst_latency_s < 0.2


def test_nobody_at_the_other_end_is_told_at_once():
    begun = time.monotonic()
    with pytest.raises(LinkLost, match="cannot be opened"):
        SerComRobot("/dev/does-not-exist").connect()
    with pytest.raises(LinkLost, match="nothing answers at 127.0.0.1:1"):
        EPuck2Robot("127.0.0.1:1").connect()
    assert time.monotonic() - begun < LONGEST
    assert issubclass(LinkLost, RobotError)
