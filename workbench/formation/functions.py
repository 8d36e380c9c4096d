"""Functions of the user's own inside the compiled loop: a reward, or a steering law, given as one
plain Python function.

A function is compiled by numba and called by its address, so that it costs no more than the
built-in ones:

    def calm(u, v):                          # errors in units of their bounds, both in [-1, 1]
        return -(u * u + 2.0 * v * v)
    learn(config, steps=200_000, reward=calm)

    def chase(distance, bearing):            # m, rad (left positive) of the robot in front
        # forward speed in m/s, turning rate in rad/s (left positive)
        return 0.06 + 2.0 * (distance - 0.15), 4.0 * bearing
    evaluate(OwnLaw(function=chase), config)

It may call ``math``, numpy and other functions as far as numba can; numbers, tuples and arrays that
it takes from outside are frozen when it is compiled, and compiled anew when they have changed. It
must return the same for the same arguments.

>>> own_reward(lambda u, v: -abs(u)).worst
-1.0
>>> own_reward(lambda u, v: 1.0 / u)
Traceback (most recent call last):
    ...
ValueError: reward '<lambda>' is not finite at u = 0, v = -1; expected a finite number for all u, v
in [-1, 1]

Contract: values are looked at on a grid when a function is given; where it fails between the points
of the grid, the run stops with an error that says where. Compiled functions are kept for as long as
the process lives.
"""

import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import CellType, CodeType, FunctionType
from typing import Any, ClassVar

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from workbench.formation import steering
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws import ControlLaw
from workbench.formation.reward import OWN

Reward = Callable[[float, float], float]
Law = Callable[[float, float], tuple[float, float]]
_GRID = np.linspace(-1.0, 1.0, 101)
_POINT = types.float64(types.float64, types.float64)
_RETURNS = {"reward": "a number", "law": "two numbers: speed in m/s, turning rate in rad/s"}
_compiled: dict[
    tuple[str, str], list[Any]
] = {}  # (hash, what) → C functions; never emptied: their addresses are in use


@dataclass(frozen=True)
class OwnReward:
    """A compiled reward.

    Attributes:
        name: of the function.
        sha256: of what it does: code, constants and what it takes from outside.
        address: of the compiled function.
        worst: its smallest value on a grid of all u, v in [-1, 1].
    """

    name: str
    sha256: str
    address: int
    worst: float


def own_reward(function: Reward) -> OwnReward:
    """Compile a reward r(u, v) of errors in units of their bounds, and look at its values.

    Raises:
        TypeError: it is no function of two numbers that numba can compile.
        ValueError: a value is not finite, or not the same twice.
    """
    [call] = _compile(function, "reward")
    values = _look(
        [call], _GRID, _GRID, "reward", _name(function), "u = {:g}, v = {:g}", "u, v in [-1, 1]"
    )
    return OwnReward(_name(function), code_sha256(function), call.address, float(values.min()))


def with_reward(
    config: ConvoyConfig, function: Reward | None
) -> tuple[ConvoyConfig, OwnReward | None]:
    """Return the configuration that says "own" and the compiled reward, or what was given if there
    is no function.
    """
    return (
        (config, None) if function is None else (replace(config, reward=OWN), own_reward(function))
    )


def check_reward(config: ConvoyConfig, reward: OwnReward | None, *, learning: bool) -> None:
    """Refuse a function where the configuration says a preset, and learning without one where it
    says "own".

    Raises:
        ValueError: what was given, and what goes together.
    """
    if (reward is not None) != (config.reward == OWN) and (learning or reward is not None):
        given = reward.name if reward is not None else None
        raise ValueError(
            f"ConvoyConfig.reward = {config.reward!r} with the function {given!r}; give one "
            f"with {OWN!r}, only there"
        )


