"""Compiled functions: numba's ``njit``, with a cache on disk that no edit leaves stale.

numba keeps compiled code beside a function's own file and looks at that file only. But the code of the control loop contains the
reward, the learner and everything else that it calls: after an edit of ``reward.py`` the old reward would go on to be used. Here
the cache's folder is named after all sources of the package together, so that any edit compiles anew (about 20 s, once).

>>> from workbench.robot.motors import motor_speed
>>> motor_speed(550) == motor_speed.py_func(550)  # the function as it was written is still there
True

Contract: functions are compiled at their first call for the types that they get; other users of numba are not affected.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite import ir
from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., object])
_PACKAGE = Path(__file__).parent
_KEPT = 5  # folders of earlier sources


def _name() -> str:
    digest = hashlib.sha256()
    for file in sorted(_PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode() + file.read_bytes())
    return f"numba-{digest.hexdigest()[:16]}"


def _folder() -> Path:
    """Return the cache's folder: in the package, else in the user's own cache, else a new one that only this process uses."""
    for parent in (_PACKAGE / "__pycache__", Path(os.path.expanduser("~")) / ".cache" / "workbench"):
        if parent.is_absolute():  # a user without a home stays "~"
            with contextlib.suppress(OSError):
                (parent / NAME).mkdir(parents=True, exist_ok=True)
                if os.access(parent / NAME, os.W_OK):
                    return parent / NAME
    return Path(tempfile.mkdtemp(prefix=NAME))


def _remove_old(parent: Path) -> None:
    """Remove folders of earlier sources, which other processes may be removing as well."""
    ages = []
    for path in parent.glob("numba-*"):
        with contextlib.suppress(OSError):
            ages.append((path.stat().st_mtime, path))
    for _, path in sorted(ages, reverse=True)[_KEPT:]:
        shutil.rmtree(path, ignore_errors=True)


NAME = _name()
FOLDER = _folder()
_remove_old(FOLDER.parent)


def compiled(function: F) -> Dispatcher[F]:
    """Return the function compiled by numba without Python objects, cached on disk."""
    settings: Any = numba.config  # its names are made at run time
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(Path(before) / NAME if before else FOLDER)  # a folder of the user's own choice is respected
    try:
        return njit(cache=True, nogil=True)(function)
    finally:
        settings.CACHE_DIR = before


def _call_at(typing_context: Any, address: Any, x: Any, y: Any) -> Any:
    """Return what the C function float64(float64, float64) at an address returns for x and y."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        pointer = builder.inttoptr(arguments[0], ir.FunctionType(double, [double, double]).as_pointer())
        return builder.call(pointer, arguments[1:])

    return types.float64(types.int64, types.float64, types.float64), generate


call_at: Any = intrinsic(_call_at)  # numba passes the typing context; callers pass address, x, y
