"""From a study's table to what it says: numbers per condition, and differences from a reference
condition, seed by seed.

>>> table = pd.DataFrame({"lam": [0, 0, 1, 1], "seed": [1, 2, 1, 2], "losses": [10, 20, 12, 24]})
>>> by_condition(table, ["lam"], "losses")[["lam", "value", "seeds"]].values.tolist()
[[0.0, 15.0, 2.0], [1.0, 18.0, 2.0]]
>>> apart = difference(table, ["lam"], "losses", {"lam": 0})
>>> apart[["lam", "value"]].values.tolist()
[[0.0, 0.0], [1.0, 3.0]]

Contract: conditions keep the order in which the table has them; seeds are the unit of every
interval (95 % interval), so that a condition may have each seed once.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from workbench.lab.statistics import TimeToCriterion, interval, paired, time_to_criterion


def by_condition(
    table: pd.DataFrame, keys: Sequence[str], value: str, *, statistic: str = "mean"
) -> pd.DataFrame:
    """Return one line per condition: its keys, "value", "low", "high" and "seeds".

    Args:
        table: one line per condition and seed.
        keys: the columns that name a condition.
        value: the column to summarise.
        statistic: "mean", "median" or "iqm".
    """
    lines = []
    for names, part in _conditions(table, keys):
        lines.append((*names, *interval(part[value], statistic=statistic), len(part)))
    return pd.DataFrame(lines, columns=[*keys, "value", "low", "high", "seeds"])


def by_quantity(table: pd.DataFrame, keys: Sequence[str], values: Iterable[str]) -> pd.DataFrame:
    """Return ``by_condition`` of several columns below each other, named in the first column,
    "quantity".
    """
    parts = [by_condition(table, keys, value).assign(quantity=value) for value in values]
    return pd.concat(parts, ignore_index=True)[["quantity", *keys, "value", "low", "high", "seeds"]]


def difference(
    table: pd.DataFrame,
    keys: Sequence[str],
    value: str,
    reference: Mapping[str, Any],
    *,
    statistic: str = "mean",
) -> pd.DataFrame:
    """Return one line per condition: how far it is from a reference condition, paired by seed.

    Args:
        reference: the keys of the reference condition; keys that it leaves out are compared within.

    Raises:
        ValueError: there is no such condition, or its seeds are not those of the others.
    """
    lines = []
    within = [key for key in keys if key not in reference]
    for names, part in _conditions(table, keys):
        wanted = dict(zip(keys, names, strict=True)) | dict(reference)
        base = table
        for key in [*within, *reference]:
            base = base[base[key] == wanted[key]]
        if list(base["seed"]) != list(part["seed"]):
            raise ValueError(
                f"reference {wanted!r} has seeds {list(base['seed'])}, {names!r} has "
                f"{list(part['seed'])}"
            )
        lines.append((*names, *paired(part[value], base[value], statistic=statistic), len(part)))
    return pd.DataFrame(lines, columns=[*keys, "value", "low", "high", "seeds"])


def criterion_times(
    table: pd.DataFrame, keys: Sequence[str], value: str, length: float
) -> pd.DataFrame:
    """Return one line per condition: runs that reached a criterion, the median time, and the mean
    time up to ``length``.
    """
    lines = []
    for names, part in _conditions(table, keys):
        times: TimeToCriterion = time_to_criterion(part[value], length)
        lines.append(
            (*names, times.n, times.reached, times.median, times.mean, times.low, times.high)
        )
    return pd.DataFrame(
        lines, columns=[*keys, "seeds", "reached", "median", "value", "low", "high"]
    )


def _conditions(
    table: pd.DataFrame, keys: Sequence[str]
) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame]]:
    """Yield the names and lines of every condition; refuse keys that do not tell conditions
    apart.
    """
    clash = {"value", "low", "high", "seeds", "quantity"} & set(keys)
    if clash:
        raise ValueError(
            f"keys {sorted(clash)} are names of the result; rename these columns of the table first"
        )
    for names, part in table.groupby(list(keys), sort=False, dropna=False):
        if part["seed"].duplicated().any():
            raise ValueError(
                f"condition {dict(zip(keys, names, strict=True))!r} has seeds more than once: "
                "it mixes several conditions; name "
                f"them in keys, of {[column for column in table if column not in keys]!r}"
            )
        yield names, part


def said(line: Any, unit: str = "", digits: int = 1) -> str:
    """Return a line's number and interval in words, e.g. "3.2 mm [2.9, 3.6], n = 10"."""
    number, low, high = (f"{line[name]:.{digits}f}" for name in ("value", "low", "high"))
    return f"{number}{unit and ' ' + unit} [{low}, {high}], n = {int(line['seeds'])}"


def clear_from(lines: pd.DataFrame, level: str) -> float:
    """Return the smallest level from which on every interval lies above zero, infinite if the last
    one does not.
    """
    clear = (lines.sort_values(level, ascending=False)["low"] > 0).to_numpy()
    levels = lines.sort_values(level, ascending=False)[level].to_numpy(float)
    count = int(clear.argmin()) if not clear.all() else len(clear)
    return float(levels[count - 1]) if count else math.inf
