"""The range-and-bearing board: a ring of twelve infrared receivers and emitters on an e-puck, that
hears messages of other boards, from how far and from where.

    for heard in robot.get_range_bearing():          # since the last step
        heard.range_m, heard.bearing_rad, heard.data
    robot.send(pack(Report(sender=0, about=1, bearing_rad=3.1, speed_mps=0.05, turn_radps=0.0)))

The board is at the address 0x20 of the robot's I2C bus (0x40 in SerCom's ``W`` and ``Y``, which
leave room for the direction). Registers as the firmware of the DEMIURGE project has them (public
repository demiurge-project/argos3-epuck, erab_firmware), and its conversion of readings:

    read    0 whether a message was heard, and take it · 10 11 1 2 its four bytes
            3 4 bearing in 0.1 mrad · 5 6 range in counts, near is large
    write   13 19 20 14 four bytes, and send them with the last · 12 power, 0 the most
            16 take the light of now for zero · 17 where to calculate, 0 on the board
            21 bits of a message

Nobody has tried this with a real board. Its published errors could not be read: noise is a
parameter of the simulated one. A bus without a board may answer zeros, which is "nothing heard".

>>> to_metres(to_counts(0.5)) == to_metres(to_counts(0.501))  # a count is half a per cent
True
>>> unpack(pack(Report(sender=2, about=15, bearing_rad=0.0, speed_mps=0.05, turn_radps=-0.3)))
Report(sender=2, about=15, bearing_rad=0.0, speed_mps=0.05, turn_radps=-0.3)

Contract: bearings are to the left in (-π, π]; a message has four bytes, shorter ones are filled
from the left.
"""

import math
import struct
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from workbench import fields
from workbench.robot.faults import BadReply
from workbench.robot.wire.sercom import ADC

if TYPE_CHECKING:
    from workbench.robot.vocabulary import Words

BUS_ADDRESS = 0x40
DATA_BYTES = 4
MOST_HEARD = 16  # messages that are taken in a control period
MOST_WAITING = 16  # the newest, that an emulated board keeps for who does not ask; our choice
# a range of k exp(a - b counts), in cm: halved every 123 counts; k is a board's own
_K, _A, _B = 0.0867439, 9.06422, 0.00565075
_BEARING = 1e-4  # rad
_TURN_COUNTS = math.ceil(2 * math.pi / _BEARING)
SET_UP = ((17, 0), (21, 8 * DATA_BYTES), (12, 0), (16, 0))  # register, value
READ_DATA = (10, 11, 1, 2)
READ_PLACE = (3, 4, 5, 6)
WRITE_DATA = (13, 19, 20, 14)
# what a report has room for: robots 0 to 15, e-puck speeds
ROBOTS, _STEPS = 16, 127
_SPEED, _TURN, _ANGLE = 0.001, 0.02, 2 * math.pi / 256  # m/s, rad/s, rad


class Heard(NamedTuple):
    """A message, how far away (m) and in which direction (rad) it was sent."""

    range_m: float
    bearing_rad: float
    data: bytes


class Report(NamedTuple):
    """What a follower needs from the robot that it keeps its place by: how that sees it, and how
    that moves. Our own format: the board takes any four bytes.

    Attributes:
        sender, about: numbers of robots, the leader is 0; bearing_rad: of ``about``, seen by the
            sender; speed_mps, turn_radps: of the sender.
    """

    sender: int
    about: int
    bearing_rad: float
    speed_mps: float
    turn_radps: float


def pack(report: Report) -> bytes:
    """Return a report as four bytes: bearing in 1.4°, speed in 1 mm/s, turning rate in 20 mrad/s,
    cut to what a signed byte holds.

    Raises:
        ValueError: a robot above 15, or a number that is not finite.
    """
    for name in ("sender", "about"):
        fields.whole(name, getattr(report, name), 0, ROBOTS - 1, "")
    for name in ("bearing_rad", "speed_mps", "turn_radps"):
        if not math.isfinite(getattr(report, name)):
            raise ValueError(f"{name} = {getattr(report, name)!r}; expected a finite number")
    bearing = round(report.bearing_rad / _ANGLE) % 256
    speed = max(-_STEPS, min(_STEPS, round(report.speed_mps / _SPEED)))
    turn = max(-_STEPS, min(_STEPS, round(report.turn_radps / _TURN)))
    return struct.pack("<BBbb", report.sender << 4 | report.about, bearing, speed, turn)


