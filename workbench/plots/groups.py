"""Runs beside each other: what differs between them names the groups, seeds are the points.

>>> from workbench.formation.config import ConvoyConfig
>>> from workbench.lab.runs import learn
>>> base = ConvoyConfig(drive="rolling", followers=1)
>>> few = [learn(base.with_seed(seed), steps=300, progress=False) for seed in (1, 2)]
>>> compare({"a": few, "b": few}, ["losses"]).table["group"].tolist()
['a', 'b']
"""

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.fields import did_you_mean, flat
from workbench.lab.runs import Run
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import dots, one_note
from workbench.plots.figures import png
from workbench.plots.style import CYCLE, style

USUAL = ("losses", "rms_distance_error_mm", "bias_mm", "ripple_mm", "bearing_std_deg")
_COLUMNS = 3  # panels side by side


@dataclass(frozen=True, eq=False)
class Comparison:
    """Groups of runs; a notebook shows the table and the figure.

    Attributes:
        table: a row per quantity and group: value (mean), low, high (95 % interval), seeds.
        runs: a row per run: group, seed, quantities.
        figure: mean and interval per group, and every run as a point.
    """

    table: pd.DataFrame
    runs: pd.DataFrame
    figure: Figure

    def __repr__(self) -> str:
        """Show the table."""
        return str(self.table.to_string(index=False, float_format=lambda value: f"{value:.3g}"))

    def _repr_html_(self) -> str:
        """Show the table and the figure."""
        picture = base64.b64encode(png(self.figure)).decode()
        shown = self.table.to_html(index=False, float_format="%.3g")
        return f"{shown}<img alt='mean, interval and runs' src='data:image/png;base64,{picture}'>"


def compare(
    runs: Iterable[Run] | Mapping[str, Iterable[Run]], quantities: Sequence[str] = USUAL
) -> Comparison:
    """Return means with intervals over seeds, and a figure with every run as a point.

    Args:
        runs: finished runs, grouped by what their configurations differ in beside the seed; or
            groups by name.
        quantities: of the runs' summaries.

    Raises:
        ValueError: there are no runs, a seed is twice in a group, or a quantity is in no summary.
    """
    groups = runs if isinstance(runs, Mapping) else _grouped(list(runs))
    lines = []
    for group, members in groups.items():
        for run in members:
            unknown = [name for name in quantities if name not in run.summary]
            if unknown:
                raise ValueError(
                    f"quantity {unknown[0]!r}; expected one of {', '.join(run.summary)}"
                    + did_you_mean(unknown[0], run.summary)
                )
            numbers = {name: run.summary[name] for name in quantities}
            lines.append({"group": group, "seed": run.config.seed} | numbers)
    if not lines:
        raise ValueError("runs is empty; expected finished runs, such as those of learn_seeds")
    table = pd.DataFrame(lines)
    twice = table[table.duplicated(["group", "seed"])]
    if len(twice):
        raise ValueError(
            f"seed {twice['seed'].iloc[0]} is twice in group {twice['group'].iloc[0]!r}; seeds are "
            "the unit of every interval: name groups that differ in something else"
        )
    summary = _summary(table, quantities)
    return Comparison(summary, table, _draw(summary, table, quantities))


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
    order = {name: k for k, name in enumerate([*quantities, *table["group"].unique()])}
    return found.sort_values(
        ["quantity", "group"], key=lambda column: column.map(order), ignore_index=True
    )[["quantity", "group", "value", "low", "high", "seeds"]]


def _grouped(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Return runs by the fields in which they differ, as words."""
    told = [
        {"kind": run.kind, "length": run.length} | flat(run.config.with_seed(0)) for run in runs
    ]
    differ = [
        name for name in (told[0] if told else ()) if any(t[name] != told[0][name] for t in told)
    ]
    groups: dict[str, list[Run]] = {}
    for run, values in zip(runs, told, strict=True):
        label = ", ".join(f"{name} = {values[name]}" for name in differ) or "all"
        groups.setdefault(label, []).append(run)
    return groups


def _draw(summary: pd.DataFrame, table: pd.DataFrame, quantities: Sequence[str]) -> Figure:
    names = list(table["group"].unique())
    labels = [fill(str(name), 26) for name in names]
    columns = min(_COLUMNS, len(quantities))
    rows = math.ceil(len(quantities) / columns)
    lines = sum(label.count("\n") + 1 for label in labels)
    with style():
        height = rows * (1.1 + max(0.5 * len(names), 0.24 * lines))
        figure = Figure(figsize=(2.3 + 2.3 * columns, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for number, (name, ax) in enumerate(zip(quantities, axes, strict=False)):
            part = summary[summary["quantity"] == name]
            words = name.replace("_", " ")
            dots(part, "group", xlabel=words, ax=ax, number=number % len(CYCLE))
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_yticks(range(len(names)), labels if number % columns == 0 else [""] * len(names))
            places = [names.index(group) for group in table["group"]]
            ax.plot(table[name], places, "|", color="#999999", markersize=9, zorder=0)
        for ax in axes[len(quantities) :]:
            ax.set_axis_off()
        one_note(list(axes))
    return figure
