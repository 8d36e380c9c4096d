"""Range and bearing: messages as bytes, the board's registers over a real wire, and followers that
hear.
"""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import workbench as wb
from workbench.formation.senses.range_bearing import RangeBearingConfig
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.logs.driving import drive
from workbench.logs.listener import Listener
from workbench.robot.faults import BadReply, NotSupported
from workbench.robot.open import open_robot
from workbench.robot.range_bearing import (
    Board,
    Heard,
    Report,
    four_bytes,
    pack,
    to_counts,
    to_metres,
    unpack,
)
from workbench.robot.wire.emulator import Emulator
from workbench.robot.wire.epuck1 import SerComRobot
from workbench.robot.wire.firmware import SerComFirmware
from workbench.robot.wire.sercom import VARIANTS

from .wires import MemoryLink, SteppedClock

QUIET = RangeBearingConfig(
    noise_range_m=0.0, noise_bearing_rad=0.0, sector_bias_rad=0.0, odometry_error=0.0
)
CONFIG = wb.ConvoyConfig(
    followers=3,
    drive="planar",
    sensing="range-and-bearing",
    leader_speed_mps=0.05,
    wheel_speed_mps=(0.0, 0.12),
    seed=5,
)
PATIENT = 10.0


@given(
    st.integers(0, 15),
    st.integers(0, 15),
    st.floats(-math.pi, math.pi),
    st.floats(-0.12, 0.12),
    st.floats(-2.5, 2.5),
)
def test_a_report_comes_back_within_its_steps(sender, about, bearing, speed, turn):
    data = pack(Report(sender, about, bearing, speed, turn))
    told = unpack(data)
    assert len(data) == 4 and (told.sender, told.about) == (sender, about)
    assert abs(math.remainder(told.bearing_rad - bearing, 2 * math.pi)) <= math.pi / 256 + 1e-9
    assert told.speed_mps == pytest.approx(speed, abs=0.0005 + 1e-9)
    assert told.turn_radps == pytest.approx(turn, abs=0.01 + 1e-9)


def test_what_does_not_fit_is_cut_or_refused():
    assert unpack(pack(Report(0, 1, 0.0, 9.0, -99.0)))[3:] == (0.127, -2.54)
    with pytest.raises(ValueError, match="speed_mps = inf; expected a finite number"):
        pack(Report(0, 1, 0.0, math.inf, 0.0))
    with pytest.raises(ValueError, match="expected 4 bytes"):
        unpack(b"abc")
    with pytest.raises(ValueError, match="about = 16; expected a whole number from 0 to 15"):
        pack(Report(0, 16, 0.0, 0.0, 0.0))
    for data in (b"", b"12345", "text", 7):
        with pytest.raises(ValueError, match="expected one to 4 bytes"):
            four_bytes(data)


@given(st.floats(0.05, 1.0))
def test_ranges_come_back_within_half_a_count(range_m):
    assert to_metres(to_counts(range_m)) == pytest.approx(range_m, rel=0.003)
    assert 0 <= to_counts(range_m) <= 4095


def test_readings_have_the_calibration_of_the_public_driver():
    assert 100 * to_metres(430) == pytest.approx(66, abs=0.5)  # facts: 66 at 430 counts
    assert to_metres(430 + 123) / to_metres(430) == pytest.approx(0.5, abs=0.002)


def test_registers_are_taken_message_by_message():
    batches = iter([[Heard(0.3, -1.0, b"\x00\x01\x02\xff"), Heard(0.5, 2.0, b"abcd")], [], []])
    sent, passing = [], []
    board = Board(lambda may: (passing.append(may), next(batches))[1], sent.append)
    assert [board.read(0), board.read(10), board.read(2)] == [1, 0, 255]
    assert (board.read(3) << 8 | board.read(4)) == round(1e4 * (2 * math.pi - 1.0))
    assert [board.read(0), bytes(board.read(k) for k in (10, 11, 1, 2))] == [1, b"abcd"]
    assert [board.read(0), board.read(0)] == [0, 0]
    assert passing == [True, False, True]  # time passes once it has said that there is no more
    for register, value in zip((13, 19, 20, 14), (1, 2, 3, 300), strict=True):
        board.write(register, value)
    assert sent == [bytes([1, 2, 3, 44])]


def _listened(robot, periods=25, before=0):
    """Return what a robot hears while it drives, after some periods in which it stands."""
    found = []
    with robot:
        robot.enable("range_bearing")
        for _ in range(before):
            robot.step()
        for k in range(periods):
            robot.step()
            robot.set_motors_speed(380, 380 + 4 * (k % 5))
            found.append(robot.get_range_bearing())
            robot.send(bytes([k]))
    return found


