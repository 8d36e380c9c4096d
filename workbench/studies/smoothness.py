"""Is the path a smoothed variant, more so with learning (E5, E6)?"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.lab.statistics import interval, paired
from workbench.lab.study import Case, Study, by_robot
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_condition
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curves
from workbench.studies.conditions import HORIZON
from workbench.studies.motion_trials import measure_motion
from workbench.studies.published import formation, load_study, per_robot


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for name in ("paper", "offset"):
        for updates in (0, 1_000, 10_000, 100_000, HORIZON):
            config = replace(SETTINGS[name], drive="rolling")
            trial = Trial(config=config, steps=updates, horizon=HORIZON, minutes=20.0)
            cases.append(({"setting": name, "updates": updates}, trial))
    return cases


NAMES = {"paper": "paper's 9×9 tiles", "offset": "offset tilings, 4 × 5×5"}
PATH = {
    "ratio": "judder J₁ / J₀",
    "excess_1": "excess X over the tractrix",
    "coherence_1": "coherence γ²",
}
CHATTER = {
    "turn_rms_deg_s": "turning above 1 Hz, °/s RMS",
    "ldlj_vector": "LDLJ of velocity (higher: smoother)",
    "switches_per_m": "switches per metre",
}
STOPS = ["0", "1 k", "10 k", "100 k", "1 M"]  # updates after which was measured
ROBOTS = range(5)
FOLLOWERS = [1, 2, 3, 4]


def first_follower(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting, updates and seed: the formation's numbers, and the first follower's
    judder over the leader's (``ratio``), excess and coherence.
    """
    judder = per_robot(table, "judder_mm")
    return (
        formation(table)
        .replace({"setting": NAMES})
        .assign(
            ratio=judder[1] / judder[0],
            excess_1=per_robot(table, "excess")[1],
            coherence_1=per_robot(table, "coherence")[1],
        )
    )


