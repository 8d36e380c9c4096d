"""A real e-puck2 over WiFi: 21 bytes of commands, 1 + 104 bytes of sensors, on TCP port 1000.

Offsets: GCtronic's e-puck2 firmware and its clients. Every packet that asks for sensors also
carries the wheel speeds, so that a read never leaves them behind. The motors do up to 1100 steps/s.

>>> len(command(300, -300, sensors=True)), command(300, -300, sensors=True)[:7].hex()
(21, '8002002c01d4fe')

Contract: see ``robot.api``.
"""

import struct
from collections.abc import Sequence

from workbench.robot.api import WATCHDOG_S, Robot
from workbench.robot.faults import BadReply, LinkTimeout, RobotError
from workbench.robot.geometry import CONTROL_PERIOD, MAX_STEPS_EPUCK2
from workbench.robot.wire.links import TcpLink
from workbench.robot.wire.sercom import check_counts

COMMAND = 0x80
SENSORS_PACKET = 0x02
EMPTY_PACKET = 0x03
IMAGE_PACKET = 0x01
COMMAND_BYTES = 21
SENSOR_BYTES = 104
IMAGE_BYTES = 38400
SOUND_STOP = 0x20
PLACES = {  # sensor: offset in the sensor bytes, struct code
    "accelerometer": (0, "<3h"),
    "proximity": (37, "<8H"),
    "light": (53, "<8H"),
    "microphone": (71, "<4H"),
    "motor_position": (79, "<2h"),
    "battery": (83, "<H"),
    "selector": (89, "<B"),
    "floor": (90, "<3H"),
}


def command(
    left: int,
    right: int,
    *,
    sensors: bool,
    calibrate: bool = False,
    position: bool = False,
    leds: int = 0,
) -> bytes:
    """Return a command packet: speeds in steps/s, or with ``position`` the step counters; leds: a
    bit for each light.
    """
    head = struct.pack(
        "<BBBhhB",
        COMMAND,
        0b10 if sensors else 0,
        (1 if calibrate else 0) | (4 if position else 0),
        left,
        right,
        leds,
    )
    return head + bytes(12) + bytes([SOUND_STOP])


def parse_sensors(data: bytes) -> dict[str, tuple[float, ...]]:
    """Return all sensors of a packet's 104 bytes.

    Raises:
        BadReply: another length, or counts that cannot be.
    """
    if len(data) != SENSOR_BYTES:
        raise BadReply(f"expected {SENSOR_BYTES} sensor bytes, got {len(data)}")
    found: dict[str, tuple[float, ...]] = {}
    for sensor, (place, code) in PLACES.items():
        values = struct.unpack_from(code, data, place)
        if sensor in ("proximity", "light", "floor"):
            found[sensor] = check_counts(sensor, values)
        else:
            found[sensor] = tuple(float(value) for value in values)
    return found


class EPuck2Robot(Robot):
    """An e-puck2.

    Args:
        address: host or host:port.
        debug: print every exchange.
        timeout_s: for one reply.
        period_s, watchdog_s: see Robot.
    """

    capabilities = frozenset(PLACES) | {"motor_speed", "drive", "calibrate", "led"}
    most_steps = MAX_STEPS_EPUCK2
    most_counts = 2**15 - 1

    def __init__(
        self,
        address: str,
        debug: bool = False,
        *,
        timeout_s: float = 0.25,
        period_s: float = CONTROL_PERIOD,
        watchdog_s: float | None = WATCHDOG_S,
    ) -> None:
        super().__init__(period_s=period_s, watchdog_s=watchdog_s, debug=debug)
        host, _, port = address.partition(":")
        if not host or (port and not port.isdigit()) or int(port or 1000) > 65535:
            raise ValueError(f"address = {address!r}; expected HOST or HOST:PORT")
        self.host = host
        self.port = int(port or 1000)
        self.timeout_s = timeout_s
        self._link: TcpLink | None = None
        self._leds = 0

    def _open(self) -> None:
        self._link = TcpLink(self.host, self.port, timeout_s=self.timeout_s)
        try:
            self._converse(command(0, 0, sensors=False))
        except RobotError:
            self._close()
            raise

    def _close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def _converse(self, packet: bytes, timeout_s: float | None = None) -> bytes:
        """Send a packet and return the reply's bytes after the header."""
        if self._link is None:
            raise LinkTimeout("the connection is closed")
        self._link.drain()
        self._link.write(packet)
        head = self._link.read(1, timeout_s)[0]
        sizes = {SENSORS_PACKET: SENSOR_BYTES, EMPTY_PACKET: 0, IMAGE_PACKET: IMAGE_BYTES}
        if head not in sizes:
            raise BadReply(f"expected a packet that begins with {sorted(sizes)}, got {head}")
        data = self._link.read(sizes[head], timeout_s)
        if self.debug:
            print("→", packet.hex(), "←", head, len(data))
        return data

    def _drive(self, left: int, right: int) -> None:
        self._converse(command(left, right, sensors=False, leds=self._leds))

    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        if not sensors:
            return {}
        found = parse_sensors(self._converse(command(*self._speed, sensors=True, leds=self._leds)))
        found["motor_speed"] = (float(self._speed[0]), float(self._speed[1]))
        return {sensor: found[sensor] for sensor in sensors}

    def _set_device(self, device: str, values: tuple[int, ...]) -> None:
        if device == "motor_position":
            self._converse(command(*values, sensors=False, position=True, leds=self._leds))
            self._drive(*self._speed)
        elif device == "led":
            led, value = values
            bits = 1 << led if 0 <= led < 8 else 0xFF
            self._leds = (
                self._leds ^ bits
                if value == 2
                else (self._leds | bits if value else self._leds & ~bits)
            )
            self._drive(*self._speed)
        else:
            self._converse(
                command(*self._speed, sensors=False, calibrate=True, leds=self._leds), 4.0
            )

    def _version(self) -> str:
        return f"e-puck2 at {self.host}:{self.port}"
