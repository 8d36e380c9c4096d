"""Tables of weights that travel: what the studies "copies", "transfer", "delays" and "gap" say,
condition by condition.

Contract: functions take a study's table and return new ones; intervals are those of ``effects``,
seeds are the unit.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from workbench.formation.config import ConvoyConfig
from workbench.measures import comparisons as effects
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.realities import emulated_world
from workbench.studies.tables import STUDIES
from workbench.studies.transfer_trials import DELAYS, NOISE_FACTORS

MOSTLY = 0.99  # share of time inside the bounds that counts as mostly inside: our choice
WHOSE = {
    "own": "its own",
    "copied": "the first's",
    "last": "the last's",
    "shared": "learned together",
}  # weights
ERRORS = {"rms_distance_mm": "distance", "rms_bearing_deg": "bearing"}


def judging_worlds(config: ConvoyConfig, numbers: Iterable[int]) -> pd.DataFrame:
    """Return one line per judging world: what is different there."""
    lines = []
    for number in numbers:
        world = emulated_world(config, number, family="judging")
        body = world.body
        infrared = world.infrared
        camera = world.camera
        lines.append(
            {
                "world": number,
                "commands late (s)": body.delay / 10,
                "slip": body.slip,
                "missed readings": body.missed,
                "gain spread": infrared.gain_spread,
                "noise ×": infrared.noise,
                "ambient (counts)": infrared.ambient_counts,
                "picture": camera.conditions,
                "camera latency (s)": camera.latency_s,
                "markers missed": camera.dropout,
            }
        )
    return pd.DataFrame(lines).set_index("world")


def copied_to_own(copies: pd.DataFrame, weights: str) -> pd.DataFrame:
    """Return the geometric mean ratio of a follower's error with other weights to that with its
    own, per setting and follower.

    The arithmetic mean of ratios exceeds 1 where two policies are equally good and differ by
    chance; the geometric one does not.

    Args:
        copies: the study "copies".
        weights: "copied" (the first follower's), "last" (the last one's) or "shared".
    """
    parts = []
    for error, words in ERRORS.items():
        for follower in range(1, 5):
            ratio = np.log(
                copies[f"{weights}_{error}_{follower}"] / copies[f"own_{error}_{follower}"]
            )
            parts.append(
                copies[["setting", "robots", "seed"]].assign(
                    error=words, follower=follower, log=ratio
                )
            )
    lines = effects.by_condition(
        pd.concat(parts), ["error", "robots", "setting", "follower"], "log"
    )
    lines[["value", "low", "high"]] = np.exp(lines[["value", "low", "high"]])
    return lines


def errors_in_line(copies: pd.DataFrame, setting: str) -> pd.DataFrame:
    """Return the RMS distance error in mm by robots, weights and follower, of one setting of the
    study "copies".
    """
    part = copies[copies["setting"] == setting]
    lines = []
    for kind, words in WHOSE.items():
        for follower in range(1, 5):
            line = effects.by_condition(part, ["robots"], f"{kind}_rms_distance_mm_{follower}")
            lines.append(line.assign(weights=words, follower=follower))
    return pd.concat(lines)


def losses_by_weights(copies: pd.DataFrame) -> pd.DataFrame:
    """Return greedy losses by setting and weights, summed over robots, seeds and followers."""
    groups = copies.groupby("setting", sort=False)
    lost = {}
    for kind, words in WHOSE.items():
        lost[words] = (
            groups[[f"{kind}_losses_{follower}" for follower in range(1, 5)]]
            .sum()
            .sum(axis=1)
            .astype(int)
        )
    return pd.DataFrame(lost)


def judged(transfer: pd.DataFrame) -> pd.DataFrame:
    """Return the study "transfer" with three columns more: mostly_inside, degradation, commands.

    ``degradation`` is the RMS distance error over that of nominal weights of the same route, table
    and seed in the nominal simulation; ``commands`` says whether commands come in time in that
    world.
    """
    keys = ["route", "table", "seed"]
    nominal = transfer[transfer["training"] == "nominal"].set_index(keys)["nominal_rms_distance_mm"]
    own = nominal.loc[pd.MultiIndex.from_frame(transfer[keys])].to_numpy()
    return transfer.assign(
        mostly_inside=transfer["judged_share_inside"] >= MOSTLY,
        degradation=transfer["judged_rms_distance_mm"] / own,
        commands=np.where(transfer["delay"] == 0, "in time", "late"),
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
        rms_mm=("judged_rms_distance_mm", "mean"),
        degradation=("degradation", "median"),
        worst_degradation=("degradation", "max"),
    ).astype({"losses": int})


def by_delay(delays: pd.DataFrame) -> pd.DataFrame:
    """Return share_inside and degradation by how late (s) commands come, per case (route and
    table).
    """
    parts = []
    for k in DELAYS:
        error = delays[f"delay_{k}_rms_distance_mm"] / delays["nominal_rms_distance_mm"]
        case = delays["route"] + ", " + delays["table"]
        columns = {
            "late": k / 10,
            "case": case,
            "share_inside": delays[f"delay_{k}_share_inside"],
            "degradation": error,
        }
        parts.append(
            effects.by_quantity(
                delays.assign(**columns), ["case", "late"], ["share_inside", "degradation"]
            )
        )
    return pd.concat(parts)


def losses_by_delay(delays: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all worlds, worlds without any, and the worst degradation, by how late
    commands come.
    """
    lines = []
    for k in DELAYS:
        error = delays[f"delay_{k}_rms_distance_mm"] / delays["nominal_rms_distance_mm"]
        lines.append(
            delays[["route", "table"]].assign(
                late=k / 10, losses=delays[f"delay_{k}_losses"], degradation=error
            )
        )
    return _lost(pd.concat(lines).groupby(["route", "table", "late"], sort=False))


