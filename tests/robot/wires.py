"""A wire in memory, on a clock that only moves when somebody waits: thousands of faults in
seconds, without sleeping.
"""

import threading

from workbench.robot.clock import Clock
from workbench.robot.wire.epuck1 import SerComRobot
from workbench.robot.wire.epuck2 import EPuck2Robot
from workbench.robot.wire.firmware import EPuck2Firmware, SerComFirmware
from workbench.robot.wire.links import Link
from workbench.robot.wire.sercom import VARIANTS

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


def wired(dialect, body):
    """A driver, its link and the firmware around a connected body."""
    variant, binary = DIALECTS[dialect]
    clock = SteppedClock()
    firmware = (
        SerComFirmware(body, VARIANTS[variant], lockstep=True)
        if variant
        else EPuck2Firmware(body, lockstep=True)
    )
    link = MemoryLink(firmware, clock)
    kinds = {"period_s": 0.0, "watchdog_s": None, "clock": clock, "link": lambda: link}
    robot = (
        SerComRobot("memory", variant=variant, binary=binary, **kinds)
        if variant
        else EPuck2Robot("memory", **kinds)
    )
    return robot, link