def test_an_emulated_board_tells_over_the_wire_what_its_body_hears():
    direct = SimulatedRobot(CONFIG)
    told = _listened(direct, before=2)  # what a board has heard before is not for a new program
    body = SimulatedRobot(CONFIG)
    with Emulator(body, "epuck1", rate=0) as emulator:
        wired = _listened(_board(emulator))
        assert body.sent == direct.sent == [bytes([0, 0, 0, k]) for k in range(25)]
    assert [len(heard) for heard in told] == [3] * 25
    for direct_heard, wired_heard in zip(told, wired, strict=True):
        for mine, its in zip(direct_heard, wired_heard, strict=True):
            assert its.data == mine.data
            assert its.range_m == pytest.approx(mine.range_m, rel=0.003)
            turned = math.remainder(its.bearing_rad - mine.bearing_rad, 2 * math.pi)
            assert abs(turned) <= 0.5e-4 + 1e-9


def test_both_bearings_are_the_relative_heading_and_range_and_place_are_true_without_noise():
    with SimulatedRobot(replace(CONFIG, range_bearing=QUIET)) as robot:
        robot.enable("range_bearing")
        for _ in range(60):
            robot.step()
            robot.set_motors_speed(400, 380)
        x, y, heading = robot.pose()
        for heard in robot.get_range_bearing():
            report = unpack(heard.data)
            theirs = robot.convoy.world.pose(0, report.sender)
            place = np.array([x, y]) + heard.range_m * np.array(
                [math.cos(heading + heard.bearing_rad), math.sin(heading + heard.bearing_rad)]
            )
            assert place == pytest.approx(theirs[:2], abs=1e-6)
            relative = heard.bearing_rad - report.bearing_rad + math.pi
            off = math.remainder(relative - (theirs[2] - heading), 2 * math.pi)
            assert abs(off) <= math.pi / 256 + 1e-6


def test_messages_get_lost_come_seldom_and_do_not_come_from_far():
    lossy = replace(CONFIG, range_bearing=replace(QUIET, message_loss=0.4))
    heard = _listened(SimulatedRobot(lossy), 200)
    assert sum(map(len, heard)) / 600 == pytest.approx(0.6, abs=0.06)
    seldom = replace(CONFIG, range_bearing=replace(QUIET, period=5))
    assert [len(h) for h in _listened(SimulatedRobot(seldom), 11)] == [3, 0, 0, 0, 0] * 2 + [3]
    near = replace(CONFIG, range_bearing=replace(QUIET, range_m=0.2))
    senders = {unpack(h.data).sender for h in _listened(SimulatedRobot(near), 5)[0]}
    assert senders == {0, 2}  # not the third, two places behind


@pytest.fixture(scope="module")
def policy():
    config = replace(wb.SETTINGS["recommended"], followers=1, drive="rolling", seed=2)
    paced = replace(config, leader_speed_mps=0.05, wheel_speed_mps=(0.0, 0.12))
    return paced, wb.learn(paced, steps=60_000, progress=False).policy


@pytest.mark.parametrize("link", ["sim", "board"])
def test_a_learned_follower_drives_a_robot_by_what_it_hears(policy, link):
    learned, weights = policy
    config = replace(learned, sensing="range-and-bearing", drive="planar", followers=1)
    solo = SoloFollower(config, weights.transferred("range-and-bearing"))
    body = SimulatedRobot(config)
    if link == "sim":
        with body:
            report = drive(body, solo, seconds=60)
            distance, bearing = body.true_errors()
    else:
        with Emulator(body, "epuck1", rate=0) as emulator:
            with _board(emulator) as robot:
                report = drive(robot, solo, seconds=60)
                distance, bearing = body.true_errors()
    assert report.periods == 600 and report.losses == 0
    assert abs(distance - config.middle_m) < 0.035 and abs(bearing) < math.radians(20)


@pytest.mark.parametrize("number", [1, 2])
def test_who_listens_follows_the_one_before_it_and_reports_to_the_others(number):
    told = replace(CONFIG, range_bearing=QUIET)
    with SimulatedRobot(told, robot=number) as robot:
        listener = Listener(robot, told)
        for _ in range(30):
            robot.step()
            seen = listener()
            robot.set_motors_speed(350, 360)
        distance, bearing = robot.true_errors()
        assert seen == pytest.approx((distance, bearing), abs=0.01)
        reports = [unpack(data) for data in robot.sent]
        assert {report.sender for report in reports} == {number}
        assert {report.about for report in reports[4:]} == {0, 1, 2, 3} - {number}
        # counters that are set, or begin anew, are no way
        robot.set_motor_position(20_000, 20_000)
        robot.step()
        assert listener() == pytest.approx(robot.true_errors(), abs=0.02)


def test_the_leader_listens_to_nobody_and_robots_without_a_number_of_their_own_hear_nothing():
    with (
        SimulatedRobot(CONFIG, robot=0) as robot,
        pytest.raises(ValueError, match="follows nobody"),
    ):
        Listener(robot, CONFIG)
    many = replace(CONFIG, followers=17, range_bearing=replace(QUIET, range_m=5.0))
    assert "range_bearing" not in SimulatedRobot(many, robot=16).capabilities
    with Emulator(SimulatedRobot(many, robot=15), "epuck1", rate=0) as emulator:
        heard = _listened(_board(emulator, number=15), 4)
    assert [len(each) for each in heard] == [15] * 4


