"""How do the settings follow?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import OTHER_TRACKS, measure_widely
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import dot_panels
from workbench.studies.conditions import GREEDY


def cases() -> Sequence[Case]:
    """Return the conditions."""
    settings = {name: SETTINGS[name] for name in ("paper", "logarithmic", "offset", "recommended")}
    settings["logarithmic 3×3"] = replace(
        SETTINGS["logarithmic"], state_tiles=(3, 3)
    )  # the smallest table that follows well
    settings["offset, 3×3 actions"] = replace(SETTINGS["offset"], action_levels=(3, 3))
    return [
        ({"setting": name}, replace(config, drive="rolling")) for name, config in settings.items()
    ]


PANELS = {"losses": "losses while learning (400 000 updates)"} | GREEDY


def as_learned(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting and seed: learning, and the greedy drive on the learned track."""
    same = table[table["track"].isna() | (table["track"] == "as learned")]
    return same.groupby(["setting", "seed"], sort=False).first().reset_index()


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and greedy errors by setting."""
    trials = as_learned(table)
    fig = dot_panels(trials, "setting", PANELS, size=(10.8, 2.9))
    for ax in fig.axes:
        ax.set_xlim(left=0)
    return fig, by_quantity(trials, ["setting"], PANELS)


TRACKS = {("as learned",): "greedy_{}"} | {(name,): f"{name}_{{}}" for name in OTHER_TRACKS}
ROWS = Rows(("track",), TRACKS, prefix="greedy_")
STUDY = Study(
    "recommended",
    __doc__,
    cases,
    function=measure_widely,
    steps=400_000,
    minutes=30.0,
    rows=ROWS,
    plots={"recommended_setting": plot},
)
