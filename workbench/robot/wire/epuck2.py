"""A real e-puck2 over WiFi: 21 bytes of commands, 1 + 104 bytes of sensors, on TCP port 1000.

Offsets: GCtronic's e-puck2 firmware and its clients. Once asked, the robot sends sensor packets at
about 45 Hz, header and payload apart: what comes in is read as a stream of frames, and the newest
one that came after the request counts. Every packet that asks for sensors also carries the wheel
speeds, so that a read never leaves them behind. The motors do up to 1100 steps/s. A stop is
confirmed by step counters that stay where they are.

>>> len(command(300, -300, sensors=True)), command(300, -300, sensors=True)[:7].hex()
(21, '8002002c01d4fe')

Contract: see ``robot.api``.
"""

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

from workbench.robot.api import Robot
from workbench.robot.faults import BadReply, LinkTimeout
from workbench.robot.geometry import MAX_STEPS_EPUCK2
from workbench.robot.guardian import GuardedLink
from workbench.robot.wire.links import Link, TcpLink
from workbench.robot.wire.sercom import check_counts

COMMAND = 0x80
SENSORS_PACKET = 0x02
EMPTY_PACKET = 0x03
IMAGE_PACKET = 0x01
COMMAND_BYTES = 21
SENSOR_BYTES = 104
IMAGE_BYTES = 38400
SIZES = {SENSORS_PACKET: SENSOR_BYTES, EMPTY_PACKET: 0, IMAGE_PACKET: IMAGE_BYTES}
SOUND_STOP = 0x20
ENTRY = "workbench.robot.wire.epuck2:EPuck2Robot"
CALIBRATION_S = 3.0  # one second deaf, one more without packets
ASK_AGAIN_S = 0.1
STILL_S = 0.05  # between two readings of the step counters that must not differ
RESYNCHRONISE_S = 0.1
RGB_ON = 100
ENDS_ALL = bytes(COMMAND_BYTES)  # zeros complete half a packet, and begin none
PLACES = {  # sensor: offset in the sensor bytes, struct code
    "accelerometer": (0, "<3h"),
    "gyroscope": (18, "<3h"),
    "magnetometer": (24, "<3f"),
    "temperature": (36, "<b"),
    "proximity": (37, "<8H"),
    "light": (53, "<8H"),
    "distance": (69, "<H"),
    "microphone": (71, "<4H"),
    "motor_position": (79, "<2h"),
    "battery": (83, "<H"),
    "remote": (86, "<3B"),
    "selector": (89, "<B"),
    "floor": (90, "<3H"),
    "button": (102, "<B"),
}


def command(
    left: int,
    right: int,
    *,
    sensors: bool,
    calibrate: bool = False,
    position: bool = False,
    lights: bytes = bytes(13),
) -> bytes:
    """Return a command packet: speeds in steps/s, or with ``position`` the step counters.

    Args:
        lights: a byte of bits for LED1, LED3, LED5, LED7, body and front, then red, green and blue
            of LED2, LED4, LED6 and LED8.
    """
    head = struct.pack(
        "<BBBhh",
        COMMAND,
        0b10 if sensors else 0,
        (1 if calibrate else 0) | (4 if position else 0),
        left,
        right,
    )
    return head + lights + bytes([SOUND_STOP])


