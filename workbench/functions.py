"""Functions of the user's own, compiled and called by their address from the compiled loop.

A reward is a function of u and v, the distance error (positive: too far) and the bearing (positive:
to the left) in units of their bounds; a law one of distance in m and bearing in rad.

A function of two numbers costs no more than a built-in one then. It may call ``math``, numpy and
other functions as far as numba can; numbers, tuples and arrays that it takes from outside are
frozen when it is compiled, and compiled anew for every run. It must return the same for the same
arguments.

Contract: values are looked at on a grid when a function is given; where it fails between the points
of the grid, the loop notes where. What a function is, is what it returns on the grid: that is what
its hash is of. Compiled functions are kept for as long as the process lives.
"""

import hashlib
import inspect
from collections.abc import Callable
from types import CellType, CodeType, FunctionType
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

_POINT = types.float64(types.float64, types.float64)
# C functions by the user's function, the last ones; all of them: their addresses are in use
_last: WeakKeyDictionary[Any, list[Any]] = WeakKeyDictionary()
_kept: list[Any] = []


_CANNOT = (
    numba.core.errors.NumbaError,
    numba.core.errors.UnsupportedBytecodeError,
    TypeError,
    NotImplementedError,
)


class Kind(NamedTuple):
    """What a function is for: what it is called, returns, and is looked at for (two axes, as words
    with a place for each number, and in general).
    """

    name: str
    returns: str
    parts: int
    axes: tuple[NDArray[np.float64], NDArray[np.float64]]
    where: str
    domain: str


def name_of(function: Callable[..., object]) -> str:
    """Return what to call a function in messages."""
    return getattr(function, "__name__", repr(function))


def plain(function: Any, kind: Kind) -> Any:
    """Return the Python function behind a function or a numba dispatcher; refuse anything else."""
    found = getattr(function, "py_func", function)
    if not inspect.isfunction(found):
        raise TypeError(
            f"{kind.name} = {function!r}; expected a plain Python function of two numbers that "
            f"returns {kind.returns}; further numbers come in by a closure"
        )
    return found


def compile_anew(function: Callable[..., object], kind: Kind) -> list[Any]:
    """Return a C function for each number that a function returns; NaN where the function raises.

    Raises:
        TypeError: it is no function of two numbers that numba can compile, or returns other things.
    """
    key = plain(function, kind)
    inner: Any = _fresh(function, {})  # its types are known to numba only

    def call(x: float, y: float) -> object:
        return inner(x, y)

    outer: Any = numba.njit(call)  # defaults of further arguments are filled in here
    try:
        outer.compile((types.float64, types.float64))
    except _CANNOT as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        said = [line for line in lines if not line.startswith("Failed in nopython")]
        raise TypeError(
            f"{kind.name} {name_of(function)!r} cannot be compiled: "
            f"{[*said, type(error).__name__][0]}; expected a function of two numbers that returns "
            f"{kind.returns}"
        ) from error
    _check_result(outer.overloads[types.float64, types.float64].signature.return_type, key, kind)
    picks = (
        (lambda both: both[0], lambda both: both[1]) if kind.parts > 1 else (lambda value: value,)
    )
    calls = [numba.cfunc(_POINT)(_guarded(outer, numba.njit(pick))) for pick in picks]
    _last[key] = calls
    _kept.extend(calls)
    return calls


def last_compiled(function: Callable[..., object], kind: Kind) -> list[Any]:
    """Return what ``compile_anew`` returned last for a function."""
    return _last.get(plain(function, kind)) or compile_anew(function, kind)


def _check_result(result: Any, function: Any, kind: Kind) -> None:
    """Refuse what a compiled function returns unless it is as many numbers as expected."""
    found: list[Any] = list(getattr(result, "types", [result]))
    real = all(isinstance(one, (types.Float, types.Integer, types.Boolean)) for one in found)
    several = isinstance(result, types.BaseTuple)
    if not real or several != (kind.parts > 1) or len(found) != kind.parts:
        raise TypeError(
            f"{kind.name} {name_of(function)!r} returns {result}; expected {kind.returns}"
        )


