"""The robot's end of the wire: SerCom and e-puck2 packets, answered around any robot of the API.

``SerComFirmware`` and ``EPuck2Firmware`` are state machines of bytes: ``feed`` takes what has come
in and returns what goes out. They have the firmware's habits, also the bad ones
(gctronic/e-puck-library Asercom.c, GCtronic e-puck2): a chain of binary commands without its 0x00
makes the parser deaf to lines; ``M`` is silent on the Overo; N and O have ten values there; E
echoes the command; Q wraps at 16 bits; an unknown command is told so.

>>> from workbench.formation.simulated import SimulatedRobot
>>> from workbench.robot.wire.sercom import VARIANTS
>>> with SimulatedRobot() as body:
...     firmware = SerComFirmware(body, VARIANTS["overo"])
...     firmware.feed(b"D,300,300\\rE\\rM\\rX\\r")
b'd\\r\\ne,300,300\\r\\nz,Command not found\\r\\n'

Contract: no threads, no clocks; ``lockstep`` lets a control period pass whenever a sensor is read a
second time, otherwise whoever owns the body lets time pass. A firmware never raises on bytes.
"""

import math
import re
import struct
from collections import deque
from collections.abc import Callable
from typing import Protocol

from workbench.robot.api import Robot
from workbench.robot.range_bearing import BUS_ADDRESS, MOST_WAITING, Board, Heard
from workbench.robot.wire.epuck2 import (
    COMMAND,
    COMMAND_BYTES,
    EMPTY_PACKET,
    PLACES,
    SENSOR_BYTES,
    SENSORS_PACKET,
)
from workbench.robot.wire.sercom import BTCOM, Variant

WELCOME = (
    b"\x0c\x07WELCOME to the SerCom protocol on e-Puck\r\nthe EPFL education robot "
    b'type "H" for help\r\n'
)
VERSION = b"v,Version 1.2.2 August 2008 GCtronic\r\nHW version: emulated\r\n"
BTCOM_VERSION = f"v,{BTCOM} September 2006\r\n".encode()
UNKNOWN = b"z,Command not found\r\n"
CALIBRATING = (
    b"k, Starting calibration - Remove any object in sensors range\r\n",
    b"k, Calibration finished\r\n",
)
# bytes after a binary command; others have none. Writing over I2C is for Bluetooth only
_OPERANDS = {"D": 4, "P": 4, "L": 2}
_I2C_OPERANDS = {"w": 35, "W": 3}
HELP = {  # what ``H`` lists; the last row is not there on the Overo
    "ACEHKMNOQRSUVb": "reads or does it",
    "DLP": "letter, then two numbers",
    "BFGIJTWY": "with a radio only",
}
PICTURE = (1, 40, 40, 8, 3200)  # mode, width, height, zoom, bytes of a picture
STOP_PACKETS = 2  # sensor packets that a driver asks for to make sure of a stop
STREAM_S = 1 / 45  # s between two sensor packets of an e-puck2
CALIBRATION_S = 2.0  # s in which it neither hears nor sends afterwards
_LINE = 64  # bytes of the receiving ring


class Firmware(Protocol):
    """Bytes in, bytes out."""

    def feed(self, data: bytes) -> bytes:
        """Take bytes that came in and return those that go out."""

    def live(self) -> None:
        """Let the body move on for a control period."""


class _Body:
    """A robot as its firmware sees it."""

    def __init__(self, robot: Robot, lockstep: bool) -> None:
        self.robot = robot
        self._lockstep = lockstep
        self._seen = set[str]()
        self.held = False  # whether reading passes no time, in lockstep
        self._read: dict[str, Callable[[], tuple[float, ...]]] = {
            "proximity": robot.get_proximity,
            "light": robot.get_light_sensor,
            "floor": robot.get_floor_sensors,
            "motor_position": robot.get_motor_position,
            "accelerometer": robot.get_accelerometer,
            "gyroscope": robot.get_gyroscope,
            "magnetometer": robot.get_magnetometer,
            "distance": robot.get_distance_sensor,
            "temperature": robot.get_temperature,
            "selector": robot.get_selector,
            "battery": robot.get_battery,
        }
        able = (*self._read, "range_bearing")
        self.sensors = [name for name in able if name in robot.capabilities]
        robot.enable(*self.sensors)
        self._awake = False
        self._heard: deque[Heard] = deque(maxlen=MOST_WAITING)

    def sensor(self, name: str) -> list[int]:
        """Return a sensor's values; in lockstep, who reads a sensor again reads it a control period
        later.
        """
        self._look(name)
        return [int(value) for value in self._read[name]()]

    def heard(self, passing: bool) -> list[Heard]:
        """Return the messages since it was asked last, in lockstep of a control period later if
        time may pass.
        """
        if "range_bearing" not in self.sensors:
            return []
        if passing and not self._heard:
            self._look("range_bearing")
        heard = list(self._heard)
        self._heard.clear()
        return heard

    def send(self, data: bytes) -> None:
        """Send four bytes by its board, if it has one."""
        if "send" in self.robot.capabilities:
            self.robot.send(data)

    def _look(self, name: str) -> None:
        """Let time pass where reading does."""
        if not self._awake:
            self.live()
        if self._lockstep and not self.held:
            if name in self._seen:
                self.live()
                self._seen.clear()
            self._seen.add(name)

    def live(self) -> None:
        """Let a control period pass."""
        self.robot.step()
        self._awake = True
        if "range_bearing" in self.sensors:
            self._heard.extend(self.robot.get_range_bearing())

    def drive(self, left: int, right: int) -> tuple[int, int]:
        most = self.robot.most_steps
        speeds = (max(-most, min(most, left)), max(-most, min(most, right)))
        self.robot.set_motors_speed(*speeds)
        return speeds