class _Wire(MemoryLink):
    """A wire that can spoil one reply line of the board's registers."""

    def __init__(self, firmware, clock):
        super().__init__(firmware, clock)
        self.lines = 0
        self.spoil = lambda number, line: line
        self.back = self._back

    def _back(self, data):
        kept = []
        for line in data.splitlines(keepends=True):
            register = line.startswith(b"y,")
            kept.append(self.spoil(self.lines, line) if register else line)
            self.lines += register
        return b"".join(kept)


def _wired(messages):
    """Return a driver, its wire and a body that hears these messages in its every period."""
    body = SimulatedRobot(CONFIG)
    body.connect()
    body._listen = lambda: tuple(
        number for k in messages for number in (0.1 * k, 0.2 * k, float(k)) if k
    )
    clock = SteppedClock()
    wire = _Wire(SerComFirmware(body, VARIANTS["epuck1"], lockstep=True), clock)
    kinds = {"period_s": 0.0, "watchdog_s": None, "clock": clock, "link": lambda: wire}
    return SerComRobot("memory", board=True, **kinds), wire


@pytest.mark.parametrize("line", range(2, 60))
def test_one_spoilt_line_loses_no_message_that_was_announced(line):
    robot, wire = _wired((1, 2, 3))
    with robot:
        robot.enable("range_bearing")
        robot.step()
        wire.lines = 0
        wire.spoil = lambda number, text: b"y,4\x80\r\n" if number == line else text
        robot.step()
        heard = [int.from_bytes(each.data) for each in robot.get_range_bearing()]
    if line in (18, 19, 36, 37):  # what announces a message, spoilt, takes that one along
        heard.insert(line // 18, line // 18 + 1)
    if line in (54, 55):  # spoilt, "no more" is asked for again, when time has passed
        assert heard[3:] == [1, 2, 3]
        del heard[3:]
    assert heard == [1, 2, 3]


@pytest.mark.parametrize(
    ("register", "value"), [(0, 37), (0, -1), (10, 4100), (2, -300), (5, 16), (3, 255)]
)
def test_registers_that_no_board_has_are_no_messages(register, value):
    robot, wire = _wired((1,))
    asked = f"y,64,{register}\r\n".encode()
    last = []

    def spoil(_, line):
        wrong = bool(last) and last[-1] == asked
        last.append(line)
        return f"y,{value}\r\n".encode() if wrong else line

    with robot:
        robot.enable("range_bearing")
        robot.step()
        wire.spoil = spoil
        with pytest.raises(BadReply, match="expected") as caught:
            robot.step()
    assert "the robot stands" in caught.value.__notes__[0]


def test_over_a_late_link_messages_come_late_and_nobody_is_stopped_for_it():
    busy = replace(CONFIG, followers=5, range_bearing=replace(QUIET, range_m=3.0))
    with Emulator(SimulatedRobot(busy), "epuck1", rate=1.0, delay_s=0.03) as emulator:
        with _board(emulator, period_s=0.1) as robot:
            robot.enable("range_bearing", "motor_position")
            heard = []
            for _ in range(20):
                robot.step()
                robot.set_motors_speed(200, 200)
                heard += [unpack(each.data).sender for each in robot.get_range_bearing()]
    assert set(heard) == {0, 2, 3, 4, 5}


def test_a_new_client_hears_nothing_of_before():
    body = SimulatedRobot(CONFIG)
    with Emulator(body, "epuck1", rate=1.0) as emulator:
        with _board(emulator, period_s=0.1) as robot:
            robot.enable("range_bearing")
            for _ in range(3):
                robot.step()
            assert robot.get_range_bearing()
        time.sleep(1.0)  # ten periods of messages wait
        with _board(emulator, period_s=0.1) as robot:
            robot.enable("range_bearing")
            robot.step()
            assert len(robot.get_range_bearing()) <= 3  # of the period that runs at most


def _board(emulator, **options):
    address = emulator.url.partition(":")[2]
    return open_robot(f"board:{address}", **({"period_s": 0.0, "timeout_s": PATIENT} | options))


def test_a_board_is_refused_where_there_is_no_bus_and_missed_where_there_is_none(tmp_path):
    with pytest.raises(ValueError, match="board = True with variant = 'overo'.*epuck1"):
        open_robot("overo:/dev/null", board=True)
    with Emulator(SimulatedRobot(CONFIG), "epuck1", rate=0) as emulator:
        with open_robot(emulator.url, period_s=0.0, timeout_s=PATIENT) as robot:
            with pytest.raises(NotSupported, match="range_bearing"):
                robot.enable("range_bearing")
            with pytest.raises(NotSupported, match="cannot 'send'"):
                robot.send(b"hi")
