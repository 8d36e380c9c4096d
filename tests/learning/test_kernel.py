"""The GQ(λ) kernel against independent oracles, against published results, and against its own
identities.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.learning.gq import GQ
from workbench.learning.kernel import Features, Learner, Signal, StepSizes, gq_update, new_trace

DATA = Path(__file__).parents[1] / "data"


def _lists(pairs):
    return np.array([i for i, _ in pairs], np.int64), np.array([v for _, v in pairs], np.float64)


@pytest.mark.parametrize("name", ["trace1_lambda0", "trace2_lambda04"])
def test_kernel_equals_the_oracle_after_every_step(name):
    oracle = json.loads((DATA / f"{name}.json").read_text())
    theta = np.zeros(oracle["n"])
    w = np.zeros(oracle["n"])
    index, value, slot = new_trace(oracle["n"])
    n = 0
    decay = 0.0
    for step, expected in zip(oracle["steps"], oracle["expected"], strict=True):
        if step["start"]:
            slot[:] = -1
            n = 0
            decay = 0.0
        n, delta, _ = gq_update(
            Learner(theta, w, index, value, slot),
            n,
            Features(*_lists(step["phi"])),
            Features(*_lists(step["phi_bar"])),
            Signal(step["r"], step["z"], 1.0, step["rho"]),
            decay,
            step["gamma"],
            step["lambda"],
            StepSizes(oracle["alpha"], oracle["beta"], 0.0, 0.0),
        )
        decay = step["gamma"] * step["lambda"]
        dense = np.zeros(oracle["n"])
        dense[index[:n]] = value[:n]
        for got, key in ((theta, "theta"), (w, "w"), (dense, "e"), (delta, "delta")):
            np.testing.assert_allclose(
                got, expected[key], rtol=0, atol=1e-12, err_msg=f"{key} at step {expected['step']}"
            )


def _dense_gq(steps, features, alpha, beta, lam):
    """The equations of White & Sutton written with dense vectors: another way to compute the
    same.
    """
    theta = np.zeros(features)
    w = np.zeros(features)
    e = np.zeros(features)
    gamma_t = 0.0
    for phi, reward, bar, gamma, rho, z, interest in steps:
        delta = reward + (1 - gamma) * z + gamma * theta @ bar - theta @ phi
        e = rho * gamma_t * lam * e + interest * phi
        old_w = w.copy()
        theta = theta + alpha * (delta * e - gamma * (1 - lam) * (old_w @ e) * bar)
        w = w + beta * (delta * e - (old_w @ phi) * phi)
        gamma_t = gamma
    return theta, w, e


def _random_steps(rng, features, count):
    steps = []
    for _ in range(count):
        phi = np.zeros(features)
        bar = np.zeros(features)
        phi[rng.choice(features, 3, replace=False)] = rng.normal(size=3)
        bar[rng.choice(features, 3, replace=False)] = rng.normal(size=3)
        steps.append(
            (
                phi,
                rng.normal(),
                bar,
                rng.choice([0.0, 0.9]),
                rng.uniform(0, 1.1),
                rng.normal(),
                rng.uniform(0.5, 1.5),
            )
        )
    return steps


@pytest.mark.parametrize(("lam", "beta"), [(0.0, 0.01), (0.5, 0.01), (1.0, 0.01), (0.7, 0.0)])
def test_sparse_kernel_equals_dense_equations_on_random_features(lam, beta):
    rng = np.random.default_rng(5)
    steps = _random_steps(rng, 12, 60)
    learner = GQ(12, 0.05, beta=beta)
    for phi, reward, bar, gamma, rho, z, interest in steps:
        active = np.flatnonzero(phi)
        active_bar = np.flatnonzero(bar)
        learner.learn(
            (active, phi[active]),
            reward,
            (active_bar, bar[active_bar]),
            gamma=gamma,
            lam=lam,
            rho=rho,
            outcome=z,
            interest=interest,
        )
    theta, w, e = _dense_gq(steps, 12, 0.05, beta, lam)
    for got, expected in ((learner.theta, theta), (learner.w, w), (learner.trace(), e)):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


def test_with_lambda_one_the_secondary_weights_have_no_influence():
    steps = _random_steps(np.random.default_rng(1), 8, 40)
    with_w = _dense_run(steps, beta=0.3, lam=1.0)
    without = _dense_run(steps, beta=0.0, lam=1.0)
    assert np.any(with_w.w != 0)
    np.testing.assert_array_equal(with_w.theta, without.theta)


def _dense_run(steps, beta, lam):
    learner = GQ(8, 0.05, beta=beta)
    for phi, reward, bar, gamma, rho, z, interest in steps:
        learner.learn(
            (np.arange(8), phi),
            reward,
            (np.arange(8), bar),
            gamma=gamma,
            lam=lam,
            rho=rho,
            outcome=z,
            interest=interest,
        )
    return learner


def test_outcome_at_a_terminal_equals_adding_it_to_the_reward():
    a, b = GQ(3, 0.1, beta=0.01), GQ(3, 0.1, beta=0.01)
    a.learn(([0], [1.0]), 0.5, ([], []), gamma=0.0, lam=0.5, rho=1.0, outcome=2.0)
    b.learn(([0], [1.0]), 2.5, ([], []), gamma=0.0, lam=0.5, rho=1.0)
    np.testing.assert_array_equal(a.theta, b.theta)


def test_one_tile_and_lambda_zero_moves_w_to_the_td_error():
    # w_i <- w_i + β (δ - w_i): with δ = 2 (θ = 0, r = 2, terminal) and β = 0.25, from w = 0: 0.5;
    # then δ = 2 - 0.2, w = 0.825
    learner = GQ(1, 0.1, beta=0.25)
    learner.learn(([0], [1.0]), 2.0, ([], []), gamma=0.0, lam=0.0, rho=1.0)
    assert learner.w[0] == pytest.approx(0.5, abs=1e-15)
    learner.begin_episode()
    learner.learn(([0], [1.0]), 2.0, ([], []), gamma=0.0, lam=0.0, rho=1.0)
    assert learner.w[0] == pytest.approx(0.5 + 0.25 * (1.8 - 0.5), abs=1e-15)


def test_rho_has_no_effect_at_lambda_zero():
    steps = _random_steps(np.random.default_rng(2), 8, 30)
    other = [(phi, r, bar, g, 7.0 * rho, z, i) for phi, r, bar, g, rho, z, i in steps]
    np.testing.assert_array_equal(
        _dense_run(steps, 0.1, 0.0).theta, _dense_run(other, 0.1, 0.0).theta
    )


def test_rho_zero_empties_the_old_trace_but_the_own_pair_still_learns():
    learner = GQ(3, 0.1)
    learner.learn(([0], [1.0]), 0.0, ([1], [1.0]), gamma=0.9, lam=0.9, rho=1.0)
    learner.learn(([1], [1.0]), -1.0, ([2], [1.0]), gamma=0.9, lam=0.9, rho=0.0)
    np.testing.assert_array_equal(learner.trace(), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(learner.theta, [0.0, -0.1, 0.0])


def test_the_terminal_error_is_credited_to_the_whole_trace():
    # trap 1: decaying with this transition's γ = 0 would wipe the trace first; e = (0.9·0.5, 1), δ
    # = 10
    learner = GQ(2, 0.1)
    learner.learn(([0], [1.0]), 0.0, ([1], [1.0]), gamma=0.9, lam=0.5, rho=1.0)
    learner.learn(([1], [1.0]), 10.0, ([], []), gamma=0.0, lam=0.5, rho=1.0)
    np.testing.assert_allclose(learner.theta, [0.1 * 10 * 0.45, 1.0])


def test_a_cut_off_drops_small_entries_and_zero_keeps_all():
    def length(cutoff):
        learner = GQ(50, 0.1, cutoff=cutoff)
        for i in range(49):
            learner.learn(([i], [1.0]), 0.0, ([i + 1], [1.0]), gamma=0.5, lam=1.0, rho=1.0)
        return np.count_nonzero(learner.trace())

    assert length(0.0) == 49
    assert length(1e-3) == 10  # 0.5^0 ... 0.5^9 = 0.00195 stay, 0.5^10 = 0.00098 goes


def test_baird_star_q_learning_diverges_and_greedy_gq_does_not():
    # facts: 7 states, solid -> state 7, dotted -> one of 1..6; behaviour solid 1/7; γ 0.99, θ = 1
    # but θ[7] = 10
    def features(state, solid):
        if not solid:
            return [7 + state + 1], [1.0]
        return ([0, state + 1], [1.0, 2.0]) if state < 6 else ([0, 7], [2.0, 1.0])

    def run(alpha, beta, lam, steps):
        rng = np.random.default_rng(0)
        learner = GQ(15, alpha, beta=beta)
        learner.theta[:] = 1.0
        learner.theta[7] = 10.0

        def q(s, a):
            index, value = features(s, a)
            return float(np.dot(learner.theta[index], value))

        state = 0
        for _ in range(steps):
            solid = rng.random() < 1 / 7
            following = 6 if solid else int(rng.integers(6))
            best = q(following, True) >= q(following, False)
            learner.learn(
                features(state, solid), 0.0, features(following, best), gamma=0.99, lam=lam, rho=1.0
            )
            state = following
        return max(abs(q(s, a)) for s in range(7) for a in (True, False))

    start = 12.0
    assert run(0.05, 0.25, 0.0, 5000) < 2.0 < start
    assert 200 < run(0.01, 0.0, 0.0, 5000) < 450  # Q-learning: β = 0; published 282 to 349
    assert run(0.01, 0.0, 0.0, 20000) > 10_000


@pytest.mark.parametrize(("beta", "lam"), [(0.0, 0.0), (0.005, 0.0), (0.5, 0.0), (0.5, 0.1)])
def test_random_walk_reaches_the_published_values(beta, lam):
    rng = np.random.default_rng(3)
    expected = np.array([0.271334, 0.430689, 0.567347, 0.715970, 0.893312])
    target = np.array([0.3, 0.7])
    behaviour = np.array([0.5, 0.5])
    learner = GQ(10, 0.01, beta=beta)
    for _ in range(10_000):
        learner.begin_episode()
        state = 2
        while True:
            action = int(rng.random() >= 0.5)
            following = state + (1 if action else -1)
            rho = target[action] / behaviour[action]
            phi = ([2 * state + action], [1.0])
            if following in (-1, 5):
                learner.learn(phi, float(following == 5), ([], []), gamma=0.0, lam=lam, rho=rho)
                break
            bar = ([2 * following, 2 * following + 1], target)
            learner.learn(phi, 0.0, bar, gamma=0.9, lam=lam, rho=rho)
            state = following
    values = learner.theta.reshape(5, 2) @ target
    np.testing.assert_allclose(values, expected, atol=0.05)