class SerComFirmware:
    """An e-puck1's SerCom around a connected robot.

    Args:
        robot: the body.
        variant: see ``robot.wire.sercom.VARIANTS``.
        lockstep: let a control period pass whenever a sensor is read a second time.
    """

    def __init__(self, robot: Robot, variant: Variant, *, lockstep: bool = False) -> None:
        self._body = _Body(robot, lockstep)
        self._board = Board(self._body.heard, self._body.send)
        self.variant = variant
        self._line = bytearray()
        self._chain = bytearray()
        self._replies = bytearray()  # of the chain so far
        self._binary = False
        self._speed = (0, 0)

    def live(self) -> None:
        """Let the body move on for a control period."""
        self._body.live()

    def feed(self, data: bytes) -> bytes:
        """Take bytes and return the replies, in order."""
        out = bytearray()
        for byte in data:
            if self._binary:
                self._chain.append(byte)
                out += self._run_chain()
            elif byte >= 128 and not self._line:
                self._binary = True
                self._chain[:] = [byte]
                out += self._run_chain()
            elif byte in (10, 13):
                if self._line:
                    out += self._run_line(bytes(self._line))
                    self._line.clear()
            elif byte and len(self._line) < _LINE:
                self._line.append(byte)
        return bytes(out)

    def _run_chain(self) -> bytes:
        """Run what is complete of a binary chain; 0x00 ends it, and sends what it asked for."""
        while self._chain:
            if self._chain[0] == 0:
                self._binary = False
                rest = bytes(self._chain[1:])
                self._chain.clear()
                out = bytes(self._replies)
                self._replies.clear()
                return out + (self.feed(rest) if rest else b"")
            letter = chr(256 - self._chain[0])
            own = _I2C_OPERANDS if self.variant.lights else {}
            size = (_OPERANDS | own).get(letter, 0)
            if len(self._chain) < 1 + size:
                return b""
            operands = bytes(self._chain[1 : 1 + size])
            del self._chain[: 1 + size]
            self._replies += self._run_binary(letter, operands)
        return b""

    def _run_binary(self, letter: str, operands: bytes) -> bytes:
        if letter == "D":
            self._speed = self._body.drive(*struct.unpack("<hh", operands))
            return b""
        if letter == "P":
            self._body.robot.set_motor_position(*struct.unpack("<hh", operands))
            return b""
        if letter == "L":
            number, value = operands
            if number in (8, 9):
                self._light("BF"[number - 8], [value])
            else:
                self._body.robot.set_led(number, value)
            return b""
        if letter == "A":  # acceleration, orientation and inclination, as floats
            return struct.pack("<3f", *self._spheric())
        if letter == "I":
            return struct.pack("<3B", *PICTURE[:3]) + bytes(PICTURE[-1]) if self._radio else b""
        if letter == "U":  # the buffer of sound, and where in it is now
            return bytes(601)
        if letter == "W":
            self._write_bus(list(operands))
            return b""
        if letter in ("b", "t", "g", "u"):
            return self._binary_only(letter)
        values = self._numbers(
            letter.upper() if letter == "a" else letter, self.variant.floor_binary
        )
        return (
            b""
            if values is None
            else struct.pack(f"<{len(values)}H", *(value & 0xFFFF for value in values))
        )

    @property
    def _radio(self) -> bool:
        """Whether it talks over Bluetooth, with camera and I2C at hand; not so on the Overo."""
        return self.variant.lights

    def _binary_only(self, letter: str) -> bytes:
        if letter == "t":
            return bytes(1)
        if letter == "b":
            return struct.pack("<H", self._body.sensor("battery")[0])
        return bytes(6)  # gyroscope, microphones

    def _spheric(self) -> tuple[float, float, float]:
        """Return length, orientation and inclination in degrees of the acceleration."""
        x, y, z = self._body.sensor("accelerometer")
        length = math.sqrt(x * x + y * y + z * z)
        tilt = math.degrees(math.acos(z / length)) if length else 0.0
        return length, math.degrees(math.atan2(y, x)), tilt

    def _numbers(self, letter: str, floor: int) -> list[int] | None:
        """Return the numbers of a reading, None if the command reads nothing."""
        if letter in ("N", "O"):
            ring = self._body.sensor("proximity" if letter == "N" else "light")
            return (ring + [0, 0])[: self.variant.infrared]
        if letter == "M":
            return (self._body.sensor("floor") + [0, 0])[:floor] if floor else None
        if letter == "E":
            return list(self._speed)
        if letter == "Q":
            return [_wrap16(value) for value in self._body.sensor("motor_position")]
        if letter == "A":
            return self._body.sensor("accelerometer")
        if letter == "U":
            return [0, 0, 0]
        return None

    def _run_line(self, line: bytes) -> bytes:
        text = line.decode("ascii", "replace").strip()
        letter = text[:1]
        if letter.upper() not in ("B", "G"):
            letter = letter.upper()
        numbers = _scan(text[1:])
        if letter == "D":  # what is missing is 0, what follows two numbers is ignored
            self._speed = self._body.drive(*(numbers + [0, 0])[:2])
            return b"d\r\n"
        if letter == "P":
            self._body.robot.set_motor_position(*map(_wrap16, (numbers + [0, 0])[:2]))
            return b"p\r\n"
        if letter == "T":
            return b"t\r\n"
        if letter == "g":
            return b"g,0,0,0\r\n"
        if letter in tuple("GHIJWYZ"):
            return self._rare(letter, numbers)
        if letter in ("L", "B", "F"):
            return self._light(letter, numbers)
        if letter == "S":
            self._speed = self._body.drive(0, 0)
            return b"s\r\n"
        if letter == "K":
            self._body.robot.calibrate_proximity_sensors()
            return b"".join(CALIBRATING)
        if letter == "V":
            return VERSION if self.variant.battery else BTCOM_VERSION
        if letter == "R":
            self._speed = self._body.drive(0, 0)
            return b"r\r\n" + WELCOME
        return self._read(letter) if len(text) == 1 else UNKNOWN

    def _read(self, letter: str) -> bytes:
        """Answer a line that asks for a reading."""
        if letter in ("C", "b"):
            values = self._body.sensor("selector" if letter == "C" else "battery")[:1]
        elif letter == "M" and not self.variant.floor_ascii:
            return b""
        else:
            found = self._numbers(letter, self.variant.floor_ascii)
            if found is None:
                return UNKNOWN
            garbled = letter == "M" and self.variant.floor_ascii_garbled
            values = [_garbled(value) for value in found] if garbled else found
        return (",".join([letter.lower(), *map(str, values)]) + "\r\n").encode()

    def _rare(self, letter: str, numbers: list[int]) -> bytes:
        """Answer help, remote, camera and I2C; all but help stay silent on the Overo."""
        if letter == "H":
            rows = list(HELP.items())[: 3 if self._radio else 2]
            lines = [f'"{one}" {words}' for letters, words in rows for one in letters]
            return ("\n" + "\r\n".join(lines) + "\r\n").encode()
        if not self._radio:
            return b""
        first = ",".join(str(number) for number in (numbers + [0, 0])[:2])
        if letter == "W":
            self._write_bus(numbers)
        value = self._read_bus(numbers) if letter == "Y" else 0
        return {
            "G": b"g IR check : 0x0, address : 0x0, data : 0x0\r\n",
            "I": ("i," + ",".join(map(str, PICTURE)) + "\r\n").encode(),
            "J": b"j\r\n",
            "W": b"w\r\n",
            "Y": f"y,{first}\r\ny,{value}\r\n".encode(),
            "Z": b"",
        }[letter]

    def _write_bus(self, numbers: list[int]) -> None:
        """Write a register of what is on the bus, the board if anything."""
        module, register, value = (numbers + [0, 0, 0])[:3]
        if self.variant.bus and module == BUS_ADDRESS:
            self._board.write(register, value)

    def _read_bus(self, numbers: list[int]) -> int:
        """Return a register as a signed byte, as the firmware does."""
        module, register = (numbers + [0, 0])[:2]
        if not (self.variant.bus and module == BUS_ADDRESS):
            return 0
        value = self._board.read(register)
        return value - 256 if value > 127 else value

    def _light(self, letter: str, numbers: list[int]) -> bytes:
        robot = self._body.robot
        if letter == "L":
            robot.set_led(*(numbers + [0, 0])[:2])
            return b"l\r\n"
        (robot.set_body_led if letter == "B" else robot.set_front_led)((numbers + [0])[0])
        return f"{letter.lower()}\r\n".encode()


