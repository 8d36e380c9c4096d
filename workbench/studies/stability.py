"""Do robots stabilise from the first on (E4)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.studies.motion_trials import measure_stability


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"setting": name}, replace(SETTINGS[name], drive="planar"))
        for name in ("paper", "recommended")
    ]


STUDY = Study("stability", __doc__, cases, seeds=30, function=measure_stability, steps=1_300_000)
