"""Do the first follower's weights serve all others (E7), and what helps them (C2)?"""

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
from workbench.plots.comparisons import curves
from workbench.plots.style import note
from workbench.studies.conditions import OTHER, ROBOT, with_infrared
from workbench.studies.transfer_trials import CURES, measure_copies


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
    "range": "the first's, learned at many speeds",
}
ERRORS = {"rms_distance_error_mm": "distance", "rms_bearing_deg": "bearing"}
CLOSE, FAR = 1.1, 1.25  # of one's own error: the mean, and the far end of its interval


def copied_to_own(table: pd.DataFrame, weights: str, cures: str = "none") -> pd.DataFrame:
    """Return the geometric mean ratio of a follower's error with other weights to that with its
    own, per error, setting and follower.

    The arithmetic mean of ratios exceeds 1 where two policies are equally good and differ by
    chance; the geometric one does not. Both drive with the same cures.

    Args:
        weights: "copied" (the first follower's), "last" (the last one's), "shared" or "range".
        cures: "none", or "calm" with interpolated commands and trim.
    """
    ordered = table[table["cures"] == cures].sort_values("robot", kind="stable")
    ordered = ordered.rename(columns={"robot": "follower"})
    own = ordered[ordered["weights"] == "own"]
    other = ordered[ordered["weights"] == weights]
    parts = [
        other.assign(error=words, log=np.log(other[error].to_numpy() / own[error].to_numpy()))
        for error, words in ERRORS.items()
    ]
    lines = by_condition(pd.concat(parts), ["error", "robots", "setting", "follower"], "log")
    lines[["value", "low", "high"]] = np.exp(lines[["value", "low", "high"]])
    return lines


def of_others(table: pd.DataFrame, weights: str = "copied", cures: str = "none") -> pd.DataFrame:
    """Return the ratios of the first follower's weights on all followers behind it."""
    ratios = copied_to_own(table, weights, cures)
    return ratios[ratios["follower"] > 1]


def as_good(ratios: pd.DataFrame) -> "pd.Series[bool]":
    """Return where errors are as those with one's own weights: within 1.1, no interval beyond
    1.25.
    """
    return (ratios["value"] <= CLOSE) & (ratios["high"] <= FAR)


def errors_in_line(table: pd.DataFrame, setting: str, cures: str = "none") -> pd.DataFrame:
    """Return RMS, bias and ripple of the distance in mm by robots, weights and follower, of one
    setting.
    """
    part = table[(table["setting"] == setting) & (table["cures"] == cures)]
    lines = []
    for whose, words in WHOSE.items():
        for follower in range(1, 5):
            of = part[(part["weights"] == whose) & (part["robot"] == follower)]
            for error in ("rms_distance_error_mm", "bias_mm", "ripple_mm"):
                line = by_condition(of, ["robots"], error)
                lines.append(line.assign(weights=words, follower=follower, error=error))
    return pd.concat(lines)


