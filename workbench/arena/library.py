"""MuJoCo's own library, as Python's binding has loaded it."""

import ctypes
import functools
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


@functools.cache
def stopwatches_off() -> bool:
    """Switch off MuJoCo's own stopwatches, which Python's binding switches on and which take a
    tenth of a planar step: ``MjData.timer`` stays at zero in this process from here on. Return
    whether that could be done.
    """
    found = library()
    if found is None:
        return False
    try:
        ctypes.c_void_p.in_dll(found, "mjcb_time").value = None
    except ValueError:
        return False
    return True
