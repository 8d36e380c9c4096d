"""Trials of the full run through the overhead camera: learn, follow greedily, and follow for five
minutes on real pixels.

Learning and the greedy evaluation use the configuration's own sensing; the last five minutes are
driven twice from the same start, once with sensing "camera" and once with every picture drawn and
searched. Errors of those are true ones.

>>> config = ConvoyConfig(followers=1, drive="planar", sensing="camera")
>>> trial = Trial(config=config, steps=300, minutes=1.0)
>>> numbers = measure_camera(trial, pixel_minutes=0.05)
>>> sorted(numbers)[:3]
['bearing_std_deg_last_third', 'camera_bearing_std_deg', 'camera_bias_mm']
"""

import math
from dataclasses import replace

import numpy as np

from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.policy import Policy
from workbench.formation.senses.table import CAMERA
from workbench.lab.runs import evaluate, learn
from workbench.lab.trial import Trial
from workbench.measures.errors import summary, true_errors
from workbench.robot.geometry import CONTROL_PERIOD

PIXEL_MINUTES = 5.0


def measure_camera(trial: Trial, *, pixel_minutes: float = PIXEL_MINUTES) -> dict[str, float]:
    """Return shares of visits, losses and errors of the full run, greedy, and on pixels beside the
    fast model.
    """
    run = learn(trial.config, steps=trial.steps, progress=False)
    judged = trial.unseen
    assert isinstance(run.policy, Policy)
    learned = run.summary
    greedy = evaluate(run.policy, judged, minutes=trial.minutes, progress=False).summary
    kept = ("share_best_cell", "share_best_3x3", "losses")
    late = (
        "share_best_3x3_last_third",
        "rms_distance_error_mm_last_third",
        "bearing_std_deg_last_third",
    )
    result = {
        name: float(learned[name]) if learned[name] is not None else math.nan
        for name in kept + late
    }
    result |= {
        f"greedy_{name}": math.nan if greedy[name] is None else float(greedy[name])
        for name in ("share_best_3x3", *_NAMES)
    }
    for sensing in CAMERA:
        seen = trial.config.sensing in CAMERA  # without a camera there is nothing to compare
        numbers = (
            followed(run.policy, replace(judged, sensing=sensing), pixel_minutes)
            if seen
            else dict.fromkeys(_NAMES, math.nan)
        )
        result |= {f"{sensing}_{name}": value for name, value in numbers.items()}
    return result


_NAMES = ("losses", "rms_distance_error_mm", "bias_mm", "ripple_mm", "bearing_std_deg")


def followed(policy: Policy, config: ConvoyConfig, minutes: float) -> dict[str, float]:
    """Return losses and true errors in mm and degrees of a greedy drive."""
    convoy = Convoy(
        config,
        [config.seed],
        periods=round(minutes * 60 / CONTROL_PERIOD),
        policy=policy.theta,
        threads=1,
    )
    steps = convoy.whole()
    distance, bearing = true_errors(steps)
    everywhere = np.ones_like(distance, bool)
    errors = summary(distance, bearing, everywhere, wanted_m=config.middle_m)
    losses = float(np.count_nonzero(steps["event"][:, 1:] & LOSS))
    return {"losses": losses} | {name: errors[name] for name in _NAMES[1:]}
