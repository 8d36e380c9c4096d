"""Tables of weights that travel: what the studies "copies", "transfer", "delays" and "gap" say, condition by condition.

Contract: functions take a study's table and return new ones; intervals are those of ``effects``, seeds are the unit.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from workbench.formation.config import ConvoyConfig
from workbench.study import effects
from workbench.study.transfer_trials import DELAYS, NOISE_FACTORS
from workbench.study.worlds import emulated_world

KEPT = 0.99  # share of time inside the bounds from which on a policy is said to keep its leader: our choice
ERRORS = {"rms_distance_mm": "distance", "rms_bearing_deg": "bearing"}


def judging_worlds(config: ConvoyConfig, numbers: Iterable[int]) -> pd.DataFrame:
    """Return one line per judging world: what is different there."""
    lines = []
    for number in numbers:
        world = emulated_world(config, number, family="judging")
        body, infrared, camera = world.body, world.infrared, world.camera
        lines.append(
            {
                "world": number, "commands late (s)": body.delay / 10, "slip": body.slip, "missed readings": body.missed,
                "gain spread": infrared.gain_spread, "noise ×": infrared.noise, "ambient (counts)": infrared.ambient_counts,
                "picture": camera.conditions, "camera latency (s)": camera.latency_s, "markers missed": camera.dropout,
            }
        )  # fmt: skip
    return pd.DataFrame(lines).set_index("world")


def copied_to_own(copies: pd.DataFrame, weights: str) -> pd.DataFrame:
    """Return the geometric mean ratio of a follower's error with other weights to that with its own, per setting and follower.

    The arithmetic mean of ratios exceeds 1 where two policies are equally good and differ by chance; the geometric one does not.

    Args:
        copies: the study "copies".
        weights: "copied" (the first follower's), "last" (the last one's) or "shared".
    """
    parts = []
    for error, words in ERRORS.items():
        for follower in range(1, 5):
            ratio = np.log(copies[f"{weights}_{error}_{follower}"] / copies[f"own_{error}_{follower}"])
            parts.append(copies[["setting", "robots", "seed"]].assign(error=words, follower=follower, log=ratio))
    lines = effects.by_condition(pd.concat(parts), ["error", "robots", "setting", "follower"], "log")
    lines[["value", "low", "high"]] = np.exp(lines[["value", "low", "high"]])
    return lines


def judged(transfer: pd.DataFrame) -> pd.DataFrame:
    """Return the study "transfer" with three columns more: kept, degradation, commands.

    ``degradation`` is the RMS distance error over that of nominal weights of the same route, table and seed in the nominal
    simulation; ``commands`` says whether commands come in time in that world.
    """
    keys = ["route", "table", "seed"]
    nominal = transfer[transfer["training"] == "nominal"].set_index(keys)["nominal_rms_distance_mm"]
    own = nominal.loc[pd.MultiIndex.from_frame(transfer[keys])].to_numpy()
    return transfer.assign(
        kept=transfer["judged_share_inside"] >= KEPT, degradation=transfer["judged_rms_distance_mm"] / own,
        commands=np.where(transfer["delay"] == 0, "in time", "late"),
    )  # fmt: skip


def by_training(table: pd.DataFrame) -> pd.DataFrame:
    """Return one line per route, table, training and commands of a ``judged`` table, worlds as the unit."""
    groups = table.groupby(["route", "table", "commands", "training"], sort=False)
    return groups.agg(
        worlds=("seed", "size"), without_loss=("judged_losses", lambda lost: int((lost == 0).sum())), kept=("kept", "sum"),
        losses=("judged_losses", "sum"), share_inside=("judged_share_inside", "mean"), rms_mm=("judged_rms_distance_mm", "mean"),
        degradation=("degradation", "median"), worst_degradation=("degradation", "max"),
    ).astype({"losses": int})  # fmt: skip


def by_delay(delays: pd.DataFrame) -> pd.DataFrame:
    """Return share_inside and degradation by how late (s) commands come, per case (route and table)."""
    parts = []
    for k in DELAYS:
        error = delays[f"delay_{k}_rms_distance_mm"] / delays["nominal_rms_distance_mm"]
        case = delays["route"] + ", " + delays["table"]
        columns = {"late": k / 10, "case": case, "share_inside": delays[f"delay_{k}_share_inside"], "degradation": error}
        parts.append(effects.by_quantity(delays.assign(**columns), ["case", "late"], ["share_inside", "degradation"]))
    return pd.concat(parts)


def losses_by_delay(delays: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all worlds, and worlds without any, by how late commands come, per route and table."""
    groups, columns = delays.groupby(["route", "table"], sort=False), {}
    for k in DELAYS:
        columns[f"{k / 10} s"] = groups[f"delay_{k}_losses"].sum().astype(int)
    for k in DELAYS:
        columns[f"{k / 10} s, free"] = groups[f"delay_{k}_losses"].agg(lambda lost: int((lost == 0).sum()))
    return pd.DataFrame(columns)


def by_noise(gap: pd.DataFrame) -> pd.DataFrame:
    """Return share_inside and rms_distance_mm by the factor on the noise, per case (route and training)."""
    parts = []
    for factor in NOISE_FACTORS:
        columns = {name: gap[f"{name}_noise_{factor}"] for name in ("share_inside", "rms_distance_mm")}
        part = gap.assign(noise=factor, case=gap["route"] + ", " + gap["training"], **columns)
        parts.append(effects.by_quantity(part, ["case", "noise"], list(columns)))
    return pd.concat(parts)


def settled(transfer: pd.DataFrame) -> pd.DataFrame:
    """Return, per route, place and table that was learned in from nothing and seed: how that went, and how it follows there.

    Columns: minutes (to the first 250 s without any loss, NaN if never), losses (while learning), rms_mm and turning_deg_s (RMS
    above 1 Hz) of the greedy drive afterwards, in the world that was learned in.
    """
    parts = []
    for training, where, seen in (("nominal", "simulated", "nominal"), ("there", "emulated", "judged")):
        part = transfer[transfer["training"] == training].assign(where=where)
        names = {
            "learning_minutes_to_lossfree": "minutes", "learning_losses": "losses", f"{seen}_rms_distance_mm": "rms_mm",
            f"{seen}_turn_rms_deg_s": "turning_deg_s",
        }  # fmt: skip
        parts.append(part.rename(columns=names)[["route", "where", "table", "seed", *names.values()]])
    return pd.concat(parts)


def on_robot_against_simulation(transfer: pd.DataFrame, column: str, simulated: str) -> pd.DataFrame:
    """Return, per route and paired by seed, what 5×5/3×3 emulated has more of a ``settled`` column than a table simulated."""
    every = settled(transfer).set_index(["where", "table"])
    there, here = (
        every.loc[key].set_index(["route", "seed"])[column] for key in (("emulated", "5×5/3×3"), ("simulated", simulated))
    )
    difference = (there - here).dropna().rename("difference").reset_index()
    return effects.by_condition(difference, ["route"], "difference")
