"""The follower: one implementation, with the update buffer's properties (L5), terminals (L4) and no
learning in a reset (X3).
"""

import numpy as np
import pytest
from numba import njit

from tests.learning.online_sarsa import TrueOnlineSarsa
from workbench.formation import follower as module
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import EXPLORED, LEARNED, LOSS, RECOVERED
from workbench.formation.records import PERIOD, ROBOT
from workbench.formation.reset import APPROACH, FOLLOW, TURN
from workbench.learning.config import LearnerConfig
from workbench.learning.gq import GQ, GreedyGQ
from workbench.learning.kernel import new_trace


@njit
def _act(task, follower, step, memory, seen, explore):
    follower[0].seen.distance, follower[0].seen.bearing = seen
    learning = follower[0].learning
    learning.epsilon, learning.chance, learning.room = explore
    return module.act(task[0], follower[0], step[0], memory)


@njit
def _learn(task, follower, memory):
    return module.learn(task[0], follower[0], memory)


class _Robot:
    """One follower outside a convoy, driven observation by observation, as a loop on a real robot
    would.
    """

    def __init__(self, tilings=1, **learner):
        self.config = ConvoyConfig(
            followers=1, drive="planar", tilings=tilings, learner=LearnerConfig(**learner)
        )
        self.task = Convoy(self.config, [1], steps=1000).task
        pairs = self.config.rows * self.config.action_count
        self.follower = np.zeros(1, ROBOT)
        self.step = np.zeros(1, PERIOD)
        self.follower["choice"]["state"] = -1
        self.follower["learning"]["learns"] = 1
        self.weights = np.zeros((2, pairs))
        self.weights[0] = self.config.learner.theta0 / tilings
        empty = new_trace(pairs)
        self.ids = np.stack([empty[0], empty[2], empty[0]])
        self.values = np.stack([empty[1], empty[1]])

    def act(self, distance, bearing, epsilon=0.0, u=0.99, room=True):
        memory = module.Memory(self.weights, self.ids, self.values)
        seen = (float(distance), float(bearing))
        explore = (float(epsilon), float(u), int(room))
        arrays = (self.task, self.follower, self.step, memory)
        left, right, finite = _act(*arrays, seen, explore)
        assert finite
        return left, right

    def learn(self):
        memory = module.Memory(self.weights, self.ids, self.values)
        assert _learn(self.task, self.follower, memory)


def _cells(config, distance, bearing):
    """Rows of the weight table that are active in an observation, found without the follower's
    code.
    """
    rows = []
    first = 0
    for grid in config.grids():
        rows.append(first + grid.index(distance - config.middle_m, bearing))
        first += grid.n
    return rows


def _walk(count, seed=0):
    """Observations that wander inside the bounds and now and then beyond."""
    rng = np.random.default_rng(seed)
    distance = 0.15
    bearing = 0.0
    for _ in range(count):
        distance = float(np.clip(distance + rng.normal(0, 0.02), 0.075, 0.23))
        bearing = float(np.clip(bearing + rng.normal(0, 0.15), -0.8, 0.8))
        yield distance, bearing, float(rng.random())


@pytest.mark.parametrize("buffer", [True, False])
def test_followers_and_the_public_class_learn_the_same_bits(buffer):
    robot = _Robot(buffer=buffer, epsilon=0.3, gamma=0.7, lam=0.6)
    learner = robot.config.learner
    twin = GreedyGQ(
        81,
        49,
        alpha=learner.alpha,
        beta=learner.beta,
        gamma=0.7,
        lam=0.6,
        cutoff=1e-8,
        theta0=learner.theta0,
    )
    learned = 0
    for distance, bearing, u in _walk(600):
        robot.act(distance, bearing, epsilon=0.3, u=u)
        waiting = robot.follower[0].copy()
        step = robot.step[0]
        robot.learn()
        if step["event"] & LEARNED:
            state = int(step["state"])
            action = int(step["action"])
            following = None if step["event"] & LOSS else int(waiting["waiting"]["next_state"])
            twin.update(
                state,
                action,
                float(waiting["waiting"]["reward"]),
                following,
                rho=float(waiting["waiting"]["rho"]),
            )
            learned += 1
            if following is None:
                twin.begin_episode()
    assert learned > 150
    np.testing.assert_array_equal(robot.weights[0], twin.theta.ravel())
    np.testing.assert_array_equal(robot.weights[1], twin.w.ravel())


