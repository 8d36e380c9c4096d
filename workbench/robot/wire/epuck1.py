"""A real e-puck1 over its serial line, in SerCom (``robot.wire.sercom``), ASCII or binary.

    with SerComRobot("/dev/rfcomm0") as robot: ...
    with SerComRobot("/dev/ttyS0", variant="overo", binary=True) as robot: ...

Whatever state the parser was left in, every stop ends it first: zeros complete the longest operand
list and leave binary mode, a return ends half a line. What came too late for an earlier request is
dropped. Speeds count as told when the robot's own echo of them says so. On the Overo the ground
sensors are on a bus of Linux and not here.

Contract: see ``robot.api``. No request waits longer than the link's time-out, but calibration (up
to 4 s).
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from workbench import fields
from workbench.robot.api import PATIENCE_S, Robot
from workbench.robot.faults import BadReply, LinkTimeout
from workbench.robot.guardian import GuardedLink
from workbench.robot.range_bearing import (
    BUS_ADDRESS,
    MOST_HEARD,
    MOST_WAITING,
    READ_DATA,
    READ_PLACE,
    ROBOTS,
    SET_UP,
    WRITE_DATA,
    Heard,
    to_heard,
)
from workbench.robot.wire.links import Link, SerialLink
from workbench.robot.wire.sercom import (
    READS,
    VARIANTS,
    Variant,
    ascii_numbers,
    ascii_request,
    battery,
    binary_numbers,
    binary_request,
    check_counts,
)

ENTRY = "workbench.robot.wire.epuck1:SerComRobot"
CALIBRATION_S = 4.0
AT_ONCE = 8  # requests for the same register: what the robot's receiver holds
RESET_S = 0.9
QUIET_S = 0.05
# more zeros than any command waits for operands end a binary chain, a return ends a line
ENDS_ALL = bytes(64) + b"\r"


def _capabilities(variant: Variant, board: bool) -> frozenset[str]:
    able = {"proximity", "light", "motor_speed", "motor_position", "accelerometer", "selector"}
    able |= {"drive", "calibrate", "led", "raw", "microphone", "sound"}
    able |= {"battery"} if variant.battery else set()
    able |= {"floor"} if variant.floor_binary else set()
    able |= {"body_led", "front_led"} if variant.lights else set()
    able |= {"range_bearing", "send"} if board else set()
    return frozenset(able)


class SerComRobot(Robot):
    """An e-puck1.

    Args:
        address: serial port.
        debug: print every exchange.
        variant: one of ``sercom.VARIANTS``.
        binary: use the binary protocol for sensors and speeds.
        baud: default: the variant's.
        board: whether a range-and-bearing board is on it, see ``robot.range_bearing``.
        number: which robot of a formation it is, 0 the leader: what reports on it call it.
        timeout_s: for one reply.
        guardian: put a process between program and wire that stops the robot when the program is
            killed, see ``robot.guardian``.
        kinds: ``period_s``, ``watchdog_s``, ``clock``, see Robot.
        link: opens another link than a serial port, for tests.
    """

    wired = True
    calibration_s = CALIBRATION_S
    most_counts = 2**15 - 1

    def __init__(
        self,
        address: str,
        debug: bool = False,
        *,
        variant: str = "epuck1",
        binary: bool = False,
        baud: int | None = None,
        board: bool = False,
        number: int = 1,
        timeout_s: float = 0.25,
        guardian: bool = False,
        link: Callable[[], Link] | None = None,
        **kinds: Any,
    ) -> None:
        super().__init__(debug=debug, **kinds)
        if variant not in VARIANTS:
            raise ValueError(f"variant = {variant!r}; expected one of {', '.join(VARIANTS)}")
        if not isinstance(board, bool):
            raise ValueError(f"board = {board!r}; expected True or False")
        if board and not VARIANTS[variant].bus:
            able = ", ".join(row.name for row in VARIANTS.values() if row.bus)
            raise ValueError(
                f"board = True with variant = {variant!r}, whose bus is not there for programs: "
                f"expected variant = {able}"
            )
        self.address = address
        self.variant = VARIANTS[variant]
        self.binary = binary
        self.baud = baud or self.variant.baud
        self.timeout_s = timeout_s
        self.capabilities = _capabilities(self.variant, board)
        self.number = fields.whole("number", number, 0, ROBOTS - 1)
        self._forget_board()
        self._link: Link | None = None
        self._connect = link or (self._open_guarded if guardian else self._open_port)

    def _open(self) -> None:
        self._link = self._connect()
        self._forget_board()

    def _open_port(self) -> Link:
        return SerialLink(self.address, self.baud, timeout_s=self.timeout_s, clock=self.clock)

    def _open_guarded(self) -> Link:
        own = {"variant": self.variant.name, "binary": self.binary, "baud": self.baud}
        return GuardedLink(
            ENTRY,
            self.address,
            own,
            silence_s=self.watchdog_s,
            timeout_s=self.timeout_s,
            clock=self.clock,
        )

    def _send_stop(self) -> None:
        self._channel().write(ENDS_ALL + ascii_request("D", 0, 0))

    def _end_request(self) -> None:
        self._channel().write(ENDS_ALL)

    def _stands(self) -> bool:
        return self._ask("E", counts=(2,)) == (0, 0)

    def _announce(self, seconds: float) -> None:
        self._channel().patience(seconds)

    def _limit(self, until: float) -> None:
        if self._link is not None:
            self._link.until = until

    def _close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def _settle(self) -> None:
        """Read until the line is quiet."""
        link = self._channel()
        try:
            for _ in range(20):
                link.read_line(QUIET_S)
        except (LinkTimeout, BadReply):
            pass  # quiet, or a half line
        link.drain()

    def _channel(self) -> Link:
        if self._link is None:
            raise LinkTimeout("the serial port is closed")
        return self._link

    def _say(self, data: bytes) -> Link:
        link = self._channel()
        link.drain()
        if self.debug:
            print("→", data)
        link.write(data)
        return link

    def _ask(self, letter: str, *numbers: int, counts: tuple[int, ...]) -> tuple[int, ...]:
        link = self._say(ascii_request(letter, *numbers))
        line = self._read_reply(link, letter.lower(), self.timeout_s)
        return ascii_numbers(line, letter.lower(), counts)

    def _read_reply(self, link: Link, letter: str, timeout_s: float) -> bytes:
        """Return the line that begins with a letter; lines before it answer requests that were
        given up.
        """
        deadline = self.clock.now() + timeout_s
        other = None
        while True:
            try:
                line = link.read_line(max(0.0, deadline - self.clock.now()))
            except LinkTimeout:
                if other is None:
                    raise
                raise BadReply(f"expected '{letter},…', got {other[:60]!r}") from None
            if self.debug:
                print("←", line)
            if line[:1] == letter.encode():
                return line
            other = line

    def _drive(self, left: int, right: int) -> None:
        # the echo of E behind it confirms that it was heard, and heard right
        if self.binary:
            link = self._say(binary_request(("D", left, right), ("E",)))
            told = binary_numbers(link.read(4), "h")
        else:
            link = self._say(ascii_request("D", left, right) + ascii_request("E"))
            told = ascii_numbers(self._read_reply(link, "e", self.timeout_s), "e", (2,))
        if told != (left, right):
            raise BadReply(f"speeds {(left, right)} were sent, {told} came back")

    def _count(self, sensor: str, *, binary: bool) -> tuple[int, ...]:
        if sensor in ("proximity", "light"):
            return (self.variant.infrared,)
        if sensor == "floor":
            return (self.variant.floor_binary if binary else self.variant.floor_ascii,)
        return (3,) if sensor == "accelerometer" else (2,)

    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        found: dict[str, tuple[float, ...]] = {}
        always = ("floor",) if self.variant.floor_ascii_garbled else ()
        chained = [s for s in sensors if s in READS and (self.binary or s in always)]
        if chained:
            # the echo of E behind the readings tells replies that have slipped, such as the late
            # half of an earlier one
            link = self._say(binary_request(*((READS[sensor][0],) for sensor in chained), ("E",)))
            sizes = [2 * self._count(sensor, binary=True)[0] for sensor in chained]
            data = link.read(sum(sizes) + 4)
            told = binary_numbers(data[-4:], "h")
            if told != self._speed:
                raise BadReply(
                    f"speeds {self._speed} are set, {told} came back behind the readings"
                )
            for sensor, size in zip(chained, sizes, strict=True):
                found[sensor] = self._accept(sensor, binary_numbers(data[:size], READS[sensor][2]))
                data = data[size:]
        for sensor in sensors:
            if sensor not in found:
                found[sensor] = self._read_one(sensor)
        return found

    def _read_one(self, sensor: str) -> tuple[float, ...]:
        if sensor in READS:
            letter = READS[sensor][0]
            if sensor == "accelerometer":
                letter = "A"
            return self._accept(sensor, self._ask(letter, counts=self._count(sensor, binary=False)))
        if sensor == "selector":
            return self._accept(sensor, self._ask("C", counts=(1,)))
        if sensor == "battery":
            link = self._say(ascii_request("b"))
            return (float(battery(self._read_reply(link, "b", self.timeout_s))),)
        if sensor == "range_bearing":
            return self._listen()
        return self._accept(sensor, self._ask("U", counts=(3,)))

    # the range-and-bearing board, register by register over the bus

    def _forget_board(self) -> None:
        self._board_ready = False
        self._messages: list[Heard] = []  # of this exchange
        self._announced: bool | None = None  # whether there was one, as far as that was heard
        self._taken = False  # whether a message has been taken that is still to be read
        self._data: Sequence[int] = ()

    def _set_up_board(self) -> None:
        """Set the board up, once, and forget what it has heard before; there is time of its own for
        that.
        """
        if self._board_ready:
            return
        self._limit(self.clock.now() + PATIENCE_S)
        self._write_registers(SET_UP)
        for _ in range(MOST_WAITING // AT_ONCE + 1):
            if 0 in self._registers(*[0] * AT_ONCE):
                break
        self._taken = False
        self._board_ready = True
        self._limit(self.clock.now() + PATIENCE_S)

    def _listen(self) -> tuple[float, ...]:
        """Return range, bearing and data of what the board has heard, one after the other: what can
        be read in half a control period, and one message at least. The rest waits in the board. A
        reply that was no good loses no message that had been announced.
        """
        self._set_up_board()
        until = self.clock.now() + (self.period_s / 2 or math.inf)
        while len(self._messages) < MOST_HEARD:
            if not self._taken and not self._take():
                break
            data = self._data or self._registers(*READ_DATA)
            self._data = ()
            self._messages.append(to_heard(data, self._registers(*READ_PLACE)))
            self._taken = False
            if self.clock.now() > until:
                break
        heard = self._messages
        self._messages = []
        told = [(one.range_m, one.bearing_rad, float(int.from_bytes(one.data))) for one in heard]
        return tuple(number for one in told for number in one)

    def _take(self) -> bool:
        """Take the next message, with its data in the same go; return whether there was one."""
        self._data = ()
        self._announced = None
        try:
            _, *data = self._registers(0, *READ_DATA)
        except (LinkTimeout, BadReply):
            if self._announced is False:  # the rest says nothing
                return False
            raise
        self._data = tuple(data)
        return self._taken

    def _registers(self, *numbers: int) -> list[int]:
        """Return registers of the board, asked for at once: no more than the receiver holds."""
        link = self._say(b"".join(ascii_request("Y", BUS_ADDRESS, number) for number in numbers))
        values = []
        for number in numbers:
            echo = ascii_numbers(self._read_reply(link, "y", self.timeout_s), "y", (2,))
            if echo != (BUS_ADDRESS, number):
                raise BadReply(f"register {(BUS_ADDRESS, number)} was asked for, {echo} came back")
            [value] = ascii_numbers(self._read_reply(link, "y", self.timeout_s), "y", (1,))
            if not -128 <= value <= 255:
                raise BadReply(f"register {number} of the board is {value}; expected a byte")
            values.append(value & 0xFF)  # the firmware's bytes are signed
            if number == 0:
                if value not in (0, 1):
                    raise BadReply(
                        f"register 0 of the board is {value}; expected 0 or 1: is it on?"
                    )
                self._announced = self._taken = value == 1
        return values

    def _write_registers(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Write registers of the board, told at once."""
        lines = [ascii_request("W", BUS_ADDRESS, *pair) for pair in pairs]
        link = self._say(b"".join(lines))
        for _ in lines:
            ascii_numbers(self._read_reply(link, "w", self.timeout_s), "w", (0,))

    def _send(self, data: tuple[int, ...]) -> None:
        self._set_up_board()
        self._write_registers(list(zip(WRITE_DATA, data, strict=True)))

    def _accept(self, sensor: str, values: tuple[int, ...]) -> tuple[float, ...]:
        if sensor in ("proximity", "light"):
            return check_counts(sensor, values)[:8]
        if sensor == "floor":
            return check_counts(sensor, values)[:3]
        return tuple(float(value) for value in values)

    def _set_device(self, device: str, values: tuple[int, ...]) -> None:
        if device == "motor_position":
            self._ask("P", *values, counts=(0,))
        elif device == "led":
            self._ask("L", *values, counts=(0,))
        elif device == "sound":
            self._ask("T", *values, counts=(0,))
        elif device == "body_led":
            self._ask("B", *values, counts=(0,))
        elif device == "send":
            self._send(values)
        elif device == "front_led":
            self._ask("F", *values, counts=(0,))
        else:
            self._limit(self.clock.now() + self.timeout_s + CALIBRATION_S)
            self._announce(CALIBRATION_S + 1.0)
            link = self._say(ascii_request("K"))
            for patience in (self.timeout_s, CALIBRATION_S):  # it has started; it has finished
                self._read_reply(link, "k", patience)

    def _version(self) -> str:
        with self._lock:
            return str(self._protected(lambda: self._raw("V")))

    def _reset(self) -> None:
        self._drive(0, 0)
        self._forget_board()
        until = self.clock.now() + RESET_S
        self._limit(until)
        link = self._say(ascii_request("R"))
        while b"WELCOME" not in link.read_line(until - self.clock.now()):
            pass
        self._settle()

    def _raw(self, message: str) -> str:
        link = self._say(message.encode("ascii") + b"\r")
        lines = [link.read_line()]
        try:
            while len(lines) < 20:
                lines.append(link.read_line(QUIET_S))
        except LinkTimeout:
            pass  # that was all
        return "\n".join(line.decode("ascii", "replace") for line in lines)
