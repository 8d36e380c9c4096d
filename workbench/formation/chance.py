"""Chance: which generator serves which purpose, all of one seed.

One SeedSequence per formation has named children, so that what one of them draws never shifts another. What only one robot
draws, such as its calibration, has a generator of its own.

>>> float(children(1)["policy"].random()) == float(children(1)["policy"].random())
True

Contract: names are only ever added at the end; the order decides what a seed means.
"""

import numpy as np

CHILDREN = (
    "track", "sensor", "policy", "noise", "infrared", "units", "camera", "hidden", "lens", "pictures", "covered",
    "bodies", "slip", "silence",
)  # fmt: skip


def children(seed: int) -> dict[str, np.random.Generator]:
    """Return the named generators of one seed; "policy" decides when a follower explores."""
    spawned = np.random.SeedSequence(seed).spawn(len(CHILDREN))
    return {name: np.random.default_rng(child) for name, child in zip(CHILDREN, spawned, strict=True)}


def own_chance(seed: int, robot: int, purpose: str = "readings") -> np.random.Generator:
    """Return a generator of one robot's own."""
    return np.random.default_rng([seed, robot, *purpose.encode()])
