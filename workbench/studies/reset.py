"""What does restarting the simulation do to sections that are seldom reached?"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from workbench.arena.tracks import TrackConfig
from workbench.lab.statistics import paired
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import SECTIONS, Trial, measure_sections
from workbench.measures.comparisons import by_condition, by_quantity, difference, said
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curves, one_note
from workbench.studies.conditions import BASE


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (
            {"track": shape, "reset": reset, "steps": steps},
            Trial(
                config=replace(BASE, reset=reset, track=TrackConfig(shape=shape)),
                steps=steps,
                minutes=20.0,
            ),
        )
        for shape in ("circle", "eight")
        for steps in (2_500, 5_000, 10_000, 20_000, 40_000, 80_000)
        for reset in ("manoeuvre", "restart")
    ]


def held_out(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per trial: its losses while learning, the share of training (%) in the quarter
    that a restart reaches last, and greedy losses per follower-hour there minus in the first.

    The eight comes first: its colours agree in both panels of the plot.
    """
    keys = ["track", "reset", "steps", "seed"]
    table = table.sort_values("track", ascending=False, kind="stable")
    first, last = (table[table["section"] == k].set_index(keys) for k in (1, SECTIONS))
    lost = "greedy_losses_per_hour"
    whole = table[table["section"].isna()].set_index(keys)
    return (
        whole[["losses"]]
        .assign(held_out=last[lost] - first[lost], training_percent_4=100 * last["training_share"])
        .reset_index()
    )


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw how much is trained in the held-out quarter, and what restarts cost there beside the
    manoeuvre, paired by seed.
    """
    trials = held_out(table)
    trials["case"] = trials["track"] + ", " + trials["reset"]
    seen = by_condition(trials, ["case", "steps"], "training_percent_4")
    keys = ["track", "steps", "reset"]
    apart = difference(trials, keys, "held_out", {"reset": "manoeuvre"})
    apart = apart[apart["reset"] == "restart"]
    fig = Figure(figsize=(10.4, 4.2), layout="constrained")
    left, right = fig.subplots(1, 2)
    share = "share of training in the held-out quarter in %"
    rate = "losses per follower-hour in quarter 4\nbeyond quarter 1, restart − manoeuvre"
    label = "learning updates"
    one: dict[str, Any] = {"ax": left, "even": True, "legend": False}
    curves(seen, "steps", by="case", xlabel=label, ylabel=share, **one)
    two = one | {"ax": right}
    curves(apart, "steps", by="track", xlabel=label, ylabel=rate, **two)
    left.axhline(25, color="#777777", linestyle=":", linewidth=0.8)
    right.axhline(0, color="#777777", linestyle=":", linewidth=0.8)
    below: dict[str, Any] = {
        "loc": "upper center",
        "bbox_to_anchor": (0.5, -0.16),
        "ncols": 2,
        "fontsize": 8,
    }
    left.legend(**below)
    right.legend(**below)
    one_note([left, right])
    return fig, by_quantity(trials, ["track", "reset", "steps"], ["training_percent_4", "held_out"])


def harm(table: pd.DataFrame) -> pd.DataFrame:
    """Return, by track, how much less is trained in the held-out quarter with restarts (points),
    and how many more losses per hour that costs there than with the manoeuvre; means over lengths,
    paired by seed.
    """
    trials = held_out(table)
    lines = []
    for track, part in trials.groupby("track", sort=False):
        means = part.groupby(["reset", "seed"])[["training_percent_4", "held_out"]].mean()
        for value in ("training_percent_4", "held_out"):
            apart = paired(means.loc["restart"][value], means.loc["manoeuvre"][value])
            lines.append((track, value, *apart, part["seed"].nunique()))
    return pd.DataFrame(lines, columns=["track", "measure", "value", "low", "high", "seeds"])


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide X2: restarts cost losses where they keep followers from training, on either track."""
    apart = harm(table).set_index(["measure", "track"])
    costs, shares = apart.loc["held_out"], apart.loc["training_percent_4"]
    because = (
        "restarts minus manoeuvre; training in the held-out quarter, points: "
        + ", ".join(f"{track} {said(line)}" for track, line in shares.iterrows())
        + "; losses per hour there beyond those where it trained: "
        + ", ".join(f"{track} {said(line)}" for track, line in costs.iterrows())
    )
    fails = (
        "losses in the held-out quarter that are not clearly more with restarts on any track; then "
        "on one of them, or as much training there"
    )
    claim = "Restarting the simulation after a loss leads to some overtraining of the same section."
    harmed = [bool(low > 0) for low in costs["low"]]
    parts = (any(harmed), all(harmed), *(bool(high < 0) for high in shares["high"]))
    return Verdict("X2", claim, ruling(*parts), because, fails)


ROWS = Rows(("section",), {(k,): f"{{}}_{k}" for k in range(1, SECTIONS + 1)})
STUDY = Study(
    "reset",
    __doc__,
    cases,
    function=measure_sections,
    rows=ROWS,
    plots={"reset_sections": plot},
    verdicts={"X2": verdict},
)
