"""How do the settings follow on wheels?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.lab.trial import measure_widely


def cases() -> Sequence[Case]:
    """Return the conditions."""
    settings = {name: SETTINGS[name] for name in ("paper", "logarithmic", "recommended")}
    settings["logarithmic 3×3"] = replace(
        SETTINGS["logarithmic"], state_tiles=(3, 3)
    )  # the smallest table that follows well
    settings["recommended, 3×3 actions"] = replace(SETTINGS["recommended"], action_levels=(3, 3))
    return [
        ({"setting": name}, replace(config, drive="wheels")) for name, config in settings.items()
    ]


STUDY = Study("recommended", __doc__, cases, function=measure_widely, steps=400_000, minutes=30.0)
