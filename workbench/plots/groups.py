"""Runs beside each other: what differs between them names the groups, seeds are the points.

>>> from workbench.formation.config import ConvoyConfig
>>> from workbench.lab.runs import learn
>>> base = ConvoyConfig(drive="rolling", followers=1)
>>> few = [learn(base.with_seed(seed), steps=300, progress=False) for seed in (1, 2)]
>>> compare({"a": few, "b": few}, quantities=["losses"]).table["group"].tolist()
['a', 'b']
"""

import base64
import html
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.fields import did_you_mean, flat
from workbench.formation.policy import Policy
from workbench.lab.runs import Run
from workbench.measures.comparisons import by_quantity, difference
from workbench.plots.comparisons import dots, one_note
from workbench.plots.figures import png
from workbench.plots.style import CYCLE, note, style

USUAL = ("losses", "rms_distance_error_mm", "bias_mm", "ripple_mm", "bearing_std_deg")
_COLUMNS = 3  # panels side by side


@dataclass(frozen=True, eq=False)
class Comparison:
    """Groups of runs; a notebook shows the table and the figure, ``figure.savefig("mine.png")``
    stores it.

    Attributes:
        table: a row per quantity and group: value (mean), low, high (95 % interval over seeds:
            Student's t, corrected for skewness), seeds.
        differences: a row per quantity and group, from the first group, seed by seed; without rows
            where the groups have different seeds.
        runs: a row per run: group, seed, quantities.
        figure: mean and interval per group, and every run as a tick.
    """

    table: pd.DataFrame
    differences: pd.DataFrame
    runs: pd.DataFrame
    figure: Figure

    def __repr__(self) -> str:
        """Show the tables."""
        shown = [_as_text(self.table)]
        if len(self.differences):
            shown.append(f"{self._said()}\n{_as_text(self.differences)}")
        elif self.table["group"].nunique() > 1:
            shown.append(self._said())
        return "\n\n".join(shown)

    def _said(self) -> str:
        """Return what the differences are, or why there are none."""
        if len(self.differences):
            return f"Differences from {self.table['group'].iloc[0]}, seed by seed:"
        return (
            "No differences: the groups have different seeds, or a single one; evaluate with "
            "config.with_seed(seed) for the same."
        )

    def _repr_html_(self) -> str:
        """Show the tables and the figure."""
        picture = base64.b64encode(png(self.figure)).decode()
        shown = self.table.to_html(index=False, float_format="%.3g")
        if len(self.differences):
            told = self.differences.to_html(index=False, float_format="%.3g")
            shown += f"<p>{html.escape(self._said())}</p>{told}"
        return f"{shown}<img alt='mean, interval and runs' src='data:image/png;base64,{picture}'>"


def _as_text(table: pd.DataFrame) -> str:
    return str(table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))


def compare(
    runs: Iterable[Run] | Mapping[str, Iterable[Run]],
    *,
    quantities: Sequence[str] | str | None = None,
) -> Comparison:
    """Return means with intervals over seeds, differences from the first group, and a figure with
    every run as a tick.

    Args:
        runs: finished runs, grouped by what they differ in beside the seed; or groups by name:
            {"default": runs, "mine": others}.
        quantities: of the runs' summaries; default: the usual ones, of evaluations those of the
            last third, as followers begin at rest and in line.

    Raises:
        TypeError: something is no run.
        ValueError: there are no runs, a seed is twice in a group, or a quantity is no number of a
            run's summary.
    """
    if isinstance(runs, Mapping):
        groups = {str(name): _runs(members) for name, members in runs.items()}
    else:
        groups = _grouped(_runs(runs))
    if quantities is None:
        quantities = _usual([run for members in groups.values() for run in members])
    quantities = [quantities] if isinstance(quantities, str) else list(quantities)
    empty = [name for name, members in groups.items() if not members]
    if empty or not groups or not quantities:
        raise ValueError(
            f"runs = {list(groups)!r}, quantities = {quantities!r}, without runs: {empty!r}; "
            "expected finished runs, such as those of learn_seeds, and quantities of a summary"
        )
    lines = [
        {"group": group, "seed": run.config.seed} | _numbers(run, quantities, group)
        for group, members in groups.items()
        for run in members
    ]
    table = pd.DataFrame(lines)
    twice = table[table.duplicated(["group", "seed"])]
    if len(twice):
        raise ValueError(
            f"seed {twice['seed'].iloc[0]} is twice in group {twice['group'].iloc[0]!r}; seeds are "
            "the unit of every interval: name groups that differ in something else, as in "
            "compare({'default': runs, 'mine': others})"
        )
    summary = _summary(table, quantities)
    figure = _draw(summary, table, quantities)
    return Comparison(summary, _differences(table, quantities), table, figure)


def _usual(runs: Sequence[Run]) -> list[str]:
    """Return what is usually compared: of evaluations that are long enough, their last third."""
    late = [name if name == "losses" else f"{name}_last_third" for name in USUAL]
    settled = all(
        run.kind == "evaluate" and all(run.summary[name] is not None for name in late)
        for run in runs
    )
    return late if settled else list(USUAL)


def _runs(runs: Any) -> list[Run]:
    """Return runs as a list; a single one is a list of one."""
    if isinstance(runs, Run):
        return [runs]
    found = list(runs)
    wrong = [one for one in found if not isinstance(one, Run)]
    if wrong:
        raise TypeError(
            f"runs has a {type(wrong[0]).__name__} in it; expected runs, or groups of them by "
            "name: {'default': runs, 'mine': others}"
        )
    return found


