"""Which of λ, γ, α, η, θ₀ and the ε schedule matter?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Study
from workbench.learning.config import PRESETS
from workbench.measures.comparisons import by_condition, by_quantity
from workbench.plots.comparisons import beside, dots
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
    """Draw losses and errors, one block per parameter, its default marked."""
    rows = {factor: table[table["factor"] == factor] for factor in SYMBOLS}
    heights = [part["level"].nunique() for part in rows.values()]
    fig = Figure(figsize=(10.8, 13.0), layout="constrained")
    grid = fig.subplots(6, 3, height_ratios=heights, sharex="col")
    for line, (factor, part) in zip(grid, rows.items(), strict=True):
        for ax, (value, words) in zip(line, LOSSES_AND_GREEDY.items(), strict=True):
            summary = by_condition(part, ["level"], value)
            default = summary.set_index("level").loc[DEFAULTS[factor], "value"]
            label = words if factor == "epsilon" else ""
            dots(summary, "level", xlabel=label, ax=ax, reference=default)
        line[0].set_ylabel(SYMBOLS[factor], rotation=0, fontsize=14, labelpad=14)
        beside(line)
    return fig, by_quantity(table, ["factor", "level"], LOSSES_AND_GREEDY)


STUDY = Study("parameters", __doc__, cases, plots={"parameters": plot})
