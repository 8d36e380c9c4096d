"""Trials of how smoothly followers move: learn (or not), then drive frozen on an unseen track, and
measure the whole motion.

``measure_motion`` gives one line of plain numbers: ``learning_…`` while learning, ``following_…``
frozen afterwards, without exploration. Names that end in a number belong to that robot, 0 being the
leader; see ``workbench.measures.judder.judder`` and ``workbench.measures.motion.chatter`` for what
they mean. Lengths in mm, angles in degrees, errors from true poses, also where the followers sense
with noise; times to being stable from sensed ones. What a trial does not have (a gain without a
robot in front) is NaN; a drive shorter than a loop, or a follower that never gets round, is an
error.

>>> config = ConvoyConfig(followers=1, drive="planar")
>>> trial = Trial(config=config, controller="carrot", minutes=2.0)
>>> numbers = measure_motion(trial)
>>> numbers["following_losses"], numbers["judder_mm_0"] > 2 > numbers["judder_mm_1"]
(0.0, True)
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.formation.follower import LEARNED, LOSS
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.table import Controller
from workbench.formation.policy import Policy
from workbench.lab.statistics import time_to_stable
from workbench.lab.trial import CONTROLLERS, Trial
from workbench.measures.errors import summary
from workbench.measures.judder import judder, tractrix_line
from workbench.measures.motion import Motion, chatter, follow
from workbench.robot.geometry import CONTROL_PERIOD

OWN_BLOCK = 5000  # own updates per block of the criterion of being stable
_STABLE_FROM = 3 * OWN_BLOCK  # own updates that a run must have to be judged
_RIVAL = (
    "following_losses",
    "following_collisions",
    "following_share",
    "following_rms_distance_error_mm",
    "following_bias_mm",
    "following_ripple_mm",
    "following_bearing_std_deg",
    "judder_mm_0",
    "judder_mm_1",
    "judder_mm_4",
    "excess_1",
    "coherence_1",
    "turn_rms_deg_s_1",
    "variation_mm_s_per_m_1",
    "switches_per_m_1",
)


def measure_motion(trial: Trial) -> dict[str, float]:
    """Return all numbers of a trial: learning, errors, collisions, judder and chatter."""
    controller, learned = _prepare(trial)
    judged = replace(trial.unseen, reset="manoeuvre")
    motion = (
        _ideal(judged, trial.minutes)
        if controller is None
        else follow(controller, judged, minutes=trial.minutes)
    )
    return (
        learned
        | _followed(motion, judged.middle_m)
        | _by_robot(judder(motion))
        | _by_robot(chatter(motion))
    )


def measure_rival(trial: Trial) -> dict[str, float]:
    """Return the numbers of ``measure_motion`` by which learners are compared."""
    numbers = measure_motion(trial)
    return {
        name: value
        for name, value in numbers.items()
        if name.startswith("learning_losses") or name in _RIVAL
    }


def measure_stability(trial: Trial) -> dict[str, float]:
    """Return when each follower was stable, in its own updates, and its losses while learning."""
    _, learned = _prepare(trial)
    return {
        name: value
        for name, value in learned.items()
        if name.startswith(("stable", "learning_losses"))
    }


def _prepare(trial: Trial) -> tuple[Controller | None, dict[str, float]]:
    """Return who drives, None for the ideal, and what was measured while it learned."""
    if trial.controller == "tractrix":
        return None, {}
    make = CONTROLLERS[trial.controller]
    if make is not None:
        return make(trial.config), {}
    config = trial.config
    if trial.steps == 0:
        tables = config.followers if config.weights == "own" else 1
        theta = np.full(
            (tables, config.rows, config.action_count), config.learner.theta0 / config.tilings
        )
        return Policy.of(config, theta), {}
    convoy = Convoy(
        config, [config.seed], steps=trial.steps, horizon=trial.horizon or None, threads=1
    )
    steps = convoy.whole()
    if convoy.updates[0] < trial.steps:
        raise RuntimeError(
            f"seed {config.seed}: only {convoy.updates[0]} of {trial.steps} updates; the "
            "followers were lost"
        )
    return Policy.of(config, convoy.tables(0)[0]), _learned(steps)


def _learned(steps: NDArray[np.void]) -> dict[str, float]:
    """Return losses, collisions and times to being stable of a whole learning run, and the chatter
    of its last 250 s.
    """
    at = steps[:, 1:]
    lost = at["event"] & LOSS != 0
    late = lost[2 * len(lost) // 3 :]
    result = {
        "learning_losses": float(lost.sum()),
        "learning_losses_per_hour_last_third": float(
            late.sum() / (late.size * CONTROL_PERIOD / 3600)
        ),
        "learning_collisions": _collisions(Motion.of_steps(steps)),
    }
    for k in range(at.shape[1]):
        own = at["event"][:, k] & LEARNED != 0
        enough = np.count_nonzero(own) >= _STABLE_FROM
        error = at["distance_error"][own, k]
        result[f"learning_losses_{k + 1}"] = float(lost[:, k].sum())
        result[f"stable_updates_{k + 1}"] = (
            time_to_stable(lost[own, k], error, block=OWN_BLOCK) if enough else math.nan
        )
    tail = chatter(Motion.of_steps(steps[-BLOCK:]))
    return result | {f"learning_{name}": value for name, value in _by_robot(tail).items()}


def _followed(motion: Motion, wanted_m: float) -> dict[str, float]:
    """Return losses, collisions and true errors of a frozen drive."""
    distance, bearing = motion.errors()
    following = motion.following[:, 1:]
    result = {
        "following_losses": float(np.count_nonzero(following[:-1] & ~following[1:])),
        "following_share": float(following.mean()),
        "following_collisions": _collisions(motion),
        "following_smallest_gap_mm": 1000 * float(motion.gaps_m().min()),
    }
    parts = {"": np.ones_like(following)} | {
        f"_{k + 1}": np.arange(following.shape[1]) == k for k in range(following.shape[1])
    }
    for name, part in parts.items():
        errors = summary(distance, bearing, following & part, wanted_m=wanted_m)
        for kind in ("rms_distance_error_mm", "bias_mm", "ripple_mm", "bearing_std_deg"):
            result[f"following_{kind}{name}"] = errors[kind]
    return result


def _collisions(motion: Motion) -> float:
    """Return how often two robots began to touch, seen once per sample."""
    return float(
        np.count_nonzero(np.diff((motion.gaps_m() < 0).astype(int), axis=0, prepend=0) == 1)
    )


def _ideal(config: ConvoyConfig, minutes: float) -> Motion:
    """Return the leader's real path and what rods of length d* make of it: no robots, no limits, no
    errors.
    """
    leader = follow(CarrotPI(), config, minutes=minutes)
    line = tractrix_line(
        leader.position[:, 0], config.middle_m, config.followers, start=leader.position[0, 1:]
    )
    return Motion.of_path(line, leader.fs, leader.track)


def _by_robot(table: pd.DataFrame) -> dict[str, float]:
    """Return a table with one line per robot as one line of numbers, their names ending in the
    robot's place.
    """
    columns = [name for name in table if name not in ("robot", "loops")]
    return {
        f"{name}_{int(line['robot'])}": float(line[name])
        for name in columns
        for _, line in table.iterrows()
    }
