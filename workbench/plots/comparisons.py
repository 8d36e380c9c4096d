"""Plots of studies: a quantity against a level or for named conditions, each mean with its interval
over seeds; ``curve_panels`` and ``dot_panels`` draw several quantities side by side.

Like all plots they take data, draw on ``ax`` and return it. The tables come from
``workbench.measures.comparisons``.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from workbench.measures.comparisons import by_condition
from workbench.plots.style import CYCLE, MARKERS, new_axes, note

LINES = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 2)))
BAND = "mean, 95 % interval over seeds"


def curves(
    summary: pd.DataFrame,
    x: str,
    *,
    by: str,
    xlabel: str,
    ylabel: str,
    ax: Axes | None = None,
    even: bool = False,
    log: bool = False,
    legend: bool = True,
) -> Axes:
    """Draw value against a numeric level, one line per case of ``by``, with intervals.

    Args:
        summary: lines with columns x, by, "value", "low", "high", "seeds".
        even: whether levels stand at even distances, whatever they are.
        log: whether the value axis is logarithmic; otherwise it begins at zero.
    """
    ax = ax or new_axes(5.4, 3.6)
    cases = list(summary[by].unique())
    levels = sorted(summary[x].unique())
    at = {level: place if even else float(level) for place, level in enumerate(levels)}
    span = max(at.values()) - min(at.values()) or 1.0
    for number, case in enumerate(cases):
        part = summary[summary[by] == case]
        shift = (0.008 if len(cases) < 4 else 0.02) * span * (number - (len(cases) - 1) / 2)
        spread = np.array([part["value"] - part["low"], part["high"] - part["value"]])
        ax.errorbar(
            part[x].map(at) + shift,
            part["value"],
            yerr=np.maximum(spread, 0),
            color=CYCLE[number],
            marker=MARKERS[number],
            markersize=5,
            linestyle=LINES[number % len(LINES)],
            capsize=2.5,
            linewidth=1.3,
            elinewidth=1,
            label=str(case),
        )
    if log:
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(lambda number, _: f"{number:g}")
        ax.yaxis.set_minor_formatter(NullFormatter())
    else:
        ax.set_ylim(bottom=min(0.0, 1.05 * float(summary["low"].min())))
    if even:
        ax.set_xticks(range(len(levels)), [f"{level:,}".replace(",", " ") for level in levels])
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    note(ax, f"{BAND}, n = {_seeds(summary)}")
    if legend:
        ax.legend()
    return ax


def dots(
    summary: pd.DataFrame,
    rows: str,
    *,
    xlabel: str,
    ax: Axes | None = None,
    reference: float | None = None,
    number: int = 0,
) -> Axes:
    """Draw one row per condition: its mean and interval as a dot with bars, on a value axis.

    Args:
        summary: lines with columns rows, "value", "low", "high", "seeds".
        reference: a value to mark with a vertical line.
        number: of colour and marker.
    """
    ax = ax or new_axes(5.4, 0.32 * len(summary) + 1.2)
    places = np.arange(len(summary))
    spread = np.array([summary["value"] - summary["low"], summary["high"] - summary["value"]])
    if reference is not None:
        ax.axvline(reference, color="#777777", linestyle=":", linewidth=1)
    ax.errorbar(
        summary["value"],
        places,
        xerr=np.maximum(spread, 0),
        fmt=MARKERS[number],
        color=CYCLE[number],
        markersize=5,
        capsize=2.5,
    )
    ax.set_yticks(places, [str(name) for name in summary[rows]])
    ax.set_ylim(len(summary) - 0.5, -0.5)
    ax.set_xlabel(xlabel)
    note(ax, f"{BAND}, n = {_seeds(summary)}")
    return ax


def curve_panels(
    table: pd.DataFrame,
    by: str,
    x: str,
    values: Mapping[str, str],
    *,
    xlabel: str,
    size: tuple[float, float],
    even: bool = True,
    legends: Sequence[int] | None = None,
) -> Figure:
    """Draw several quantities of a study's table against a level, side by side.

    Args:
        table: a row per condition and seed.
        by, x: the columns that name the condition: a case, a numeric level.
        values: column → its words on the axis.
        size: of the figure, inches.
        legends: numbers of the panels that have one; default all.
    """
    fig = Figure(figsize=size, layout="constrained")
    axes = fig.subplots(1, len(values))
    for number, (ax, value) in enumerate(zip(axes, values, strict=True)):
        summary = by_condition(table, [by, x], value)
        words, legend = values[value], legends is None or number in legends
        curves(summary, x, by=by, xlabel=xlabel, ylabel=words, ax=ax, even=even, legend=legend)
    return fig


def dot_panels(
    table: pd.DataFrame,
    rows: str,
    values: Mapping[str, str],
    *,
    size: tuple[float, float],
    reference: float | None = None,
) -> Figure:
    """Draw several quantities of a study's table for named conditions, side by side.

    Args:
        table: a row per condition and seed.
        rows: the column that names the condition.
        values: column → its words on the axis.
        size: of the figure, inches.
        reference: see ``dots``.
    """
    fig = Figure(figsize=size, layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.1)  # inches: room for the longest name
    axes = fig.subplots(1, len(values))
    for ax, (value, words) in zip(axes, values.items(), strict=True):
        dots(by_condition(table, [rows], value), rows, xlabel=words, ax=ax, reference=reference)
    beside(axes)
    return fig


def beside(axes: Sequence[Axes]) -> None:
    """Leave the row names to the first of several dot plots side by side."""
    for ax in axes[1:]:
        ax.set_yticklabels([])


def one_note(axes: Sequence[Axes]) -> None:
    """Leave the note on bands to the first of several plots side by side, where it would not fit
    above each.
    """
    for ax in axes[1:]:
        note(ax, "")


def _seeds(summary: pd.DataFrame) -> str:
    seeds = sorted(summary["seeds"].unique())
    return str(seeds[0]) if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
