"""Behaviour policies: what to do while learning about the greedy policy.

ε-greedy over |A| actions: with probability ε any action, each alike, otherwise the greedy one. Its
importance ratio against the greedy target is ρ = 1/(1 - ε + ε/|A|) for the greedy action and 0 for
all others. One rule serves behaviour, ρ and the learning target: the greedy action is the one with
the largest value, the lowest index on ties.

>>> import numpy as np
>>> values = np.array([0.0, 2.0, 2.0, -1.0])
>>> greedy_action(values, 0, 4)
1
>>> action, rho = choose_action(values, 0, 4, 0.2, 0.9)
>>> action, round(rho, 4)
(1, 1.1765)

Contract: chance comes in as one uniform number u in [0, 1): below ε it explores, and u/ε picks the
action.
"""

from typing import Any

import numpy as np

from workbench.compiled import compiled

SCHEDULES = ("linear", "exponential", "constant")


@compiled
def greedy_action(values: Any, start: int, actions: int) -> int:
    """Return the action with the largest of values[start : start + actions], the lowest index on
    ties.
    """
    best = 0
    for action in range(1, actions):
        if values[start + action] > values[start + best]:
            best = action
    return best


@compiled
def greedy_of_sum(values: Any, starts: Any, count: int, actions: int) -> int:
    """Return the action with the largest sum of values[starts[k] + action] over the first ``count``
    starts, one per tiling.
    """
    if count == 1:
        return greedy_action(values, starts[0], actions)
    best = 0
    highest = -np.inf
    for action in range(actions):
        total = 0.0
        for k in range(count):
            total += values[starts[k] + action]
        if total > highest:
            best = action
            highest = total
    return best


@compiled
def choose_action(
    values: Any, start: int, actions: int, epsilon: float, u: float
) -> tuple[int, float]:
    """Return an ε-greedy action and its importance ratio ρ, both fixed by the values of this
    moment.
    """
    return explore(greedy_action(values, start, actions), actions, epsilon, u)


@compiled
def explore(best: int, actions: int, epsilon: float, u: float) -> tuple[int, float]:
    """Return an ε-greedy action and its importance ratio ρ where ``best`` is the greedy one."""
    action = best
    if u < epsilon:
        action = min(int(u / epsilon * actions), actions - 1)
    if action != best:
        return action, 0.0
    return action, 1.0 / (1.0 - epsilon + epsilon / actions)


@compiled
def epsilon_at(schedule: int, start: float, final: float, horizon: float, update: float) -> float:
    """Return ε after a number of updates, reaching ``final`` at ``horizon`` and staying there.

    Args:
        schedule: index into SCHEDULES; "exponential" falls geometrically and needs final > 0,
            "constant" keeps start.
        start, final: ε at update 0 and from ``horizon`` on.
        horizon: number of updates of the fall.
        update: updates done so far.
    """
    if schedule == 2:
        return start
    if update >= horizon:
        return final
    share = update / horizon
    if schedule == 1:
        epsilon: float = start * (final / start) ** share
        return epsilon
    return start + (final - start) * share
