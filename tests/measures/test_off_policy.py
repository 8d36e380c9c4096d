"""What a log says of a policy that did not make it."""

from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench import paths
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.lab.trial import Trial
from workbench.logs.recordings import load_recording
from workbench.measures.off_policy import (
    BLOCK,
    Log,
    evaluate_log,
    learn_from_log,
    log_of,
    make_log,
    perceive,
    ratios,
)
from workbench.studies import off_policy_trials

RAW = replace(
    wb.SETTINGS["infrared"],
    sensing="ir-raw",
    followers=1,
    drive="planar",
    state_tiles=(5, 5),
    action_levels=(3, 3),
)
LEARNING = paths.DATA / "recordings" / "emulated_epuck1_learning.csv"


def _chain(steps=6000, epsilon=0.3, seed=0):
    """A known world: two states; action 0 stays or goes to 0, action 1 to 1; reward -1 in state 1;
    behaviour is 1-ε on 0.
    """
    rng = np.random.default_rng(seed)
    states = np.zeros(steps + 1, np.int64)
    actions = np.zeros(steps + 1, np.int64)
    probabilities = np.ones(steps + 1)
    for t in range(steps):
        explored = rng.random() < epsilon
        actions[t] = rng.integers(2) if explored else 0
        probabilities[t] = epsilon / 2 + (1 - epsilon) * (actions[t] == 0)
        states[t + 1] = actions[t] if rng.random() < 0.9 else 1 - actions[t]
    return states, actions, probabilities, -(states == 1).astype(float)


def _policy(theta):
    return wb.Policy(
        np.asarray(theta, float)[None],
        np.array([0.0, 1.0]),
        np.array([0.0, 1.0, 2.0]),
        np.array([1]),
        np.array([1, 2]),
    )


@pytest.mark.parametrize(
    (
        "theta",
        "error",
    ),  # the worse the action values, the more the estimate scatters; it stays right
    [
        ([[0.0, -1.0], [0.0, -1.0]], 0.12),
        ([[-0.6, -1.4], [-0.6, -1.4]], 0.12),
        ([[5.0, 1.0], [5.0, -3.0]], 0.4),
    ],
)
def test_the_estimate_is_right_whatever_the_action_values_say(theta, error):
    gamma = 0.8
    covered = 0
    for seed in range(10):
        states, actions, probabilities, rewards = _chain(seed=seed)
        log = make_log(
            states, actions, probabilities, rewards, np.arange(len(states)) < len(states) - 1
        )
        found = evaluate_log(log, _policy(theta), gamma=gamma)
        truth = -0.1 / (1 - gamma)  # always action 0: state 1 with probability 0.1 after every step
        covered += found["low"] <= truth <= found["high"]
        assert found["value"] == pytest.approx(truth, abs=error) and found[
            "sampled"
        ] == pytest.approx(truth, abs=0.2)
        assert (
            found["mean_ratio"] == pytest.approx(1, abs=0.05) and 0 < found["effective_share"] <= 1
        )
    assert covered >= 8


def test_ratios_are_one_over_the_probability_of_what_the_policy_would_have_done():
    log = Log(
        np.array([0, 1, 0]),
        np.array([0, 1, 1]),
        np.array([0.5, 0.8, 0.1]),
        np.zeros(3),
        np.zeros(3, int),
        np.zeros(3, bool),
    )
    np.testing.assert_array_equal(ratios(log, _policy([[1.0, 0.0], [0.0, 1.0]])), [2.0, 1.25, 0.0])


def test_steps_end_at_terminals_and_where_the_log_breaks_off():
    states = np.array([3, 4, -1, -1, 5, 6, 7])
    acted = np.array([True, True, False, False, True, True, False])
    log = make_log(states, np.zeros(7, int), np.ones(7), np.arange(7.0), acted)
    np.testing.assert_array_equal(log.state, [3, 4, 5, 6])
    np.testing.assert_array_equal(log.next_state, [4, -1, 6, 7])
    np.testing.assert_array_equal(log.ends, [False, True, False, True])
    np.testing.assert_array_equal(log.reward, [1, 2, 5, 6])


