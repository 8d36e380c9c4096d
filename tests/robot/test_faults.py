"""Links that fail (R2, R4): a robot is stopped where a channel is alive, first on reconnect, and
nothing hangs.
"""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.lab.runs import learn
from workbench.robot.faults import BadReply, LinkLost, LinkTimeout, RobotError
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import FAULTS, Emulator
from workbench.robot.wire.epuck1 import SerComRobot
from workbench.robot.wire.epuck2 import EPuck2Robot

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
def test_sixty_faults_on_real_wires_leave_a_stopped_robot_and_documented_errors_only():
    wires = [("epuck1", False), ("overo", True), ("epuck2", False)]
    with ThreadPoolExecutor(len(wires)) as pool:  # mostly waiting
        injected = sum(pool.map(lambda wire: _inject(*wire), wires))
    assert injected >= 60


def _inject(protocol, binary):
    """Inject faults into one kind of link; return how many."""
    chance = np.random.default_rng(sum(protocol.encode()))
    # late and split replies take half a second and closed terminals a new one: seldom
    kinds = [
        kind for kind in FAULTS if not (protocol != "epuck2" and kind in ("hang up", "half open"))
    ]
    weights = np.array([0.02 if kind in ("late", "split") else 1.0 for kind in kinds])
    slowest = 0.0
    raised = 0
    stopped = 0
    injected = 0
    with _emulator(protocol) as emulator:
        options = {} if protocol == "epuck2" else {"binary": binary}
        robot = open_robot(
            emulator.url, period_s=0.0, timeout_s=TIMEOUT, watchdog_s=None, **options
        )
        robot.enable("proximity")
        for _ in range(12):
            if not robot.is_connected():
                emulator.heal()
                before = len(emulator.heard)
                robot.connect()
                assert _is_stop(emulator.heard[before][1], protocol), emulator.heard[before]
            robot.step()
            robot.set_motors_speed(400, 300)
            assert _speed(emulator) == (400, 300)
            count = int(
                chance.choice([1, 2, 4])
            )  # one bad reply; both; so many that stop has no reply either
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
                assert _speed(emulator) == (
                    0,
                    0,
                )  # the robot hears but cannot answer: it stands, too
            emulator.heal()
            if "late" in chosen or "split" in chosen:
                time.sleep(0.6)  # until the emulator listens again
        robot.disconnect()
    assert slowest < LONGEST
    assert raised > 3 and stopped > 0
    return injected


@pytest.mark.parametrize("protocol", ["epuck1", "epuck2"])
def test_one_bad_reply_is_asked_for_again(protocol):
    with (
        _emulator(protocol) as emulator,
        open_robot(emulator.url, period_s=0.0, timeout_s=0.1) as robot,
    ):
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
        assert (
            "may still be moving; stop is the first thing sent on reconnect"
            in caught.value.__notes__[0]
        )
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
    with (
        _emulator(protocol) as emulator,
        open_robot(emulator.url, period_s=0.05, watchdog_s=0.2) as robot,
    ):
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
    with (
        _emulator("epuck1") as emulator,
        open_robot(emulator.url, period_s=0.0, watchdog_s=0.15) as robot,
    ):
        robot.set_motors_speed(500, 500)
        begun = time.monotonic()
        while time.monotonic() - begun < 0.6:
            slow(20_000_000)
        assert _speed(emulator) == (0, 0) and robot.watchdog_stops >= 1


class _Told:
    """A clock that passes when told."""

    time = 0.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


def test_late_steps_are_counted_with_the_longest_delay():
    with _emulator("epuck1") as emulator, open_robot(emulator.url, period_s=0.05) as robot:
        real, robot.clock = robot.clock, (clock := _Told())  # however busy the machine is
        for pause in (0.0, 0.0, 0.12, 0.0, 0.09):
            robot.step()
            clock.time += pause
        robot.step()
        robot.clock = real
        assert robot.missed_deadlines == 2
        assert robot.worst_latency_s == pytest.approx(0.07)


def test_nobody_at_the_other_end_is_told_at_once():
    begun = time.monotonic()
    with pytest.raises(LinkLost, match="cannot be opened"):
        SerComRobot("/dev/does-not-exist").connect()
    with pytest.raises(LinkLost, match="nothing answers at 127.0.0.1:1"):
        EPuck2Robot("127.0.0.1:1").connect()
    assert time.monotonic() - begun < LONGEST
    assert issubclass(LinkLost, RobotError)


def _lose_a_byte_of(emulator, times):
    """Let the robot hear ,0,0 instead of D,0,0, so many times."""
    feed = emulator._firmware.feed
    left = [times]

    def lossy(data):
        if left[0] and b"D,0,0" in data:
            left[0] -= 1
            data = data.replace(b"D,0,0", b",0,0")
        return feed(data)

    emulator._firmware.feed = lossy


@pytest.mark.parametrize("lost", [1, 2])
def test_connecting_makes_sure_that_the_robot_stands_even_if_a_byte_of_stop_is_lost(lost):
    with _emulator("epuck1") as emulator:
        emulator._firmware.feed(b"D,400,400\r")
        _lose_a_byte_of(emulator, lost)
        with open_robot(emulator.url, period_s=0.0, timeout_s=TIMEOUT):
            assert _speed(emulator) == (0, 0)