def test_with_several_tilings_followers_learn_the_bits_of_gq_on_lists_of_features():
    robot = _Robot(tilings=4, epsilon=0.3, gamma=0.7, lam=0.6)
    config = robot.config
    learner = robot.config.learner
    twin = GQ(
        config.rows * 49,
        learner.alpha / 4,
        beta=learner.beta / 4,
        cutoff=1e-8,
        theta0=learner.theta0 / 4,
    )
    before = None
    learned = 0
    for distance, bearing, u in _walk(600):
        robot.act(distance, bearing, epsilon=0.3, u=u)
        step = robot.step[0]
        waiting = robot.follower[0].copy()
        robot.learn()
        if step["event"] & LEARNED:
            phi = np.array(before) * 49 + int(step["action"])
            gamma = 0.7
            bar = np.zeros(0, int)
            if step["event"] & LOSS:
                gamma = 0.0
            else:
                now = np.array(_cells(config, distance, bearing)) * 49
                bar = now + int(np.argmax(sum(twin.theta[start : start + 49] for start in now)))
            twin.learn(
                (phi, np.ones(4)),
                float(waiting["waiting"]["reward"]),
                (bar, np.ones(bar.size)),
                gamma=gamma,
                lam=0.6,
                rho=float(waiting["waiting"]["rho"]),
            )
            learned += 1
            if step["event"] & LOSS:
                twin.begin_episode()
        before = _cells(config, distance, bearing)
    assert learned > 150
    np.testing.assert_array_equal(robot.weights[0], twin.theta)
    np.testing.assert_array_equal(robot.weights[1], twin.w)


@pytest.mark.parametrize("tilings", [1, 4])
@pytest.mark.parametrize("rule", ["watkins-q", "expected-sarsa", "qrc"])
def test_rival_rules_are_settings_of_the_kernel_bit_by_bit(rule, tilings):
    epsilon = 0.3
    eta = 1.0
    robot = _Robot(tilings=tilings, rule=rule, eta=eta, epsilon=epsilon, gamma=0.7, lam=0.6)
    config = robot.config
    learner = robot.config.learner
    correction = {"qrc": {"beta": learner.alpha * eta / tilings, "kappa": 1.0}}.get(rule, {})
    twin = GQ(
        config.rows * 49,
        learner.alpha / tilings,
        cutoff=1e-8,
        theta0=learner.theta0 / tilings,
        **correction,
    )
    before = None
    choice = None
    learned = 0
    greedy_steps = 0
    for distance, bearing, u in _walk(600, seed=11):
        robot.act(distance, bearing, epsilon=epsilon, u=u)
        step = robot.step[0].copy()
        robot.learn()
        now = (
            np.array(_cells(config, distance, bearing)) * 49
            if robot.follower["choice"]["state"][0] >= 0
            else None
        )
        lost = bool(step["event"] & LOSS)
        if step["event"] & LEARNED:
            gamma = 0.7
            bar = np.zeros(0, int)
            values = np.zeros(0)
            if lost:
                gamma = 0.0
            else:
                best = int(np.argmax(sum(twin.theta[start : start + 49] for start in now)))
                bar = now + best
                values = np.ones(tilings)
                if rule == "expected-sarsa":
                    bar = (now[:, None] + np.arange(49)).ravel()
                    chances = np.full(49, epsilon / 49)
                    chances[best] += 1 - epsilon
                    values = np.tile(chances, tilings)
            greedy = choice == before[1]
            ratio = {"watkins-q": float(greedy), "expected-sarsa": 1.0}.get(
                rule, greedy / (1 - epsilon + epsilon / 49)
            )
            phi = (before[0] + choice, np.ones(tilings))
            twin.learn(
                phi,
                float(robot.follower["waiting"]["reward"][0]),
                (bar, values),
                gamma=gamma,
                lam=0.6,
                rho=ratio,
            )
            greedy_steps += greedy
            learned += 1
            if lost:
                twin.begin_episode()
        if now is not None:
            # the choice was made before learning: with the weights of then, which the robot's own
            # flag tells greedy or not
            choice = int(robot.follower["choice"]["action"][0])
            before = (now, choice if not step["event"] & EXPLORED else -1)
    assert learned > 150 and 0.3 < greedy_steps / learned < 0.95
    np.testing.assert_array_equal(robot.weights[0], twin.theta)
    np.testing.assert_array_equal(robot.weights[1], twin.w)


