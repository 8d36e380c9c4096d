"""Ends of programs: whatever ends one, connected robots are stopped first.

    a program that ends, or fails, without ``with``    at exit, for every connected robot
    Ctrl-C (SIGINT), SIGTERM, SIGHUP                   as KeyboardInterrupt, once: what comes while
                                                       robots are being stopped is only noted
    Ctrl-C while code is compiled                      compilers swallow it: it is noted, and looked
                                                       at before a robot is told to move

SIGINT is noted from the moment on when ``open_robot`` is imported; the other handlers are put in
place when the first robot connects and taken away when the last one is gone; those of others are
left alone. SIGKILL and a computer that loses power cannot be caught: see ``robot.guardian``.

Contract: handlers are Python's and belong to the main thread; elsewhere only the end of the program
is looked after.
"""

import atexit
import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any
from weakref import WeakSet

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
ON_ITS_WAY_S = 1.0  # s in which an interruption has reached what stops the robots
REMEMBERED_S = 60.0  # s, longer than anything compiles
_USUAL = (signal.SIG_DFL, signal.default_int_handler)


class _Ends:
    """Who is looked after, and what has come in.

    Attributes:
        robots: that are connected.
        holders: who wants the handlers: robots, and a command line from its first line on.
        before: the handlers that were there.
        noted: when a signal came that nobody has acted on for sure, in s of ``time.monotonic``.
        stopping: how deep in what stops robots the main thread is; held: a signal came meanwhile.
    """

    def __init__(self) -> None:
        self.robots: WeakSet[Any] = WeakSet()
        self.holders = 0
        self.before: dict[int, Any] = {}
        self.noted = -math.inf
        self.stopping = 0
        self.held = False


_now = _Ends()


def _in_main() -> bool:
    return threading.current_thread() is threading.main_thread()


def add(robot: Any) -> None:
    """Look after a robot that has connected."""
    if robot not in _now.robots:
        _now.robots.add(robot)
        hold()


def remove(robot: Any) -> None:
    """Look after a robot no longer: it stands, or its link is gone."""
    if robot in _now.robots:
        _now.robots.discard(robot)
        release()


def hold() -> None:
    """Put handlers in place, unless they are."""
    _now.holders += 1
    if _now.before or not _in_main():
        return
    note_interrupts()
    for number in SIGNALS:
        if signal.getsignal(number) in _USUAL:
            _now.before[number] = signal.signal(number, _interrupt)


def note_interrupts() -> None:
    """Note from now on when the program is interrupted: importing and compiling swallow it."""
    if _in_main() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def release() -> None:
    """Take handlers away with the last who wants them."""
    _now.holders = max(0, _now.holders - 1)
    if _now.holders or not _in_main():
        return
    for number, handler in _now.before.items():
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, handler)
    _now.before.clear()


def _interrupt(number: int, frame: FrameType | None) -> None:
    again = time.monotonic() - _now.noted < ON_ITS_WAY_S
    _now.noted = time.monotonic()
    if _now.stopping:
        _now.held = True
        return
    # the first one is on its way to what stops the robots: nothing may overtake it
    if again and any(robot.is_connected() for robot in _now.robots):
        return
    raise KeyboardInterrupt


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let no signal interrupt what stops a robot; it interrupts what comes after."""
    if not _in_main():
        yield
        return
    _now.stopping += 1
    try:
        yield
    finally:
        _now.stopping -= 1
        if _now.held and not _now.stopping:
            _now.held = False
            settle()
            raise KeyboardInterrupt


def look() -> None:
    """Raise KeyboardInterrupt if a signal was swallowed: called before a robot is told to move."""
    if _is_noted():
        settle()
        raise KeyboardInterrupt


def settle() -> None:
    """Forget a signal that has been acted on: the robot was stopped."""
    _now.noted = -math.inf


def _is_noted() -> bool:
    return time.monotonic() - _now.noted < REMEMBERED_S


@atexit.register
def _at_exit() -> None:
    for robot in list(_now.robots):
        with suppress(KeyboardInterrupt):
            robot.disconnect()