def test_connecting_to_a_robot_that_does_not_stop_is_refused():
    with _emulator("epuck1") as emulator:
        emulator._firmware.feed(b"D,400,400\r")
        _lose_a_byte_of(emulator, 10**9)
        with pytest.raises(BadReply, match="may still be moving"):
            open_robot(emulator.url, period_s=0.0, timeout_s=TIMEOUT).connect()


def test_closing_sends_stop_once_more_if_a_byte_of_it_is_lost():
    with _emulator("epuck1") as emulator:
        with open_robot(emulator.url, period_s=0.0, timeout_s=TIMEOUT) as robot:
            robot.set_motors_speed(400, 400)
            _lose_a_byte_of(emulator, 1)
        assert _speed(emulator) == (0, 0)


def test_the_late_half_of_a_binary_reply_is_never_taken_for_readings():
    with (
        _emulator("overo") as emulator,
        open_robot(emulator.url, period_s=0.0, timeout_s=0.25) as robot,
    ):
        known = tuple(float(100 * k) for k in range(1, 9))
        emulator.robot.get_proximity = lambda: known
        robot.enable("proximity")
        robot.set_motors_speed(200, 300)
        refused = 0
        for _ in range(4):
            emulator.fault("split")
            try:
                robot.step()
            except (BadReply, LinkTimeout):
                refused += 1
                time.sleep(0.3)
                robot.connect()
                continue
            assert robot.get_proximity() == known
        assert refused >= 1


def test_a_cut_off_packet_of_one_client_is_not_completed_by_the_next():
    with _emulator("epuck2") as emulator:
        host, port = emulator.address.split(":")
        with socket.create_connection((host, int(port))) as raw:
            raw.sendall(
                struct.pack("<BBBhhB", 0x80, 0, 0, 700, 700, 0)
            )  # the first bytes of a packet that drives
            time.sleep(0.2)
        with open_robot(emulator.url, period_s=0.0, timeout_s=TIMEOUT):
            assert _speed(emulator) == (0, 0)


def test_a_client_that_does_not_read_does_not_keep_the_emulator_from_closing():
    emulator = _emulator("epuck1")
    emulator.open()
    port = os.open(emulator.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        for _ in range(300):
            try:
                os.write(port, b"N\r" * 40)
            except BlockingIOError:
                break
        time.sleep(0.3)
        closing = threading.Thread(target=emulator.close, daemon=True)
        closing.start()
        closing.join(5.0)
        assert not closing.is_alive()
    finally:
        os.close(port)


def test_a_period_that_begins_late_as_the_timer_overslept_counts_and_a_whole_one_follows(
    monkeypatch,
):
    with SimulatedRobot(CONFIG, realtime=True) as robot:
        robot.enable("proximity")
        robot.step()
        sleep = time.sleep
        monkeypatch.setattr(time, "sleep", lambda seconds: sleep(seconds + 0.08))
        robot.step()
        monkeypatch.undo()
        begun = time.monotonic()
        robot.step()
        assert robot.missed_deadlines >= 1 and robot.worst_latency_s > 0.07
        assert time.monotonic() - begun > 0.09


def test_raw_commands_that_drive_and_watchdogs_shorter_than_a_period_are_refused():
    with _emulator("epuck1") as emulator, open_robot(emulator.url, period_s=0.0) as robot:
        with pytest.raises(ValueError, match="use set_motors_speed, which the watchdog knows of"):
            robot.send_and_receive("D,500,500")
        with pytest.raises(
            ValueError, match=r"left = 40000; expected a whole number of motor steps, up to ±32767"
        ):
            robot.set_motor_position(40000, 0)
    for watchdog in (-1.0, 0.05, float("nan")):
        with pytest.raises(ValueError, match="watchdog_s = .* expected more than a control period"):
            SerComRobot("/dev/null", watchdog_s=watchdog)
    for rate in (-1.0, 1e-12, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="rate = .*; expected 0 for lockstep"):
            Emulator(SimulatedRobot(CONFIG), "epuck1", rate=rate)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_program_that_is_told_to_end_stops_the_robot_first(tmp_path, number):
    learned = learn(
        replace(CONFIG, state_tiles=(5, 5), action_levels=(3, 3)), steps=500, progress=False
    )
    learned.save(tmp_path / "run")
    with Emulator(SimulatedRobot(learned.config), "epuck1") as emulator:
        arguments = [
            "drive",
            "--robot",
            emulator.url,
            "--weights",
            str(tmp_path / "run"),
            "--seconds",
            "60",
        ]
        program = subprocess.Popen(
            [sys.executable, "-m", "workbench", *arguments], stderr=subprocess.PIPE
        )
        until = time.monotonic() + 120
        while _speed(emulator) == (0, 0) and time.monotonic() < until and program.poll() is None:
            time.sleep(0.05)
        assert _speed(emulator) != (0, 0), (
            program.stderr.read() if program.poll() is not None else "it never drove"
        )
        program.send_signal(number)
        _, errors = program.communicate(timeout=30)
        assert program.returncode == 130 and b"the robot has been told to stop" in errors
        assert _speed(emulator) == (0, 0)
