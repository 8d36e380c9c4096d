"""Trials of shapes: learn somewhere, then keep every shape; and change shapes while driving.

>>> numbers = measure_shapes(ShapeTrial(controller="carrot", minutes=2.0, judged="rolling"))
>>> numbers["wedge_contacts"], numbers["wedge_place_rms_mm"] < 4
(0.0, True)
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.arena.tracks import TrackConfig
from workbench.fields import choice, configuration, integer
from workbench.formation.assignment import ASSIGNMENTS
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.formation.follower import LOSS
from workbench.formation.laws.table import Controller
from workbench.formation.policy import Policy
from workbench.formation.shapes import FormationConfig
from workbench.lab.runs import learn, periods_of
from workbench.lab.trial import CONTROLLERS, JudgedTrial, Trial
from workbench.measures.motion import Motion
from workbench.measures.shapes import ARRIVED_M, contacts, places_in_world, reform_s, shape_errors

JUDGED = ("column", "line", "wedge", "diamond")
FOLLOWERS = 4
EIGHT = TrackConfig(shape="eight", radius_m=1.0, judder="none")


@configuration
class ShapeTrial(JudgedTrial):
    """Learn on a configuration, then keep shapes on a figure-eight of 1 m."""

    frame: str = choice(("heading", "path"), "what places are relative to", default="heading")
    judder: str = choice(
        ("none", "spectrum"), "of the line that the leader follows", default="none"
    )


@configuration
class ReformTrial(Trial):
    """Change shapes while a law drives."""

    followers: int = integer(1, 64, "", "how many", default=4)
    rule: str = choice(tuple(ASSIGNMENTS), "who takes which place", default="squared")
    flow: str = choice(("flow", "straight"), "how places move", default="flow")
    changes: int = integer(1, 1000, "", "how many, one a block", default=10)


def measure_shapes(trial: ShapeTrial) -> dict[str, float]:
    """Return losses while learning, and for every shape the measures of ``measures.shapes`` and the
    losses.
    """
    controller, numbers = _driver(trial)
    for shape in JUDGED:
        spacing_m = trial.config.formation.spacing_m
        told = FormationConfig(shape=shape, frame=trial.frame, spacing_m=spacing_m)
        config = replace(
            trial.unseen,
            followers=FOLLOWERS,
            track=replace(EIGHT, judder=trial.judder),
            weights="own",
            reward="quadratic",  # nobody learns here, and distances do not hold a line
            formation=told,
        )
        found = _kept(controller, config, trial.minutes)
        numbers |= {f"{shape}_{name}": value for name, value in found.items()}
    return numbers


def measure_place(trial: ShapeTrial) -> dict[str, float]:
    """Return losses while learning one place, and how well it is kept there afterwards."""
    controller, numbers = _driver(trial)
    return numbers | _kept(controller, trial.unseen, trial.minutes)


def _driver(trial: Trial) -> tuple[Controller, dict[str, float]]:
    make = CONTROLLERS[trial.controller]
    if make is not None:
        return make(trial.config), {"learning_losses": math.nan}
    run = learn(trial.config, steps=trial.steps, progress=False)
    return run.policy, {"learning_losses": float(run.summary["losses"])}


def _kept(controller: Controller, config: ConvoyConfig, minutes: float) -> dict[str, float]:
    """Return how well a formation keeps its shape."""
    driver = controller.theta if isinstance(controller, Policy) else controller
    convoy = Convoy(config, [config.seed], periods=periods_of(minutes), policy=driver, threads=1)
    steps = convoy.whole()
    motion = Motion.of_steps(steps, None, config.robot)
    told = config.formation
    frame = "path" if told.relative_to == "path" else "heading"
    found = shape_errors(motion, convoy.goals[0], frame=frame, window_m=told.window_m)
    losses = float(np.count_nonzero(steps["event"][:, 1:] & LOSS))
    return {name: float(value) for name, value in found.items()} | {"losses": losses}


def _reforming(trial: ReformTrial) -> ConvoyConfig:
    """Return where shapes are changed, on a figure-eight with room for them."""
    # without flow places go straight to their goals, whoever is in the way
    clearance = 0.12 if trial.flow == "flow" else 0.0
    told = FormationConfig(
        shape="column", frame="heading", assignment=trial.rule, clearance_m=clearance
    )
    width = 0.15 * (trial.followers // 2 + 1)
    return replace(
        trial.unseen,
        followers=trial.followers,
        track=replace(EIGHT, radius_m=max(1.0, 2 * width)),
        formation=told,
    )


def measure_reform(trial: ReformTrial) -> dict[str, float]:
    """Return how many changes of shape had a contact or a loss, how long they took, and how near
    bodies came.
    """
    config = _reforming(trial)
    law = CONTROLLERS["carrot"]
    assert law is not None
    driver: Any = law(config)
    most = trial.changes * BLOCK
    convoy = Convoy(config, [config.seed], periods=most, policy=driver, threads=1)
    chance = np.random.default_rng([config.seed, trial.followers])
    last, seconds, nearest = "column", [], math.inf
    touched = lost = 0
    for _ in range(trial.changes):
        last = str(chance.choice([shape for shape in (*JUDGED, "circle") if shape != last]))
        convoy.instruct(last)
        block = convoy.run_block()[0].copy()
        motion = Motion.of_steps(block, None, config.robot)
        goals = convoy.goals[0]
        touched += contacts(motion) > 0
        lost += bool(np.any(block["event"][:, 1:] & LOSS))
        nearest = min(nearest, float(motion.gaps_m().min()))
        seconds.append(reform_s(motion, places_in_world(motion, goals), ARRIVED_M))
    late = np.where(np.isnan(seconds), math.inf, seconds)  # who never arrives arrives last
    return {
        "changes": float(trial.changes),
        "changes_with_contact": float(touched),
        "changes_with_loss": float(lost),
        "never_in_shape": float(np.sum(np.isinf(late))),
        "median_reform_s": float(np.median(late)),
        "p95_reform_s": float(np.percentile(late, 95, method="higher")),
        "nearest_mm": 1000 * nearest,
    }
