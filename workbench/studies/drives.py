"""Does a formation on a cheaper drive learn and follow as on wheels?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.arena.drives.table import DRIVES
from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_quantity, difference
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import dot_panels
from workbench.studies.conditions import GREEDY, LOSSES_AND_GREEDY

# what a drive may differ by from wheels, set before the data: losses by a share, mm, degrees
MARGINS = {"losses": 0.25, **dict(zip(GREEDY, (0.5, 0.25), strict=True))}


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"setting": name, "drive": drive}, replace(SETTINGS[name], drive=drive))
        for name in ("paper", "recommended")
        for drive in DRIVES
    ]


def from_wheels(table: pd.DataFrame) -> pd.DataFrame:
    """Return differences from wheels by quantity, setting and drive, with their margin, and whether
    the whole interval lies within it.
    """
    parts = []
    for quantity, margin in MARGINS.items():
        wheels = table[table["drive"] == "wheels"].groupby("setting")[quantity].mean()
        apart = difference(table, ["setting", "drive"], quantity, {"drive": "wheels"})
        share = apart["setting"].map(wheels) if quantity == "losses" else 1.0
        parts.append(apart.assign(quantity=quantity, margin=margin * share))
    lines = pd.concat(parts, ignore_index=True)
    lines = lines[lines["drive"] != "wheels"]
    outside = lines[["low", "high"]].abs().max(axis=1) > lines["margin"]
    return lines.assign(within=~outside).set_index(["quantity", "setting", "drive"])


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and greedy errors by setting and drive."""
    named = table.assign(condition=table["setting"] + ", " + table["drive"])
    fig = dot_panels(named, "condition", LOSSES_AND_GREEDY, size=(10.8, 2.9))
    for ax in fig.axes:
        ax.set_xlim(left=0)
    return fig, by_quantity(table, ["setting", "drive"], LOSSES_AND_GREEDY)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide whether every interval of rolling's differences lies within its margin."""
    rolling = from_wheels(table).xs("rolling", level="drive")
    words = [
        f"{setting}, {quantity}: {line['value']:+.2f} [{line['low']:+.2f}, {line['high']:+.2f}], "
        f"margin {line['margin']:.2f}"
        for (quantity, setting), line in rolling.iterrows()
    ]
    because = f"rolling less wheels: {'; '.join(words)}; n = {STUDY.seeds} seeds"
    claim = "A formation that rolls learns and follows as one on wheels."
    return Verdict("drives", claim, ruling(*rolling["within"]), because)


STUDY = Study(
    "drives",
    __doc__,
    cases,
    steps=400_000,
    minutes=30.0,
    seeds=20,
    plots={"drives_learning": plot},
    verdicts={"drives": verdict},
)
