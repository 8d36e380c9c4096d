"""One progress bar for everything that takes long: rate and time left, plain where
WORKBENCH_STATIC=1.

A progress argument is True (a bar), False (nothing) or a function that is called with the number of
units just done.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

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


def void(_: object) -> None:
    """Drop a value."""
