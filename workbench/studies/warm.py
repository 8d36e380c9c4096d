"""When do weights of other robots or another task help, and when do they harm (E7)?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.arena.tracks import TrackConfig
from workbench.formation.body import BodyConfig
from workbench.lab.study import Case, Rows, Study
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import dot_panels, one_note
from workbench.studies.conditions import BASE, OTHER
from workbench.studies.transfer_trials import (
    LATER,
    measure_warm,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    tasks = {
        "other robots": replace(BASE, body=OTHER),
        "leader 20 % slower": replace(BASE, leader_speed_mps=0.048),
        "leader 20 % faster": replace(BASE, leader_speed_mps=0.072),
        "leader at half speed": replace(BASE, leader_speed_mps=0.03),
        "anticlockwise": replace(BASE, track=TrackConfig(direction="anticlockwise")),
        "figure eight": replace(BASE, track=TrackConfig(shape="eight")),
        "commands 0.2 s late": replace(BASE, body=BodyConfig(delay=2)),
    }
    return [({"task": name}, config) for name, config in tasks.items()]


SAVED = {
    "losses_saved": "losses saved",
    "updates_saved": "updates saved",
    "error_saved_mm": "distance error saved (mm)",
}


def pairs(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per task and seed: what a cold start takes and a warm one saves.

    A run that never was quiet counts with its whole length.
    """
    cold, warm = (table[table["start"] == s].reset_index(drop=True) for s in ("cold", "warm"))
    settled = [part["updates_to_quiet"].fillna(LATER) for part in (cold, warm)]
    return cold[["task", "seed"]].assign(
        cold_learning_losses=cold["learning_losses"],
        cold_settled=settled[0],
        warm_settled=settled[1],
        losses_saved=cold["learning_losses"] - warm["learning_losses"],
        updates_saved=settled[0] - settled[1],
        error_saved_mm=cold["rms_distance_error_mm"] - warm["rms_distance_error_mm"],
    )


def saved(table: pd.DataFrame) -> pd.DataFrame:
    """Return ``pairs`` by quantity and task, with intervals."""
    several = ["cold_learning_losses", "cold_settled", "warm_settled", *SAVED]
    return by_quantity(pairs(table), ["task"], several)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw what a warm start saves, task by task."""
    words = {value: f"{name}, simulated" for value, name in SAVED.items()}
    fig = dot_panels(pairs(table), "task", words, size=(9.6, 3.2), reference=0.0)
    one_note(fig.axes)
    return fig, saved(table)


ROWS = Rows(("start",), {("cold",): "cold_{}", ("warm",): "warm_{}"})
STUDY = Study(
    "warm",
    __doc__,
    cases,
    minutes=10.0,
    function=measure_warm,
    rows=ROWS,
    plots={"warm_starts": plot},
)
