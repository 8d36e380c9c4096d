"""Do the first follower's weights serve all others (E7)?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_condition
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curves, one_note
from workbench.plots.style import note
from workbench.studies.conditions import OTHER, ROBOT, with_infrared
from workbench.studies.transfer_trials import (
    measure_copies,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    infrared = replace(
        SETTINGS["infrared"], drive="rolling", state_tiles=(5, 5), action_levels=(3, 3)
    )
    settings = {
        "paper": (replace(SETTINGS["paper"], drive="rolling"), 400_000),
        "paper-robot, camera": (replace(ROBOT, sensing="camera"), 400_000),
        "recommended": (replace(SETTINGS["recommended"], drive="rolling"), 400_000),
    } | {f"5×5/3×3, {route}": (replace(infrared, sensing=route), 200_000) for route in INFRARED}
    cases: list[Case] = []
    for name, (config, steps) in settings.items():
        for robots in ("alike", "different"):
            fleet = (
                replace(with_infrared(config, gain_spread=0.0), body=BodyConfig())
                if robots == "alike"
                else replace(config, body=OTHER)
            )
            cases.append(
                (
                    {"setting": name, "robots": robots},
                    Trial(config=fleet, steps=steps, minutes=20.0),
                )
            )
    return cases


WHOSE = {
    "own": "its own",
    "copied": "the first's",
    "last": "the last's",
    "shared": "learned together",
}
ERRORS = {"rms_distance_mm": "distance", "rms_bearing_deg": "bearing"}


def copied_to_own(table: pd.DataFrame, weights: str) -> pd.DataFrame:
    """Return the geometric mean ratio of a follower's error with other weights to that with its
    own, per error, setting and follower.

    The arithmetic mean of ratios exceeds 1 where two policies are equally good and differ by
    chance; the geometric one does not.

    Args:
        weights: "copied" (the first follower's), "last" (the last one's) or "shared".
    """
    ordered = table.sort_values("robot", kind="stable").rename(columns={"robot": "follower"})
    own = ordered[ordered["weights"] == "own"]
    other = ordered[ordered["weights"] == weights]
    parts = [
        other.assign(error=words, log=np.log(other[error].to_numpy() / own[error].to_numpy()))
        for error, words in ERRORS.items()
    ]
    lines = by_condition(pd.concat(parts), ["error", "robots", "setting", "follower"], "log")
    lines[["value", "low", "high"]] = np.exp(lines[["value", "low", "high"]])
    return lines


def of_others(table: pd.DataFrame) -> pd.DataFrame:
    """Return the ratios of the first follower's weights on all followers behind it."""
    ratios = copied_to_own(table, "copied")
    return ratios[ratios["follower"] > 1]


def errors_in_line(table: pd.DataFrame, setting: str) -> pd.DataFrame:
    """Return the RMS distance error in mm by robots, weights and follower, of one setting."""
    part = table[table["setting"] == setting]
    lines = []
    for whose, words in WHOSE.items():
        for follower in range(1, 5):
            of = part[(part["weights"] == whose) & (part["robot"] == follower)]
            line = by_condition(of, ["robots"], "rms_distance_mm")
            lines.append(line.assign(weights=words, follower=follower))
    return pd.concat(lines)


def losses_by_weights(table: pd.DataFrame) -> pd.DataFrame:
    """Return greedy losses by setting and weights, summed over robots, seeds and followers."""
    lost = table.groupby(["setting", "weights"], sort=False)["losses"].sum().astype(int)
    return lost.unstack("weights")[list(WHOSE)].rename(columns=WHOSE)


def runs_with_losses(table: pd.DataFrame) -> pd.DataFrame:
    """Return in how many runs anybody was lost, by setting and weights."""
    runs = table.groupby(["setting", "robots", "seed", "weights"], sort=False)["losses"].sum() > 0
    counts = runs.groupby(["setting", "weights"], sort=False).sum()
    return counts.unstack("weights")[list(WHOSE)].rename(columns=WHOSE)


def copied_over_own(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw copied over own errors down a line of robots that differ; the numbers have those of
    robots that are alike, too.
    """
    others = of_others(table)
    fig = Figure(figsize=(9.6, 3.8), layout="constrained")
    axes = fig.subplots(1, 2)
    shown = others[others["robots"] == "different"]
    for ax, error in zip(axes, ("distance", "bearing"), strict=True):
        part = shown[shown["error"] == error]
        label, words = "simulated follower", f"RMS error in {error}, copied / own"
        curves(part, "follower", by="setting", xlabel=label, ylabel=words, ax=ax, even=True)
        ax.axhline(1.1, color="#777777", linewidth=0.8)
        ax.set(yscale="log", ylim=(0.5, 6.5))
        ax.set_yticks([0.5, 0.7, 1, 1.4, 2, 3, 4, 6], ["0.5", "0.7", "1", "1.4", *"2346"])
        ax.minorticks_off()
    one_note(axes)
    note(axes[0], f"geometric mean, 95 % bootstrap interval over seeds, n = {STUDY.seeds}")
    return fig, others


def in_line(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw errors by place in line with four kinds of weights, paper's setting."""
    places = errors_in_line(table, "paper")
    fig = Figure(figsize=(9.6, 3.6), layout="constrained")
    axes = fig.subplots(1, 2, sharey=True)
    for ax, (robots, part) in zip(axes, places.groupby("robots"), strict=True):
        label, words = f"simulated follower, robots {robots}", "RMS distance error (mm)"
        curves(part, "follower", by="weights", xlabel=label, ylabel=words, ax=ax, even=True)
    axes[1].get_legend().remove()
    axes[0].set_ylim(4, 9)
    one_note(axes)
    return fig, places


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E7: nobody lost, with poses and with infrared, and errors within 1.1 of one's own."""
    lost = losses_by_weights(table)["the first's"]
    infrared = lost.index.str.contains("ir-")
    seeing, feeling = int(lost[~infrared].sum()), int(lost[infrared].sum())
    good = {error: part["value"] <= 1.1 for error, part in of_others(table).groupby("error")}
    counts = ", ".join(f"{int(ok.sum())} of {len(ok)} in {error}" for error, ok in good.items())
    because = (
        f"copies lost a leader {seeing} times with absolute coordinates, {feeling} times with "
        f"infrared; mean ratios of at most 1.1: {counts}; n = {STUDY.seeds} seeds each"
    )
    claim = (
        "It is sufficient to learn on the first follower and run a greedy policy on all other "
        "robots."
    )
    parts = (seeing == 0, feeling == 0, *(bool(ok.all()) for ok in good.values()))
    return Verdict("E7", claim, ruling(*parts), because)


ROWS = Rows(
    ("weights", "robot"),
    {(whose, k): f"{whose}_{{}}_{k}" for whose in WHOSE for k in range(1, 5)},
)
STUDY = Study(
    "copies",
    __doc__,
    cases,
    function=measure_copies,
    rows=ROWS,
    plots={"copies": copied_over_own, "copies_in_line": in_line},
    verdicts={"E7": verdict},
)
