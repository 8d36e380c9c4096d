"""Configurations: frozen dataclasses whose fields know their range, unit and meaning.

A field is declared once, with everything that there is to say about it; checks, error messages,
JSON and the documentation all follow from the declaration.

>>> @configuration
... class Wheel:
...     radius_m: float = real(0.001, 0.1, "m", "radius of the wheel", default=0.02)
>>> Wheel(radius_m=0.5)
Traceback (most recent call last):
    ...
ValueError: Wheel.radius_m = 0.5; expected a number from 0.001 to 0.1 m (radius of the wheel)
>>> Wheel(radius=0.02)
Traceback (most recent call last):
    ...
TypeError: Wheel has no field 'radius' (given 0.02); fields: radius_m; did you mean 'radius_m'?

Contract: a configuration is immutable; vary it with ``dataclasses.replace``. ``to_dict`` gives
plain JSON values and ``from_dict`` reads them back to an equal configuration.
"""

import dataclasses
import difflib
import functools
import numbers
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")
_Check = Callable[[object], object]  # returns the accepted value, raises _Wrong


class _Wrong(Exception):
    """The value does not fit: the message says what was expected."""

    def __init__(self, expected: str, *, wrong_type: bool) -> None:
        super().__init__(expected)
        self.wrong_type = wrong_type


def _declare(default: Any, expected: str, doc: str, check: _Check) -> Any:
    return dataclasses.field(
        default=default, metadata={"expected": expected, "doc": doc, "check": check}
    )


def _number(value: object, low: float, high: float, expected: str, whole: bool) -> int | float:
    kind = numbers.Integral if whole else numbers.Real
    if isinstance(value, bool) or not isinstance(value, kind):
        raise _Wrong(expected, wrong_type=True)
    # before converting: it may be too large for a float; NaN fails too
    if not low <= value <= high:  # type: ignore[operator]
        raise _Wrong(expected, wrong_type=False)
    # its kind was checked above
    number = int(value) if whole else float(value)  # type: ignore[call-overload]
    return number


def unwrapped(value: Any) -> Any:
    """Return a value out of numpy as Python's own: scalars and arrays, () to (n,)."""
    item = getattr(value, "tolist", None)
    if item is not None and type(value).__module__ == "numpy":
        return item()
    return value


def real(low: float, high: float, unit: str, doc: str, *, default: float) -> Any:
    """Declare a finite number in [low, high] of the given unit."""
    expected = f"a number from {low:g} to {high:g} {unit}".rstrip()
    return _declare(
        default, expected, doc, lambda value: _number(value, low, high, expected, False)
    )


def integer(low: int, high: int, unit: str, doc: str, *, default: int) -> Any:
    """Declare a whole number in [low, high] of the given unit."""
    expected = f"a whole number from {low} to {high} {unit}".rstrip()
    return _declare(default, expected, doc, lambda value: _number(value, low, high, expected, True))


def _several(
    default: tuple[Any, ...], expected: str, doc: str, item: Callable[[object], object]
) -> Any:
    def check(value: object) -> object:
        if not isinstance(value, (tuple, list)) or len(value) != len(default):
            raise _Wrong(expected, wrong_type=not isinstance(value, (tuple, list)))
        return tuple(item(entry) for entry in value)

    return _declare(default, expected, doc, check)


def reals(low: float, high: float, unit: str, doc: str, *, default: tuple[float, ...]) -> Any:
    """Declare a tuple of ``len(default)`` finite numbers in [low, high]."""
    expected = f"{len(default)} numbers from {low:g} to {high:g} {unit}".rstrip()
    return _several(
        default, expected, doc, lambda value: _number(value, low, high, expected, False)
    )


def integers(low: int, high: int, unit: str, doc: str, *, default: tuple[int, ...]) -> Any:
    """Declare a tuple of ``len(default)`` whole numbers in [low, high]."""
    expected = f"{len(default)} whole numbers from {low} to {high} {unit}".rstrip()
    return _several(default, expected, doc, lambda value: _number(value, low, high, expected, True))


