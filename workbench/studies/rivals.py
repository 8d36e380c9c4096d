"""What do other linear learners do in its place?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study, by_robot
from workbench.measures.comparisons import by_quantity, difference
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curve_panels, dots
from workbench.studies.conditions import with_learner
from workbench.studies.motion_trials import measure_rival
from workbench.studies.published import formation, per_robot

RIVALS = ("greedy-gq", "watkins-q", "expected-sarsa", "qrc", "true-online-sarsa")


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for setting, alphas in (("paper", (0.03, 0.1, 0.3)), ("offset", (0.1,))):
        base = replace(SETTINGS[setting], drive="rolling")
        for rule in RIVALS:
            for alpha in alphas:
                several = (
                    (0.01, 0.1, 1.0)
                    if rule == "greedy-gq" and alpha == 0.1
                    else (1.0 if rule == "qrc" else 0.01,)
                )
                for eta in several:
                    config = with_learner(base, rule=rule, alpha=alpha, eta=eta)
                    used = round(
                        config.learner.beta / alpha, 9
                    )  # rules without a correction have none
                    cases.append(
                        ({"setting": setting, "rule": rule, "eta": used, "alpha": alpha}, config)
                    )
    return cases


LEARNERS = {  # name → rule and η of the table
    "Greedy-GQ(λ), η 0.01": ("greedy-gq", 0.01),
    "Greedy-GQ(λ), η 0.1": ("greedy-gq", 0.1),
    "Greedy-GQ(λ), η 1": ("greedy-gq", 1.0),
    "QRC(λ)": ("qrc", 1.0),
    "Watkins' Q(λ)": ("watkins-q", 0.0),
    "Expected Sarsa(λ)": ("expected-sarsa", 0.0),
    "true online Sarsa(λ)": ("true-online-sarsa", 0.0),
}
REFERENCE = "Greedy-GQ(λ), η 0.01"
PANELS = {
    "learning_losses": "losses while learning",
    "following_rms_distance_error_mm": "frozen: RMS distance error in mm",
    "following_bearing_std_deg": "frozen: bearing spread in °",
}
MEASURES = PANELS | {
    "excess_1": "excess X (–)",
    "turn_rms_deg_s_1": "turning above 1 Hz, °/s",
}
LABELS = (
    "Δ losses while learning",
    "Δ mm RMS, frozen",
    "Δ bearing spread, °",
    "Δ excess X (–)",
    "Δ turning, °/s",
)
TUNING_SEEDS = 15  # on these a learner's step size is chosen, on the others it is judged


def trials(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per run, with the learner's name and the first follower's smoothness."""
    names = {pair: name for name, pair in LEARNERS.items()}
    found = formation(table)
    pairs = zip(found["rule"], found["eta"], strict=True)
    return found.assign(
        learner=[names[pair] for pair in pairs],
        excess_1=per_robot(table, "excess")[1],
        turn_rms_deg_s_1=per_robot(table, "turn_rms_deg_s")[1],
    )


def several_steps(table: pd.DataFrame) -> pd.DataFrame:
    """Return the ``trials`` on the paper's tiles of learners that ran with several step sizes."""
    runs = trials(table)
    once = ["Greedy-GQ(λ), η 0.1", "Greedy-GQ(λ), η 1"]
    return runs[(runs["setting"] == "paper") & ~runs["learner"].isin(once)]


def same_step(table: pd.DataFrame) -> pd.DataFrame:
    """Return the ``trials`` at α = 0.1, which every learner has."""
    runs = trials(table)
    return runs[runs["alpha"] == 0.1]


def from_reference(runs: pd.DataFrame) -> pd.DataFrame:
    """Return how far every learner is from the paper's, by setting and measure, paired by seed;
    ``relative`` and ``reach`` are mean and farther end of the interval over the reference's mean.
    """
    lines = []
    for setting, part in runs.groupby("setting", sort=False):
        for value in MEASURES:
            base = part[part["learner"] == REFERENCE][value].mean()
            effect = difference(part, ["learner"], value, {"learner": REFERENCE})
            effect = effect[effect["learner"] != REFERENCE].assign(setting=setting, measure=value)
            effect["relative"] = effect["value"] / base
            effect["reach"] = effect[["low", "high"]].abs().max(axis=1) / base
            lines.append(effect)
    return pd.concat(lines, ignore_index=True)


