"""Greedy-GQ(λ) as an object: oracle, identities, refusals, state, and the update buffer."""

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.lab.storage import read_npz, write_npz
from workbench.learning.gq import GQ, GreedyGQ

DATA = Path(__file__).parents[1] / "data"


def test_class_equals_the_oracle_after_every_step():
    oracle = json.loads((DATA / "trace6_greedy_control.json").read_text())
    learner = GreedyGQ(
        oracle["nS"],
        oracle["nA"],
        alpha=oracle["alpha"],
        beta=oracle["beta"],
        gamma=oracle["gamma"],
        lam=oracle["lambda"],
    )
    for step, expected in zip(oracle["steps"], oracle["expected"], strict=True):
        if step["start"]:
            learner.begin_episode()
        rho = 1 / step["mu"] if step["a"] == learner.greedy(step["s"]) else 0.0
        learner.update(step["s"], step["a"], step["r"], step["sn"], rho=rho)
        for got, key in (
            (learner.theta, "theta"),
            (learner.w, "w"),
            (learner.trace(), "e"),
            (learner.delta, "delta"),
        ):
            wanted = (
                np.reshape(expected[key], (oracle["nA"], oracle["nS"])).T
                if key != "delta"
                else expected[key]
            )
            np.testing.assert_allclose(
                got, wanted, rtol=0, atol=1e-12, err_msg=f"{key} at step {expected['step']}"
            )


def _stream(count, seed=0, states=6, actions=3):
    rng = np.random.default_rng(seed)
    return [
        (
            int(rng.integers(states)),
            int(rng.integers(actions)),
            float(rng.normal()),
            None if rng.random() < 0.1 else int(rng.integers(states)),
            float(rng.choice([0.0, 1.05])),
        )
        for _ in range(count)
    ]


def _learner(beta=0.01, lam=0.7, cutoff=0.0):
    return GreedyGQ(6, 3, alpha=0.1, beta=beta, gamma=0.9, lam=lam, cutoff=cutoff)


def _play(learner, stream):
    learner.begin_episode()
    for s, a, r, s_next, rho in stream:
        learner.update(s, a, r, s_next, rho=rho)
        if s_next is None:
            learner.begin_episode()
    return learner


def test_without_secondary_weights_and_rho_zero_or_one_it_is_watkins_q_lambda():
    alpha = 0.1
    gamma = 0.9
    lam = 0.7
    theta = np.zeros((6, 3))
    e = np.zeros((6, 3))
    learner = _learner(beta=0.0)
    learner.begin_episode()
    for s, a, r, s_next, _ in _stream(400, seed=4):
        greedy = a == int(np.argmax(theta[s]))
        e = (
            gamma * lam * e if greedy else np.zeros_like(e)
        )  # Watkins: cut where the action was not greedy
        e[s, a] += 1
        delta = r + (0 if s_next is None else gamma * theta[s_next].max()) - theta[s, a]
        learner.update(s, a, r, s_next, rho=float(greedy))
        theta = theta + alpha * delta * e
        np.testing.assert_allclose(learner.theta, theta, rtol=0, atol=1e-12)
        if s_next is None:
            e[:] = 0
            learner.begin_episode()


def test_a_time_limit_is_not_a_terminal():
    cut = _learner()
    ended = _learner()
    for learner in (cut, ended):
        learner.theta[:] = 1.0
        learner.begin_episode()
    cut.update(0, 0, 0.0, 1, rho=1.0)
    ended.update(0, 0, 0.0, None, rho=1.0)
    assert cut.theta[0, 0] == pytest.approx(1 + 0.1 * (0.9 - 1))
    assert ended.theta[0, 0] == pytest.approx(1 - 0.1)


def test_begin_episode_clears_the_trace():
    learner = _play(_learner(), _stream(7))
    learner.begin_episode()
    assert not learner.trace().any()


def test_ties_go_to_the_lowest_action_and_rho_is_fixed_at_the_choice():
    learner = _learner()
    assert learner.greedy(0) == 0
    rng = np.random.default_rng(0)
    chosen = [learner.act(0, rng, epsilon=0.3) for _ in range(4000)]
    assert {rho for action, rho in chosen if action == 0} == {1 / (1 - 0.3 + 0.3 / 3)}
    assert {rho for action, rho in chosen if action != 0} == {0.0}
    share = np.mean([action == 0 for action, _ in chosen])
    assert share == pytest.approx(0.8, abs=0.03)