def unpack(data: bytes) -> Report:
    """Return the report in four bytes.

    Raises:
        ValueError: other than four bytes.
    """
    if len(data) != DATA_BYTES:
        raise ValueError(f"data = {data!r}; expected {DATA_BYTES} bytes, as ``pack`` makes them")
    who, bearing, speed, turn = struct.unpack("<BBbb", data)
    angle = math.remainder(bearing * _ANGLE, 2 * math.pi)
    return Report(who >> 4, who & 15, angle, speed * _SPEED, turn * _TURN)


def four_bytes(data: bytes) -> bytes:
    """Return a message with four bytes.

    Raises:
        ValueError: what is no one to four bytes.
    """
    if not isinstance(data, (bytes, bytearray)) or not 1 <= len(data) <= DATA_BYTES:
        raise ValueError(f"data = {data!r}; expected one to {DATA_BYTES} bytes")
    return bytes(data).rjust(DATA_BYTES, b"\0")


def to_counts(range_m: float) -> int:
    """Return the reading of a range, 12 bits."""
    return max(0, min(ADC, round((_A - math.log(max(range_m, 1e-3) * 100 / _K)) / _B)))


def to_metres(counts: int) -> float:
    """Return the range of a reading."""
    return _K * math.exp(_A - _B * counts) / 100


def to_heard(data: Sequence[int], place: Sequence[int]) -> Heard:
    """Return the message in the registers READ_DATA and READ_PLACE, bytes each.

    Raises:
        BadReply: a range of more than 12 bits, or a bearing beyond a turn.
    """
    bearing, counts = place[0] << 8 | place[1], place[2] << 8 | place[3]
    if counts > ADC or bearing > _TURN_COUNTS:
        raise BadReply(
            f"range {counts}, bearing {bearing}; expected 0 to {ADC}, 0 to {_TURN_COUNTS} counts"
        )
    return Heard(to_metres(counts), math.remainder(bearing * _BEARING, 2 * math.pi), bytes(data))


class Reporter:
    """Tells the others how a robot sees them, one of them a period, in turn: what they need to
    follow it. Who is heard is known by their reports; until somebody is, it reports on itself.

    Args:
        robot: connected, with a board; ``robot.number`` says which it is.
    """

    def __init__(self, robot: "Words") -> None:
        self._robot = robot
        self._seen: dict[int, float] = {}  # bearings of those who have reported
        self._next = 0

    def report(self, heard: Sequence[Heard], speed_mps: float, turn_radps: float) -> None:
        """Note who is where, and send a report on one of them."""
        for message in heard:
            self._seen[unpack(message.data).sender] = message.bearing_rad
        if not self._seen:
            self._robot.send(pack(Report(self._robot.number, self._robot.number, 0.0, 0.0, 0.0)))
            return
        about = sorted(self._seen)[self._next % len(self._seen)]
        self._next += 1
        told = Report(self._robot.number, about, self._seen[about], speed_mps, turn_radps)
        self._robot.send(pack(told))


class Board:
    """The registers of an emulated board.

    Args:
        listen: returns what has been heard since it was asked last. It is given whether the board
            has just said that there was nothing: where asking lets time pass (lockstep), it does so
            then.
        send: sends four bytes.
    """

    def __init__(
        self, listen: Callable[[bool], Sequence[Heard]], send: Callable[[bytes], None]
    ) -> None:
        self._listen = listen
        self._send = send
        self._waiting: deque[Heard] = deque()
        self._empty = True  # whether it has said that there was none, the last time
        self._read = dict.fromkeys((*READ_DATA, *READ_PLACE), 0)
        self._written = dict.fromkeys(WRITE_DATA, 0)

    def write(self, register: int, value: int) -> None:
        """Set a register."""
        if register in self._written:
            self._written[register] = value & 0xFF
        if register == WRITE_DATA[-1]:
            self._send(bytes(self._written[each] for each in WRITE_DATA))

    def read(self, register: int) -> int:
        """Return a register, a byte."""
        return self._next() if register == 0 else self._read.get(register, 0)

    def _next(self) -> int:
        """Take the next message; return 0 if there is none."""
        if not self._waiting:
            self._waiting.extend(self._listen(self._empty))
        self._empty = not self._waiting
        if self._empty:
            return 0
        heard = self._waiting.popleft()
        bearing = round(heard.bearing_rad % (2 * math.pi) / _BEARING)
        place = struct.pack(">HH", bearing, to_counts(heard.range_m))
        self._read.update(zip(READ_DATA, heard.data, strict=True))
        self._read.update(zip(READ_PLACE, place, strict=True))
        return 1
