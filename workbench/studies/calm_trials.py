"""Trials of what an output stage makes of the same weights: errors, bias and ripple apart, and
restlessness, of one frozen drive after the other.

All drives of a trial are on the same unseen track. The first minute, in which a trim finds its
place, does not count. Errors are true ones, in mm and degrees; turning is the RMS turning rate
above 1 Hz in °/s, mean over the followers.

>>> config = ConvoyConfig(followers=1, drive="rolling")
>>> drive = judged(CarrotPI(), config, minutes=2.0)
>>> drive["losses"], drive["bias_mm"] < 1
(0.0, True)
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.fields import configuration, real
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.table import Controller
from workbench.lab.runs import learn
from workbench.lab.trial import TUNED, JudgedTrial, Trial
from workbench.measures.errors import summary
from workbench.measures.motion import chatter, follow
from workbench.robot.geometry import CONTROL_PERIOD

SETTLING_S = 60.0
ELSEWHERE = 5000  # added to the seed: tracks and noise on which gains are tuned, and nothing judged
NOISES = {"none": (0.0, 0.0), "1 mm, 1°": (1e-3, 1.0), "2 mm, 2°": (2e-3, 2.0)}
# how a table drives: output, trim, filter
OUTPUTS: dict[str, dict[str, Any]] = {
    "greedy": {"output": "greedy", "trim": 0.0},
    "greedy, trim": {"output": "greedy", "trim": 0.01},
    "interpolated": {"output": "interpolated", "trim": 0.0},
    "interpolated, trim": {"output": "interpolated", "trim": 0.01},
}
MAIN = "interpolated, trim"
LONG = (("none", "none"), ("2 mm, 2°", "alpha-beta"))  # noise and filter of the whole drives
SHORT = 6.0  # drives that are compared with each other only are that much shorter


def judged(controller: Controller, config: ConvoyConfig, minutes: float) -> dict[str, float]:
    """Return losses, errors and turning of a frozen drive, from the second minute on."""
    motion = follow(controller, config, minutes=minutes)
    distance, bearing = motion.errors()
    following = motion.following[:, 1:]
    late = np.zeros_like(following)
    late[round(SETTLING_S / CONTROL_PERIOD) :] = True
    errors = summary(distance, bearing, following & late, wanted_m=config.middle_m)
    return {
        "losses": float(np.count_nonzero(following[:-1] & ~following[1:])),
        "turning": float(chatter(motion)["turn_rms_deg_s"].iloc[1:].mean()),
    } | errors


def noisy(config: ConvoyConfig, noise: str) -> ConvoyConfig:
    """Return a configuration with one of NOISES on what followers are told."""
    distance, degrees = NOISES[noise]
    return replace(config, noise_distance_m=distance, noise_bearing_rad=math.radians(degrees))


def measure_calm(trial: JudgedTrial) -> dict[str, float]:
    """Return losses while learning, drives by every output without noise, and by the calm one with
    every noise, filtered or not; the same of the tuned law.
    """
    found: dict[str, float] = {}
    drives: dict[tuple[str, str, str], tuple[Controller, dict[str, Any]]] = {}
    if trial.controller == "learner":
        run = learn(trial.config, steps=trial.steps, progress=False)
        found["learning_losses"] = float(run.summary["losses"])
        for noise in NOISES:
            # what is not calm without noise is not driven with it
            outputs = OUTPUTS if noise == "none" else {MAIN: OUTPUTS[MAIN]}
            for output, options in outputs.items():
                for kept in ("none", "alpha-beta") if noise != "none" else ("none",):
                    drives[output, noise, kept] = run.policy, options
    else:
        for noise in NOISES:
            for kept in ("none", "alpha-beta") if noise != "none" else ("none",):
                drives["law", noise, kept] = TUNED[noise != "none"], {}
    for (output, noise, kept), (controller, options) in drives.items():
        main = output in (MAIN, "law") and (noise, kept) in LONG
        minutes = trial.minutes if main else max(trial.minutes / SHORT, 2.0)
        world = replace(noisy(trial.unseen, noise), filter=kept, **options)
        numbers = judged(controller, world, minutes)
        found |= {f"{output}|{noise}|{kept}|{key}": value for key, value in numbers.items()}
    return found


@configuration
class Gains(Trial):
    """A trial of the carrot law with some gains."""

    k_distance: float = real(0.0, 20.0, "1/s", "speed per distance error", default=2.0)
    k_integral: float = real(0.0, 20.0, "1/s²", "speed per integral of it", default=0.5)
    k_bearing: float = real(0.0, 20.0, "1/s", "turning rate per bearing", default=4.0)


def measure_gains(trial: Gains) -> dict[str, float]:
    """Return how a law with these gains drives, on tracks that nothing else is judged on."""
    law = CarrotPI(
        k_distance=trial.k_distance, k_integral=trial.k_integral, k_bearing=trial.k_bearing
    )
    config = replace(trial.config, seed=trial.config.seed + ELSEWHERE)
    return judged(law, config, trial.minutes)
