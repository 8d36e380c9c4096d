"""How does the learner compare with classical control (E10)?"""

import math
from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.lab.trial import CONTROLLERS, Trial
from workbench.studies.motion_trials import measure_motion


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for noise, mm, degrees in (("none", 0.0, 0.0), ("2 mm, 2°", 2.0, 2.0)):
        for controller in CONTROLLERS:
            if controller == "tractrix" and noise != "none":
                continue  # it senses nothing
            for name in (
                ("paper", "recommended")
                if controller in ("learner", "quantised carrot")
                else ("paper",)
            ):
                config = replace(
                    SETTINGS[name],
                    noise_distance_m=mm / 1000,
                    noise_bearing_rad=math.radians(degrees),
                )
                trial = Trial(config=config, controller=controller, steps=400_000, minutes=20.0)
                cases.append(({"controller": controller, "setting": name, "noise": noise}, trial))
    return cases


STUDY = Study("controllers", __doc__, cases, function=measure_motion)
