"""How many tiles, uniform or logarithmic, for distance and for bearing?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import TILINGS
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_condition, by_quantity, criterion_times
from workbench.plots.comparisons import curve_panels, curves
from workbench.studies.conditions import BASE, GREEDY, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    both = (True, True)
    for axis, along, theta0 in (
        ("distance", (True, False), -0.1),
        ("bearing", (False, True), -0.1),
        ("both", both, -0.1),
        ("both", both, 0.0),
    ):
        for spacing in TILINGS:
            for count in (3, 5, 7, 9, 11, 13, 15):
                numbers = (count if along[0] else 9, count if along[1] else 9)
                kinds = (spacing if along[0] else "uniform", spacing if along[1] else "uniform")
                config = replace(
                    BASE, state_tiles=numbers, distance_tiling=kinds[0], bearing_tiling=kinds[1]
                )
                label = {"axis": axis, "spacing": spacing, "tiles": count, "theta0": theta0}
                cases.append((label, with_learner(config, theta0=theta0)))
    return cases


ALONG = {"distance": "greedy_rms_distance_error_mm", "bearing": "greedy_bearing_std_deg"}


def precision(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw greedy errors against the number of tiles along both dimensions."""
    cases = table["spacing"] + ", θ₀ " + table["theta0"].map("{:g}".format)
    both = table.assign(**{"spacing, θ₀": cases})[table["axis"] == "both"]
    by, x = "spacing, θ₀", "tiles"
    label = "tiles along each dimension"
    fig = curve_panels(both, by, x, GREEDY, xlabel=label, size=(10.4, 3.9))
    return fig, by_quantity(both, [by, x], GREEDY)


def apart(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw the error of each dimension against the number of tiles along it alone."""
    fig = Figure(figsize=(10.4, 3.9), layout="constrained")
    numbers = []
    for ax, (axis, value) in zip(fig.subplots(1, 2), ALONG.items(), strict=True):
        summary = by_condition(table[table["axis"] == axis], ["spacing", "tiles"], value)
        label, words = f"tiles along {axis}", GREEDY[value]
        curves(summary, "tiles", by="spacing", xlabel=label, ylabel=words, ax=ax, even=True)
        numbers.append(summary.assign(axis=axis))
    return fig, pd.concat(numbers)


def learning_times(table: pd.DataFrame) -> pd.DataFrame:
    """Return thousand updates to the first block without loss, by spacing and number of tiles."""
    whole = table[(table["axis"] == "both") & (table["theta0"] == -0.1)]
    times = criterion_times(whole, ["spacing", "tiles"], "updates_to_lossfree", STUDY.steps)
    times[["value", "low", "high"]] /= 1000
    return times


def learning_time(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw what more tiles cost: losses and time to learn, at θ₀ = −0.1."""
    whole = table[(table["axis"] == "both") & (table["theta0"] == -0.1)]
    times = learning_times(table)
    losses = by_condition(whole, ["spacing", "tiles"], "losses")
    fig = Figure(figsize=(10.4, 3.9), layout="constrained")
    left, right = fig.subplots(1, 2)
    label = "tiles along each dimension"
    words = ("losses while learning", "thousand updates to the first block without loss")
    curves(losses, "tiles", by="spacing", xlabel=label, ylabel=words[0], ax=left, even=True)
    curves(times, "tiles", by="spacing", xlabel=label, ylabel=words[1], ax=right, even=True)
    return fig, losses.merge(times, on=["spacing", "tiles"], suffixes=("_losses", "_time"))


STUDY = Study(
    "tiles",
    __doc__,
    cases,
    plots={
        "tiles_precision": precision,
        "tiles_apart": apart,
        "tiles_learning_time": learning_time,
    },
)
