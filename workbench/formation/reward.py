"""Reward presets. The paper gives no reward function: every preset is our choice and none is "the
paper's".

With u = e_d / e_max and v = o_err / o_max, both in [-1, 1] inside the bounds:

    quadratic   -(u² + v²)         both errors, the default
    absolute    -(|u| + |v|)       both errors, steep at the optimum
    distance    -u²                the bearing is free inside its bounds
    alive       1 - (u² + v²) / 2  never negative; ends with the episode

Losing the leader must never pay. The terminal reward is ``factor`` times the worst step reward
divided by (1 - γ): with factor >= 1 no sum of discounted step rewards is worse than losing. Where
step rewards are never negative, the worst is 0 and so is the terminal reward: ending forgoes
everything that would follow.

>>> terminal_reward(worst_step_reward("quadratic"), 0.8, 1.0)
-10.0
>>> round(step_reward(PRESETS.index("quadratic"), 0.5, -0.5), 2)
-0.5
"""

import math

from workbench.compiled import compiled

PRESETS = ("quadratic", "absolute", "distance", "alive")
OWN = "own"  # a function of the user's, see formation.own_reward
GRAPH = "graph"  # on distances between robots, see formation.graph
_WORST = {"quadratic": -2.0, "absolute": -2.0, "distance": -1.0, "alive": 0.0}


@compiled
def step_reward(preset: int, u: float, v: float) -> float:
    """Return the reward of a step that ends inside the bounds, for a preset given by its place in
    PRESETS.
    """
    if preset == 0:
        return -(u * u + v * v)
    if preset == 1:
        return -(abs(u) + abs(v))
    if preset == 2:
        return -u * u
    if preset == 3:
        return 1.0 - (u * u + v * v) / 2.0
    return math.nan  # the user's own, where its function was not given


def terminal_reward(worst: float, gamma: float, factor: float) -> float:
    """Return the reward of losing the leader: factor times the worst step reward, if that is
    negative, over (1 - γ).
    """
    return round(factor * min(worst, 0.0) / (1.0 - gamma), 12) + 0.0


def worst_step_reward(preset: str) -> float:
    """Return the smallest reward that a step inside the bounds can have."""
    return _WORST[preset]