def pairs(
    low: float, high: float, unit: str, doc: str, *, default: tuple[Any, ...], whole: bool = False
) -> Any:
    """Declare a tuple of any number of pairs of finite, or whole, numbers in [low, high]."""
    kind = "whole numbers" if whole else "numbers"
    expected = f"pairs of {kind} from {low:g} to {high:g} {unit}".rstrip()

    def check(value: object) -> object:
        if not isinstance(value, (tuple, list)):
            raise _Wrong(expected, wrong_type=True)
        for pair in value:
            if not isinstance(pair, (tuple, list)) or len(pair) != 2:
                raise _Wrong(expected, wrong_type=False)
        return tuple(
            tuple(_number(entry, low, high, expected, whole) for entry in pair) for pair in value
        )

    return _declare(default, expected, doc, check)


def choice(options: tuple[str, ...], doc: str, *, default: str) -> Any:
    """Declare one of a few words."""
    expected = "one of " + ", ".join(repr(option) for option in options)

    def check(value: object) -> object:
        if not isinstance(value, str):
            raise _Wrong(expected, wrong_type=True)
        if value not in options:
            raise _Wrong(expected + did_you_mean(value, options), wrong_type=False)
        return value

    return _declare(default, expected, doc, check)


def flag(doc: str, *, default: bool) -> Any:
    """Declare a yes-or-no field."""

    def check(value: object) -> object:
        if not isinstance(value, bool):
            raise _Wrong("True or False", wrong_type=True)
        return value

    return _declare(default, "True or False", doc, check)


def part(kind: type, doc: str, *, default: object) -> Any:
    """Declare a nested configuration of the given class; a mapping is accepted too and read by
    ``from_dict``.
    """
    expected = f"a {kind.__name__}, or a mapping of its fields"

    def check(value: object) -> object:
        if isinstance(value, Mapping):
            return from_dict(kind, value)
        if not isinstance(value, kind):
            raise _Wrong(expected, wrong_type=True)
        return value

    return _declare(default, expected, doc, check)


