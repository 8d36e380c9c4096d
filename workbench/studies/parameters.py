"""Which of λ, γ, α, η, θ₀ and the ε schedule matter?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Study
from workbench.learning.config import PRESETS
from workbench.measures.comparisons import by_condition, by_quantity
from workbench.studies.conditions import BASE, LOSSES_AND_GREEDY, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    values: dict[str, Sequence[float]] = {
        "lam": (0.0, 0.4, 0.6, 0.8, 0.9, 1.0),
        "gamma": (0.0, 0.5, 0.7, 0.8, 0.9, 0.95),
        "alpha": (0.01, 0.03, 0.1, 0.3, 0.6),
        "eta": (0.0, 0.01, 0.1, 1.0),
        "theta0": (-1.0, -0.3, -0.1, -0.03, 0.0),
    }
    cases = [
        ({"factor": n, "level": f"{v:g}"}, with_learner(BASE, **{n: v}))
        for n, several in values.items()
        for v in several
    ]
    schedules: dict[str, dict[str, float | str]] = {
        "0.05 → 0.01": {},
        "0.05 → 0": {"epsilon_final": 0.0},
        "0.2 → 0.01": {"epsilon": 0.2},
        "0.05 → 0.01, exponential": {"epsilon_schedule": "exponential"},
        "0.05": {"epsilon_schedule": "constant"},
        "0.01": {"epsilon_schedule": "constant", "epsilon": 0.01},
        "0": {"epsilon_schedule": "constant", "epsilon": 0.0},
    }
    cases += [
        ({"factor": "epsilon", "level": name}, with_learner(BASE, **changes))
        for name, changes in schedules.items()
    ]
    return cases + [
        ({"factor": "preset", "level": name}, replace(BASE, learner=learner))
        for name, learner in PRESETS.items()
    ]


SYMBOLS = {"lam": "λ", "gamma": "γ", "alpha": "α", "eta": "η", "theta0": "θ₀", "epsilon": "ε"}
DEFAULTS = {
    "lam": "0.8",
    "gamma": "0.8",
    "alpha": "0.1",
    "eta": "0.01",
    "theta0": "-0.1",
    "epsilon": "0.05 → 0.01",
}


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors, a column per parameter, its default marked."""
    rows = {factor: table[table["factor"] == factor] for factor in SYMBOLS}
    widths = [part["level"].nunique() for part in rows.values()]
    fig = Figure(figsize=(12.0, 6.4), layout="constrained")
    grid = fig.subplots(3, 6, width_ratios=widths, sharey="row", sharex="col")
    for line, (value, words) in zip(grid, LOSSES_AND_GREEDY.items(), strict=True):
        for ax, (factor, part) in zip(line, rows.items(), strict=True):
            summary = by_condition(part, ["level"], value)
            at = range(len(summary))
            spread = [summary["value"] - summary["low"], summary["high"] - summary["value"]]
            ax.errorbar(
                at, summary["value"], np.maximum(spread, 0), fmt="o", markersize=4, capsize=2.5
            )
            default = summary.set_index("level").loc[DEFAULTS[factor], "value"]
            ax.axhline(default, color="#777777", linestyle=":", linewidth=1)
            names = [name.replace(" → ", "→").replace(", ", " ") for name in summary["level"]]
            ax.set_xticks(at, names, rotation=60, ha="right", rotation_mode="anchor", fontsize=7.5)
            ax.set_xlim(-0.6, len(summary) - 0.4)
        line[0].set_ylabel(words.replace(" error", "\nerror").replace(" learning", "\nlearning"))
    for ax, symbol in zip(grid[0], SYMBOLS.values(), strict=True):
        ax.set_title(symbol, fontsize=13)
    fig.supxlabel("mean, 95 % interval over ten seeds; dotted: with all defaults", fontsize=9)
    return fig, by_quantity(table, ["factor", "level"], LOSSES_AND_GREEDY)


STUDY = Study("parameters", __doc__, cases, plots={"parameters": plot})
