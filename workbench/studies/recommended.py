"""How do the settings follow?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.lab.statistics import interval, share_interval
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import OTHER_TRACKS, measure_widely
from workbench.measures.comparisons import by_quantity
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import dot_panels


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


PANELS = {
    "losses": "losses while learning (400 000 updates)",
    "greedy_bias_mm": "greedy: bias in mm",
    "greedy_ripple_mm": "greedy: ripple in mm",
    "greedy_bearing_std_deg": "greedy: bearing spread in °",
}


def as_learned(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting and seed: learning, and the greedy drive on the learned track."""
    same = table[table["track"].isna() | (table["track"] == "as learned")]
    return same.groupby(["setting", "seed"], sort=False).first().reset_index()


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and greedy errors by setting."""
    trials = as_learned(table)
    fig = dot_panels(trials, "setting", PANELS, size=(12.6, 3.1))
    for ax in fig.axes:
        ax.set_xlim(left=0)
    return fig, by_quantity(trials, ["setting"], PANELS)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E1: with the paper's tiles nobody is lost after learning, losses fall, and the same
    with the other settings.
    """
    runs = as_learned(table)
    lost = runs["greedy_losses"] > 0
    words, free, fall = [], {}, {}
    for name, part in runs.groupby("setting", sort=False):
        count = int(lost[part.index].sum())
        _, _, most = share_interval(count, len(part))
        late = interval(part["losses_per_hour_last_third"])
        whole = interval(part["losses"] / part["simulated_minutes"] * 60 / FOLLOWERS)
        free[name], fall[name] = count == 0, late[2] < whole[1]
        words.append(
            f"{name} {count} of {len(part)} (up to {100 * most:.0f} %), losses per follower and "
            f"hour {whole[0]:.1f} [{whole[1]:.1f}, {whole[2]:.1f}] in all, {late[0]:.1f} "
            f"[{late[1]:.1f}, {late[2]:.1f}] in the last third"
        )
    because = f"frozen runs that lose anybody, after {STUDY.steps} updates: {'; '.join(words)}"
    fails = (
        "a frozen run with the paper's tiles that loses its leader; then losses that do not fall "
        "while learning, or the same with another setting"
    )
    others = [free[name] for name in free if name != "paper"]
    parts = (free["paper"], fall["paper"], *others)
    claim = "Followers learn to follow, online."
    return Verdict("E1", claim, ruling(*map(bool, parts)), because, fails)


FOLLOWERS = 4
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
    verdicts={"E1": verdict},
)
