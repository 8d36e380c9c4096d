"""MuJoCo's own library, as Python's binding has loaded it."""

import ctypes
import functools
import os
from pathlib import Path

import mujoco


@functools.cache
def library() -> ctypes.CDLL | None:
    """Return MuJoCo's library, None where it is not found."""
    for folder in (Path(mujoco.__file__).parent, *_core_folder()):
        for path in sorted(folder.glob("libmujoco*")) + sorted(folder.glob("mujoco.dll")):
            try:
                return ctypes.CDLL(str(path))
            except OSError:
                continue
    return None


def _core_folder() -> list[Path]:
    """Return where the package with MuJoCo's library is, if that is one of its own."""
    try:
        import mujoco_core  # type: ignore[import-not-found]  # part of mujoco from 4.0 on
    except ImportError:
        return []
    return [Path(mujoco_core.__file__).parent]


def former() -> bool:
    """Return whether MuJoCo is to be run as it was before blocks were compiled as a whole, for
    comparison: its batch, stopwatches on, and all that is seen in the physics.
    """
    return os.environ.get("WORKBENCH_BATCH") == "1"


def stopwatches(on: bool) -> bool:
    """Switch MuJoCo's own stopwatches on or off for this process. Python's binding has them on, and
    they take a tenth of a planar step; off, ``MjData.timer`` stays at zero. Return whether that
    could be done.
    """
    clock = _stopwatch()
    if clock is None:
        return False
    pointer, first = clock
    pointer.value = first if on else None
    return True


@functools.cache
def _stopwatch() -> tuple[ctypes.c_void_p, int | None] | None:
    """Return the library's pointer to a clock, and where it points at first."""
    found = library()
    if found is None:
        return None
    try:
        pointer = ctypes.c_void_p.in_dll(found, "mjcb_time")
    except ValueError:
        return None
    return pointer, pointer.value