def test_followers_and_true_online_sarsa_learn_the_same_bits():
    robot = _Robot(rule="true-online-sarsa", epsilon=0.3, gamma=0.7, lam=0.6)
    learner = robot.config.learner
    twin = TrueOnlineSarsa(
        81, 49, alpha=learner.alpha, gamma=0.7, lam=0.6, cutoff=1e-8, theta0=learner.theta0
    )
    learned = 0
    for distance, bearing, u in _walk(600, seed=12):
        robot.act(distance, bearing, epsilon=0.3, u=u)
        step = robot.step[0].copy()
        waiting = robot.follower[0].copy()
        robot.learn()
        if step["event"] & LEARNED:
            over = bool(step["event"] & LOSS)
            following = (None, None)
            if not over:
                now = waiting["choice"]
                following = (int(now["state"]), int(now["action"]))
            twin.update(
                int(step["state"]),
                int(step["action"]),
                float(waiting["waiting"]["reward"]),
                *following,
            )
            learned += 1
            if over:
                twin.begin_episode()
    assert learned > 150
    np.testing.assert_array_equal(robot.weights[0], twin.theta.ravel())


def test_random_actions_are_marked_and_greedy_ones_are_not():
    robot = _Robot(epsilon=0.5, gamma=0.5)
    robot.act(0.15, 0.0, epsilon=0.5, u=0.25)  # explores: action 24 of 49
    assert robot.step["event"][0] & EXPLORED and robot.follower["choice"]["action"][0] == 24
    robot.act(
        0.15, 0.0, epsilon=0.5, u=0.0
    )  # explores too, but hits the greedy action, the lowest on ties
    assert not robot.step["event"][0] & EXPLORED
    robot.act(0.15, 0.0, epsilon=0.5, u=0.9)
    assert not robot.step["event"][0] & EXPLORED


def _spoil(buffer):
    """Make the greedy action so bad that learning it would change the next choice in the same
    state.
    """
    robot = _Robot(buffer=buffer, theta0=0.0)
    robot.act(0.15, 0.0)
    first = int(robot.follower["choice"]["action"][0])
    robot.act(0.151, 0.01)  # same tile; the reward just now was negative
    return robot, first, int(robot.follower["choice"]["action"][0])


def test_with_the_buffer_action_t_plus_1_uses_weights_without_transition_t():
    robot, first, second = _spoil(buffer=True)
    assert second == first
    assert robot.weights[0].min() == 0.0  # not learned yet
    robot.learn()
    assert robot.weights[0].min() < 0.0
    robot, first, second = _spoil(buffer=False)
    assert second == first + 1  # learned at once: the next action in order is now greedy


def test_buffered_and_immediate_updates_of_a_fixed_stream_are_bit_identical():
    # force the same actions: explore always, with the same u; ρ is then 0 or fixed by θ of the
    # choice, so fix it to 0
    results = []
    for buffer in (True, False):
        robot = _Robot(buffer=buffer, epsilon=0.1, gamma=0.5)
        for distance, bearing, u in _walk(400, seed=3):
            robot.act(distance, bearing, epsilon=1.0, u=u)
            robot.follower["choice"]["rho"] = 0.9
            robot.learn()
        results.append(robot.weights.copy())
    assert np.count_nonzero(results[0][1]) > 100
    np.testing.assert_array_equal(*results)