def at_the_end(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return, by setting, the table's rows after all updates."""
    last = table[table["updates"] == HORIZON].replace({"setting": NAMES})
    return {name: last[last["setting"] == name] for name in NAMES.values()}


def over_followers(table: pd.DataFrame, value: str) -> pd.Series:
    """Return the mean of a column over the followers, a number per run."""
    mean: pd.Series = per_robot(table, value)[FOLLOWERS].mean(axis=1)
    return mean


def path(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw how the first follower's path gets smoother with learning."""
    runs = first_follower(table)
    fig = Figure(figsize=(11.4, 4.4), layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.12)  # inches: room for the axes' words
    parts = []
    for ax, (value, words) in zip(fig.subplots(1, 3), PATH.items(), strict=True):
        summary = by_condition(runs, ["setting", "updates"], value)
        label, log = "learning updates", value != "coherence_1"
        curves(
            summary,
            "updates",
            by="setting",
            xlabel=label,
            ylabel=words,
            ax=ax,
            even=True,
            log=log,
            legend=False,
        )
        ax.axhline(1.0, color="#777777", linestyle=":", linewidth=0.9)
        ax.set_xticks(range(5), ["none", *STOPS[1:]])
        parts.append(summary.assign(quantity=value))
    handles = fig.axes[0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=2)
    return fig, pd.concat(parts)


def down_the_line(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw judder by place in line after learning, beside rods that pull each other (from the study
    "controllers").
    """
    rods = load_study("controllers").query("controller == 'tractrix'")
    cases = at_the_end(table) | {"pulled rods (no robots)": rods}
    rows = []
    for name, part in cases.items():
        judder = per_robot(part, "judder_mm")
        rows += [(name, k, *interval(judder[k]), len(judder)) for k in ROBOTS]
    line = pd.DataFrame(rows, columns=["setting", "robot", "value", "low", "high", "seeds"])
    fig = Figure(figsize=(5.4, 3.6), layout="constrained")
    ax = fig.add_subplot()
    label, words = "place in line (0: leader)", "judder J in mm"
    curves(line, "robot", by="setting", xlabel=label, ylabel=words, ax=ax, even=True, log=True)
    return fig, line


def chatter(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw how restlessly followers move, frozen and while learning."""
    rows = []
    named = table.replace({"setting": NAMES})
    groups = list(named.groupby(["setting", "updates"], sort=False))
    for prefix, when in (("", "frozen"), ("learning_", "while learning")):
        for (name, updates), part in groups:
            for value in CHATTER:
                numbers = over_followers(part, prefix + value).dropna()
                if len(numbers):
                    case = f"{name}, {when}"
                    rows.append((value, case, updates, *interval(numbers), len(numbers)))
    columns = ["quantity", "case", "updates", "value", "low", "high", "seeds"]
    lines = pd.DataFrame(rows, columns=columns)
    stops = sorted(lines["updates"].unique())
    fig = Figure(figsize=(10.4, 7.2), layout="constrained")
    axes = fig.subplots(2, 3, sharex=True, sharey="col")
    for row, when in zip(axes, ("while learning", "frozen"), strict=True):
        part = lines[lines["case"].str.endswith(when)]
        part = part.assign(setting=part["case"].str.removesuffix(f", {when}"))
        for ax, (value, words) in zip(row, CHATTER.items(), strict=True):
            of = part[part["quantity"] == value]
            one: dict[str, Any] = {"ax": ax, "even": False, "legend": False}
            places = of.assign(updates=of["updates"].map(stops.index))
            curves(places, "updates", by="setting", xlabel="", ylabel=words, **one)
            if value != "switches_per_m":
                calm = per_robot(table, value)[0].mean()
                ax.axhline(
                    calm,
                    color="#777777",
                    linestyle=(0, (8, 3)),
                    linewidth=1.2,
                    label="the leader's",
                )
            ax.set_xticks(range(5), STOPS)
            ax.set_title(when, loc="left", fontsize=9)
    for ax in axes[1]:
        ax.set_xlabel("learning updates")
    axes[0, 1].set_ylim(-22, -12)
    handles = axes[1, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=3, title="mean, 95 % interval, 10 seeds")
    return fig, lines


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"


def smoothed_path(table: pd.DataFrame) -> Verdict:
    """Decide E6: smoother than the leader, smoother with learning, smoother than a pulled rod."""
    runs = first_follower(table)
    first, last = (runs[runs["updates"] == updates] for updates in (0, HORIZON))
    numbers = []
    drops = []
    smooth, improved, merit = [], [], []
    for name in NAMES.values():
        end = last[last["setting"] == name]
        ratio, above = interval(end["ratio"]), interval(end["excess_1"])
        change = paired(end["excess_1"], first[first["setting"] == name]["excess_1"])
        smooth.append(ratio[2] < 1)
        merit.append(above[2] < 1)
        improved.append(change[2] < 0)
        text = "{}: J₁/J₀ {:.3f} [{:.3f}, {:.3f}], X₁ {:.2f} [{:.2f}, {:.2f}]"
        numbers.append(text.format(name, *ratio, *above))
        drops.append("{} {:.1f} [{:.1f}, {:.1f}]".format(name, *change))
    parts = (bool(all(smooth)), bool(all(improved)), bool(any(merit)))
    because = (
        f"smoother than the leader's: {_yes(parts[0])}; than untrained: {_yes(parts[1])}; than a "
        f"pulled rod (X < 1): {_yes(parts[2])}, so that the smoothing is "
        f"{'learned' if parts[2] else 'that of geometry'}. {'; '.join(numbers)}; change of X₁ from "
        f"0 to 1 000 000 updates: {'; '.join(drops)}; n = {STUDY.seeds} seeds each."
    )
    claim = (
        "The path of the followers is a smoothed variant of the leader's, and learning improves it "
        "online."
    )
    fails = (
        "a first follower whose path is not clearly smoother than the leader's; then one that "
        "learning does not improve, or that is no smoother than a pulled rod's"
    )
    return Verdict("E6", claim, ruling(*parts), because, fails)


def smooth_motion(table: pd.DataFrame) -> Verdict:
    """Decide E5: turning and jerk fall from learning to frozen, and turning stays restless."""
    early = table[table["updates"] == 1000].replace({"setting": NAMES})
    leader = per_robot(table, "turn_rms_deg_s")[0].mean()
    calmer, calmer_jerk, quiet, cases = [], [], [], []
    for name, end in at_the_end(table).items():
        start = early[early["setting"] == name]
        during = over_followers(start, "learning_turn_rms_deg_s")
        after = over_followers(end, "turn_rms_deg_s")
        change = paired(after, during)
        before = over_followers(start, "learning_ldlj_vector")
        jerk = paired(over_followers(end, "ldlj_vector"), before)
        calmer.append(change[2] < 0)
        calmer_jerk.append(jerk[1] > 0)
        quiet.append(after.mean() < 1.5 * leader)
        text = "{}: {:.0f} → {:.0f} °/s, change {:.0f} [{:.0f}, {:.0f}]"
        cases.append(
            text.format(name, during.mean(), after.mean(), *change)
            + ", jerk (LDLJ) {:.1f} [{:.1f}, {:.1f}]".format(*jerk)
        )
    parts = (bool(all(calmer)), not all(quiet), bool(all(calmer_jerk)))
    because = (
        f"turning above 1 Hz falls: {_yes(parts[0])}; stays above 1.5 times the leader's "
        f"{leader:.0f} °/s: {_yes(parts[1])}; jerk falls (LDLJ rises): {_yes(parts[2])}. While "
        f"learning, to 1 000 updates → frozen, after 1 000 000: {'; '.join(cases)}; "
        f"n = {STUDY.seeds} seeds each."
    )
    claim = (
        "A very juddering movement during the learning phase, which only smooths to a certain "
        "degree after convergence."
    )
    fails = (
        "turning that does not clearly fall from learning to frozen; then motion that gets as calm "
        "as the leader's, or jerk that does not fall"
    )
    return Verdict("E5", claim, ruling(*parts), because, fails)


def without_collisions(table: pd.DataFrame) -> Verdict:
    """Decide M3: no two robots touched in any frozen drive after 10 000 updates or more."""
    runs = formation(table)
    trained = runs[runs["updates"] >= 10_000]
    hours = len(trained) * 20 / 60
    touched = int(trained["following_collisions"].sum())
    gap = trained["following_smallest_gap_mm"].min()
    before = runs["following_collisions"].sum() + runs["learning_collisions"].sum() - touched
    seeds, settings, stops = (trained[name].nunique() for name in ("seed", "setting", "updates"))
    because = (
        f"{touched} in {hours:.0f} h ({seeds} seeds × {settings} settings × {stops} stops), below "
        f"{3 / hours:.2f}/h if hours are independent and there are none (95 %); smallest gap "
        f"{gap:.0f} mm. Before and while learning: {before:.0f}; bounds (80 mm between centres) "
        "and reset keep robots apart, too. Looked for once per 0.1 s; four followers."
    )
    claim = "Up to four followers drive without collisions after learning."
    fails = "two robots that touch in any frozen drive after 10 000 updates"
    return Verdict("M3", claim, ruling(touched == 0), because, fails)


STUDY = Study(
    "smoothness",
    __doc__,
    cases,
    function=measure_motion,
    rows=by_robot(0, 1, 2, 3, 4),
    plots={
        "smoothness_online": path,
        "judder_down_the_line": down_the_line,
        "motion_chatter": chatter,
    },
    verdicts={"E5": smooth_motion, "E6": smoothed_path, "M3": without_collisions},
)
