"""Rewards for progress: what is summed up over an episode is the way that was made good."""

from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.envs.environments import FollowVectorEnv
from workbench.envs.shaping import PER_METRE, TOUCHING
from workbench.formation.shapes import FormationConfig

WORM = wb.ConvoyConfig(
    drive="rolling",
    followers=3,
    track=wb.TrackConfig(shape="eight", radius_m=1.0, judder="none"),
    leader_speed_mps=0.05,
    wheel_speed_mps=(0.0, 0.12),
)
WEDGE = replace(WORM, formation=FormationConfig(shape="wedge", frame="heading"))


def _far(env):
    """Return how far followers are from their places, worked out from what is on the floor."""
    convoy = env.convoy
    here = np.array([convoy.world.pose(0, k) for k in range(convoy.world.robots)])
    if convoy.config.formation.shaped:
        return np.linalg.norm(convoy.places[0] - here[1:, :2], axis=1)
    towards = np.stack([np.cos(here[1:, 2]), np.sin(here[1:, 2])], axis=1)
    wanted = here[1:, :2] + convoy.config.middle_m * towards
    return np.linalg.norm(here[:-1, :2] - wanted, axis=1)


def _played(env, steps=6):
    """Return rewards (T, followers), how many touched (T, followers), and distances before and
    after.
    """
    env.reset(seed=4)
    begun = _far(env)
    earned, touched = [], []
    for k in range(steps):
        actions = {name: (24, 25, 31)[(k + i) % 3] for i, name in enumerate(env.agents)}
        _, rewards, terminated, _, told = env.step(actions)
        assert not any(terminated.values())
        earned.append(list(rewards.values()))
        touched.append([told[name]["contact"] for name in rewards])
    return np.array(earned), np.array(touched), begun, _far(env)


@pytest.mark.parametrize("config", [WORM, WEDGE], ids=["worm", "wedge"])
def test_progress_adds_up_to_the_way_that_was_made_good(config):
    earned, touched, begun, ended = _played(wb.ConvoyEnv(config, reward="shaping"))
    expected = PER_METRE * (begun - ended) + TOUCHING * touched.sum(axis=0)
    assert earned.sum(axis=0) == pytest.approx(expected, abs=1e-6)
    assert np.ptp(earned, axis=1).max() > 0


def test_shared_progress_is_everybodys_and_a_touch_ones_own():
    alone, touched, *_ = _played(wb.ConvoyEnv(WORM, reward="shaping"))
    together, again, *_ = _played(wb.ConvoyEnv(WORM, reward="shared-shaping"))
    own = alone - TOUCHING * touched
    assert np.array_equal(touched, again)
    assert together - TOUCHING * touched == pytest.approx(
        np.repeat(own.sum(axis=1, keepdims=True), 3, axis=1), abs=1e-9
    )


def test_who_touches_another_pays_for_it():
    close = replace(WORM, followers=1, distance_m=(0.0705, 0.22))
    env = wb.FollowEnv(close, actions="continuous", reward="shaping")
    env.reset(seed=1)
    for _ in range(300):
        _, reward, over, _, told = env.step([1.0, 1.0])
        if over or told["contact"]:
            break
    assert told["contact"] and reward < TOUCHING + PER_METRE * 0.02


def test_rewards_come_through_a_vector_and_a_formation_that_begins_anew_starts_from_there():
    env = FollowVectorEnv(3, WORM, reward="shaping")
    env.reset(seed=1)
    rewards = []
    for _ in range(80):  # the first drives off and is lost, and begins anew
        _, reward, *_ = env.step(np.array([0, 24, 24]))
        rewards.append(reward)
    assert np.abs(rewards).max() < PER_METRE * 0.1 * 0.25
    with pytest.raises(ValueError, match="reward = 'shapin'; expected .*'shaping'"):
        wb.FollowEnv(WORM, reward="shapin")
