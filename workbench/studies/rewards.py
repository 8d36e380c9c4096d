"""What does the reward decide, and the punishment of a loss?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import dot_panels
from workbench.studies.conditions import BASE, LOSSES_AND_GREEDY, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    presets = ("quadratic", "absolute", "distance", "alive")
    cases = [
        ({"reward": name, "terminal_factor": 1.0, "theta0": -0.1}, replace(BASE, reward=name))
        for name in presets
    ]
    for factor in (2.0, 10.0):
        cases.append(
            (
                {"reward": "quadratic", "terminal_factor": factor, "theta0": -0.1},
                replace(BASE, terminal_factor=factor),
            )
        )
    optimistic = {
        "quadratic": 0.0,
        "absolute": 0.0,
        "distance": 0.0,
        "alive": 5.0,
    }  # no reward sums up to more: 1 / (1 - γ) = 5
    for name, theta0 in optimistic.items():
        label = {"reward": name, "terminal_factor": 1.0, "theta0": theta0}
        cases.append((label, with_learner(replace(BASE, reward=name), theta0=theta0)))
    return cases


def cased(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with a column ``case``: reward, terminal reward and initial value."""
    case = table["reward"] + ", terminal ×" + table["terminal_factor"].map("{:g}".format)
    return table.assign(case=case + ", θ₀ " + table["theta0"].map("{:g}".format))


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors by reward and initial value."""
    named = cased(table)
    fig = dot_panels(named, "case", LOSSES_AND_GREEDY, size=(11.0, 4.0))
    for ax, ticks in ((fig.axes[0], (200, 1000, 5000)), (fig.axes[1], (5, 10, 40))):
        ax.set_xscale("log")
        ax.minorticks_off()
        ax.set_xticks(ticks, [str(tick) for tick in ticks])
    return fig, by_quantity(named, ["case"], LOSSES_AND_GREEDY)


STUDY = Study("rewards", __doc__, cases, plots={"reward_presets": plot})
