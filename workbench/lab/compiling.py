"""What is compiled at the first use of all, and a bar while that lasts.

>>> prepare(progress=False)  # later runs begin at once, also those of other processes
"""

import contextlib
import gc
import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import event
from tqdm.auto import tqdm

from workbench import paths, sources
from workbench.compiled import adopt, on_disk, parent
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.records import PERIOD
from workbench.formation.shapes import FormationConfig
from workbench.lab.progress import Progress
from workbench.lab.records import Recorder
from workbench.lab.sweeps import cores

# what needs each of the three loops, and about how many functions it has, for the bar alone
LOOPS = {
    "line": (ConvoyConfig(), 113),
    "places": (ConvoyConfig(followers=1, formation=FormationConfig(frame="heading")), 135),
    "whole": (SETTINGS["infrared"], 180),
}
_OWN_SHARE = 0.67  # of them, where another process helps
_PATIENCE_S = 300.0  # with the other process
_HELP = "import sys; from workbench.lab.compiling import help_compile; help_compile(sys.argv[1])"


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


def _kind(convoy: Convoy) -> str:
    """Return which of LOOPS a convoy runs."""
    if not convoy.plain:
        return "whole"
    return "places" if convoy.config.formation.shaped else "line"


def help_compile(kind: str) -> None:
    """Compile the second half of a loop, and what records it, for another process."""
    config, _ = LOOPS[kind]
    with _uncollected():
        _compile_half(Convoy(config, [1], steps=1), 1)
        Recorder(config, 1).add(np.zeros((1, config.followers + 1), PERIOD), 0)


def _compile_half(convoy: Convoy, half: int) -> None:
    for part, types in convoy.parts(half):
        part.compile(types)


@contextmanager
def _helped(kind: str) -> Iterator[None]:
    """Let another process compile the second half of a loop meanwhile, and take over what it made.
    What fails there is left to this process.
    """
    # a cache of its own: in a common one both could write one file
    with tempfile.TemporaryDirectory("-helper", dir=parent(), ignore_cleanup_errors=True) as place:
        helper = _begin_helper(kind, place)
        try:
            yield
            if helper is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    helper.wait(_PATIENCE_S)
        finally:
            if helper is not None:
                helper.kill()
                helper.wait()
        with contextlib.suppress(OSError):
            adopt(Path(place))


def _begin_helper(kind: str, place: str) -> "subprocess.Popen[bytes] | None":
    """Return a process that compiles into a cache at a place, None where none can begin."""
    found = [str(sources.PACKAGE.parent), os.environ.get("PYTHONPATH", "")]
    own = {"PYTHONPATH": os.pathsep.join(filter(None, found)), "NUMBA_CACHE_DIR": place}
    quiet = subprocess.DEVNULL
    # not by multiprocessing, which would run an unguarded script again
    command = [sys.executable, "-P", "-c", _HELP, kind]
    try:
        return subprocess.Popen(
            command, env=os.environ | own, stdin=quiet, stdout=quiet, stderr=quiet
        )
    except OSError:
        return None


def compile_blocks(convoy: Convoy, progress: Progress, *, periods: bool = False) -> None:
    """Compile what a convoy runs whole blocks by, and single periods if asked for. On two cores
    where nothing of it is on disk; never in a worker process, whose neighbours use the other cores.
    """
    kind = _kind(convoy)
    total = LOOPS[kind][1]
    loop = convoy.loop
    free = multiprocessing.parent_process() is None and cores() > 1 and sys.executable
    helped = free and loop is not None and not on_disk(loop)
    with watched(progress, round(total * _OWN_SHARE) if helped else total), _uncollected():
        if helped:
            with _helped(kind):
                _compile_half(convoy, 0)
        convoy.compile(periods=periods)


def prepare(config: ConvoyConfig | None = None, *, progress: Progress = True) -> None:
    """Compile what learning with a configuration needs, one seed at a time, and watching it live,
    so that nothing waits for it later. What a classical law needs is compiled when it drives.

    Args:
        config: default the paper's, and whatever needs no more than that.
        progress: True for a bar while something is compiled.
    """
    convoy = Convoy(config or ConvoyConfig(), [1], steps=1)
    recorder = Recorder(convoy.config, 1)
    compile_blocks(convoy, progress, periods=True)
    with _uncollected():
        for [steps] in convoy.steps():
            recorder.add(steps, 0)