def did_you_mean(word: str, options: Iterable[str], *, ends: str = "") -> str:
    """Return "; did you mean …?" with the option that a word is nearest to, "" if none is near.

    Args:
        ends: a part's field of this name is the nearest of all.
    """
    options = list(options)
    within = [option for option in options if option.endswith(f".{ends}")]
    close = within[:1] or difflib.get_close_matches(word, options, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


class Named(dict[str, T]):
    """What there is by its name; an unknown name is answered with those there are."""

    def __missing__(self, name: str) -> T:
        """Refuse a name that is not there.

        Raises:
            KeyError: always.
        """
        hint = did_you_mean(str(name), self)
        raise KeyError(f"{name}; expected one of {', '.join(self)}{hint}")


def _inner(cls: type) -> list[str]:
    """Return the fields of a configuration's parts, as part.field."""
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    return [
        f"{name}.{field.name}"
        for name, default in defaults.items()
        if dataclasses.is_dataclass(default)
        for field in dataclasses.fields(default)
    ]


def _refuse_unknown(cls: type, given: Mapping[str, object]) -> None:
    names = [field.name for field in dataclasses.fields(cls)]
    for name, value in given.items():
        if name not in names:
            hint = did_you_mean(name, [*names, *_inner(cls)], ends=name)
            raise TypeError(
                f"{cls.__name__} has no field {name!r} (given {value!r}); fields: "
                f"{', '.join(names)}{hint}"
            )


@dataclass_transform(
    frozen_default=True,
    kw_only_default=True,
    field_specifiers=(real, integer, reals, integers, choice, flag, part),
)
def configuration(cls: type[T]) -> type[T]:
    """Make a class a checked, frozen, keyword-only dataclass.

    Every value is checked against its declaration (ValueError for the range, TypeError for the type
    or an unknown name); then the class's own ``_check(self)``, if it has one, judges values
    together.
    """

    def __post_init__(self: Any) -> None:
        for field in dataclasses.fields(self):
            value = unwrapped(getattr(self, field.name))
            try:
                accepted = field.metadata["check"](value)
            except _Wrong as wrong:
                kind = TypeError if wrong.wrong_type else ValueError
                doc = field.metadata["doc"]
                raise kind(
                    f"{cls.__name__}.{field.name} = {value!r}; expected {wrong} ({doc})"
                ) from None
            object.__setattr__(self, field.name, accepted)
        if hasattr(self, "_check"):
            self._check()

    # the hook that dataclass() looks for
    cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    made = dataclasses.dataclass(frozen=True, kw_only=True)(cls)
    plain_init = made.__init__

    @functools.wraps(plain_init)
    def __init__(self: Any, *args: object, **given: object) -> None:
        _refuse_unknown(made, given)
        plain_init(self, *args, **given)

    # adds the list of valid names to the error
    made.__init__ = __init__  # type: ignore[method-assign]
    made.__repr__ = _short  # type: ignore[method-assign]
    made._repr_html_ = _as_html  # type: ignore[attr-defined]
    made.__doc__ = f"{made.__doc__ or ''}\n\nFields:\n{describe(made)}"
    return made


def changed(config: Any) -> dict[str, Any]:
    """Return what of a configuration is not the default, by the names of fields."""
    values = ((field, getattr(config, field.name)) for field in dataclasses.fields(config))
    return {field.name: value for field, value in values if value != field.default}


def _short(config: Any) -> str:
    """Return how a configuration is made; what is not said is the default."""
    given = ", ".join(f"{name}={value!r}" for name, value in changed(config).items())
    return f"{type(config).__name__}({given})"


def _as_html(config: Any) -> str:
    """Return what differs from the default, with what it means."""
    from workbench import markup

    own = {field.name: field for field in dataclasses.fields(config)}
    rows = [
        (name, f"{value!r}", f"default {own[name].default!r}", own[name].metadata["doc"])
        for name, value in changed(config).items()
    ]
    name = type(config).__name__
    return markup.table(rows, name if rows else f"{name}: all defaults")


def describe(cls: type) -> str:
    """Return one line per field of a configuration: name, default, range and meaning."""
    lines = []
    for field in dataclasses.fields(cls):
        default = field.default
        shown = (
            f"{type(default).__name__}()" if dataclasses.is_dataclass(default) else repr(default)
        )
        lines.append(
            f"    {field.name} = {shown}: {field.metadata['doc']}; {field.metadata['expected']}"
        )
    return "\n".join(lines)


def to_dict(config: Any) -> dict[str, Any]:
    """Return a configuration as plain JSON values, nested parts included."""
    plain: dict[str, Any] = dataclasses.asdict(config)
    return plain


def flat(config: Any) -> dict[str, Any]:
    """Return a configuration as one mapping of plain values, names of nested fields with dots:
    "learner.alpha".
    """
    found: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            found |= {f"{field.name}.{name}": entry for name, entry in flat(value).items()}
        else:
            found[field.name] = value
    return found


def from_dict(cls: type[T], values: Mapping[str, Any]) -> T:
    """Read a configuration of class ``cls`` from plain values, checking names, types and ranges.

    Raises:
        TypeError: an unknown name or a value of the wrong type.
        ValueError: a value out of range.
    """
    _refuse_unknown(cls, values)
    return cls(**values)


def whole(name: str, number: Any, low: int, high: int, unit: str = "") -> int:
    """Return an argument that must be a whole number in [low, high], also out of numpy or as 3.0.

    Raises:
        ValueError: it is none.
    """
    value = unwrapped(number)
    expected = f"a whole number from {low} to {high} {unit}".rstrip()
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not plain or not low <= value <= high or value != int(value):
        raise ValueError(f"{name} = {number!r}; expected {expected}")
    return int(value)


MOST = 10**15  # that anybody may ask for


def positive(name: str, number: float) -> int:
    """Return an argument that must be a whole number of at least 1; 1e5 is one.

    Raises:
        ValueError: it is none.
    """
    value = unwrapped(number)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or not 1 <= value <= MOST:
        raise ValueError(
            f"{name} = {number!r}; expected a whole number, at least 1 and at most 1e15"
        )
    return int(value)