def losses_by_noise(gap: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all seeds by the factor on the noise, per route and training."""
    columns = {f"× {factor}": gap[f"losses_noise_{factor}"] for factor in NOISE_FACTORS}
    return (
        gap[["route", "training"]]
        .assign(**columns)
        .groupby(["route", "training"], sort=False)
        .sum()
        .astype(int)
    )


def _lost(groups: Any) -> pd.DataFrame:
    return groups.agg(
        losses=("losses", lambda lost: int(lost.sum())),
        without_loss=("losses", lambda lost: int((lost == 0).sum())),
        worst_degradation=("degradation", "max"),
    )


def by_noise(gap: pd.DataFrame) -> pd.DataFrame:
    """Return share_inside and rms_distance_mm by the factor on the noise, per case (route and
    training).
    """
    parts = []
    for factor in NOISE_FACTORS:
        columns = {
            name: gap[f"{name}_noise_{factor}"] for name in ("share_inside", "rms_distance_mm")
        }
        part = gap.assign(noise=factor, case=gap["route"] + ", " + gap["training"], **columns)
        parts.append(effects.by_quantity(part, ["case", "noise"], list(columns)))
    return pd.concat(parts)


def settled(transfer: pd.DataFrame) -> pd.DataFrame:
    """Return, per route, place and table that was learned in from nothing and seed: how that went,
    and how it follows there.

    Columns: minutes (to the first 250 s without any loss; a run that had none counts as its whole
    length, a lower bound), never (settled), losses (while learning), rms_mm and turning_deg_s (RMS
    above 1 Hz, driving back after losses included) of the drive afterwards, in the world that was
    learned in.
    """
    parts = []
    lengths = {}
    for label, trial in zip(*STUDIES["transfer"].trials([1]), strict=True):
        lengths[label["route"]] = trial.steps / trial.config.followers * CONTROL_PERIOD / 60
    for training, where, seen in (
        ("nominal", "simulated", "nominal"),
        ("there", "emulated", "judged"),
    ):
        part = transfer[transfer["training"] == training].assign(where=where)
        names = {
            "learning_minutes_to_lossfree": "minutes",
            "learning_losses": "losses",
            f"{seen}_rms_distance_mm": "rms_mm",
            f"{seen}_turn_rms_deg_s": "turning_deg_s",
        }
        parts.append(
            part.rename(columns=names)[["route", "where", "table", "seed", *names.values()]]
        )
    table = pd.concat(parts)
    whole = table["route"].map(lengths)
    return table.assign(never=table["minutes"].isna(), minutes=table["minutes"].fillna(whole))


def on_robot_against_simulation(
    transfer: pd.DataFrame, column: str, simulated: str
) -> pd.DataFrame:
    """Return, per route and paired by seed, what 5×5/3×3 emulated has more of a ``settled`` column
    than a table simulated.
    """
    every = settled(transfer).set_index(["where", "table"])
    there, here = (
        every.loc[key].set_index(["route", "seed"])[column]
        for key in (("emulated", "5×5/3×3"), ("simulated", simulated))
    )
    difference = (there - here).rename("difference").reset_index()
    return effects.by_condition(difference, ["route"], "difference")


def in_the_right_tile(tiles: pd.DataFrame) -> pd.DataFrame:
    """Return how many of the rows that the model sees inside the bounds lie in its tile, by
    readings and model.

    Args:
        tiles: lines of data/validation/tiles.csv; the shares of their routes and tables are summed
            up as lowest and highest.
    """
    share = tiles["share_same_tile"] * tiles["both_inside"] / tiles["model_inside"]
    return share.groupby([tiles["readings"], tiles["model"]]).agg(["min", "max"])