def _guarded(inner: Any, pick: Any) -> Callable[[float, float], float]:
    """Return the part of a compiled function's result that a compiled ``pick`` takes, NaN where it
    raises.
    """

    def value(x: float, y: float) -> float:
        try:
            return float(pick(inner(x, y)))
        except Exception:  # numba knows no other kind
            return np.nan

    return value


def _check_bounds(function: Callable[..., object], kind: Kind) -> None:
    """Call a function on its grid with bounds checked: compiled code reads past the end of an array
    without a word.

    Raises:
        ValueError: an index out of range, and where.
    """
    checked = _fresh(function, {}, boundscheck=True)
    for x in kind.axes[0].tolist():
        for y in kind.axes[1].tolist():
            try:
                checked(x, y)
            except IndexError as error:
                raise ValueError(
                    f"{kind.name} {name_of(function)!r} reads beyond the end of an array at "
                    f"{kind.where.format(x, y)} ({error}); expected indices in range for all "
                    f"{kind.domain}"
                ) from None
            except Exception:  # whatever else it raises is found below, as no finite number
                return


def look(function: Callable[..., object], kind: Kind) -> NDArray[np.float64]:
    """Return the values (parts, points, points) of a function on its grid; refuse what is not
    finite or changes.
    """
    _check_bounds(function, kind)
    calls = last_compiled(function, kind)
    first, second = (
        np.array(
            [
                [[c.ctypes(float(x), float(y)) for y in kind.axes[1]] for x in kind.axes[0]]
                for c in calls
            ]
        )
        for _ in range(2)
    )
    bad = np.argwhere(~np.isfinite(first + second).all(axis=0))
    if len(bad):
        place = kind.where.format(*(axis[k] for axis, k in zip(kind.axes, bad[0], strict=True)))
        raise ValueError(
            f"{kind.name} {name_of(function)!r} is not finite at {place}; expected a finite "
            f"number for all {kind.domain}"
        )
    if not np.array_equal(first, second):
        raise ValueError(
            f"{kind.name} {name_of(function)!r} does not return the same for the same arguments; "
            "expected a function without chance or memory"
        )
    return first


def values_sha256(values: NDArray[np.float64]) -> str:
    """Return a hash of values to nine digits, so that it is the same on any machine."""
    return hashlib.sha256(
        " ".join(f"{value + 0.0:.8e}" for value in values.flat).encode()
    ).hexdigest()


def _fresh(function: Any, made: dict[int, Any], **options: bool) -> Any:
    """Return a function compiled anew, with all functions that it calls: numba goes on with the
    numbers of the first time.
    """
    plain = getattr(function, "py_func", function)
    if id(plain) in made:
        return made[id(plain)]
    made[id(plain)] = None  # a function that calls itself is left as it is
    names = _names(plain.__code__)
    helpers = {
        name: value
        for name, value in plain.__globals__.items()
        if name in names and _is_function(value)
    }
    outside = {name: _fresh(value, made, **options) or value for name, value in helpers.items()}
    cells = tuple(
        CellType(_fresh(cell.cell_contents, made, **options) or cell.cell_contents)
        if _is_function(cell.cell_contents)
        else cell
        for cell in plain.__closure__ or ()
    )
    copy = FunctionType(
        plain.__code__,
        plain.__globals__ | outside,
        plain.__name__,
        plain.__defaults__,
        cells or None,
    )
    copy.__kwdefaults__ = plain.__kwdefaults__
    own = {"nopython": True} | getattr(function, "targetoptions", {}) | options
    made[id(plain)] = numba.jit(**own)(copy)
    return made[id(plain)]


def _is_function(value: Any) -> bool:
    return inspect.isfunction(getattr(value, "py_func", value))


def _names(code: CodeType) -> set[str]:
    """Return all names that occur in code and in the functions within it."""
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return {*code.co_names, *code.co_freevars}.union(*inner)
