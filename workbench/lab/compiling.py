"""What is compiled at the first use of all, and a bar while that lasts.

>>> prepare(progress=False)  # later runs begin at once, also those of other processes
"""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event
from tqdm.auto import tqdm

from workbench import paths
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.lab.progress import Progress
from workbench.lab.records import Recorder

# about how many functions there are, of a plain configuration and of any other: for the bar alone
FUNCTIONS = {True: 115, False: 180}


class _Watch(event.Listener):
    """Shows a bar from the first function on that this thread compiles, not finds in the cache."""

    def __init__(self, total: int) -> None:
        self.total = total
        self.bar: Any = None
        self._thread = threading.get_ident()

    def on_start(self, event: Any) -> None:
        """Show the bar."""
        if self.bar is None and threading.get_ident() == self._thread:
            words = "compiling, once"
            self.bar = tqdm(total=self.total, desc=words, unit=" functions", leave=False)

    def on_end(self, event: Any) -> None:
        """Count a function; there may be more than the bar was told of."""
        if self.bar is not None and threading.get_ident() == self._thread:
            self.bar.total = max(self.bar.total, self.bar.n + 1)
            self.bar.update(1)


@contextmanager
def watched(progress: Progress, total: int) -> Iterator[None]:
    """Show a bar while something is compiled, if ``progress`` is True."""
    if progress is not True or paths.STATIC:
        yield
        return
    watch = _Watch(total)
    try:
        with event.install_listener("numba:compile", watch):
            yield
    finally:
        if watch.bar is not None:
            watch.bar.close()


@contextmanager
def _uncollected() -> Iterator[None]:
    """Collect no garbage meanwhile: a compiler leaves little, and looking for it takes a
    twentieth of its time. In the main thread alone: of two, one would undo the other's.
    """
    collecting = gc.isenabled() and threading.current_thread() is threading.main_thread()
    if not collecting:
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def compile_blocks(convoy: Convoy, progress: Progress) -> None:
    """Compile what a convoy runs whole blocks by."""
    with watched(progress, FUNCTIONS[convoy.plain]), _uncollected():
        convoy.compile()


def prepare(config: ConvoyConfig | None = None, *, progress: Progress = True) -> None:
    """Compile what learning with a configuration needs, one seed at a time, and watching it live,
    so that nothing waits for it later. What a classical law needs is compiled when it drives.

    Args:
        config: default the paper's, and whatever needs no more than that.
        progress: True for a bar while something is compiled.
    """
    convoy = Convoy(config or ConvoyConfig(), [1], steps=1)
    recorder = Recorder(convoy.config, 1)
    with watched(progress, FUNCTIONS[convoy.plain]), _uncollected():
        convoy.compile(periods=True)
        for [steps] in convoy.steps():
            recorder.add(steps, 0)
