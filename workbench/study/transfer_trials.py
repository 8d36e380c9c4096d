"""Trials of weights that travel: from robot to robot, and from the nominal simulation into emulated realities.

Everything is judged by true poses. Lengths in mm, angles in degrees; names that end in a number belong to that follower. A
quantity that does not exist is NaN.

>>> trial = Transfer(config=ConvoyConfig(drive="planar", followers=1), steps=2000, minutes=1.0, training="nominal")
>>> sorted(name for name in measure_transfer(trial) if name.startswith("nominal"))
['nominal_losses', 'nominal_rms_bearing_deg', 'nominal_rms_distance_mm', 'nominal_share_inside']
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workbench.fields import choice, configuration, integer
from workbench.formation.body import BodyConfig
from workbench.formation.config import INFRARED, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.policy import Policy
from workbench.formation.reset import FOLLOW
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.study.infrared_trials import true_errors, within
from workbench.study.trials import UNSEEN, Trial
from workbench.study.worlds import emulated_world

TRAININGS = ("nominal", "delay matched", "randomised", "there", "nominal, then there")
RANDOM_WORLDS = 10  # tuning worlds that randomised training goes through, one after the other
EARLY = 5_000  # updates over which a warm start is compared with a cold one
NOISE_FACTORS = (0, 1, 2, 3, 4, 5)
OTHER_BODY = BodyConfig(wheel_spread=0.02, axle_spread=0.02)


@configuration
class Transfer(Trial):
    """A trial whose weights are learned in one world and judged in another; the judging world's number is the seed."""

    training: str = choice(TRAININGS, "where the weights are learned", default="nominal")
    there_steps: int = integer(0, 10**9, "", "learning updates in the judging world, of trainings that have some", default=20_000)


def measure_transfer(trial: Transfer) -> dict[str, float]:
    """Return how a policy follows greedily in its judging world and in the nominal one, and what learning there took."""
    config, seed = trial.config, trial.config.seed
    there = emulated_world(config, seed, family="judging")
    theta, numbers = None, {"delay": float(there.body.delay), "losses_there": math.nan}
    if trial.training == "randomised":
        for k in range(RANDOM_WORLDS):
            world = emulated_world(config, RANDOM_WORLDS * seed + k, family="tuning")
            theta, _ = _learned(world.with_seed(seed + 100 * k), trial.steps // RANDOM_WORLDS, theta)
    elif trial.training != "there":
        known = BodyConfig(delay=there.body.delay) if trial.training == "delay matched" else BodyConfig()
        theta, _ = _learned(replace(config, body=known), trial.steps, None)
    if trial.training.endswith("there"):
        theta, losses = _learned(there, trial.there_steps, theta)
        numbers["losses_there"] = float(losses)
    assert theta is not None
    unseen = seed + UNSEEN
    for name, world in (("judged", there), ("nominal", config)):
        steps = _followed(world.with_seed(unseen), theta, trial)
        numbers |= {f"{name}_{key}": value for key, value in _errors(world, steps, slice(None)).items()}
    return numbers


def measure_copies(trial: Trial) -> dict[str, float]:
    """Return each follower's errors with its own weights and with a copy of the first one's, on robots that are not alike."""
    theta, _ = _learned(trial.config, trial.steps, None)
    judged = trial.config.with_seed(trial.config.seed + UNSEEN)
    bodies = replace(judged, body=OTHER_BODY)
    result: dict[str, float] = {}
    for name, config, table in (("own", judged, theta), ("copied", judged, theta[:1]), ("copied_elsewhere", bodies, theta[:1])):
        steps = _followed(config, table, trial)
        for follower in range(config.followers):
            numbers = _errors(config, steps, slice(follower, follower + 1))
            result |= {f"{name}_{key}_{follower + 1}": value for key, value in numbers.items()}
    return result


def measure_gap(trial: Trial) -> dict[str, float]:
    """Return how a policy that learned with noise × 1 follows with noise × 0 to × 5: of infrared, or white on true errors."""
    config = trial.config
    theta, _ = _learned(config, trial.steps, None)
    result: dict[str, float] = {}
    for factor in NOISE_FACTORS:
        noisy = with_noise(config, factor).with_seed(config.seed + UNSEEN)
        errors = _errors(noisy, _followed(noisy, theta, trial), slice(None))
        result |= {f"{key}_noise_{factor}": value for key, value in errors.items()}
    return result


def with_noise(config: ConvoyConfig, factor: float) -> ConvoyConfig:
    """Return a configuration whose sensors are a factor times as noisy as it says."""
    if config.sensing in INFRARED:
        return replace(config, infrared=replace(config.infrared, noise=factor * config.infrared.noise))
    return replace(config, noise_distance_m=factor * config.noise_distance_m, noise_bearing_rad=factor * config.noise_bearing_rad)


def measure_warm(trial: Trial) -> dict[str, float]:
    """Return losses and errors of the first updates with weights that were learned on the nominal task, and without.

    ``trial.config`` is the new task; the old one is the same but for body, track and the leader's speed.
    """
    old = replace(trial.config, body=BodyConfig(), track=ConvoyConfig().track, leader_speed_mps=ConvoyConfig().leader_speed_mps)
    theta, _ = _learned(old, trial.steps, None)
    result: dict[str, float] = {}
    for name, begin in (("cold", None), ("warm", theta)):
        later, losses = _learned(trial.config.with_seed(trial.config.seed + UNSEEN), EARLY, begin)
        steps = _followed(trial.config.with_seed(trial.config.seed + 2 * UNSEEN), later, trial)
        errors = {f"{name}_greedy_{key}": value for key, value in _errors(trial.config, steps, slice(None)).items()}
        result |= {f"{name}_losses": float(losses)} | errors
    return result


def _learned(config: ConvoyConfig, steps: int, theta: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], int]:
    """Return the tables after a number of updates, and the losses meanwhile; patient with followers that are lost for long."""
    convoy = Convoy(config, [config.seed], steps=steps, policy=theta, threads=1)
    losses = 0
    while not convoy.finished:
        losses += int(np.count_nonzero(convoy.run_block()[0]["event"][:, 1:] & LOSS))
    return convoy.tables(0)[0], losses


def _followed(config: ConvoyConfig, theta: NDArray[np.float64], trial: Trial) -> NDArray[np.void]:
    """Return the step records of a greedy drive, (periods, robots)."""
    periods = round(trial.minutes * 60 / CONTROL_PERIOD)
    convoy = Convoy(config, [config.seed], periods=periods, policy=Policy.of(config, theta).theta, threads=1)
    kept = []
    while not convoy.finished:
        block = convoy.run_block()[0]
        kept.append(block[: np.count_nonzero(block["phase"][:, 0] >= 0)].copy())
    return np.concatenate(kept)


def _errors(config: ConvoyConfig, steps: NDArray[np.void], who: slice) -> dict[str, float]:
    """Return losses, the share of all time truly inside the bounds, and RMS errors there, of some followers together."""
    at = steps[:, 1:][:, who]
    distance, bearing = (values[:, who] for values in true_errors(steps))
    inside = within(config, distance, bearing) & (at["phase"] == FOLLOW)
    errors = {"rms_distance_mm": math.nan, "rms_bearing_deg": math.nan}
    if inside.any():
        errors["rms_distance_mm"] = 1000 * math.sqrt(float(np.mean((distance[inside] - config.middle_m) ** 2)))
        errors["rms_bearing_deg"] = math.degrees(math.sqrt(float(np.mean(bearing[inside] ** 2))))
    return {"losses": float(np.count_nonzero(at["event"] & LOSS)), "share_inside": float(inside.mean())} | errors
