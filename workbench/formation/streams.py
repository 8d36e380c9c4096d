"""Chance: which generator serves which purpose, all of one seed.

One SeedSequence per formation has named children, so that what one of them draws never shifts
another. What only one robot draws, such as its calibration, has a generator of its own. Who the
robots are, FLEET, can have a seed apart from what happens to them: the same robots on another
track, or other robots on the same one.

>>> float(children(1)["policy"].random()) == float(children(1)["policy"].random())
True

Contract: names are only ever added at the end; the order decides what a seed means.
"""

import numpy as np

CHILDREN = (
    "track",
    "sensor",
    "policy",
    "noise",
    "infrared",
    "units",
    "camera",
    "hidden",
    "lens",
    "pictures",
    "covered",
    "bodies",
    "slip",
    "silence",
    "places",
    "board",
    "messages",
)
FLEET = (
    "units",
    "bodies",
    "lens",
)  # sensors, wheels and axles, and the camera that hangs over them


def children(seed: int, fleet: int = 0) -> dict[str, np.random.Generator]:
    """Return the named generators of one seed, those of FLEET of another unless it is 0; "policy"
    decides who explores when.
    """
    own, other = (
        dict(zip(CHILDREN, np.random.SeedSequence(number).spawn(len(CHILDREN)), strict=True))
        for number in (seed, fleet or seed)
    )
    return {
        name: np.random.default_rng(other[name] if name in FLEET else own[name])
        for name in CHILDREN
    }


def own_chance(seed: int, robot: int, purpose: str = "readings") -> np.random.Generator:
    """Return a generator of one robot's own."""
    return np.random.default_rng([seed, robot, *purpose.encode()])
