"""SerCom and e-puck2 packets: decoders that never guess, and a firmware with the real one's
traps.
"""

import struct
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.robot.faults import BadReply
from workbench.robot.wire.epuck2 import SENSOR_BYTES, command, lights_of, parse_sensors
from workbench.robot.wire.firmware import EPuck2Firmware, SerComFirmware
from workbench.robot.wire.sercom import (
    VARIANTS,
    ascii_numbers,
    ascii_request,
    binary_numbers,
    binary_request,
    check_counts,
)

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)


@given(st.binary(max_size=80))
def test_any_line_is_numbers_or_a_bad_reply(line):
    try:
        numbers = ascii_numbers(line, "n", (8, 10))
    except BadReply as error:
        assert "expected" in str(error)
    else:
        assert len(numbers) in (8, 10) and all(-32768 <= n <= 65535 for n in numbers)


@given(st.lists(st.integers(-32768, 65535), min_size=2, max_size=2))
def test_a_proper_line_is_read_back(numbers):
    assert ascii_numbers(f"q,{numbers[0]},{numbers[1]}".encode(), "q", (2,)) == tuple(numbers)


@given(st.binary(max_size=40))
def test_any_bytes_are_counts_or_a_bad_reply(data):
    try:
        counts = check_counts("proximity", binary_numbers(data, "H"))
    except BadReply:
        return
    assert all(0 <= count <= 4095 for count in counts)


@given(st.binary(min_size=SENSOR_BYTES - 2, max_size=SENSOR_BYTES + 2))
def test_any_packet_is_sensors_or_a_bad_reply(data):
    try:
        found = parse_sensors(data)
    except BadReply:
        return
    assert len(data) == SENSOR_BYTES and all(0 <= v <= 4095 for v in found["proximity"])


@pytest.mark.parametrize(
    "line",
    [
        b"n,1,2,3",
        b"m,1,2,3,4,5,6,7,8",
        b"n,1,2,3,4,5,6,7,8.5",
        b"n,1,2,3,4,5,6,7,99999",
        b"",
        b"n,1, 2,3,4,5,6,7,8",
    ],
)
def test_a_wrong_line_is_named(line):
    with pytest.raises(BadReply, match="expected"):
        ascii_numbers(line, "n", (8,))


def test_readings_below_zero_on_the_wire_are_zero():
    # N = max(0, raw - offset) on the robot; where a firmware lets it fall below, clients that
    # unpack unsigned see 65 000 and more
    assert check_counts("proximity", (65530, -3, 12)) == (0.0, 0.0, 12.0)


@pytest.fixture(scope="module")
def body():
    with SimulatedRobot(CONFIG) as robot:
        yield robot


@given(st.lists(st.binary(max_size=30), max_size=5))
def test_no_bytes_break_a_firmware_and_a_zero_and_a_line_wake_it(body, chunks):
    for firmware in (
        SerComFirmware(body, VARIANTS["epuck1"]),
        SerComFirmware(body, VARIANTS["overo"]),
    ):
        for chunk in chunks:
            firmware.feed(chunk)
        firmware.feed(
            bytes(64) + b"\r"
        )  # ends whatever operands a chain still waits for, and the chain
        assert firmware.feed(b"D,0,0\rE\r").endswith(b"e,0,0\r\n")
    packets = EPuck2Firmware(body)
    for chunk in chunks:
        packets.feed(chunk)


def test_a_binary_command_without_its_end_leaves_the_robot_deaf_to_lines(body):
    firmware = SerComFirmware(body, VARIANTS["epuck1"])
    unfinished = binary_request(("D", 300, 200))[:-1]  # as the public pyePuck sends it
    assert firmware.feed(unfinished) == b"" and body._speed == (300, 200)  # it is executed
    assert firmware.feed(b"N\r") == b""  # and then nothing is heard, not even 'z'
    firmware.feed(b"\x00")
    assert firmware.feed(b"D,0,0\r") == b"d\r\n"


def test_the_overo_has_ten_values_and_no_floor(body):
    overo = SerComFirmware(body, VARIANTS["overo"])
    epuck1 = SerComFirmware(body, VARIANTS["epuck1"])
    assert overo.feed(b"M\r") == b"" and overo.feed(binary_request(("M",))) == b""
    assert overo.feed(b"N\r").count(b",") == 10 and epuck1.feed(b"N\r").count(b",") == 8
    assert (
        len(overo.feed(binary_request(("N",), ("E",)))) == 24
        and len(epuck1.feed(binary_request(("N",), ("M",)))) == 26
    )
    assert SerComFirmware(body, VARIANTS["epuck1-bt"]).feed(b"M\r").count(b",") == 3


def test_the_firmware_clamps_echoes_and_wraps(body):
    firmware = SerComFirmware(body, VARIANTS["epuck1"])
    firmware.feed(b"D,1500,-1500\r")
    assert firmware.feed(b"E\r") == b"e,1000,-1000\r\n"
    firmware.feed(b"S\r")
    body.set_motor_position(40000, -40000)
    assert firmware.feed(b"Q\r") == b"q,-25536,25536\r\n"
    firmware.feed(b"P,0,0\r")
    assert firmware.feed(b"X\r") == b"z,Command not found\r\n"
    # what is missing is 0, what follows is ignored: half a line is a command
    for line, speeds in ((b"D,1\r", "1,0"), (b"D\r", "0,0"), (b"D,300,-300D,0,0\r", "300,-300")):
        assert firmware.feed(line) == b"d\r\n"
        assert firmware.feed(b"E\r") == f"e,{speeds}\r\n".encode()
    assert firmware.feed(b"R\r").endswith(b'type "H" for help\r\n')


def test_requests_are_the_bytes_that_the_firmware_documents():
    assert ascii_request("N") == b"N\r"
    assert binary_request(("N",)) == bytes([256 - ord("N"), 0])
    lights = lights_of([1, 1, 1, 0, 0, 0, 0, 0, 1, 0])  # LED1 to LED8, body, front
    packet = command(1, -2, sensors=True, calibrate=True, position=True, lights=lights)
    assert packet[:8] == struct.pack("<BBBhhB", 0x80, 2, 5, 1, -2, 0b010011)
    assert packet[8:20] == bytes([100] * 3 + [0] * 9) and len(packet) == 21
