"""How do formations change their shape while they drive, and does anybody touch anybody?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import ConvoyConfig
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_condition
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import beside, dots, one_note
from workbench.studies.shape_trials import ReformTrial, measure_reform
from workbench.studies.shapes import REACH

SIZES = (4, 8, 16)
RULES = {"names": "fixed names", "squared": "squared distances", "auction": "auction"}
FLOWS = {"straight": "straight", "flow": "flow"}
BAR_S = 16.0  # four followers; set before the data
QUANTITIES = {
    "touched_percent": "changes with a contact in %",
    "median_reform_s": "median time until all are in place in s",
}


def cases() -> Sequence[Case]:
    """Return the conditions."""
    base = replace(ConvoyConfig(), drive="rolling", **REACH)
    return [
        (
            {"robots": size, "rule": RULES[rule], "places": FLOWS[flow]},
            ReformTrial(config=base, controller="carrot", followers=size, rule=rule, flow=flow),
        )
        for size in SIZES
        for rule in RULES
        for flow in FLOWS
    ]


def changes(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw contacts and times of changes."""
    told = table.assign(
        touched_percent=100 * table["changes_with_contact"] / table["changes"],
        case=table["robots"].astype(str) + ", " + table["rule"] + ", " + table["places"],
    )
    fig = Figure(figsize=(9.6, 5.4), layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.15)  # inches: room for the longest name
    axes = list(fig.subplots(1, 2))
    parts = []
    for ax, (value, words) in zip(axes, QUANTITIES.items(), strict=True):
        summary = by_condition(told, ["case"], value)
        if value == "touched_percent":
            summary["low"] = summary["low"].clip(lower=0.0)
        dots(summary, "case", xlabel=words, ax=ax)
        parts.append(summary.assign(quantity=value))
    beside(axes)
    one_note(axes)
    return fig, pd.concat(parts)


def untouched(table: pd.DataFrame) -> Verdict:
    """Decide F1's second part."""
    flow = table[(table["places"] == "flow") & (table["rule"] != RULES["names"])]
    straight = table[(table["places"] == "straight") & (table["rule"] == RULES["squared"])]
    touched, made = flow["changes_with_contact"].sum(), flow["changes"].sum()
    without = straight["changes_with_contact"].sum()
    four = flow[(flow["robots"] == SIZES[0]) & (flow["rule"] == RULES["squared"])]
    seconds = four["median_reform_s"].median()
    lost = flow["changes_with_loss"].sum()
    return Verdict(
        "F1, changes",
        "A self-organising group changes its shape while it drives, without contact.",
        ruling(bool(touched == 0), bool(lost == 0), bool(seconds <= BAR_S)),
        f"{touched:.0f} of {made:.0f} changes of 4, 8 and 16 followers with a contact where places "
        f"flow (squared distances, auction), {without:.0f} of {straight['changes'].sum():.0f} "
        f"where they go straight (squared distances); {lost:.0f} with a loss; "
        f"four followers take {seconds:.0f} s (median, n = {len(four)})",
        f"a contact; a loss, or more than {BAR_S:g} s with four followers, leave it at mostly",
    )


STUDY = Study(
    "reform",
    __doc__.strip(),
    cases,
    function=measure_reform,
    plots={"reform": changes},
    verdicts={"F1, changes": untouched},
)
