"""One progress bar for everything that takes long: rate and time left, plain where
WORKBENCH_STATIC=1.

A progress argument is True (a bar), False (nothing) or a function that is called with the number of
units just done.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from tqdm import tqdm

from workbench import paths

Progress = bool | Callable[[int], None]


@contextmanager
def report(
    progress: Progress, total: int, label: str, done: int = 0, unit: str = " updates"
) -> Iterator[Callable[[int], None]]:
    """Yield the function to call with the number of units just done, of ``total`` with ``done``
    before.
    """
    if callable(progress):
        yield progress
        return
    hidden = not progress or paths.STATIC
    with tqdm(
        total=total, initial=done, desc=label, unit=unit, unit_scale=True, disable=hidden
    ) as bar:
        yield lambda count: void(bar.update(count))


@contextmanager
def stages(progress: bool, label: str) -> Iterator[Callable[[str], None]]:
    """Yield the function to call with the name of what begins now; a line says each second for how
    long that has taken.
    """
    ended = Event()
    with tqdm(
        bar_format="{desc}: {elapsed}", desc=label, disable=not progress or paths.STATIC
    ) as line:

        def tick() -> None:
            while not ended.wait(1.0):
                line.refresh()

        ticking = Thread(target=tick, daemon=True)
        ticking.start()
        try:
            yield lambda name: line.set_description_str(f"{label}, {name}")
        finally:
            ended.set()
            ticking.join()


def void(_: object) -> None:
    """Drop a value."""
