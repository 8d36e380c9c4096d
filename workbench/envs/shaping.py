"""Rewards for progress, as multi-agent benchmarks have them, to compare learners with those there:

    shaping          100 for every metre that a follower has come nearer to its place, -10 while it
                     touches another robot
    shared-shaping   the progress of all together, for each; its own -10

The place is that of the moment: with a shape it sets out from where the follower stands and moves
to where it is asked at its own speed, so that what is rewarded is to stay on it. A follower of the
robot in front is as far from its place as that robot is from the point d* straight ahead.

Factors are those of the scenario ``passage`` of VMAS (public repository
proroklab/VectorizedMultiAgentSimulator), whose robots are as large as e-pucks in its units; the
rest of the environment is ours. Losing the leader ends an episode without a terminal reward.

Contract: nothing is written; arrays are (B, followers).
"""

import numpy as np
from numpy.typing import NDArray

from workbench.formation.convoy import Convoy

REWARDS = ("shaping", "shared-shaping")
PER_METRE = 100.0
TOUCHING = -10.0

Floats = NDArray[np.float64]


def far_m(convoy: Convoy, distance: Floats, bearing: Floats) -> Floats:
    """Return how far followers are from their places, m.

    Args:
        distance, bearing: of the robot in front, m and rad; not needed with a shape.
    """
    if convoy.config.formation.shaped:
        pose = convoy.robots["pose"][:, 1:]
        here = np.stack([pose["x"], pose["y"]], axis=-1)
        apart: Floats = np.linalg.norm(convoy.places - here, axis=-1)
        return apart
    square = distance**2 + convoy.config.middle_m**2
    return np.sqrt(np.maximum(square - 2 * distance * convoy.config.middle_m * np.cos(bearing), 0))


def progress(name: str, before: Floats, now: Floats, touching: NDArray[np.bool_]) -> Floats:
    """Return the rewards of a step from these distances to those.

    >>> nobody = np.zeros((1, 2), bool)
    >>> step = np.array([[0.03, 0.05]]), np.array([[0.02, 0.06]])
    >>> [progress(name, *step, nobody).round(6) + 0.0 for name in REWARDS]
    [array([[ 1., -1.]]), array([[0., 0.]])]
    """
    nearer = PER_METRE * (before - now)
    if name == "shared-shaping":
        nearer = np.broadcast_to(nearer.sum(axis=1, keepdims=True), nearer.shape)
    return nearer + TOUCHING * touching
