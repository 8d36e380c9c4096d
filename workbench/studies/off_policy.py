"""Is a policy's value known from a log that it did not make?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.studies.off_policy_trials import measure_off_policy


def cases() -> Sequence[Case]:
    """Return the conditions."""
    small = replace(
        SETTINGS["infrared"], drive="rolling", followers=1, state_tiles=(5, 5), action_levels=(3, 3)
    )
    return [({"route": route}, replace(small, sensing=route)) for route in INFRARED]


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw each seed's value and interval from the log, and what its policy then did."""
    fig = Figure(figsize=(9.6, 3.4), layout="constrained")
    axes = fig.subplots(1, 2)
    for ax, (route, part) in zip(axes, table.groupby("route"), strict=True):
        spread = np.array([part["value"] - part["low"], part["high"] - part["value"]])
        label = "from the log, 95 % interval"
        ax.errorbar(part["seed"], part["value"], yerr=spread, fmt="o", capsize=2.5, label=label)
        beside = part["seed"] + 0.25
        ax.plot(beside, part["truth"], "s", markersize=4, label="what the policy did")
        words = {"xlabel": f"seed ({route}, simulated)", "ylabel": "mean discounted return"}
        ax.set(**words, xticks=part["seed"])
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig, table


STUDY = Study(
    "off-policy",
    __doc__,
    cases,
    function=measure_off_policy,
    steps=100_000,
    plots={"off_policy": plot},
)
