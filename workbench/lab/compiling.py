"""What is compiled at the first use of all, and a bar while that lasts.

>>> prepare(progress=False)  # later runs begin at once, also those of other processes
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event
from tqdm.auto import tqdm

from workbench import paths
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.lab.progress import Progress

# about how many functions there are, of a plain configuration and of any other: for the bar alone
FUNCTIONS = {True: 90, False: 150}


class _Watch(event.Listener):
    """Shows a bar from the first function on that is compiled, not found in the cache."""

    def __init__(self, total: int) -> None:
        self.total = total
        self.bar: Any = None

    def on_start(self, event: Any) -> None:
        """Show the bar."""
        if self.bar is None:
            words = "compiling, once"
            self.bar = tqdm(total=self.total, desc=words, unit=" functions", leave=False)

    def on_end(self, event: Any) -> None:
        """Count a function; the bar may find more than it was told of."""
        self.bar.total = max(self.bar.total, self.bar.n + 1)
        self.bar.update(1)


@contextmanager
def watched(progress: Progress, total: int) -> Iterator[None]:
    """Show a bar while something is compiled, if ``progress`` is True."""
    if progress is not True or paths.STATIC:
        yield
        return
    watch = _Watch(total)
    with event.install_listener("numba:compile", watch):
        yield
    if watch.bar is not None:
        watch.bar.close()


def compile_blocks(convoy: Convoy, progress: Progress) -> None:
    """Compile what a convoy runs whole blocks by."""
    with watched(progress, FUNCTIONS[convoy.plain]):
        convoy.compile()


def prepare(config: ConvoyConfig | None = None, *, progress: Progress = True) -> None:
    """Compile what runs with a configuration need, the live arena included, so that nothing waits
    for it later.

    Args:
        config: default the paper's, and whatever needs no more than that.
        progress: True for a bar while something is compiled.
    """
    convoy = Convoy(config or ConvoyConfig(), [1], steps=1)
    with watched(progress, FUNCTIONS[convoy.plain]):
        convoy.compile(periods=True)