def tuned(table: pd.DataFrame) -> pd.DataFrame:
    """Return the runs of every learner with its best step size, chosen by losses while learning on
    the first half of the seeds; judged are the others. ``best`` is that step size.
    """
    lines = []
    for _, part in several_steps(table).groupby("learner", sort=False):
        tuning = part[part["seed"] <= TUNING_SEEDS].groupby("alpha")["learning_losses"].mean()
        best = float(tuning.idxmin())
        rest = part[(part["alpha"] == best) & (part["seed"] > TUNING_SEEDS)]
        lines.append(rest.assign(best=best))
    return pd.concat(lines)


def step_sizes(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors against the step size, learner by learner."""
    runs = several_steps(table)
    label = "step size α"
    size = (11.2, 4.2)
    fig = curve_panels(runs, "learner", "alpha", PANELS, xlabel=label, size=size, legends=())
    handles = fig.axes[0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=5, fontsize=8)
    return fig, by_quantity(runs, ["learner", "alpha"], PANELS)


def differences(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw how far every learner is from the paper's, by setting and measure."""
    runs = same_step(table)
    effects = from_reference(runs)
    fig = Figure(figsize=(12.6, 5.6), layout="constrained")
    grid = fig.subplots(2, 5, sharey="row")
    settings = {"paper": "paper's tiles", "offset": "offset tilings"}
    for line, (setting, words) in zip(grid, settings.items(), strict=True):
        for ax, value, name in zip(line, MEASURES, LABELS, strict=True):
            part = effects[(effects["setting"] == setting) & (effects["measure"] == value)]
            dots(part, "learner", xlabel=name, ax=ax, reference=0.0).set_title("", loc="left")
        line[0].set_ylabel(words)
    fig.suptitle(
        f"difference from {REFERENCE}, paired by seed; mean, 95 % interval, "
        f"n = {STUDY.seeds} seeds",
        fontsize=9,
    )
    return fig, by_quantity(runs, ["setting", "learner"], MEASURES)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide whether this learner is needed: whether all others do worse with their best α."""
    effects = from_reference(same_step(table))
    farthest = effects.assign(relative=effects["relative"].abs()).groupby("measure")
    reach = ", ".join(
        f"{name} {100 * farthest['relative'].max()[value]:.0f} % "
        f"({100 * farthest['reach'].max()[value]:.0f} %)"
        for value, name in MEASURES.items()
    )
    judged = tuned(table)
    worse = {}
    for value in ("learning_losses", "following_rms_distance_error_mm"):
        effect = difference(judged, ["learner"], value, {"learner": REFERENCE})
        worse[value] = set(effect[effect["low"] > 0]["learner"])
    rivals = set(judged["learner"]) - {REFERENCE}
    behind, less_precise = worse.values()
    runs = trials(table)
    failed = runs[runs["following_losses"] > 0]
    because = (
        f"at α = 0.1 no mean differs from {REFERENCE} by more than (in brackets: no interval "
        f"reaches beyond): {reach}; n = {STUDY.seeds}. At the best of three α {len(behind)} of "
        f"{len(rivals)} rivals lose clearly more and {len(less_precise)} are clearly less "
        f"precise in distance "
        f"(n = {STUDY.seeds - TUNING_SEEDS}). Frozen failures: {len(failed)} of {len(runs)} runs, "
        f"all of {', '.join(failed['learner'].unique())}. No clear rank; that is not proof of "
        "being equal."
    )
    claim = (
        "Greedy-GQ(λ) is needed: other linear learners do worse in its place. (Our reading; the "
        "paper compares with none.)"
    )
    needed = rivals <= behind or rivals <= less_precise
    fails = "a rival that neither loses clearly more nor is clearly less precise at its best α"
    return Verdict("rival learners", claim, ruling(needed), because, fails)


STUDY = Study(
    "rivals",
    __doc__,
    cases,
    minutes=10.0,
    seeds=30,
    function=measure_rival,
    rows=by_robot(0, 1, 2, 3, 4),
    plots={"rivals_step_size": step_sizes, "rivals_difference": differences},
    verdicts={"rival learners": verdict},
)
