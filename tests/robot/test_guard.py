"""The guard: whatever byte is lost, doubled or flipped on the way to a robot, it stands after an
error, or the error says that it may not.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.robot.wires import DIALECTS, wired
from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.faults import LinkTimeout, RobotError

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)
LONGEST_S = 1.0
KINDS = {
    "lost": lambda data, k: data[:k] + data[k + 1 :],
    "doubled": lambda data, k: data[: k + 1] + data[k : k + 1] + data[k + 1 :],
    "flipped": lambda data, k: data[:k] + bytes([data[k] ^ 0x20]) + data[k + 1 :],
    "high bit": lambda data, k: data[:k] + bytes([data[k] ^ 0x80]) + data[k + 1 :],
}
OPERATIONS = {
    "connect": lambda robot: None,
    "drive": lambda robot: robot.set_motors_speed(250, -100),
    "step": lambda robot: robot.step(),
    "led": lambda robot: robot.set_led(3, 1),
    "counters": lambda robot: robot.set_motor_position(0, 0),
    "stop": lambda robot: robot.stop(),
    "disconnect": lambda robot: robot.disconnect(),
}


@pytest.fixture(scope="module")
def body():
    with SimulatedRobot(CONFIG) as robot:
        yield robot


def _once(place, kind):
    """Change one byte, counted over all that is written from now on."""
    left = [place]

    def change(data):
        k = left[0]
        left[0] -= len(data)
        return KINDS[kind](data, k) if 0 <= k < len(data) else data

    return change


def _connected(dialect, body):
    robot, link = wired(dialect, body)
    robot.connect()
    robot.enable("proximity")
    robot.step()
    robot.set_motors_speed(400, 300)
    return robot, link


def _do(robot, operation):
    """Do it; return the error, and its notes as one text."""
    begun = robot.clock.now()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            OPERATIONS[operation](robot)
            error = None
        except RobotError as caught:
            error = caught
    said = " ".join([*getattr(error, "__notes__", []), *(str(w.message) for w in told)])
    assert robot.clock.now() - begun < LONGEST_S
    return error, said


def _length(dialect, operation, body):
    robot, link = _connected(dialect, body) if operation != "connect" else wired(dialect, body)
    link.sent.clear()
    if operation == "connect":
        robot.connect()
    else:
        _do(robot, operation)
    written = sum(map(len, link.sent))
    robot.disconnect()
    return written


@pytest.mark.parametrize("operation", [name for name in OPERATIONS if name != "connect"])
@pytest.mark.parametrize("dialect", DIALECTS)
def test_any_single_fault_on_the_way_to_the_robot_leaves_it_standing_or_said(
    dialect, operation, body
):
    for place in range(_length(dialect, operation, body)):
        for kind in KINDS:
            robot, link = _connected(dialect, body)
            link.towards = _once(place, kind)
            error, said = _do(robot, operation)
            where = f"{dialect}, {operation}, byte {place} {kind}: {error!r} {said}"
            if error is not None:
                assert body._speed == (0, 0) or "may still be moving" in said, where
                assert robot.commanded == (0, 0), where
            elif robot.is_connected():
                _do(robot, "step")  # a packet carries the speeds again
                assert body._speed == robot.commanded, where
            link.towards = lambda data: data
            _, said = _do(robot, "disconnect")
            assert body._speed == (0, 0), where
            assert not said, where


@pytest.mark.parametrize("dialect", DIALECTS)
def test_connecting_stops_a_robot_in_whatever_state_its_parser_was_left(dialect, body):
    variant, _ = DIALECTS[dialect]
    halves = (
        [b"D,700,7", b"D,700,700", b"\xbc\x58", b"\xbc\x58\x02\x58", b"\x89", b"\xb4\x01", b"K,"]
        if variant
        else [b"\x80\x00\x00" + bytes([188, 2] * 2), b"\x80", b"\x80\x02\x04\x00"]
    )
    for half in halves:
        robot, link = wired(dialect, body)
        body.set_motors_speed(600, 600)
        if variant:
            link.firmware._speed = (600, 600)
        link.firmware.feed(half)
        robot.connect()
        assert body._speed == (0, 0), half
        robot.disconnect()
    for place in range(_length(dialect, "connect", body)):
        for kind in KINDS:
            robot, link = wired(dialect, body)
            body.set_motors_speed(600, 600)
            if variant:
                link.firmware._speed = (600, 600)
            link.towards = _once(place, kind)
            robot.connect()
            assert body._speed == (0, 0), (place, kind)
            robot.disconnect()


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_thousand_faults_to_and_from_robots_leave_them_standing_or_said(dialect, body):
    chance = np.random.default_rng(sum(dialect.encode()))
    robot, link = _connected(dialect, body)
    injected = {"towards": 0, "back": 0}
    raised = 0

    def noisy(way):
        def change(data):
            if not data or chance.random() > 0.5:
                return data
            injected[way] += 1
            if way == "back" and chance.random() < 0.4:
                return data[: chance.integers(0, len(data))]  # silent, or short
            kind = str(chance.choice(list(KINDS)))
            return KINDS[kind](data, int(chance.integers(0, len(data))))

        return change

    while min(injected.values()) < 250:
        if not robot.is_connected():
            link.towards = link.back = lambda data: data
            robot.connect()
            assert body._speed == (0, 0)
        robot.enable("proximity")
        robot.set_motors_speed(400, 300)
        link.towards, link.back = noisy("towards"), noisy("back")
        for _ in range(3):
            operation = str(chance.choice(["drive", "step", "led", "counters", "stop"]))
            if not robot.is_connected():
                break
            error, said = _do(robot, operation)
            if error is not None:
                raised += 1
                assert body._speed == (0, 0) or "may still be moving" in said
        link.towards = link.back = lambda data: data
        if robot.is_connected():
            _do(robot, "stop")
            assert body._speed == (0, 0)
    robot.disconnect()
    assert body._speed == (0, 0) and raised > 20


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("peer", ["deaf", "dripping", "flooding"])
def test_hostile_peers_get_stop_again_and_again_and_a_word_within_a_second(dialect, peer, body):
    for operation in ("drive", "step", "led", "counters", "stop", "disconnect"):
        robot, link = _connected(dialect, body)
        receive = link._receive

        def drip(timeout_s, clock=robot.clock):
            clock.sleep(min(timeout_s, 0.05))
            return b"\x02" if peer == "dripping" and timeout_s >= 0.05 else b""

        link._receive = {
            "deaf": lambda timeout_s, clock=robot.clock: clock.sleep(timeout_s) or b"",
            "dripping": drip,
            "flooding": lambda timeout_s, clock=robot.clock: clock.sleep(1e-4) or b"\x55" * 4096,
        }[peer]
        link.sent.clear()
        error, said = _do(robot, operation)
        assert "may still be moving" in said, (operation, error)
        assert not robot.is_connected()
        assert len([data for data in link.sent if len(data) > 40]) >= 2  # stops, more than once
        assert body._speed == (0, 0)  # it heard them, though nobody could know
        link._receive = receive


def test_an_error_says_what_was_waited_for_and_what_became_of_the_robot(body):
    robot, link = _connected("epuck1", body)
    link.back = lambda data: b""
    with pytest.raises(LinkTimeout, match="expected a line within 0.25 s") as caught:
        robot.step()
    assert "was not confirmed: the robot may still be moving" in caught.value.__notes__[0]