@dataclass(frozen=True)
class OwnLaw(ControlLaw):
    """A steering law given as a function of distance (m) and bearing (rad): returns speed (m/s) and
    turning rate (rad/s).

    Commands stay within the learner's range of wheel speeds. Objects can be sent to other processes
    if the function can.

    Raises:
        TypeError: it is no plain function.
    """

    name: ClassVar[str] = "own"
    number: ClassVar[int] = steering.OWN
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing")

    function: Law

    def __post_init__(self) -> None:
        _plain(self.function, "law")

    def gains(self) -> tuple[float, ...]:
        """Return nothing: what the law is stands in its function."""
        return ()

    def check(self, config: ConvoyConfig) -> None:
        """As ``ControlLaw.check``; the function must give two finite numbers within the bounds.

        Raises:
            TypeError, ValueError: see ``own_reward``.
        """
        super().check(config)
        distances = np.linspace(*config.distance_m, 51)
        bearings = config.bearing_limit_rad * np.linspace(-1, 1, 51)
        where = "distance = {:g} m, bearing = {:g} rad"
        _look(
            _compile(self.function, "law"),
            distances,
            bearings,
            "law",
            _name(self.function),
            where,
            "places within the bounds",
        )

    def addresses(self) -> tuple[int, int]:
        """Return the addresses of the compiled speed and turning rate."""
        speed, turn = _compile(self.function, "law")
        return speed.address, turn.address

    def sha256(self) -> str:
        """Return a hash of what the function does."""
        return code_sha256(self.function)

    def arrays(self) -> Mapping[str, NDArray[np.generic]]:  # type: ignore[override]
        """Refuse: a function is code, and files hold none."""
        raise ValueError(
            "a law of your own is code and is not stored; leave out= out, and keep "
            "run.summary or run.records"
        )


def trouble(robots: NDArray[np.void], law: ControlLaw | None, reward: OwnReward | None) -> str:
    """Return what to say where a function of the user's own failed in the loop, "" if none did."""
    at = np.argwhere(robots["failure"]["any"] != 0)
    if not len(at):
        return ""
    record = robots[tuple(at[0])]
    x, y = float(record["failure"]["at"][0]), float(record["failure"]["at"][1])
    if isinstance(law, OwnLaw):
        where = f"distance = {x:g} m, bearing = {y:g} rad"
        return (
            f"law {_name(law.function)!r} is not finite at {where}; expected two finite "
            "numbers there"
        )
    name = reward.name if reward is not None else ""
    return (
        f"reward {name!r} is not finite at u = {x:g}, v = {y:g}; expected a finite number "
        "for all u, v in [-1, 1]"
    )


def _name(function: Callable[..., object]) -> str:
    return getattr(function, "__name__", repr(function))


def _plain(function: Any, what: str) -> Any:
    """Return the Python function behind a function or a numba dispatcher; refuse anything else."""
    plain = getattr(function, "py_func", function)
    if not inspect.isfunction(plain):
        raise TypeError(
            f"{what} = {function!r}; expected a plain Python function of two numbers that "
            f"returns {_RETURNS[what]}"
        )
    return plain


