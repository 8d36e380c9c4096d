"""Do weights from the simulation drive an emulated reality (E8, E9, E11)?"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from workbench import paths
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_condition, said
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.transfer import world_grid
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.conditions import travels
from workbench.studies.transfer_trials import (
    TRAININGS,
    Transfer,
    measure_transfer,
)
from workbench.studies.validation.tiles import in_the_right_tile


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for label, config, steps in travels():
        for training in TRAININGS:
            there = steps if training == "there" else steps // 10
            trial = Transfer(
                config=config, steps=steps, there_steps=there, minutes=30.0, training=training
            )
            cases.append((label | {"training": training}, trial))
    return cases


MOSTLY = 0.99  # share of time inside the bounds that counts as mostly inside: our choice
REAL = paths.DATA / "validation" / "tiles.csv"  # real readings beside the model's


def judged(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with three columns more: mostly_inside, degradation, commands.

    ``degradation`` is the RMS distance error over that of nominal weights of the same route, table
    and seed in the nominal simulation; ``commands`` says whether commands come in time in that
    world.
    """
    keys = ["route", "table", "seed"]
    nominal = table[table["training"] == "nominal"].set_index(keys)["nominal_rms_distance_error_mm"]
    own = nominal.loc[pd.MultiIndex.from_frame(table[keys])].to_numpy()
    return table.assign(
        mostly_inside=table["judged_share_inside"] >= MOSTLY,
        degradation=table["judged_rms_distance_error_mm"] / own,
        commands=np.where(table["delay"] == 0, "in time", "late"),
    )


def by_training(table: pd.DataFrame) -> pd.DataFrame:
    """Return one line per route, table, training and commands of a ``judged`` table, worlds as the
    unit.
    """
    groups = table.groupby(["route", "table", "commands", "training"], sort=False)
    return groups.agg(
        worlds=("seed", "size"),
        mostly_inside=("mostly_inside", "sum"),
        without_loss=("judged_losses", lambda lost: int((lost == 0).sum())),
        losses=("judged_losses", "sum"),
        share_inside=("judged_share_inside", "mean"),
        rms_mm=("judged_rms_distance_error_mm", "mean"),
        degradation=("degradation", "median"),
        worst_degradation=("degradation", "max"),
    ).astype({"losses": int})


def settled(table: pd.DataFrame) -> pd.DataFrame:
    """Return, per route, place and table that was learned in from nothing and seed: how that went,
    and how it follows there.

    Columns: minutes (to the first 250 s without any loss; a run that had none counts as its whole
    length, a lower bound), never (settled), losses (while learning), rms_mm and turning_deg_s (RMS
    above 1 Hz, driving back after losses included) of the drive afterwards, in the world that was
    learned in.
    """
    parts = []
    lengths = {}
    for label, trial in zip(*STUDY.trials([1]), strict=True):
        lengths[label["route"]] = trial.steps / trial.config.followers * CONTROL_PERIOD / 60
    for training, where, seen in (
        ("nominal", "simulated", "nominal"),
        ("there", "emulated", "judged"),
    ):
        part = table[table["training"] == training].assign(where=where)
        names = {
            "learning_minutes_to_lossfree": "minutes",
            "learning_losses": "losses",
            f"{seen}_rms_distance_error_mm": "rms_mm",
            f"{seen}_turn_rms_deg_s": "turning_deg_s",
        }
        parts.append(
            part.rename(columns=names)[["route", "where", "table", "seed", *names.values()]]
        )
    found = pd.concat(parts)
    whole = found["route"].map(lengths)
    return found.assign(never=found["minutes"].isna(), minutes=found["minutes"].fillna(whole))


def on_robot_against_simulation(table: pd.DataFrame, column: str, simulated: str) -> pd.DataFrame:
    """Return, per route and paired by seed, what 5×5/3×3 emulated has more of a ``settled`` column
    than a table simulated.
    """
    every = settled(table).set_index(["where", "table"])
    there, here = (
        every.loc[key].set_index(["route", "seed"])[column]
        for key in (("emulated", "5×5/3×3"), ("simulated", simulated))
    )
    difference = (there - here).rename("difference").reset_index()
    return by_condition(difference, ["route"], "difference")