def losses_by_weights(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses by setting, cures and weights, summed over robots, seeds and followers."""
    lost = table.groupby(["setting", "cures", "weights"], sort=False)["losses"].sum().astype(int)
    return lost.unstack("weights")[list(WHOSE)].rename(columns=WHOSE)


def runs_with_losses(table: pd.DataFrame) -> pd.DataFrame:
    """Return in how many runs anybody was lost, by setting, cures and weights."""
    keys = ["setting", "cures", "weights"]
    runs = table.groupby([*keys, "robots", "seed"], sort=False)["losses"].sum() > 0
    counts = runs.groupby(keys, sort=False).sum()
    return counts.unstack("weights")[list(WHOSE)].rename(columns=WHOSE)


def each_run(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting, robots, cures, seed and follower behind the first: its error with
    the first's weights over that with its own (``ratio``), and whether either drive lost anybody.
    """
    keys = ["setting", "robots", "cures", "seed", "robot"]
    found = table.set_index(["weights", *keys])
    own, copied = (found.loc[whose] for whose in ("own", "copied"))
    ratio = copied["rms_distance_error_mm"] / own["rms_distance_error_mm"].loc[copied.index]
    lost = (copied["losses"] > 0) | (own["losses"].loc[copied.index] > 0)
    runs = pd.DataFrame({"ratio": ratio, "lost": lost}).reset_index()
    return runs[runs["robot"] > 1]


def copied_over_own(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw copied over own distance errors, a dot per run and follower, without and with cures."""
    runs = each_run(table)
    names = list(runs["setting"].unique())
    fig = Figure(figsize=(9.6, 4.8), layout="constrained")
    axes = fig.subplots(1, 2, sharex=True, sharey=True)
    chance = np.random.default_rng(0)
    for ax, (cures, words) in zip(axes, CURED.items(), strict=True):
        part = runs[runs["cures"] == cures]
        kinds = 2 * part["setting"].map(names.index) + (part["robots"] == "different")
        at = kinds + chance.uniform(-0.3, 0.3, len(part))
        for lost, colour, label in (
            (False, "#0072B2", "nobody lost"),
            (True, "#D55E00", "somebody lost"),
        ):
            of = part["lost"] == lost
            ax.scatter(part["ratio"][of], at[of], s=7, color=colour, label=label)
        ax.axvline(CLOSE, color="#777777", linewidth=0.8)
        ax.set(xscale="log", xlabel="RMS distance error, copied / own")
        ax.set_title(words, loc="left", fontsize=9)
        ax.set_xticks([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
        ax.minorticks_off()
    rows = [f"{name}, {robots}" for name in names for robots in ("alike", "different")]
    axes[0].set_yticks(range(len(rows)), rows)
    axes[0].set_ylim(len(rows) - 0.5, -0.5)
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    lines = [of_others(table, "copied", cures).assign(cures=cures) for cures in CURED]
    return fig, pd.concat(lines)


CURED = {"none": "greedy", "calm": "interpolated, with trim"}


def in_line(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw bias and ripple by place in line with the kinds of weights, paper's setting, robots that
    differ; without cures above, with them below.
    """
    fig = Figure(figsize=(9.6, 6.2), layout="constrained")
    axes = fig.subplots(2, 2, sharex=True)
    numbers = []
    for row, (cures, words) in zip(axes, CURED.items(), strict=True):
        places = errors_in_line(table, "paper", cures)
        numbers.append(places.assign(cures=cures))
        shown = places[places["robots"] == "different"]
        for ax, error in zip(row, ("bias_mm", "ripple_mm"), strict=True):
            label = f"{error.removesuffix('_mm')} (mm), {words}"
            part = shown[shown["error"] == error]
            curves(
                part,
                "follower",
                by="weights",
                xlabel="",
                ylabel=label,
                ax=ax,
                even=True,
                legend=False,
            )
            note(ax, "")
    for ax in axes[1]:
        ax.set_xlabel("simulated follower")
    handles = axes[0, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=3)
    return fig, pd.concat(numbers)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E7: nobody lost with poses; nobody with infrared; errors as with one's own weights."""
    plain = table[table["cures"] == "none"]
    copies = plain[plain["weights"] == "copied"]
    infrared = copies["setting"].str.contains("ir-")
    seeing, feeling = (int(copies["losses"][part].sum()) for part in (~infrared, infrared))
    counts = {
        (weights, cures): as_good(of_others(table, weights, cures))
        for weights in ("copied", "range")
        for cures in CURED
    }
    good = counts["copied", "none"]
    because = (
        f"copies lost a leader {seeing} times with absolute coordinates, {feeling} times with "
        f"infrared; errors as with own weights (mean ratio at most {CLOSE:g}, interval below "
        f"{FAR:g}) in {int(good.sum())} of {len(good)} cases; n = {STUDY.seeds} seeds each"
    )
    ours = (
        f"the same with interpolation and trim: {int(counts['copied', 'calm'].sum())} of "
        f"{len(good)}; learned at many speeds: {int(counts['range', 'none'].sum())}, with both "
        f"{int(counts['range', 'calm'].sum())}"
    )
    claim = (
        "It is sufficient to learn on the first follower and run a greedy policy on all other "
        "robots."
    )
    fails = "a copy that loses its leader with absolute coordinates; then with infrared, or errors"
    parts = (seeing == 0, feeling == 0, bool(good.all()))
    return Verdict("E7", claim, ruling(*parts), because, fails, ours)


ROWS = Rows(
    ("weights", "cures", "robot"),
    {
        (whose, cures, k): f"{whose}_{cures}_{{}}_{k}"
        for whose in WHOSE
        for cures in CURES
        for k in range(1, 5)
    },
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
