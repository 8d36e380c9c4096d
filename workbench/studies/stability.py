"""Do robots stabilise from the first on (E4)?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.lab.statistics import paired
from workbench.lab.study import Case, Study, by_robot
from workbench.measures.comparisons import by_condition, criterion_times
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curves
from workbench.studies.motion_trials import measure_stability


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"setting": name}, replace(SETTINGS[name], drive="rolling"))
        for name in ("paper", "offset")
    ]


NAMES = {"paper": "paper's 9×9 tiles", "offset": "offset tilings, 4 × 5×5"}


def followers(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting, seed and follower."""
    rows = table[table["robot"].notna()].sort_values("robot", kind="stable")
    return rows.rename(columns={"robot": "follower"}).replace({"setting": NAMES})


def stable_times(table: pd.DataFrame) -> pd.DataFrame:
    """Return own updates before being stable by setting and follower; those that never were count
    with the whole run.
    """
    own = STUDY.steps / ConvoyConfig().followers
    return criterion_times(followers(table), ["setting", "follower"], "stable_updates", own)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw when followers are stable and how often they lose their leader, by place in line."""
    times = stable_times(table)
    keys = ["setting", "follower"]
    lost = by_condition(
        followers(table).rename(columns={"learning_losses": "losses"}), keys, "losses"
    )
    fig = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = fig.subplots(1, 2)
    label = "place in line"
    words = ("own updates before being stable", "losses while learning")
    curves(times, "follower", by="setting", xlabel=label, ylabel=words[0], ax=left, even=True)
    curves(lost, "follower", by="setting", xlabel=label, ylabel=words[1], ax=right, even=True)
    left.set_ylim(0, 1.25 * times["high"].max())
    return fig, pd.concat([times.assign(quantity="stable_updates"), lost.assign(quantity="losses")])


def rises(table: pd.DataFrame) -> tuple[list[bool], list[str]]:
    """Return, per setting, whether the last follower is stable later than the first, and whether
    losses grow down the line; and both in words.
    """
    own = STUDY.steps / ConvoyConfig().followers
    holds = []
    words = []
    for name, part in followers(table).groupby("setting", sort=False):
        stable, lost = (
            part.pivot(index="seed", columns="follower", values=value)
            for value in ("stable_updates", "learning_losses")
        )
        stable = stable.fillna(own)
        later = paired(stable[4], stable[1])
        more = paired(lost[4], lost[1])
        order = lost.mean().tolist()
        holds += [later[1] > 0, more[1] > 0 and order == sorted(order)]
        thousands = [number / 1000 for number in later]
        text = (
            "{}: follower 4 is stable {:.0f} [{:.0f}, {:.0f}] thousand own updates after follower 1"
        )
        words.append(
            text.format(name, *thousands)
            + ", and has {:.0f} [{:.0f}, {:.0f}] more losses".format(*more)
        )
    return holds, words


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide E4: later and with more losses at the end of the line, and in order in between."""
    holds, words = rises(table)
    between = {
        name: part["value"].tolist()
        for name, part in stable_times(table).groupby("setting", sort=False)
    }
    thousands = {name: [round(value / 1000) for value in of] for name, of in between.items()}
    ordered = {name: of == sorted(of) for name, of in thousands.items()}
    unresolved = [name for name, fine in ordered.items() if not fine]
    rest = (
        "; the order of the followers in between is not resolved with " + " and ".join(unresolved)
        if unresolved
        else ""
    )
    claim = (
        "The robots start to stabilize their behavior from the first follower towards the end of "
        "the line formation."
    )
    because = f"{'; '.join(words)}{rest}; n = {STUDY.seeds} seeds each."
    fails = (
        "a last follower that is stable no later, and loses no more, than the first with the "
        "paper's tiles; then the same with offset tilings, or the order in between"
    )
    first, *rest_of = (holds[k : k + 2] for k in range(0, len(holds), 2))
    others = [one for pair in rest_of for one in pair]
    parts = (all(first), *others, *ordered.values())
    return Verdict("E4", claim, ruling(*parts), because, fails)


STUDY = Study(
    "stability",
    __doc__,
    cases,
    seeds=30,
    function=measure_stability,
    steps=1_300_000,
    rows=by_robot(1, 2, 3, 4),
    plots={"stabilisation": plot},
    verdicts={"E4": verdict},
)
