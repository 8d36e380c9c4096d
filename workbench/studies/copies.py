"""Do the first follower's weights serve all others (E7)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.studies.conditions import OTHER, ROBOT, with_infrared
from workbench.studies.transfer_trials import (
    measure_copies,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    infrared = replace(
        SETTINGS["infrared"], drive="planar", state_tiles=(5, 5), action_levels=(3, 3)
    )
    settings = {
        "paper, on wheels": (SETTINGS["paper"], 400_000),
        "paper-robot, camera": (replace(ROBOT, sensing="camera"), 400_000),
        "recommended": (replace(SETTINGS["recommended"], drive="planar"), 400_000),
    } | {f"5×5/3×3, {route}": (replace(infrared, sensing=route), 200_000) for route in INFRARED}
    cases: list[Case] = []
    for name, (config, steps) in settings.items():
        for robots in ("alike", "different"):
            fleet = (
                replace(with_infrared(config, gain_spread=0.0), body=BodyConfig())
                if robots == "alike"
                else replace(config, body=OTHER)
            )
            cases.append(
                (
                    {"setting": name, "robots": robots},
                    Trial(config=fleet, steps=steps, minutes=20.0),
                )
            )
    return cases


STUDY = Study("copies", __doc__, cases, function=measure_copies)