class EPuck2Firmware:
    """An e-puck2's WiFi packets around a connected robot; arguments as SerComFirmware.

    In lockstep a request for sensors is answered once, and passes no time where a driver only makes
    sure: after a stop that began with zeros, and after a calibration. Otherwise it begins a stream,
    which ends with a request for nothing: whoever owns the firmware sends ``packet`` every
    STREAM_S.

    Attributes:
        streaming: whether packets are to be sent.
        calibrated: how often it was told to calibrate.
    """

    def __init__(self, robot: Robot, *, lockstep: bool = False) -> None:
        self._body = _Body(robot, lockstep)
        self._lockstep = lockstep
        self._buffer = bytearray()
        self.streaming = False
        self.calibrated = 0
        self._zeros = 0
        self._making_sure = 0  # packets that pass no time

    def live(self) -> None:
        """Let the body move on for a control period."""
        self._body.live()

    def forget(self) -> None:
        """Drop half a packet, and end the stream: another client has come."""
        self._buffer.clear()
        self.streaming = False

    def feed(self, data: bytes) -> bytes:
        """Take bytes and return a reply for every whole command packet; bytes that begin none are
        skipped.
        """
        self._buffer += data
        out = b""
        while True:
            while self._buffer and self._buffer[0] != COMMAND:
                self._zeros = 0 if self._buffer[0] else self._zeros + 1
                if self._zeros == COMMAND_BYTES:
                    self._making_sure = STOP_PACKETS
                del self._buffer[0]
            if len(self._buffer) < COMMAND_BYTES:
                return out
            packet = bytes(self._buffer[:COMMAND_BYTES])
            del self._buffer[:COMMAND_BYTES]
            self._zeros = 0
            out += self._answer(packet)

    def _answer(self, packet: bytes) -> bytes:
        _, request, settings, left, right, bits = struct.unpack_from("<BBBhhB", packet)
        robot = self._body.robot
        if settings & 1:
            robot.calibrate_proximity_sensors()
            self.calibrated += 1
            self._making_sure = 1
        if settings & 4:
            robot.set_motor_position(left, right)
        else:
            self._body.drive(left, right)
        for k in range(4):  # LED1, 3, 5, 7 are bits; LED2, 4, 6, 8 have colours
            robot.set_led(2 * k, bits >> k & 1)
            robot.set_led(2 * k + 1, int(any(packet[8 + 3 * k : 11 + 3 * k])))
        robot.set_body_led(bits >> 4 & 1)
        robot.set_front_led(bits >> 5 & 1)
        self.streaming = bool(request & 0b10) and not self._lockstep
        if self.streaming:
            return b""
        return self.packet() if request & 0b10 else bytes([EMPTY_PACKET])

    def packet(self) -> bytes:
        """Return a sensor packet of this moment."""
        self._body.held = self._making_sure > 0
        self._making_sure = max(0, self._making_sure - 1)
        data = bytearray(SENSOR_BYTES)
        for sensor, (place, code) in PLACES.items():
            count = struct.calcsize(code) // struct.calcsize("<" + code[-1])
            values = [0] * count
            if sensor in self._body.sensors:
                values = (self._body.sensor(sensor) + values)[:count]
            if code[-1] == "h":
                values = [_wrap16(value) for value in values]
            struct.pack_into(code, data, place, *values)
        return bytes([SENSORS_PACKET]) + bytes(data)


def _scan(text: str) -> list[int]:
    """Return the whole numbers of ",1,-2…" up to the first thing that is none, as sscanf does."""
    numbers = []
    while found := re.match(r",\s*([+-]?\d{1,9})", text):
        numbers.append(int(found[1]))
        text = text[found.end() :]
    return numbers


def _garbled(value: int) -> int:
    """Return a reading of 16 bits whose low byte was sign-extended before it was joined."""
    low = value & 0xFF
    return _wrap16(value | 0xFF00) if low >= 128 else value


def _wrap16(value: int) -> int:
    return (value + 32768) % 65536 - 32768
