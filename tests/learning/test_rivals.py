"""Rival learners: each against its published equations, and the identities between them."""

import numpy as np
import pytest

from tests.learning.online_sarsa import TrueOnlineSarsa
from workbench.learning.gq import GQ, GreedyGQ
from workbench.learning.kernel import Features, Learner, StepSizes, new_trace
from workbench.learning.sarsa import sarsa_update

FEATURES = 8


def _episodes(seed, count=60, end=0.1):
    """Transitions with dense features: (φ, R, φ̄ or next φ, γ', ρ), episodes end with γ' = 0."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=FEATURES) / 2
    for _ in range(count):
        over = rng.random() < end
        following = rng.normal(size=FEATURES) / 2
        yield (
            x,
            float(rng.normal()),
            following,
            0.0 if over else 0.9,
            float(rng.choice([0.0, 0.5, 1.0, 1.4])),
        )
        x = rng.normal(size=FEATURES) / 2 if over else following


def _run(stream, lam, **settings):
    learner = GQ(FEATURES, 0.05, **settings)
    everything = np.arange(FEATURES)
    for phi, reward, bar, gamma, rho in stream:
        target = (everything, bar) if gamma else ([], [])
        learner.learn((everything, phi), reward, target, gamma=gamma, lam=lam, rho=rho)
        if not gamma:
            learner.begin_episode()
    return learner


@pytest.mark.parametrize("lam", [0.0, 0.6, 1.0])
def test_without_secondary_weights_it_is_expected_sarsa_lambda_for_any_target_policy(lam):
    theta = np.zeros(FEATURES)
    e = np.zeros(FEATURES)
    decay = 0.0
    for x, reward, bar, gamma, rho in _episodes(1):
        e = rho * decay * e + x  # e = γλρe + x, θ += αδe
        theta = theta + 0.05 * (reward + gamma * theta @ bar - theta @ x) * e
        e, decay = (e, gamma * lam) if gamma else (np.zeros(FEATURES), 0.0)
    np.testing.assert_allclose(_run(_episodes(1), lam).theta, theta, rtol=0, atol=1e-12)


def test_qrc_equals_its_published_one_step_equations():
    # Ghiassian et al. 2020: θ += α (δ x - γ (h·x) x*), h += α [(δ - h·x) x - h]
    alpha = 0.05
    theta = np.zeros(FEATURES)
    h = np.zeros(FEATURES)
    for x, reward, best, gamma, _ in _episodes(2):
        delta = reward + gamma * theta @ best - theta @ x
        theta = theta + alpha * (delta * x - gamma * (h @ x) * best)
        h = h + alpha * ((delta - h @ x) * x - h)
    learner = _run(_episodes(2), 0.0, beta=0.05, kappa=1.0)
    np.testing.assert_allclose(learner.theta, theta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(learner.w, h, rtol=0, atol=1e-12)


def test_qrc_lambda_is_gq_lambda_with_minus_beta_w_added_to_the_second_update():
    lam = 0.7
    alpha = 0.05
    beta = 0.04
    theta = np.zeros(FEATURES)
    w = np.zeros(FEATURES)
    e = np.zeros(FEATURES)
    decay = 0.0
    for phi, reward, bar, gamma, rho in _episodes(3):
        delta = reward + gamma * theta @ bar - theta @ phi
        e = rho * decay * e + phi
        theta = theta + alpha * (delta * e - gamma * (1 - lam) * (w @ e) * bar)
        w = w + beta * (delta * e - (w @ phi) * phi) - beta * w
        e, decay = (e, gamma * lam) if gamma else (np.zeros(FEATURES), 0.0)
    learner = _run(_episodes(3), lam, beta=beta, kappa=1.0)
    np.testing.assert_allclose(learner.theta, theta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(learner.w, w, rtol=0, atol=1e-12)


def test_kappa_zero_is_gq_bit_by_bit_and_one_is_not():
    plain, zero, one = (
        _run(_episodes(4), 0.5, beta=0.04, **more) for more in ({}, {"kappa": 0.0}, {"kappa": 1.0})
    )
    np.testing.assert_array_equal(plain.theta, zero.theta)
    assert np.abs(plain.w - one.w).max() > 1e-3


def test_decaying_the_trace_at_the_end_of_a_step_or_at_the_start_of_the_next_is_the_same():
    lam = 0.8
    theta = np.zeros(FEATURES)
    e = np.zeros(FEATURES)
    steps = list(_episodes(5))
    rhos = [step[4] for step in steps[1:]] + [0.0]
    for (phi, reward, bar, gamma, _), rho_next in zip(steps, rhos, strict=True):
        e = e + phi
        theta = theta + 0.05 * (reward + gamma * theta @ bar - theta @ phi) * e
        e = rho_next * gamma * lam * e  # at the end, with the next step's ρ and this step's γ'
    np.testing.assert_allclose(_run(steps, lam).theta, theta, rtol=0, atol=1e-12)


def test_baird_star_qrc_stays_bounded_where_q_learning_diverges():
    def features(state, solid):
        if not solid:
            return [7 + state + 1], [1.0]
        return ([0, state + 1], [1.0, 2.0]) if state < 6 else ([0, 7], [2.0, 1.0])

    def largest(steps, **settings):
        rng = np.random.default_rng(0)
        learner = GQ(15, 0.01, **settings)
        learner.theta[:] = 1.0
        learner.theta[7] = 10.0
        state = 0
        for _ in range(steps):
            solid = rng.random() < 1 / 7
            following = 6 if solid else int(rng.integers(6))
            values = [
                learner.theta[features(following, s)[0]] @ np.array(features(following, s)[1])
                for s in (True, False)
            ]
            bar = features(following, values[0] >= values[1])
            learner.learn(features(state, solid), 0.0, bar, gamma=0.99, lam=0.0, rho=1.0)
            state = following
        return np.abs(learner.theta).max()

    assert largest(10_000) > 300  # β = 0: Q-learning, from 10
    assert largest(10_000, beta=0.01, kappa=1.0) < 15
    assert largest(60_000, beta=0.01, kappa=1.0) < 10  # on its way down


def _online_lambda_return(steps, alpha, lam):
    """The forward view for one episode (Sutton & Barto, 2nd ed., section 12.4): at every horizon
    all weights are computed anew.

    The value of the state that an n-step return ends with uses the final weights of the horizon at
    which it was reached.
    """
    final = [np.zeros(FEATURES)]
    for horizon in range(1, len(steps) + 1):
        theta = np.zeros(FEATURES)
        for t in range(horizon):
            target = 0.0
            weight = 1.0
            for n in range(1, horizon - t + 1):
                _, _, ahead, gamma = steps[t + n - 1]
                value = 0.9**n * final[t + n - 1] @ ahead if gamma else 0.0
                rewards = sum(0.9**k * steps[t + k][1] for k in range(n))
                target += (weight if n == horizon - t else weight * (1 - lam)) * (rewards + value)
                weight *= lam
            theta = theta + alpha * (target - theta @ steps[t][0]) * steps[t][0]
        final.append(theta)
    return final[-1]


@pytest.mark.parametrize("lam", [0.0, 0.5, 0.9, 1.0])
def test_true_online_sarsa_equals_the_online_lambda_return_algorithm(lam):
    rng = np.random.default_rng(6)
    xs = rng.normal(size=(9, FEATURES)) / 2
    steps = [(xs[t], float(rng.normal()), xs[t + 1], 0.9 if t < 7 else 0.0) for t in range(8)]
    expected = _online_lambda_return(steps, 0.1, lam)
    theta = np.zeros(FEATURES)
    (index, value, slot) = new_trace(FEATURES)
    n = 0
    decay = 0.0
    q_old = 0.0
    everything = np.arange(FEATURES)
    for x, reward, following, gamma in steps:
        ahead = (everything, following) if gamma else (np.zeros(0, np.int64), np.zeros(0))
        n, _, q_old = sarsa_update(
            Learner(theta, theta, index, value, slot),
            n,
            Features(everything, x),
            Features(*ahead),
            reward,
            decay,
            gamma,
            q_old,
            StepSizes(0.1, 0.0, 0.0, 0.0),
        )
        decay = gamma * lam
    np.testing.assert_allclose(theta, expected, rtol=0, atol=1e-12)


def test_without_a_trace_true_online_sarsa_is_sarsa():
    rng = np.random.default_rng(7)
    learner = TrueOnlineSarsa(4, 3, alpha=0.2, gamma=0.9, lam=0.0)
    table = np.zeros((4, 3))
    s = 0
    a = 0
    for _ in range(200):
        reward = float(rng.normal())
        s_next = int(rng.integers(4))
        a_next = int(rng.integers(3))
        table[s, a] += 0.2 * (reward + 0.9 * table[s_next, a_next] - table[s, a])
        learner.update(s, a, reward, s_next, a_next)
        s = s_next
        a = a_next
    np.testing.assert_allclose(learner.theta, table, rtol=0, atol=1e-12)


def test_true_online_sarsa_learns_the_random_walk():
    # A..E, reward 1 on leaving to the right, γ 1: the chance to end on the right, 1/6 to 5/6
    rng = np.random.default_rng(8)
    learner = TrueOnlineSarsa(5, 2, alpha=0.02, gamma=1.0, lam=0.8, theta0=0.5)
    for _ in range(4000):
        learner.begin_episode()
        s = 2
        a = int(rng.integers(2))
        while s is not None:
            moved = s + (1 if a else -1)
            a_next = int(rng.integers(2))
            over = moved in (-1, 5)
            learner.update(
                s, a, float(moved == 5), None if over else moved, None if over else a_next
            )
            s = None if over else moved
            a = a_next
    np.testing.assert_allclose(learner.theta.mean(axis=1), np.arange(1, 6) / 6, atol=0.05)


def test_bad_input_is_refused_with_the_value():
    with pytest.raises(ValueError, match="kappa = -1.0"):
        GreedyGQ(2, 2, alpha=0.1, beta=0.1, gamma=0.9, lam=0.5, kappa=-1.0)
