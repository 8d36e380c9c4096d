"""Is it better to learn with interpolated commands, or with speeds relative to the leader?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.output import ACTIONS, LEARN_BY
from workbench.lab.runs import learn
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import OTHER_TRACKS, Trial
from workbench.measures.comparisons import difference
from workbench.plots.comparisons import dot_panels
from workbench.studies.calm_trials import MAIN, OUTPUTS, judged, noisy

NAMES = {"paper": "9×9", "offset": "4 × 5×5", "recommended": "5×3"}
FILTERED = "2 mm, 2°, filtered"


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (
            {"setting": name, "learn_by": by, "actions": actions},
            replace(
                SETTINGS[name],
                drive="rolling",
                output="interpolated",
                trim=0.01,
                learn_by=by,
                actions=actions,
            ),
        )
        for name in NAMES
        for by in LEARN_BY
        for actions in ACTIONS
    ]


def measure_variants(trial: Trial) -> dict[str, float]:
    """Return losses while learning, and frozen drives: on a track of the same kind, with filtered
    noise, and on other kinds of track.
    """
    run = learn(trial.config, steps=trial.steps, progress=False)
    base = trial.unseen
    calm = replace(base, **OUTPUTS[MAIN])
    worlds = {
        "as learned": calm,
        FILTERED: replace(noisy(calm, "2 mm, 2°"), filter="alpha-beta"),
    } | {name: replace(calm, track=track) for name, track in OTHER_TRACKS.items()}
    found = {"learning_losses": float(run.summary["losses"])}
    for name, world in worlds.items():
        numbers = judged(run.policy, world, trial.minutes)
        found |= {f"{name}|{key}": value for key, value in numbers.items()}
    return found


PANELS = {
    "learning_losses": "losses while learning",
    "rms_distance_error_mm": "RMS distance error in mm",
    "turning": "turning above 1 Hz in °/s",
}


def as_learned(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per condition and seed: learning, and the drive on the kind of track that was
    learned on, with ``condition`` in words.
    """
    keys = ["setting", "learn_by", "actions", "seed"]
    whole = table[table["world"].isna()].set_index(keys)["learning_losses"]
    drive = table[table["world"] == "as learned"].drop(columns="learning_losses").set_index(keys)
    rows = drive.join(whole).reset_index()
    words = rows["setting"].map(NAMES) + ", " + rows["actions"] + ", by " + rows["learn_by"]
    return rows.assign(condition=words)


def losses_elsewhere(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses of all frozen drives by condition and world, over all seeds."""
    drives = table[table["world"].notna()]
    keys = ["setting", "learn_by", "actions"]
    sums = drives.groupby([*keys, "world"], sort=False)["losses"].sum().astype(int)
    return sums.unstack("world", sort=False)


def from_usual(table: pd.DataFrame, value: str) -> pd.DataFrame:
    """Return how far every variant is from wheel speeds learned by the table, per setting."""
    keys = ["setting", "learn_by", "actions"]
    usual = {"learn_by": "table", "actions": "wheels"}
    return difference(as_learned(table), keys, value, usual)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses while learning, errors and turning of every variant."""
    rows = as_learned(table)
    fig = dot_panels(rows, "condition", PANELS, size=(11.0, 4.4))
    for ax in fig.axes:
        ax.set_xlim(left=0)
    return fig, pd.concat([from_usual(table, value).assign(quantity=value) for value in PANELS])


WORLDS = ("as learned", FILTERED, *OTHER_TRACKS)
ROWS = Rows(("world",), {(name,): f"{name}|{{}}" for name in WORLDS})
STUDY = Study(
    "variants",
    __doc__,
    cases,
    function=measure_variants,
    steps=400_000,
    rows=ROWS,
    plots={"output_variants": plot},
)
