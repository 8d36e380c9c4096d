"""Trials of smoothness: what a line holds, and that it is what learning and following really
did.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.shapes import FormationConfig
from workbench.lab.runs import learn
from workbench.lab.trial import CONTROLLERS, UNSEEN, Trial
from workbench.learning.config import RULES, LearnerConfig
from workbench.measures.judder import judder
from workbench.measures.motion import chatter, follow
from workbench.studies.motion_trials import measure_motion, measure_rival, measure_stability

SMALL = ConvoyConfig(followers=2, drive="planar", seed=4)


def test_a_line_is_what_learning_and_frozen_following_did():
    trial = Trial(config=SMALL, steps=6000, minutes=2.5)
    numbers = measure_motion(trial)
    run = learn(SMALL, steps=6000, progress=False)
    assert (
        numbers["learning_losses"]
        == run.summary["losses"]
        == numbers["learning_losses_1"] + numbers["learning_losses_2"]
    )
    assert numbers["learning_collisions"] == run.summary["collisions"]
    motion = follow(run.policy, SMALL.with_seed(4 + UNSEEN), minutes=2.5)
    distance, bearing = motion.errors()
    where = motion.following[:, 1:]
    assert numbers["following_rms_distance_error_mm"] == pytest.approx(
        1000 * np.sqrt(np.mean((distance[where] - 0.15) ** 2))
    )
    assert numbers["following_bearing_std_deg_2"] == pytest.approx(
        np.degrees(bearing[where[:, 1], 1].std())
    )
    assert numbers["following_share"] == pytest.approx(where.mean())
    table = judder(motion)
    restless = chatter(motion)
    assert (
        numbers["excess_1"] == table["excess"][1]
        and numbers["judder_mm_2"] == table["judder_mm"][2]
    )
    assert numbers["switches_per_m_1"] == restless["switches_per_m"][1]
    assert math.isnan(numbers["gain_0"]) and math.isnan(
        numbers["stable_updates_1"]
    )  # too short to be judged


def test_losses_of_a_frozen_drive_are_the_losses_that_the_robots_had():
    untrained = measure_motion(Trial(config=SMALL, steps=0, minutes=3))
    theta = np.full((2, 81, 49), -0.1)
    steps = Convoy(SMALL.with_seed(4 + UNSEEN), [4 + UNSEEN], periods=1800, policy=theta).whole()
    assert untrained["following_losses"] == np.count_nonzero(steps["event"][:, 1:] & LOSS) > 50
    assert "learning_losses" not in untrained


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_every_controller_can_be_measured(controller):
    config = SMALL
    if controller == "l-psi-leader":  # which wants places by the leader's heading
        config = replace(SMALL, formation=FormationConfig(shape="column", frame="heading"))
    numbers = measure_motion(Trial(config=config, controller=controller, steps=2000, minutes=2))
    assert numbers["following_rms_distance_error_mm"] < 60 and numbers["judder_mm_0"] > 2
    if controller == "tractrix":
        assert numbers["following_rms_distance_error_mm"] < 0.01 and numbers[
            "excess_1"
        ] == pytest.approx(1.0, abs=0.03)


def test_noise_counts_in_sensing_and_not_in_the_measure():
    noisy = replace(SMALL, noise_distance_m=0.02)
    numbers = measure_motion(Trial(config=noisy, controller="carrot", minutes=2))
    assert numbers["following_rms_distance_error_mm"] < 15  # the noise alone has 20 mm


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_learns_to_follow(rule):
    config = ConvoyConfig(
        drive="planar", seed=2, learner=LearnerConfig(rule=rule, eta=1.0 if rule == "qrc" else 0.01)
    )
    numbers = measure_rival(Trial(config=config, steps=60_000, minutes=3))
    assert numbers["following_losses"] == 0 and numbers["following_rms_distance_error_mm"] < 15
    assert {"judder_mm_1", "learning_losses", "excess_1"} <= set(
        numbers
    ) and "ldlj_vector_1" not in numbers


def test_stability_is_told_for_every_follower():
    numbers = measure_stability(Trial(config=SMALL, steps=40_000, minutes=1))
    assert set(numbers) >= {"stable_updates_1", "stable_updates_2", "learning_losses"}
    assert all(
        math.isnan(numbers[f"stable_updates_{k}"]) or numbers[f"stable_updates_{k}"] % 5000 == 0
        for k in (1, 2)
    )
