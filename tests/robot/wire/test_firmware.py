"""The emulated firmware's answers, request by request, as the public firmware gives them."""

import math
import struct

import pytest

from workbench.formation.simulated import SimulatedRobot
from workbench.robot.geometry import STEP, TRACK
from workbench.robot.wire.epuck2 import PLACES, SENSOR_BYTES, command, parse_sensors
from workbench.robot.wire.firmware import EPuck2Firmware, SerComFirmware
from workbench.robot.wire.sercom import VARIANTS

UNKNOWN = b"z,Command not found\r\n"
ASCII = {  # request: how the reply begins, and how many numbers it has (None: not counted)
    b"D,300,-300": (b"d\r\n", None),
    b"D": (b"d\r\n", None),
    b"D,12": (b"d\r\n", None),
    b"E": (b"e,", 2),
    b"Q": (b"q,", 2),
    b"P,5,6": (b"p\r\n", None),
    b"N": (b"n,", 8),
    b"O": (b"o,", 8),
    b"A": (b"a,", 3),
    b"C": (b"c,", 1),
    b"L,3,1": (b"l\r\n", None),
    b"B,1": (b"b\r\n", None),
    b"F,1": (b"f\r\n", None),
    b"T,1": (b"t\r\n", None),
    b"t": (b"t\r\n", None),
    b"S": (b"s\r\n", None),
    b"U": (b"u,", 3),
    b"g": (b"g,0,0,0\r\n", None),
    b"V": (b"v,Version", None),
    b"K": (b"k, Starting calibration", None),
    b"H": (b'\n"A" ', None),
    b"X": (UNKNOWN, None),
}
RADIO = {  # with a Bluetooth link only; the Overo stays silent
    b"G": b"g IR check : 0x0, address : 0x0, data : 0x0\r\n",
    b"I": b"i,1,40,40,8,3200\r\n",
    b"J,1,40,40,8": b"j\r\n",
    b"W,192,1,2": b"w\r\n",
    b"Y,192,1": b"y,192,1\r\ny,0\r\n",
    b"Z": b"",
}
BINARY = {  # letter: bytes of the reply on an e-puck1 over Bluetooth
    "E": 4, "Q": 4, "N": 16, "O": 16, "a": 6, "A": 12, "u": 6, "U": 601, "b": 2, "t": 1, "g": 6,
    "M": 10, "I": 3 + 3200, "D": 0, "P": 0, "L": 0, "W": 0,
}  # fmt: skip
OPERANDS = {"D": 4, "P": 4, "L": 2, "W": 3, "w": 35}


def _firmware(variant="epuck1"):
    body = SimulatedRobot()
    body.connect()
    return SerComFirmware(body, VARIANTS[variant], lockstep=True)


@pytest.mark.parametrize("request_", ASCII)
def test_a_line_is_answered_as_the_firmware_does(request_):
    begin, count = ASCII[request_]
    answer = _firmware().feed(request_ + b"\r")
    assert answer.startswith(begin)
    if count is not None:
        assert len(answer.strip().split(b",")) == 1 + count


@pytest.mark.parametrize("request_", RADIO)
def test_what_needs_a_radio_is_silent_on_the_overo(request_):
    assert _firmware().feed(request_ + b"\r") == RADIO[request_]
    assert _firmware("overo").feed(request_ + b"\r") == b""


@pytest.mark.parametrize("letter", BINARY)
def test_a_binary_command_is_answered_with_so_many_bytes_when_its_chain_ends(letter):
    firmware = _firmware()
    request = bytes([256 - ord(letter)]) + bytes(OPERANDS.get(letter, 0))
    assert firmware.feed(request) == b""  # not before the chain ends
    assert len(firmware.feed(b"\x00")) == BINARY[letter]
    assert firmware.feed(b"E\r") == b"e,0,0\r\n"  # and lines are heard again


def test_the_overo_writes_nothing_over_i2c_so_that_its_operands_are_commands():
    firmware = _firmware("overo")
    assert firmware.feed(bytes([256 - ord("W"), 256 - ord("E"), 0])) == bytes(4)


def test_body_and_front_light_are_leds_eight_and_nine_in_binary():
    firmware = _firmware()
    lit = []
    robot = firmware._body.robot
    robot.set_body_led = lambda value: lit.append(("body", value))
    robot.set_front_led = lambda value: lit.append(("front", value))
    for number in (8, 9):
        firmware.feed(bytes([256 - ord("L"), number, 1, 0]))
    assert lit == [("body", 1), ("front", 1)]


def test_the_accelerations_floats_are_length_orientation_and_inclination():
    reply = _firmware().feed(bytes([256 - ord("A"), 0]))
    assert struct.unpack("<3f", reply) == pytest.approx((800.0, 0.0, 0.0))


def test_every_sensor_of_an_epuck2_stands_in_its_own_bytes():
    taken = [0] * SENSOR_BYTES
    for place, code in PLACES.values():
        for byte in range(place, place + struct.calcsize(code)):
            taken[byte] += 1
    assert max(taken) == 1
    data = bytearray(SENSOR_BYTES)
    struct.pack_into("<3h", data, 18, 1, -2, 3)
    struct.pack_into("<3f", data, 24, 10.5, -20.25, 30.0)
    struct.pack_into("<b", data, 36, -5)
    struct.pack_into("<H", data, 69, 812)
    struct.pack_into("<3B", data, 86, 1, 2, 3)
    struct.pack_into("<B", data, 102, 1)
    found = parse_sensors(bytes(data))
    assert found["gyroscope"] == (1, -2, 3) and found["magnetometer"] == (10.5, -20.25, 30.0)
    assert found["temperature"] == (-5,) and found["distance"] == (812,)
    assert found["remote"] == (1, 2, 3) and found["button"] == (1,)
    body = SimulatedRobot()
    body.connect()
    packet = EPuck2Firmware(body, lockstep=True).feed(command(0, 0, sensors=True))
    assert parse_sensors(packet[1:])["gyroscope"] == (0, 0, 0)  # it stands
    body.set_motors_speed(-200, 200)
    for _ in range(5):
        body.step()
    turning = 2 * 200 * STEP / TRACK
    counts = parse_sensors(
        EPuck2Firmware(body, lockstep=True).feed(command(-200, 200, sensors=True))[1:]
    )
    assert counts["gyroscope"][2] == pytest.approx(131 * math.degrees(turning), rel=0.1)
