"""What is compiled at the first use of all, and a bar while that lasts.

>>> prepare(progress=False)  # later runs begin at once, also those of other processes
"""

import gc
import multiprocessing
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core import event
from tqdm.auto import tqdm

from workbench import paths, sources
from workbench.compiled import on_disk
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.records import PERIOD
from workbench.formation.shapes import FormationConfig
from workbench.lab.progress import Progress
from workbench.lab.records import Recorder
from workbench.lab.sweeps import cores

# what needs each of the three loops, and about how many functions this process compiles of it, for
# the bar alone
LOOPS = {
    "line": (ConvoyConfig(), 76),
    "places": (ConvoyConfig(followers=1, formation=FormationConfig(frame="heading")), 92),
    "whole": (SETTINGS["infrared"], 125),
}
_HALF = "import sys; from workbench.lab.compiling import compile_half; compile_half(sys.argv[1])"


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


def _loop(convoy: Convoy) -> str:
    """Return which of LOOPS a convoy runs."""
    if not convoy.plain:
        return "whole"
    return "places" if convoy.config.formation.shaped else "line"


def compile_half(loop: str) -> None:
    """Compile the second half of a loop, and what records it, for another process to find on
    disk.
    """
    config, _ = LOOPS[loop]
    with _uncollected():
        Convoy(config, [1], steps=1).compile_half(1)
        Recorder(config, 1).add(np.zeros((1, config.followers + 1), PERIOD), 0)


@contextmanager
def _half_elsewhere(loop: str) -> Iterator[None]:
    """Let another process compile the second half of a loop meanwhile, and wait for it."""
    # not by multiprocessing, which would run an unguarded script again
    path = [str(sources.PACKAGE.parent), os.environ.get("PYTHONPATH", "")]
    other = subprocess.Popen(
        [sys.executable, "-c", _HALF, loop],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, path))},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
        other.wait()  # if it fails, this process compiles all that is missing
    finally:
        other.kill()
        other.wait()


def _compile(convoy: Convoy, *, periods: bool = False) -> None:
    """Compile a convoy's loop: on two cores where all of it is missing, but in a worker, beside
    which others work.
    """
    alone = multiprocessing.parent_process() is None and cores() > 1
    if alone and sys.executable and not on_disk(convoy.loop):
        with _half_elsewhere(_loop(convoy)):
            convoy.compile_half(0)
    convoy.compile(periods=periods)


def compile_blocks(convoy: Convoy, progress: Progress) -> None:
    """Compile what a convoy runs whole blocks by."""
    with watched(progress, LOOPS[_loop(convoy)][1]), _uncollected():
        _compile(convoy)


def prepare(config: ConvoyConfig | None = None, *, progress: Progress = True) -> None:
    """Compile what learning with a configuration needs, one seed at a time, and watching it live,
    so that nothing waits for it later. What a classical law needs is compiled when it drives.

    Args:
        config: default the paper's, and whatever needs no more than that.
        progress: True for a bar while something is compiled.
    """
    convoy = Convoy(config or ConvoyConfig(), [1], steps=1)
    recorder = Recorder(convoy.config, 1)
    with watched(progress, LOOPS[_loop(convoy)][1]), _uncollected():
        _compile(convoy, periods=True)
        for [steps] in convoy.steps():
            recorder.add(steps, 0)
