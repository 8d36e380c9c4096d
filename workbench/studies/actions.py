"""How many speed levels, over which range?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE


def cases() -> Sequence[Case]:
    """Return the conditions."""
    levels = [("levels", f"{n}×{n}", replace(BASE, action_levels=(n, n))) for n in (3, 5, 7, 9, 11)]
    ranges = [
        (
            "range",
            f"{1000 * low:.0f}–{1000 * high:.0f} mm/s",
            replace(BASE, wheel_speed_mps=(low, high)),
        )
        for low, high in (
            (0.0, 0.12),
            (0.015, 0.105),
            (0.03, 0.09),
            (0.045, 0.075),
            (0.0525, 0.0675),
        )
    ]
    settings = [
        ("setting", name, replace(SETTINGS[name], drive="planar"))
        for name in ("paper", "paper-robot")
    ]
    return [
        ({"factor": factor, "level": level}, config)
        for factor, level, config in levels + ranges + settings
    ]


STUDY = Study("actions", __doc__, cases)
