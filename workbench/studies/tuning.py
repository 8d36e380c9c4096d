"""Which gains suit the carrot law best, without noise and with filtered noise (E10)?"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.laws.carrot import CarrotPI
from workbench.lab.statistics import interval
from workbench.lab.study import Case, Study
from workbench.plots.comparisons import dots
from workbench.studies.calm_trials import Gains, measure_gains, noisy
from workbench.studies.conditions import BASE

GRID = {
    "k_distance": (0.5, 1.0, 2.0, 4.0, 8.0, 12.0),
    "k_integral": (0.1, 0.2, 0.5, 1.0),
    "k_bearing": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0),
}
COST = "rms_distance_error_mm"  # what is made small, as is usual for such laws


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for noise, kept in (("none", "none"), ("2 mm, 2°", "alpha-beta")):
        config = replace(noisy(BASE, noise), filter=kept)
        for gains in itertools.product(*GRID.values()):
            named: dict[str, Any] = dict(zip(GRID, gains, strict=True))
            cases.append(({"noise": noise} | named, Gains(config=config, minutes=10.0, **named)))
    return cases


def costs(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per noise and gains that lost nobody, those with the smallest error first; means
    over seeds.
    """
    means = table.groupby(["noise", *GRID], sort=False)[["losses", COST, "turning"]].mean()
    free = means[means["losses"] == 0].reset_index()
    return free.sort_values(["noise", COST], ascending=[False, True])


def best(table: pd.DataFrame) -> dict[bool, CarrotPI]:
    """Return the law with the best gains, without and with noise."""
    found = {}
    for noise, part in costs(table).groupby("noise", sort=False):
        found[noise != "none"] = CarrotPI(**{name: float(part.iloc[0][name]) for name in GRID})
    return found


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw what the eight best gains come to, without and with noise."""
    fig = Figure(figsize=(9.6, 3.4), layout="constrained")
    axes = fig.subplots(1, 2)
    numbers = []
    for ax, (noise, part) in zip(axes, costs(table).groupby("noise", sort=False), strict=True):
        gains = part[list(GRID)].head(8)
        names = [" / ".join(f"{value:g}" for value in row) for row in gains.to_numpy()]
        rows = []
        for (_, line), name in zip(gains.iterrows(), names, strict=True):
            of = table[(table[list(GRID)] == line).all(axis=1) & (table["noise"] == noise)]
            rows.append((noise, name, *interval(of[COST]), len(of)))
        lines = pd.DataFrame(rows, columns=["noise", "gains", "value", "low", "high", "seeds"])
        dots(lines, "gains", xlabel=f"RMS distance error (mm), noise {noise}", ax=ax)
        ax.set_title("k_distance / k_integral / k_bearing", loc="left", fontsize=9)
        numbers.append(lines)
    return fig, pd.concat(numbers)


STUDY = Study("tuning", __doc__, cases, function=measure_gains, plots={"tuned_carrot": plot})
