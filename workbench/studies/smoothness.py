"""Is the path a smoothed variant, more so with learning (E5, E6)?"""

from collections.abc import Sequence

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.studies.conditions import HORIZON
from workbench.studies.motion_trials import measure_motion


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for name in ("paper", "recommended"):
        for updates in (0, 1_000, 10_000, 100_000, HORIZON):
            trial = Trial(config=SETTINGS[name], steps=updates, horizon=HORIZON, minutes=20.0)
            cases.append(({"setting": name, "updates": updates}, trial))
    return cases


STUDY = Study("smoothness", __doc__, cases, function=measure_motion)
