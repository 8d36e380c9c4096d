"""Behaviour policies: distribution, ratio, ties and schedules."""

import numpy as np
import pytest

from workbench.learning.behaviour import SCHEDULES, choose_action, epsilon_at, greedy_action


def test_exploration_is_uniform_over_all_actions_and_ratios_average_to_one():
    values = np.array([0.0, 0.0, 3.0, 1.0, 2.0])
    epsilon = 0.5
    actions = 5
    chosen = [
        choose_action(values, 0, actions, epsilon, u) for u in (np.arange(100_000) + 0.5) / 100_000
    ]
    counts = np.bincount([a for a, _ in chosen], minlength=actions) / len(chosen)
    np.testing.assert_allclose(counts, [0.1, 0.1, 0.6, 0.1, 0.1], atol=1e-4)
    assert np.mean([rho for _, rho in chosen]) == pytest.approx(1.0, abs=1e-4)  # E_b[π/b] = 1


def test_greedy_reads_the_row_that_starts_at_the_given_place():
    values = np.array([9.0, 0.0, 1.0, 1.0])
    assert greedy_action(values, 1, 3) == 1  # 1.0 first at offset 1; ties to the lowest
    assert choose_action(values, 1, 3, 0.0, 0.0) == (1, 1.0)


@pytest.mark.parametrize(
    ("name", "middle"), [("linear", 0.055), ("exponential", np.sqrt(0.1 * 0.01)), ("constant", 0.1)]
)
def test_schedules_start_fall_and_stay(name, middle):
    kind = SCHEDULES.index(name)
    values = [epsilon_at(kind, 0.1, 0.01, 100.0, float(t)) for t in (0, 50, 100, 1000)]
    end = 0.1 if name == "constant" else 0.01
    np.testing.assert_allclose(values, [0.1, middle, end, end], rtol=1e-12)
