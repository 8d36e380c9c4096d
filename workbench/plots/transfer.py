"""Plots of weights that travel: how they follow world by world, and where real readings fall among
tiles.

Contract: plot functions take the tables of studies and of ``validate tiles``, draw on the axes
given to them and return these.
"""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm

from workbench.plots.style import CYCLE, note

SHARES = PowerNorm(4.0, 0.0, 1.0)  # colours of shares of time, most of them near 1


def world_grid(table: pd.DataFrame, ax: Axes) -> Axes:
    """Draw one row per training and one column per judging world, the later its commands the
    farther right.

    Colour is the share of time inside the bounds, the number is how many losses there were, in
    hundreds from 1 000 on.

    Args:
        table: lines of the study "transfer", of one route and one table.
    """
    worlds = table.groupby("seed")["delay"].first().sort_values(kind="stable")
    trainings = list(dict.fromkeys(table["training"]))
    by = {
        name: table.pivot(index="training", columns="seed", values=f"judged_{name}")
        for name in ("share_inside", "losses")
    }
    share, losses = (
        by[name].loc[trainings, worlds.index].to_numpy() for name in ("share_inside", "losses")
    )
    ax.imshow(share, aspect="auto", norm=SHARES)
    for (row, column), count in np.ndenumerate(losses):
        ink = "black" if SHARES(share[row, column]) > 0.6 else "white"
        words = f"{count:.0f}" if count < 1000 else f"{count / 1000:.1f}k"
        ax.text(column, row, words, ha="center", va="center", fontsize=8, color=ink)
    ax.set_yticks(range(len(trainings)), trainings)
    ax.set_xticks(
        range(len(worlds)), [f"{seed}\n{delay / 10:.1f}" for seed, delay in worlds.items()]
    )
    ax.tick_params(length=0)
    ax.axvline(
        (worlds == 0).sum() - 0.5, color="white", linewidth=2.5
    )  # to the right of it commands come late
    ax.set_xlabel("number of the world; its commands late by (s)")
    note(ax, f"emulated · {table['route'].iloc[0]} · {table['table'].iloc[0]}")
    return ax


def agreement(table: pd.DataFrame, ax: Axes) -> Axes:
    """Draw how far apart in tiles a real reading and the model's lie in the same situation, as
    shares of what the model sees.

    Args:
        table: lines of data/validation/tiles.csv, one per bar.
    """
    both = table["both_inside"] / table["model_inside"]
    same = both * table["share_same_tile"]
    near = both * table["share_within_one_tile"]
    places = np.arange(len(table))
    parts = (
        ("same tile", same, 0.0 * same, ""),
        ("next tile", near - same, same, "//"),
        ("farther", both - near, near, ".."),
        ("real one outside the bounds", 1 - both, both, "xx"),
    )
    for number, (name, width, left, hatch) in enumerate(parts):
        ax.barh(
            places,
            width,
            left=left,
            color=CYCLE[number],
            hatch=hatch,
            edgecolor="white",
            linewidth=0.5,
            label=name,
        )
    short = {"as recorded": "raw", "median of 5 rows": "median of 5"}
    names = [
        f"{line.route}, {line.table}\n{short.get(line.readings, line.readings)}"
        for line in table.itertuples()
    ]
    ax.set_yticks(places, names, fontsize=8)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.set_layout_engine("constrained", w_pad=0.2)  # inches: room for the names
    ax.invert_yaxis()
    ax.set_xlabel("share of rows that lie inside the bounds for the model (a simulated wall)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.16), ncols=4, columnspacing=1.0)
    note(
        ax,
        f"real e-puck2 · {int(table['model_inside'].min())} rows each · gains of the model fitted",
    )
    return ax
