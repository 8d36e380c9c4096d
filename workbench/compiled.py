"""Compiled functions: numba's ``njit``, with a cache on disk that no edit leaves stale.

numba keeps compiled code beside a function's own file and looks at that file only. But the code of
the control loop contains the reward, the learner and everything else that it calls: after an edit
of ``reward.py`` the old reward would go on to be used. Here the cache's folder is named after the
module and all that it imports (``workbench.sources``): an edit of any of these compiles anew, an
edit of a plot or a study does not.

>>> from workbench.robot.motors import motor_speed
>>> motor_speed(550) == motor_speed.py_func(550)  # the function as it was written is still there
True

Contract: functions are compiled at their first call for the types that they get; other users of
numba are not affected.
"""

from __future__ import annotations

import contextlib
import functools
import getpass
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar

import numba
from llvmlite import ir
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

from workbench import sources

# without arrays of its own to free, numba need not count who holds one; a division by zero is no
# exception but a number that is not finite, which lets loops be vectorised; C calls nothing of it
_BARE: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "no_cfunc_wrapper": True}
_INNER: dict[str, Any] = _BARE | {"no_cpython_wrapper": True}  # Python does not call it either
F = TypeVar("F", bound=Callable[..., object])
_njit: Any = numba.njit  # its declaration leaves out options
_KEPT = 3  # folders of earlier sources, of every module


def _parents() -> list[Path]:
    """Return where a cache may lie, best first: the package, the user's cache, a temporary folder
    of the user's.
    """
    home = Path(os.path.expanduser("~")) / ".cache" / "workbench"
    found = [sources.PACKAGE / "__pycache__" / "numba"]
    if home.is_absolute():  # a user without a home stays "~"
        found.append(home / "numba")
    return [*found, Path(tempfile.gettempdir()) / f"workbench-{_user()}" / "numba"]


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user that the system does not know, in a container
        return str(os.getuid()) if hasattr(os, "getuid") else "user"


@functools.cache
def parent() -> Path:
    """Return the folder in which this process keeps compiled code."""
    settings: Any = numba.config  # its names are made at run time
    chosen = settings.CACHE_DIR
    # a folder of the user's own choice is respected
    for place in [Path(chosen)] if chosen else _parents():
        with contextlib.suppress(OSError):
            place.mkdir(parents=True, exist_ok=True, mode=0o700)
            if os.access(place, os.W_OK) and _own(place):
                return place
    return Path(tempfile.mkdtemp(prefix="workbench-numba-"))


def _own(place: Path) -> bool:
    """Whether nobody else can have put code into a temporary folder."""
    return (
        not hasattr(os, "getuid")
        or sources.PACKAGE in place.parents
        or place.stat().st_uid == os.getuid()
    )


@functools.cache
def folder(module: str) -> Path:
    """Return the cache's folder of a module's compiled functions; those of its earlier sources are
    removed but for a few.
    """
    place = parent() / f"{module}-{sources.digest(module)}"
    if not place.is_dir():
        with contextlib.suppress(OSError):
            place.mkdir(parents=True, exist_ok=True)
        _remove_old(module)
    return place


def _remove_old(module: str) -> None:
    """Remove folders of a module's earlier sources, which other processes may be removing as
    well.
    """
    ages = []
    for path in parent().glob(f"{module}-*"):
        with contextlib.suppress(OSError):
            ages.append((path.stat().st_mtime, path))
    for _, path in sorted(ages, reverse=True)[_KEPT:]:
        shutil.rmtree(path, ignore_errors=True)


def on_disk(function: Any) -> bool:
    """Return whether the cache has code of a compiled function, for whatever types; of another
    numba or processor, too.
    """
    plain = function.py_func
    return any(folder(plain.__module__).rglob(f"*.{plain.__qualname__}-*.nbi"))


def adopt(other: Path) -> None:
    """Take over from another cache, on the same disk, what this one has nothing of: two processes
    that write into one cache can give two codes one file.
    """
    for index in sorted(other.rglob("*.nbi")):
        mine = parent() / index.relative_to(other)
        if mine.exists():
            continue
        mine.parent.mkdir(parents=True, exist_ok=True)
        stem = index.name.removesuffix("nbi")
        # the index last: what it names is there
        for file in (*index.parent.glob(f"{stem}*.nbc"), index):
            os.replace(file, mine.parent / file.name)


def compiled(function: F) -> Dispatcher[F]:
    """Return the function compiled by numba without Python objects, cached on disk.

    It may allocate nothing: counting who holds an array is half of the control loop's time.
    """
    return _cached(function, **_BARE)


def compiled_with_arrays(function: F) -> Dispatcher[F]:
    """Return the function compiled as by ``compiled``, for one that makes new arrays."""
    return _cached(function)


