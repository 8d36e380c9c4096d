"""How many speed levels, over which range?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_condition, by_quantity
from workbench.plots.comparisons import beside, dots
from workbench.studies.conditions import BASE, LOSSES_AND_GREEDY


def cases() -> Sequence[Case]:
    """Return the conditions."""
    levels = [("levels", f"{n}×{n}", replace(BASE, action_levels=(n, n))) for n in (3, 5, 7, 9, 11)]
    ranges = [
        (
            "range",
            f"{1000 * low:.0f}–{1000 * high:.0f} mm/s",
            replace(BASE, wheel_speed_mps=(low, high)),
        )
        for low, high in (
            (0.0, 0.12),
            (0.015, 0.105),
            (0.03, 0.09),
            (0.045, 0.075),
            (0.0525, 0.0675),
        )
    ]
    settings = [
        ("setting", name, replace(SETTINGS[name], drive="rolling"))
        for name in ("paper", "paper-robot")
    ]
    return [
        ({"factor": factor, "level": level}, config)
        for factor, level, config in levels + ranges + settings
    ]


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors by the number of speed levels, and by their range."""
    panels = LOSSES_AND_GREEDY
    fig = Figure(figsize=(10.8, 4.6), layout="constrained")
    grid = fig.subplots(2, 3, sharex="col")
    factors = {"levels": "speed levels per wheel", "range": "range, 7 levels"}
    for line, (factor, words) in zip(grid, factors.items(), strict=True):
        for ax, (value, name) in zip(line, panels.items(), strict=True):
            summary = by_condition(table[table["factor"] == factor], ["level"], value)
            default = summary.iloc[2]["value"]  # 7×7 levels, and 30 to 90 mm/s
            label = name if factor == "range" else ""
            dots(summary, "level", xlabel=label, ax=ax, reference=default)
        line[0].set_ylabel(words)
        beside(line)
    return fig, by_quantity(table, ["factor", "level"], panels)


STUDY = Study("actions", __doc__, cases, plots={"action_levels": plot})