def _compile(function: Callable[..., object], what: str) -> list[Any]:
    """Return the C functions of a reward (one) or of a law (speed, turning rate); NaN where the
    function raises.
    """
    plain = _plain(function, what)
    key = (code_sha256(plain), what)
    if key in _compiled:
        return _compiled[key]
    inner: Any = _fresh(function, {})  # its types are known to numba only

    def call(x: float, y: float) -> object:
        return inner(x, y)

    outer: Any = numba.njit(call)  # defaults of further arguments are filled in here
    try:
        outer.compile((types.float64, types.float64))
        result: Any = outer.overloads[types.float64, types.float64].signature.return_type
    except (numba.core.errors.NumbaError, TypeError, NotImplementedError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        first = next(
            (line for line in lines if not line.startswith("Failed in nopython")),
            type(error).__name__,
        )
        raise TypeError(
            f"{what} {_name(function)!r} cannot be compiled: {first}; expected a function of "
            "two numbers that returns "
            f"{_RETURNS[what]}"
        ) from error
    kinds: list[Any] = list(getattr(result, "types", [result]))
    real = all(isinstance(kind, (types.Float, types.Integer, types.Boolean)) for kind in kinds)
    if (
        not real
        or isinstance(result, types.BaseTuple) != (what == "law")
        or len(kinds) != (2 if what == "law" else 1)
    ):
        raise TypeError(f"{what} {_name(function)!r} returns {result}; expected {_RETURNS[what]}")
    picks = (
        (lambda both: both[0], lambda both: both[1]) if what == "law" else (lambda value: value,)
    )
    _compiled[key] = [numba.cfunc(_POINT)(_guarded(outer, numba.njit(pick))) for pick in picks]
    return _compiled[key]


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


def _look(
    calls: list[Any],
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    what: str,
    name: str,
    where: str,
    domain: str,
) -> NDArray[np.float64]:
    """Return the (first) values on a grid; refuse what is not finite or changes."""
    found = [
        [[call.ctypes(float(x), float(y)) for y in ys] for x in xs]
        for call in calls
        for _ in range(2)
    ]
    values = np.array(found)
    for k, (x, y) in enumerate((x, y) for x in xs for y in ys):
        if not np.all(np.isfinite(values.reshape(len(found), -1)[:, k])):
            raise ValueError(
                f"{what} {name!r} is not finite at {where.format(x, y)}; expected a finite "
                f"number for all {domain}"
            )
    if not np.array_equal(values[::2], values[1::2]):
        raise ValueError(
            f"{what} {name!r} does not return the same for the same arguments; expected a "
            "function without chance or memory"
        )
    first: NDArray[np.float64] = values[0]
    return first


def _fresh(function: Any, made: dict[int, Any]) -> Any:
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
    outside = {name: _fresh(value, made) or value for name, value in helpers.items()}
    cells = tuple(
        CellType(_fresh(cell.cell_contents, made) or cell.cell_contents)
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
    made[id(plain)] = numba.jit(**({"nopython": True} | getattr(function, "targetoptions", {})))(
        copy
    )
    return made[id(plain)]


def _is_function(value: Any) -> bool:
    return inspect.isfunction(getattr(value, "py_func", value))


def _names(code: CodeType) -> set[str]:
    """Return all names that occur in code and in the functions within it."""
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return {*code.co_names, *code.co_freevars}.union(*inner)


def code_sha256(function: Callable[..., object]) -> str:
    """Return a hash of what a function does: code, constants, defaults, and what it takes from
    outside, modules' values too.
    """
    digest = hashlib.sha256()
    seen = list[Any]()
    _take_function(getattr(function, "py_func", function), digest, seen)
    return digest.hexdigest()


def _take_function(function: Any, digest: Any, seen: list[Any]) -> None:
    for number, known in enumerate(seen):
        if known is function:
            digest.update(f"again {number}".encode())
            return
    seen.append(function)
    _take_code(function.__code__, digest)
    names = _names(function.__code__)
    for value in (function.__defaults__, *(function.__kwdefaults__ or {}).items()):
        _take_value("default", value, names, digest, seen)
    outside = function.__globals__ | {
        name: cell.cell_contents
        for name, cell in zip(
            function.__code__.co_freevars, function.__closure__ or (), strict=True
        )
    }
    for name in sorted(names & set(outside)):
        _take_value(name, outside[name], names, digest, seen)


def _take_code(code: CodeType, digest: Any) -> None:
    digest.update(code.co_code + repr((code.co_names, code.co_freevars)).encode())
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _take_code(constant, digest)
        else:
            digest.update(repr(constant).encode())


def _take_value(name: str, value: Any, names: set[str], digest: Any, seen: list[Any]) -> None:
    digest.update(f"{name}:{type(value).__name__}".encode())
    if _is_function(value):
        _take_function(getattr(value, "py_func", value), digest, seen)
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, tuple):
        for item in value:
            _take_value("item", item, names, digest, seen)
    elif isinstance(value, (bool, int, float, complex, str, np.generic)) or value is None:
        digest.update(repr(value).encode())
    elif inspect.ismodule(value) and value.__name__.split(".")[0] not in ("numpy", "math", "numba"):
        for attribute in sorted(names & set(vars(value))):
            _take_value(attribute, vars(value)[attribute], names, digest, seen)