def chosen(functions: Sequence[Any]) -> Any:
    """Return a function for compiled code that calls one of several, all with the same arguments
    and types: ``chosen([f, g])(1, x)`` is ``g(x)``. What follows the last number is the last
    function.
    """
    first, *others = functions
    rest: Any = chosen(others) if others else None

    def choose(number: int, *arguments: Any) -> Any:
        if number == 0:
            return first(*arguments)
        return rest(number - 1, *arguments)

    def only(number: int, *arguments: Any) -> Any:
        return first(*arguments)

    names = "_".join(f"{one.py_func.__module__}_{one.py_func.__name__}" for one in functions)
    function = _renamed(choose if others else only, f"chosen_{names.replace('.', '_')}")
    return _njit(nogil=True, **_INNER)(function)


def _renamed(function: F, name: str) -> F:
    """Give a function a name of its own: compiled code that different processes have left on disk
    is linked by names, and of two functions with one name and the same types one is run for both.
    """
    function.__name__ = function.__qualname__ = name
    return function


def exchanged(function: Any, others: Mapping[Any, Any], module: str, kind: str = "") -> Any:
    """Return a compiled function in which other compiled functions stand in the place of some that
    it calls, directly or through what it calls. All that it calls is compiled anew, without what
    Python would need to call it.

    Args:
        function: of this package.
        others: compiled function → what is called in its place, with the same arguments.
        module: whose exchange it is, one for all functions; its code has a cache of its own.
        kind: which of several exchanges of that module.
    """
    made = dict(others)
    variant = f"{module}{kind}-{sources.digest(module)}"
    suffix = f"{module}{kind}".replace(".", "_").replace("-", "_")

    def remake(one: Any) -> Any:
        if one in made:
            return made[one]
        plain = one.py_func
        calls = {
            called: plain.__globals__[called]
            for called in plain.__code__.co_names
            if isinstance(plain.__globals__.get(called), Dispatcher)
        }
        new = {called: remake(callee) for called, callee in calls.items()}
        made[one] = one
        if plain.__closure__ is None:  # else it is a table's, which has been exchanged or is small
            copy = FunctionType(plain.__code__, plain.__globals__ | new, plain.__name__)
            _renamed(copy, f"{plain.__name__}_{suffix}")
            options = _BARE if one is function else _INNER
            made[one] = _cached(copy, variant=variant, **options)
        return made[one]

    return remake(function)


def _cached(function: F, *, variant: str = "", **options: Any) -> Dispatcher[F]:
    settings: Any = numba.config
    # nobody knows what a script's function depends on
    if sources.file_of(function.__module__) is None:
        kept: Dispatcher[F] = _njit(nogil=True)(function)
        return kept
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder(function.__module__) / variant)
    try:
        kept = _njit(cache=True, nogil=True, **options)(function)
        return kept
    finally:
        settings.CACHE_DIR = before


def uncompiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function as it was written, with all that it calls: for a few calls where loading
    compiled code costs more.
    """
    plain = getattr(function, "py_func", function)
    known = plain.__globals__
    called = {
        name: uncompiled(known[name])
        for name in _names(plain.__code__)
        if isinstance(known.get(name), (Dispatcher, FunctionType))
        and known[name].__module__.startswith("workbench.")
    }
    return FunctionType(plain.__code__, known | called, plain.__name__, plain.__defaults__)


def _names(code: CodeType) -> set[str]:
    """Return all names that code uses, comprehensions within it included."""
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return set(code.co_names).union(*inner)


def _call_at(typing_context: Any, address: Any, x: Any, y: Any) -> Any:
    """Return what the C function float64(float64, float64) at an address returns for x and y."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        pointer = builder.inttoptr(
            arguments[0], ir.FunctionType(double, [double, double]).as_pointer()
        )
        return builder.call(pointer, arguments[1:])

    return types.float64(types.int64, types.float64, types.float64), generate


call_at: Any = intrinsic(_call_at)  # numba passes the typing context; callers pass address, x, y


def _step_at(typing_context: Any, address: Any, model: Any, data: Any) -> Any:
    """Call the C function void(const void*, void*) at an address with two addresses."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer]).as_pointer()
        function = builder.inttoptr(arguments[0], kind)
        builder.call(function, [builder.inttoptr(one, pointer) for one in arguments[1:]])
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64), generate


def _place(builder: Any, address: Any, k: Any) -> Any:
    """Return the pointer to the k-th float64 behind an address."""
    return builder.gep(builder.inttoptr(address, ir.DoubleType().as_pointer()), [k])


def _peek(typing_context: Any, address: Any, k: Any) -> Any:
    """Return the k-th float64 behind an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_place(builder, *arguments))

    return types.float64(types.int64, types.int64), generate


def _poke(typing_context: Any, address: Any, k: Any, value: Any) -> Any:
    """Write the k-th float64 behind an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _place(builder, *arguments[:2]))
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.float64), generate


step_at: Any = intrinsic(_step_at)  # address of the function, of the model, of the data
peek: Any = intrinsic(_peek)
poke: Any = intrinsic(_poke)