def test_rho_is_frozen_at_the_choice_even_if_the_table_changes_afterwards():
    robot = _Robot(epsilon=0.1)
    robot.act(0.15, 0.0, epsilon=0.1, u=0.5 * 0.1)  # explores: action 24 of 49
    assert robot.follower["choice"]["action"][0] == 24 and robot.follower["choice"]["rho"][0] == 0.0
    robot.weights[0, 40 * 49 + 24] = 5.0  # another follower writes: the action is greedy now
    robot.act(0.15, 0.0, epsilon=0.1, u=0.9)
    assert robot.follower["waiting"]["rho"][0] == 0.0
    robot.act(0.15, 0.0, epsilon=0.1, u=0.9)
    assert robot.follower["waiting"]["rho"][0] == pytest.approx(1 / (1 - 0.1 + 0.1 / 49))


def test_a_terminal_is_learned_once_with_no_discount_and_the_trace_is_cleared():
    robot = _Robot()
    robot.act(0.15, 0.0)
    robot.act(0.15, 0.0)
    robot.learn()
    robot.act(0.30, 0.0)
    assert robot.step["event"][0] & LOSS and robot.step["phase"][0] in (TURN, APPROACH)
    assert robot.follower["waiting"]["next_state"][0] == -1 and robot.follower["waiting"]["reward"][
        0
    ] == pytest.approx(-2 / (1 - 0.8))
    waiting = robot.follower["waiting"][0]
    pair = int(waiting["cells"][0]) + int(waiting["action"])
    before = robot.weights[0, pair]
    assert robot.ids[1, pair] >= 0  # the pair is in the trace
    robot.learn()
    assert robot.follower["learning"]["delta"][0] == pytest.approx(
        -10 - before
    )  # γ = 0: δ = R - θφ
    assert robot.weights[0, pair] < before
    after = robot.weights.copy()
    robot.learn()
    np.testing.assert_array_equal(robot.weights, after)
    assert robot.follower["learning"]["trace"][0] == 0 and np.all(robot.ids[1] == -1)


@pytest.mark.parametrize("buffer", [True, False])
def test_a_discount_of_zero_is_no_terminal(buffer):
    robot = _Robot(gamma=0.0, buffer=buffer)
    for period in range(20):
        robot.act(0.15, 0.0)
        assert period == 0 or robot.step["event"][0] & LEARNED
        robot.learn()


def test_nothing_is_learned_or_counted_during_a_reset():
    robot = _Robot()
    robot.act(0.15, 0.0)
    robot.act(0.30, 0.0)
    robot.learn()
    weights = robot.weights.copy()
    for distance in (0.29, 0.26, 0.22, 0.18):
        robot.act(distance, 0.0)
        robot.learn()
        assert robot.step["state"][0] == -1 and not robot.step["event"][0] & LEARNED
    np.testing.assert_array_equal(robot.weights, weights)
    robot.act(0.16, 0.0)  # within a third of the half range: a new episode
    assert robot.step["event"][0] & RECOVERED and robot.step["phase"][0] == FOLLOW
    robot.act(0.16, 0.0)
    robot.learn()
    assert robot.follower["learning"]["trace"][0] == 1  # the trace began anew


def test_a_used_up_budget_stops_learning_and_counting():
    robot = _Robot()
    robot.act(0.15, 0.0)
    robot.act(0.15, 0.0, room=False)
    assert robot.step["state"][0] == -1 and robot.follower["waiting"]["any"][0] == 0


def test_an_exploiting_follower_learns_nothing():
    robot = _Robot()
    robot.follower["learning"]["learns"] = 0
    robot.weights[0] = np.random.default_rng(0).normal(size=robot.weights.shape[1])
    weights = robot.weights.copy()
    for distance, bearing, u in _walk(100):
        robot.act(distance, bearing, epsilon=0.0, u=u)
        robot.learn()
    np.testing.assert_array_equal(robot.weights, weights)


def test_learning_that_diverges_is_reported():
    robot = _Robot()
    robot.act(0.15, 0.0)
    robot.act(0.15, 0.0)
    robot.weights[0, 40 * 49 : 41 * 49] = 1.7e308
    # δ = γ 1.7e308 + 1.7e308 overflows
    robot.weights[0, 40 * 49 + int(robot.follower["waiting"]["action"][0])] = -1.7e308
    memory = module.Memory(robot.weights, robot.ids, robot.values)
    assert not _learn(robot.task, robot.follower, memory)
