"""How many tiles, uniform or logarithmic, for distance and for bearing?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import TILINGS
from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    both = (True, True)
    for axis, along, theta0 in (
        ("distance", (True, False), -0.1),
        ("bearing", (False, True), -0.1),
        ("both", both, -0.1),
        ("both", both, 0.0),
    ):
        for spacing in TILINGS:
            for count in (3, 5, 7, 9, 11, 13, 15):
                numbers = (count if along[0] else 9, count if along[1] else 9)
                kinds = (spacing if along[0] else "uniform", spacing if along[1] else "uniform")
                config = replace(
                    BASE, state_tiles=numbers, distance_tiling=kinds[0], bearing_tiling=kinds[1]
                )
                label = {"axis": axis, "spacing": spacing, "tiles": count, "theta0": theta0}
                cases.append((label, with_learner(config, theta0=theta0)))
    return cases


STUDY = Study("tiles", __doc__, cases)