def worlds(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw time inside and losses, world by world and training by training."""
    drives = judged(table)
    fig = Figure(figsize=(11.0, 8.4), layout="constrained")
    axes = fig.subplots(3, 2)
    groups = drives.groupby(["route", "table"], sort=False)
    for ax, (_, part) in zip(axes.flat, groups, strict=True):
        world_grid(part, ax)
    for ax in axes[:, 1]:
        ax.set_yticklabels([])
    for ax in axes[:2].flat:
        ax.set_xlabel("")
    label, ticks = "share of time inside the bounds", [0, 0.6, 0.8, 0.9, 1.0]
    fig.colorbar(axes[0, 0].images[0], ax=axes, label=label, shrink=0.6, ticks=ticks)
    return fig, drives


def learning_there(table: pd.DataFrame) -> Verdict:
    """Decide E11: learning on the robot takes longer and moves less smoothly, on every route."""
    asked = {
        "minutes longer than with the same table simulated": ("minutes", "5×5/3×3"),
        "minutes longer than with 9×9/7×7 simulated": ("minutes", "9×9/7×7"),
        "°/s more turning than with 9×9/7×7 simulated": ("turning_deg_s", "9×9/7×7"),
    }
    parts = []
    words = []
    for name, question in asked.items():
        lines = on_robot_against_simulation(table, *question)
        parts += [bool(low > 0) for low in lines["low"]]
        each = ", ".join(f"{line['route']} {said(line)}" for _, line in lines.iterrows())
        words.append(f"{name}: {each}")
    claim = (
        "On the robot, with 5×5/3×3, learning takes longer until it is stable and motion is less "
        "smooth than in simulation."
    )
    because = "5×5/3×3 emulated, paired by seed. " + "; ".join(words)
    fails = (
        "learning on the emulated robot that takes no clearly longer by the camera than the same "
        "table simulated; then any other route or measure"
    )
    return Verdict("E11", claim, ruling(*parts), because, fails)


def infrared_travels(table: pd.DataFrame) -> Verdict:
    """Decide E9: preprocessing helps real readings into the model's tiles, and nominal weights
    follow without losses, exactly, mostly inside; in time and late.
    """
    real = pd.read_csv(REAL)
    right = in_the_right_tile(real[real["run"] == "all"])
    shares = [
        f"{line['min']:.0%} to {line['max']:.0%} {', '.join(name)}"
        for name, line in right.iterrows()
    ]
    drives = judged(table)
    drives = drives[(drives["route"] != "camera") & (drives["training"] == "nominal")]
    filtered = right.loc[("median of 5 rows", "fitted"), "min"]
    parts = [bool(filtered > right.loc[("as recorded", "nominal"), "max"])]
    words = []
    for name, part in drives.groupby("commands"):
        free, exact = part["judged_losses"] == 0, part["degradation"] <= 1.5
        parts += [bool(free.all()), bool(exact.all()), bool(part["mostly_inside"].all())]
        words.append(
            f"commands {name}: {int(free.sum())} of {len(part)} without loss, "
            f"{int(exact.sum())} within 1.5 × nominal"
        )
    words.append("real rows in the model's tile: " + "; ".join(shares))
    claim = (
        "Better models or preprocessing of the proximity sensors make training in simulation "
        "possible for infrared too."
    )
    because = "emulated, nominal weights, both routes and tables. " + "; ".join(words)
    fails = (
        "preprocessed real readings that fall into the model's tiles no more often than the worst "
        "raw ones; then losses, errors above 1.5 × nominal or time outside, in time or late"
    )
    return Verdict("E9", claim, ruling(*parts), because, fails)


STUDY = Study(
    "transfer",
    __doc__,
    cases,
    function=measure_transfer,
    plots={"worlds": worlds},
    verdicts={"E9": infrared_travels, "E11": learning_there},
)