def _numbers(run: Run, quantities: Sequence[str], group: str) -> dict[str, float]:
    """Return numbers of a run's summary."""
    for name in quantities:
        if name not in run.summary:
            raise ValueError(
                f"quantity {name!r}; expected one of {', '.join(run.summary)}"
                + did_you_mean(name, run.summary)
            )
        value = run.summary[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            why = "there was too little of it" if value is None else "that is no number"
            raise ValueError(
                f"quantity {name!r} of group {group!r}, seed {run.config.seed}, is {value!r}: "
                f"{why}; expected numbers, such as {', '.join(USUAL)}"
            )
    return {name: float(run.summary[name]) for name in quantities}


def _summary(table: pd.DataFrame, quantities: Sequence[str]) -> pd.DataFrame:
    """Return means and intervals; a single run has none."""
    alone = table.groupby("group")["seed"].transform("size") == 1
    parts = [by_quantity(table[~alone], ["group"], quantities)] if not alone.all() else []
    for line in table[alone].to_dict("records"):
        told = {"group": line["group"], "low": math.nan, "high": math.nan, "seeds": 1}
        parts.append(
            pd.DataFrame([told | {"quantity": name, "value": line[name]} for name in quantities])
        )
    found = pd.concat(parts)
    # Counts, shares and root mean squares have no mean below 0, wherever an interval ends.
    unsigned = ~found["quantity"].str.contains("mean")
    found.loc[unsigned, "low"] = found.loc[unsigned, "low"].clip(lower=0.0)
    share = found["quantity"].str.startswith("share")
    found.loc[share, "high"] = found.loc[share, "high"].clip(upper=1.0)
    order = {name: k for k, name in enumerate([*quantities, *table["group"].unique()])}
    return found.sort_values(
        ["quantity", "group"], key=lambda column: column.map(order), ignore_index=True
    )[["quantity", "group", "value", "low", "high", "seeds"]]


def _differences(table: pd.DataFrame, quantities: Sequence[str]) -> pd.DataFrame:
    """Return how far every group is from the first, where all have the same two seeds or more."""
    columns = ["quantity", "group", "value", "low", "high", "seeds"]
    groups = table["group"].unique()
    ordered = table.sort_values("seed", kind="stable")
    seeds = {tuple(ordered[ordered["group"] == group]["seed"]) for group in groups}
    if len(groups) < 2 or len(seeds) > 1 or len(seeds.pop()) < 2:
        return pd.DataFrame(columns=columns)
    parts = []
    for name in quantities:
        found = difference(ordered, ["group"], name, {"group": groups[0]})
        others = found.set_index("group").loc[groups[1:]].reset_index()
        parts.append(others.assign(quantity=name))
    return pd.concat(parts, ignore_index=True)[columns]


def _grouped(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Return runs by the fields in which they differ, as words."""
    told = [
        {"kind": run.kind, "length": run.length, "by": _driver(run), "reward_sha256": _reward(run)}
        | flat(run.config.with_seed(0))
        for run in runs
    ]
    differ = [
        name for name in (told[0] if told else ()) if any(t[name] != told[0][name] for t in told)
    ]
    groups: dict[str, list[Run]] = {}
    for run, values in zip(runs, told, strict=True):
        label = ", ".join(f"{name} = {values[name]}" for name in differ) or "all"
        groups.setdefault(label, []).append(run)
    return groups


def _driver(run: Run) -> str:
    """Return who drove in an evaluation, as far as that is no table that was learned."""
    policy = run.policy
    if run.kind != "evaluate" or isinstance(policy, Policy):
        return "table"
    gains = ", ".join(f"{value:g}" for value in policy.gains())
    function = getattr(policy, "function", None)
    return f"{policy.name} {getattr(function, '__name__', '') or gains}".strip()


def _reward(run: Run) -> str:
    return (run.reward_sha256 or "")[:8]


def _draw(summary: pd.DataFrame, table: pd.DataFrame, quantities: Sequence[str]) -> Figure:
    names = list(table["group"].unique())
    labels = [fill(str(name), 26).replace("$", r"\$") for name in names]
    columns = min(_COLUMNS, len(quantities))
    rows = math.ceil(len(quantities) / columns)
    lines = sum(label.count("\n") + 1 for label in labels)
    with style():
        height = rows * (1.1 + max(0.5 * len(names), 0.24 * lines))
        figure = Figure(figsize=(2.3 + 2.3 * columns, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for number, (name, ax) in enumerate(zip(quantities, axes, strict=False)):
            part = summary[summary["quantity"] == name]
            words = re.sub("_(mm|deg)(_last_third)?$", r"\2, \1", name).replace("_", " ")
            dots(part, "group", xlabel=words, ax=ax, number=number % len(CYCLE))
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_yticks(range(len(names)), labels if number % columns == 0 else [""] * len(names))
            places = [names.index(group) for group in table["group"]]
            ax.plot(table[name], places, "|", color="#999999", markersize=9, zorder=0)
        for ax in axes[len(quantities) :]:
            ax.set_axis_off()
        one_note(list(axes))
        if summary["seeds"].max() == 1:
            note(axes[0], "single runs: no intervals")
    return figure