@pytest.mark.parametrize("sensing", ["ir-raw", "ir-metric"])
def test_perception_of_a_log_is_the_followers_own(sensing):
    config = replace(RAW, sensing=sensing)
    follower = SoloFollower(
        config, wb.quantised_carrot(config) if sensing == "ir-metric" else None, steps=10**6
    )
    readings = []
    seen = []
    with SimulatedRobot(config) as robot:
        robot.enable("proximity")
        robot.calibrate_proximity_sensors()
        for _ in range(600):
            robot.step()
            robot.set_motors_speed(*follower.decide(robot.get_proximity()))
            readings.append(robot.get_proximity())
            seen.append((int(follower.record["choice"]["state"]), float(follower.step["reward"])))
            follower.learn()
    states, rewards = perceive(config, np.array(readings))
    kept = [t for t in range(1, 600) if seen[t][0] >= 0 and seen[t - 1][0] >= 0]
    assert len(kept) > 100
    np.testing.assert_array_equal(states[kept], [seen[t][0] for t in kept])
    np.testing.assert_allclose(rewards[kept], [seen[t][1] for t in kept], rtol=1e-6)


@pytest.mark.skipif(not LEARNING.is_file(), reason="no shipped recording")
def test_the_shipped_recording_is_a_log_from_which_can_be_learned():
    recording = load_recording(LEARNING)
    log = log_of(recording)
    assert len(log.state) > 100 and np.all(log.probability > 0)
    policy = learn_from_log(log, recording.config, passes=3)
    policy.check(recording.config)
    visited = np.unique(log.state)
    start = recording.config.learner.theta0
    assert np.any(policy.theta[0, visited] != start) and np.all(
        policy.theta[0, np.setdiff1d(np.arange(25), visited)] == start
    )


def test_learning_from_a_log_finds_the_better_action():
    states, actions, probabilities, rewards = _chain(steps=3000, epsilon=1.0)
    log = make_log(
        states, actions, probabilities, rewards, np.arange(len(states)) < len(states) - 1
    )
    config = wb.ConvoyConfig(followers=1, state_tiles=(1, 2), action_levels=(1, 2), drive="planar")
    policy = learn_from_log(log, config)
    assert np.all(policy.greedy() == 0)


def test_logs_that_cannot_be_used_are_refused():
    states, actions, probabilities, rewards = _chain(steps=200)
    short = make_log(states, actions, probabilities, rewards, np.arange(201) < 200)
    with pytest.raises(ValueError, match=f"200 steps; expected at least {2 * BLOCK}"):
        evaluate_log(short, _policy([[1.0, 0.0], [1.0, 0.0]]), gamma=0.8)
    states, actions, probabilities, rewards = _chain(steps=700)
    wrong = make_log(states, actions, 0 * probabilities, rewards, np.arange(701) < 700)
    with pytest.raises(ValueError, match="probabilities outside"):
        evaluate_log(wrong, _policy([[1.0, 0.0], [1.0, 0.0]]), gamma=0.8)
    with pytest.raises(ValueError, match="sensing = 'truth'; readings are perceived with"):
        perceive(wb.ConvoyConfig(), np.zeros((3, 8)))
    with pytest.raises(ValueError, match=r"readings have shape \(3, 7\)"):
        perceive(RAW, np.zeros((3, 7)))


def test_a_trial_holds_the_estimate_against_what_the_policy_does(monkeypatch):
    monkeypatch.setattr(off_policy_trials, "PERIODS", 1500)
    monkeypatch.setattr(off_policy_trials, "STRETCHES", 60)
    found = off_policy_trials.measure_off_policy(Trial(config=RAW, steps=30_000))
    assert found["low"] < found["value"] < found["high"] < 0 and 0 < found["half_width_share"] < 1
    assert found["truth"] == pytest.approx(found["value"], abs=0.1) and found[
        "mean_ratio"
    ] == pytest.approx(1, abs=0.05)
    assert found["contains_truth"] == (found["low"] <= found["truth"] <= found["high"])
