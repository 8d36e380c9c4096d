"""Why does the last follower lose its leader most often while it learns (E4)?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from workbench.fields import choice, configuration
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.lab.study import Case, Study, by_robot
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_condition
from workbench.plots.comparisons import dots
from workbench.studies.conditions import BASE

WHO = ("all", "last")  # who learns


@configuration
class Order(Trial):
    """A trial in which all followers learn, or the last one alone behind others that have."""

    who: str = choice(WHO, "who learns", default="all")


def cases() -> Sequence[Case]:
    """Return the conditions."""
    track = BASE.track
    each = 100_000
    conditions = {
        "R 0.5 m": Order(config=BASE, steps=4 * each),
        "R 2 m": Order(config=replace(BASE, track=replace(track, radius_m=2.0)), steps=4 * each),
        "leader at 53 mm/s": Order(config=replace(BASE, leader_speed_mps=0.053), steps=4 * each),
        "one follower, R 0.414 m": Order(
            config=replace(BASE, followers=1, track=replace(track, radius_m=0.414)), steps=each
        ),
        "last one, others frozen": Order(config=BASE, steps=4 * each, who="last"),
    }
    return [({"condition": name}, trial) for name, trial in conditions.items()]


def measure_order(trial: Order) -> dict[str, float]:
    """Return the losses of every follower that learns, over the whole run."""
    config = trial.config
    convoy = Convoy(config, [config.seed], steps=trial.steps, threads=1)
    steps = convoy.whole()
    first = 0
    if trial.who == "last":
        table, _ = convoy.tables(0)
        table[-1] = config.learner.theta0 / config.tilings
        own = trial.steps // config.followers
        convoy = Convoy(config, [config.seed], steps=own, policy=table, threads=1)
        convoy.robots["learning"]["learns"][:, 1:-1] = 0
        steps = convoy.whole()
        first = config.followers - 1
    lost = np.count_nonzero(steps["event"][:, 1:] & LOSS, axis=0)
    return {f"losses_{k + 1}": float(lost[k]) for k in range(first, config.followers)}


def losses(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses while learning by condition and place in line, with intervals."""
    rows = table[table["robot"].notna()].rename(columns={"robot": "follower"})
    return by_condition(rows, ["condition", "follower"], "losses")


def excess(table: pd.DataFrame) -> pd.DataFrame:
    """Return how many more losses the last follower of every condition has than the first one with
    R 0.5 m, paired by seed.
    """
    rows = table[table["robot"].notna()]
    first = rows[(rows["condition"] == "R 0.5 m") & (rows["robot"] == 1)].set_index("seed")
    last = rows.sort_values("robot").groupby(["condition", "seed"], sort=False).tail(1)
    more = last["losses"].to_numpy() - first.loc[last["seed"], "losses"].to_numpy()
    return by_condition(last.assign(more=more), ["condition"], "more")


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses while learning by condition and place in line."""
    lines = losses(table)
    names = lines["condition"] + ": " + lines["follower"].map(lambda k: str(int(k)))
    fig = Figure(figsize=(7.0, 4.4), layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.15)  # inches: room for the longest name
    label = "losses of a follower (its place in line) in 100 000 updates"
    ax = dots(lines.assign(name=names), "name", xlabel=label, ax=fig.subplots())
    ax.set_xlim(left=0)
    return fig, lines


STUDY = Study(
    "order",
    __doc__,
    cases,
    function=measure_order,
    seeds=30,
    rows=by_robot(1, 2, 3, 4),
    plots={"learning_order": plot},
)