def lights_of(leds: Sequence[int]) -> bytes:
    """Return the thirteen bytes of lights: LED1 to LED8, body and front, each 0 or 1."""
    bits = sum(bool(leds[led]) << k for k, led in enumerate((0, 2, 4, 6, 8, 9)))
    colours = [RGB_ON if leds[led] else 0 for led in (1, 3, 5, 7) for _ in range(3)]
    return bytes([bits, *colours])


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
        if not all(map(math.isfinite, values)):
            raise BadReply(f"{sensor} {values}; expected finite numbers")
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
        guardian: put a process between program and wire that stops the robot when the program is
            killed, see ``robot.guardian``.
        kinds: ``period_s``, ``watchdog_s``, ``clock``, see Robot.
        link: opens another link than a socket, for tests.
    """

    capabilities = frozenset(PLACES) | {
        "age",
        "motor_speed",
        "drive",
        "calibrate",
        "led",
        "body_led",
        "front_led",
    }
    wired = True
    calibration_s = CALIBRATION_S
    most_steps = MAX_STEPS_EPUCK2
    most_counts = 2**15 - 1

    def __init__(
        self,
        address: str,
        debug: bool = False,
        *,
        timeout_s: float = 0.25,
        guardian: bool = False,
        link: Callable[[], Link] | None = None,
        **kinds: Any,
    ) -> None:
        super().__init__(debug=debug, **kinds)
        host, _, port = address.partition(":")
        if not host or (port and not port.isdigit()) or int(port or 1000) > 65535:
            raise ValueError(f"address = {address!r}; expected HOST or HOST:PORT")
        self.host = host
        self.port = int(port or 1000)
        self.timeout_s = timeout_s
        self._link: Link | None = None
        self._connect = link or (self._open_guarded if guardian else self._open_socket)
        self._leds = [0] * 10  # LED1 to LED8, body, front
        self._began = 0.0  # when the last frame began to come in

    def _open(self) -> None:
        self._link = self._connect()

    def _open_socket(self) -> Link:
        return TcpLink(self.host, self.port, timeout_s=self.timeout_s, clock=self.clock)

    def _open_guarded(self) -> Link:
        return GuardedLink(
            ENTRY,
            f"{self.host}:{self.port}",
            {},
            silence_s=self.watchdog_s,
            timeout_s=self.timeout_s,
            clock=self.clock,
        )

    def _close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def _announce(self, seconds: float) -> None:
        self._channel().patience(seconds)

    def _limit(self, until: float) -> None:
        if self._link is not None:
            self._link.until = until

    def _channel(self) -> Link:
        if self._link is None:
            raise LinkTimeout("the connection is closed")
        return self._link

    def _packet(self, left: int, right: int, *, sensors: bool, **kinds: bool) -> bytes:
        return command(left, right, sensors=sensors, lights=lights_of(self._leds), **kinds)

    def _send_stop(self) -> None:
        self._channel().write(ENDS_ALL + self._packet(0, 0, sensors=False))

    def _end_request(self) -> None:
        self._channel().write(ENDS_ALL)

    def _stands(self) -> bool:
        before = self._steps()
        self.clock.sleep(STILL_S)
        # what is streamed needs no command that could be garbled on its way
        heard = self._streamed()
        after = parse_sensors(heard)["motor_position"] if heard else self._steps()
        return after == before

    def _steps(self) -> tuple[float, ...]:
        return parse_sensors(self._converse(self._packet(0, 0, sensors=True)))["motor_position"]

    def _converse(self, packet: bytes) -> bytes:
        """Send a packet and return the payload of the newest frame that ends after it: of a sensor
        packet if it asked for sensors, of any frame otherwise.
        """
        link = self._channel()
        self._streamed()
        link.write(packet)
        asked = packet[1] & 0b10
        head, data = self._frame(link)
        while asked and head != SENSORS_PACKET:
            head, data = self._frame(link)
        if self.debug:
            print("→", packet.hex(), "←", head, len(data))
        return data

    def _frame(self, link: Link) -> tuple[int, bytes]:
        """Return the next frame: its first byte and its payload."""
        head = link.read(1)[0]
        self._began = self.clock.now()
        if head not in SIZES:
            self._resynchronise(link)
            raise BadReply(f"expected a packet that begins with {sorted(SIZES)}, got {head}")
        return head, link.read(SIZES[head])

    def _streamed(self) -> bytes:
        """Drop the whole frames that have come in, keep one that is on its way; return the last
        sensor packet's payload, b"" if there was none.
        """
        link = self._channel()
        waiting = link.arrived()
        newest = b""
        while waiting:
            if waiting[0] not in SIZES:
                self._resynchronise(link)
                return b""
            size = 1 + SIZES[waiting[0]]
            if len(waiting) < size:
                break
            if waiting[0] == SENSORS_PACKET:
                newest = bytes(waiting[1:size])
            del waiting[:size]
        return newest

    def _resynchronise(self, link: Link) -> None:
        """Drop what came in, up to the pause between two packets."""
        until = min(link.until, self.clock.now() + RESYNCHRONISE_S)
        while self.clock.now() < until:
            link.arrived().clear()
            self.clock.sleep(0.005)
            if not link.arrived():
                return

    def _drive(self, left: int, right: int) -> None:
        self._converse(self._packet(left, right, sensors=False))

    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        if not sensors:
            return {}
        found = parse_sensors(self._converse(self._packet(*self._speed, sensors=True)))
        found["motor_speed"] = (float(self._speed[0]), float(self._speed[1]))
        found["age"] = (self.clock.now() - self._began,)
        return {sensor: found[sensor] for sensor in sensors}

    def _set_device(self, device: str, values: tuple[int, ...]) -> None:
        if device == "motor_position":
            self._converse(self._packet(*values, sensors=False, position=True))
            self._drive(*self._speed)
        elif device == "calibrate":
            self._calibrate()
        else:
            for led in self._lights_meant(device, values[0]):
                value = values[-1]
                self._leds[led] = 1 - self._leds[led] if value == 2 else int(bool(value))
            self._drive(*self._speed)

    @staticmethod
    def _lights_meant(device: str, number: int) -> Sequence[int]:
        """Return the places of a device's lights in ``lights_of``'s list."""
        if device != "led":
            return [{"body_led": 8, "front_led": 9}[device]]
        return [number] if 0 <= number < 8 else range(8)

    def _calibrate(self) -> None:
        """Calibrate, and wait for the first sensor packet afterwards: it is deaf meanwhile."""
        until = self.clock.now() + CALIBRATION_S
        link = self._channel()
        self._limit(until)
        self._announce(CALIBRATION_S)
        self._converse(self._packet(*self._speed, sensors=False, calibrate=True))
        while True:
            self.clock.sleep(ASK_AGAIN_S)
            self._streamed()
            link.write(self._packet(*self._speed, sensors=True))
            try:
                self._limit(min(until, self.clock.now() + ASK_AGAIN_S))
                while self._frame(link)[0] != SENSORS_PACKET:
                    pass
                return
            except (LinkTimeout, BadReply):
                if self.clock.now() >= until:
                    raise

    def _version(self) -> str:
        return f"e-puck2 at {self.host}:{self.port}"
