"""A wire in memory, on a clock that only moves when somebody waits: thousands of faults in
seconds, without sleeping.
"""

import math
import threading

from workbench.robot.clock import Clock
from workbench.robot.wire.epuck1 import SerComRobot
from workbench.robot.wire.epuck2 import EPuck2Robot
from workbench.robot.wire.firmware import (
    CALIBRATION_S,
    STREAM_S,
    EPuck2Firmware,
    SerComFirmware,
)
from workbench.robot.wire.links import Link
from workbench.robot.wire.sercom import VARIANTS

APART_S = 0.005  # between header and payload of a streamed packet
DIALECTS = {  # name: firmware variant, binary
    "epuck1": ("epuck1", False),
    "epuck1 binary": ("epuck1", True),
    "overo": ("overo", True),
    "epuck1-bt": ("epuck1-bt", False),
    "epuck2": (None, False),
}


class SteppedClock(Clock):
    """Time that passes when somebody waits for it."""

    def __init__(self):
        self.seconds = 0.0

    def now(self):
        return self.seconds

    def sleep(self, seconds):
        self.seconds += max(seconds, 0.0)

    def wait(self, event: threading.Event, seconds):
        self.sleep(seconds or 0.0)
        return event.is_set()


class MemoryLink(Link):
    """A wire to a firmware. ``towards`` and ``back`` may change what goes over it."""

    def __init__(self, firmware, clock, timeout_s=0.2):
        super().__init__(timeout_s, clock)
        self.firmware = firmware
        self.sent = []
        self.towards = self.back = lambda data: data
        self._pending = b""

    def write(self, data):
        self.sent.append(data)
        self._pending += self.back(self.firmware.feed(self.towards(data)))

    def _receive(self, timeout_s):
        if not self._pending:
            self.clock.sleep(timeout_s)
        data, self._pending = self._pending, b""
        return data

    def fileno(self):
        raise OSError("a wire in memory has no descriptor")

    def close(self):
        self._pending = b""


class Stream(MemoryLink):
    """A wire over which packets come by the clock, asked for or not."""

    def __init__(self, firmware, clock):
        super().__init__(firmware, clock)
        self._due = 0.0
        self._rest = (math.inf, b"")
        self._calibrated = 0
        self._deaf_until = 0.0
        self.packets = 0

    def write(self, data):
        if self.clock.now() < self._deaf_until:
            return
        was_streaming = self.firmware.streaming
        super().write(data)
        if not was_streaming:
            self._due = max(self._due, self.clock.now())
        if self.firmware.calibrated != self._calibrated:
            self._calibrated = self.firmware.calibrated
            self._deaf_until = self.clock.now() + CALIBRATION_S
            self._due = max(self._due, self._deaf_until)

    def _receive(self, timeout_s):
        until = self.clock.now() + timeout_s
        while True:
            at, rest = self._rest
            following = min(at, self._due if self.firmware.streaming else math.inf)
            if following <= self.clock.now():
                if at <= following:
                    self._pending += rest
                    self._rest = (math.inf, b"")
                else:
                    self._send(following)
            elif self._pending or following > until:
                break
            else:
                self.clock.seconds = following
        if not self._pending:
            self.clock.seconds = max(self.clock.seconds, until)
        data, self._pending = self._pending, b""
        return data

    def _send(self, at):
        """Let a packet begin that was due."""
        self.firmware.live()
        packet = self.back(self.firmware.packet())
        self._pending += packet[:1]
        self._rest = (at + APART_S, packet[1:])
        self._due = at + STREAM_S
        self.packets += 1


def wired(dialect, body):
    """A driver, its link and the firmware around a connected body."""
    variant, binary = DIALECTS[dialect]
    clock = SteppedClock()
    link = (
        MemoryLink(SerComFirmware(body, VARIANTS[variant], lockstep=True), clock)
        if variant
        else Stream(EPuck2Firmware(body), clock)
    )
    kinds = {"period_s": 0.0, "watchdog_s": None, "clock": clock, "link": lambda: link}
    robot = (
        SerComRobot("memory", variant=variant, binary=binary, **kinds)
        if variant
        else EPuck2Robot("memory", **kinds)
    )
    return robot, link
