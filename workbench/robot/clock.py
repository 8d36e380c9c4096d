"""The time that a robot, its link and its guard go by; tests hand over another one.

>>> CLOCK.now() <= CLOCK.now()
True
"""

import threading
import time


class Clock:
    """Wall-clock time."""

    def now(self) -> float:
        """Return seconds since some moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let seconds pass."""
        time.sleep(seconds)

    def wait(self, event: threading.Event, seconds: float | None) -> bool:
        """Wait for an event, at most so long; return whether it is set."""
        return event.wait(seconds)


CLOCK = Clock()
