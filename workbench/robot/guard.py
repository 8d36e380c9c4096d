"""The guard: stops a robot and makes sure that it stands.

A stop counts only when the speeds that the robot reads back are zero. Before every stop, whatever
its parser may be in the middle of is ended, or the stop would vanish in half a command. Stop needs
no reply to be sent; without confirmation it is sent again and again, and then the error says that
the robot may still be moving.

The watchdog is a thread of the guard's: it stops a moving robot whose program has said nothing for
some time.

Contract: ``stop`` takes at most STOP_S and is not interrupted by signals.
"""

import logging
import threading
from collections.abc import Callable
from typing import Protocol

from workbench.robot import ends
from workbench.robot.clock import Clock
from workbench.robot.faults import BadReply, LinkTimeout, RobotError

STOP_S = 0.4  # s for a stop with its confirmation
MAY_MOVE = "the robot may still be moving; stop is the first thing sent on reconnect"

_log = logging.getLogger("workbench.robot")


class Stoppable(Protocol):
    """What a guard needs of a robot."""

    def _send_stop(self) -> None:
        """End what the parser may be in the middle of and send stop; wait for nothing."""

    def _stands(self) -> bool:
        """Return whether the robot's own speeds are zero."""

    def _limit(self, until: float) -> None:
        """Let no reply be waited for beyond a moment of the clock."""


def stop(robot: Stoppable, clock: Clock) -> None:
    """Stop a robot, again and again until it is confirmed.

    Raises:
        LinkTimeout, BadReply: not confirmed within STOP_S.
        LinkLost: the link is gone.
    """
    with ends.undisturbed():
        until = clock.now() + STOP_S
        robot._limit(until)
        fault: RobotError = LinkTimeout("stop was not confirmed")
        while True:
            try:
                robot._send_stop()
                if robot._stands():
                    return
                fault = BadReply(f"speeds (0, 0) were sent, others came back: {MAY_MOVE}")
            except BadReply as error:
                fault = error
            except LinkTimeout as error:
                if not isinstance(fault, BadReply):  # which says more than that nothing came
                    fault = error
            if clock.now() >= until:
                raise fault


class Watchdog:
    """Call a function every so many seconds, in a thread of its own.

    Args:
        look: what to call; it must not raise.
        every_s: seconds between two calls, None for never.
        clock: time.

    ``end`` returns when the thread is gone; both may be called any number of times.
    """

    def __init__(self, look: Callable[[], None], every_s: float | None, clock: Clock) -> None:
        self._look = look
        self._every_s = every_s
        self._clock = clock
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
        while not self._clock.wait(self._leave, self._every_s):
            self._look()


def tell(words: str) -> None:
    """Say what a thread has done, where nobody can be raised at."""
    _log.warning(words)