def test_sparse_trace_with_a_tiny_cut_off_stays_within_rounding_of_the_full_one():
    full = _play(_learner(), _stream(3000))
    culled = _play(_learner(cutoff=1e-12), _stream(3000))
    np.testing.assert_allclose(full.theta, culled.theta, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: GQ(0, 0.1), "features = 0"),
        (lambda: GQ(3, 0.0), "alpha = 0.0; expected a finite number above 0"),
        (lambda: GQ(3, float("nan")), "alpha = nan"),
        (lambda: GQ(3, 0.1, beta=-1.0), "beta = -1.0"),
        (lambda: GQ(3, 0.1, cutoff=-1.0), "cutoff = -1.0"),
        (lambda: GQ(3, 0.1, theta0=float("inf")), "theta0 = inf"),
        (lambda: GreedyGQ(0, 3, alpha=0.1, beta=0, gamma=0.9, lam=0), "states = 0"),
        (lambda: GreedyGQ(3, 3, alpha=0.1, beta=0, gamma=1.5, lam=0), "gamma = 1.5"),
        (lambda: GreedyGQ(3, 3, alpha=0.1, beta=0, gamma=0.9, lam=-1), "lam = -1"),
        (
            lambda: _learner().update(6, 0, 0.0, 1, rho=1.0),
            "state 6; the learner has states 0 to 5",
        ),
        (
            lambda: _learner().update(0, 3, 0.0, 1, rho=1.0),
            "action 3; the learner has actions 0 to 2",
        ),
        (lambda: _learner().update(0, 0, 0.0, -1, rho=1.0), "state -1"),
        (lambda: _learner().update(0, 0, float("nan"), 1, rho=1.0), "reward = nan"),
        (lambda: _learner().update(0, 0, 0.0, 1, rho=-0.5), "rho = -0.5"),
        (
            lambda: GQ(3, 0.1).learn(([5], [1.0]), 0.0, ([], []), gamma=0, lam=0, rho=1),
            r"phi indices are \[5\]; .* features 0 to 2",
        ),
        (
            lambda: GQ(3, 0.1).learn(([0], [1.0]), 0.0, ([-1], [1.0]), gamma=0, lam=0, rho=1),
            r"phi_bar indices are \[-1\]",
        ),
        (
            lambda: GQ(3, 0.1).learn(([0, 1], [1.0]), 0.0, ([], []), gamma=0, lam=0, rho=1),
            "phi has 2 indices and 1 values",
        ),
        (lambda: _learner().act(0, np.random.default_rng(0), epsilon=1.5), "epsilon = 1.5"),
    ],
)
def test_bad_input_is_refused_with_the_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_divergence_is_an_error_with_step_norm_and_step_size():
    learner = GQ(1, 1.0)
    with (
        pytest.raises(
            FloatingPointError, match=r"diverged at update \d+: \|theta\| = .* alpha = 1"
        ),
        np.errstate(all="ignore"),
    ):
        for _ in range(2000):
            learner.learn(([0], [1.0]), 1.0, ([0], [3.0]), gamma=0.9, lam=0.0, rho=1.0)


@pytest.mark.parametrize("cut", [1, 57, 199])
def test_stop_save_load_continue_equals_never_stopping(tmp_path, cut):
    stream = _stream(200, seed=9)
    whole = _learner(cutoff=1e-8)
    part = _learner(cutoff=1e-8)
    whole.begin_episode(), part.begin_episode()
    for k, (s, a, r, s_next, rho) in enumerate(stream):
        whole.update(s, a, r, s_next, rho=rho)
        if k == cut:
            write_npz(
                tmp_path / "state.npz",
                {name: np.array(value) for name, value in part.state().items()},
            )
            part = _learner(cutoff=1e-8)
            part.load(read_npz(tmp_path / "state.npz"))
        part.update(s, a, r, s_next, rho=rho)
    for name, value in whole.state().items():
        np.testing.assert_array_equal(value, part.state()[name], err_msg=name)


def test_weights_load_without_pickle(tmp_path):
    np.savez(tmp_path / "w.npz", **_learner().state())
    with np.load(tmp_path / "w.npz", allow_pickle=False) as file:
        assert file["theta"].shape == (6, 3) and str(file["kind"]) == "GreedyGQ"


def test_a_state_of_another_learner_is_refused_and_changes_nothing():
    learner = _play(_learner(), _stream(5))
    before = learner.theta.copy()
    other = GreedyGQ(6, 4, alpha=0.1, beta=0.01, gamma=0.9, lam=0.7)
    with pytest.raises(
        ValueError, match=r"state\['theta'\] is \(6, 4\), this learner has \(6, 3\)"
    ):
        learner.load(other.state())
    with pytest.raises(ValueError, match=r"state\['gamma'\] is 0.5"):
        learner.load(GreedyGQ(6, 3, alpha=0.1, beta=0.01, gamma=0.5, lam=0.7).state())
    for broken in (np.array([99]), np.array([0, 0])):
        bad = learner.state() | {"trace_index": broken, "trace_value": np.ones(broken.size)}
        with pytest.raises(ValueError, match="trace"):
            learner.load(bad | {"theta": before + 1})
    with pytest.raises(ValueError, match="state lacks"):
        learner.load({"theta": before})
    np.testing.assert_array_equal(learner.theta, before)


def test_fractions_and_masks_are_no_indices():
    table = GreedyGQ(3, 2, alpha=0.5, beta=0.0, gamma=0.9, lam=0.9)
    with pytest.raises(ValueError, match=r"state 1.9; the learner has states 0 to 2"):
        table.update(1.9, 0, 1.0, 2, rho=1.0)
    table.update(np.int64(1), 0, 1.0, 2, rho=1.0)
    learner = GQ(3, 0.5)
    for index, message in (
        (
            np.array([False, True, False]),
            r"of type bool; expected whole numbers",
        ),
        ([1.9], r"of type float64; expected whole numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            learner.learn((index, np.ones(len(index))), 1.0, ([], []), gamma=0.0, lam=0.0, rho=1.0)
    assert not learner.theta.any()
