"""Functions of the user's own inside the compiled loop: a reward, or a steering law, given as one plain Python function.

A function is compiled by numba and called by its address, so that it costs no more than the built-in ones:

    def calm(u, v):                          # errors in units of their bounds, both in [-1, 1]
        return -(u * u + 2.0 * v * v)
    learn(config, steps=200_000, reward=calm)

    def chase(distance, bearing):            # m, rad (left positive) of the robot in front
        return 0.06 + 2.0 * (distance - 0.15), 4.0 * bearing    # forward speed in m/s, turning rate in rad/s (left positive)
    evaluate(OwnLaw(function=chase), config)

It may call ``math`` and numpy as far as numba can; what it takes from outside must be plain numbers, which are frozen when it is
compiled. It must return the same for the same arguments.

>>> own_reward(lambda u, v: -abs(u)).worst
-1.0
>>> own_reward(lambda u, v: 1.0 / u)
Traceback (most recent call last):
    ...
ValueError: reward '<lambda>' is not finite at u = 0, v = -1 (ZeroDivisionError); expected a finite number for all u, v in [-1, 1]

Contract: an Own object keeps the compiled function alive; what holds its address must hold the object too.
"""

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from workbench.formation import steering
from workbench.formation.classical import ControlLaw
from workbench.formation.config import ConvoyConfig

Reward = Callable[[float, float], float]
Law = Callable[[float, float], tuple[float, float]]
_GRID = np.linspace(-1.0, 1.0, 41)
_POINT = types.float64(types.float64, types.float64)


@dataclass(frozen=True, eq=False)
class OwnReward:
    """A compiled reward.

    Attributes:
        name: of the function.
        sha256: of what it does: code, constants and the numbers that it takes from outside.
        address: of the compiled function.
        worst: its smallest value on a grid of all u, v in [-1, 1].
    """

    name: str
    sha256: str
    address: int
    worst: float
    keep: object = field(repr=False)


def own_reward(function: Reward) -> OwnReward:
    """Compile a reward r(u, v) of errors in units of their bounds, and look at its values.

    Raises:
        TypeError: it is no function of two numbers that numba can compile.
        ValueError: a value is not finite.
    """
    name, inner = _compile(function, "reward", "a number")
    values = [_look(inner, u, v, "reward", name, "u = {:g}, v = {:g}", "u, v in [-1, 1]") for u in _GRID for v in _GRID]
    call: Any = numba.cfunc(_POINT)(_number(inner))
    return OwnReward(name, code_sha256(function), call.address, float(min(values)), call)


def _number(inner: Any) -> Callable[[float, float], float]:
    def number(x: float, y: float) -> float:
        return float(inner(x, y))

    return number


@dataclass(frozen=True)
class OwnLaw(ControlLaw):
    """A steering law given as a function of distance (m) and bearing (rad): returns speed (m/s) and turning rate (rad/s).

    Commands stay within the learner's range of wheel speeds. Objects can be sent to other processes if the function can.
    """

    name: ClassVar[str] = "own"
    number: ClassVar[int] = steering.OWN
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing")

    function: Law

    def gains(self) -> tuple[float, ...]:
        """Return nothing: what the law is stands in its function."""
        return ()

    def check(self, config: ConvoyConfig) -> None:
        """As ``ControlLaw.check``; the function must give two finite numbers within the bounds.

        Raises:
            TypeError, ValueError: see ``own_reward``.
        """
        super().check(config)
        name, inner = _compile(self.function, "law", "two numbers: speed in m/s, turning rate in rad/s")
        for distance in np.linspace(*config.distance_m, 21):
            for bearing in config.bearing_limit_rad * np.linspace(-1, 1, 21):
                where = "distance = {:g} m, bearing = {:g} rad"
                _look(inner, float(distance), float(bearing), "law", name, where, "places within the bounds")

    def addresses(self) -> tuple[int, int, object]:
        """Return the addresses of speed and turning rate, and what must be kept alive."""
        _, inner = _compile(self.function, "law", "two numbers: speed in m/s, turning rate in rad/s")
        calls: list[Any] = [numba.cfunc(_POINT)(_part(inner, k)) for k in (0, 1)]
        return calls[0].address, calls[1].address, calls

    def sha256(self) -> str:
        """Return a hash of what the function does."""
        return code_sha256(self.function)

    def arrays(self) -> Mapping[str, NDArray[np.generic]]:  # type: ignore[override]
        """Refuse: a function is code, and files hold none."""
        raise ValueError("a law of your own is code and is not stored; leave out= out, and keep run.summary or run.records")


def _part(inner: Any, k: int) -> Callable[[float, float], float]:
    if k == 0:
        return lambda x, y: float(inner(x, y)[0])
    return lambda x, y: float(inner(x, y)[1])


@functools.lru_cache(maxsize=64)
def _compile(function: Callable[..., object], what: str, returns: str) -> tuple[str, Any]:
    name = getattr(function, "__name__", repr(function))
    if not callable(function) or not hasattr(function, "__code__"):
        raise TypeError(f"{what} = {function!r}; expected a plain Python function of two numbers that returns {returns}")
    inner: Any = numba.njit(function)  # its types are known to numba only
    try:
        inner.compile((types.float64, types.float64))
        result: Any = inner.overloads[types.float64, types.float64].signature.return_type
    except (numba.core.errors.NumbaError, TypeError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise TypeError(
            f"{what} {name!r} cannot be compiled: {first}; expected a function of two numbers that returns {returns}"
        ) from error
    pair = isinstance(result, types.BaseTuple)
    if pair != (what == "law") or (pair and (len(result) != 2 or not all(isinstance(kind, types.Number) for kind in result))):
        raise TypeError(f"{what} {name!r} returns {result}; expected {returns}")
    if not pair and not isinstance(result, (types.Number, types.Boolean)):
        raise TypeError(f"{what} {name!r} returns {result}; expected {returns}")
    return name, inner


def _look(inner: Any, x: float, y: float, what: str, name: str, where: str, domain: str) -> float:
    """Return the (first) value at x, y; refuse what is not finite."""
    trouble = ""
    try:
        values = np.atleast_1d(inner(float(x), float(y)))
    except (ArithmeticError, ValueError) as error:
        values, trouble = np.array([np.nan]), f" ({type(error).__name__})"
    if not np.all(np.isfinite(values)):
        raise ValueError(
            f"{what} {name!r} is not finite at {where.format(x, y)}{trouble}; expected a finite number for all {domain}"
        )
    return float(values[0])


def code_sha256(function: Callable[..., object]) -> str:
    """Return a hash of what a function does: byte code, constants, and plain numbers that it takes from outside."""
    digest = hashlib.sha256()
    code = function.__code__
    digest.update(code.co_code + repr((code.co_names, _plain(code.co_consts))).encode())
    outside = dict(function.__globals__)
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        outside[name] = cell.cell_contents
    for name in sorted({*code.co_names, *code.co_freevars}):
        value: Any = outside.get(name)
        if isinstance(value, (int, float, bool)):
            digest.update(f"{name}={value!r}".encode())
        elif hasattr(value, "__code__") and value is not function:
            digest.update(f"{name}:{code_sha256(value)}".encode())
    return digest.hexdigest()


def _plain(constants: tuple[object, ...]) -> list[str]:
    return [repr(constant) if not hasattr(constant, "co_code") else constant.co_code.hex() for constant in constants]
