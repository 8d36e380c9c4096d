"""A thread that looks again and again whether something has to be done, such as stopping a robot.

Contract: ``end`` returns when the thread is gone; ``start`` and ``end`` may be called any number of
times.
"""

import threading
from collections.abc import Callable


class Watchdog:
    """Call a function every so many seconds, in a thread of its own.

    Args:
        look: what to call; it must not raise.
        every_s: seconds between two calls, None for never.
    """

    def __init__(self, look: Callable[[], None], every_s: float | None) -> None:
        self._look = look
        self._every_s = every_s
        self._leave = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin, unless it runs already."""
        if self._every_s is None or (self._thread is not None and self._thread.is_alive()):
            return
        self._leave.clear()
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the thread and wait for it, unless it is this one."""
        self._leave.set()
        thread = self._thread
        self._thread = None
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def _run(self) -> None:
        while not self._leave.wait(self._every_s):
            self._look()
