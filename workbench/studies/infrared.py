"""Do two infrared sensors suffice to follow (N2)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.studies.infrared_trials import measure_infrared


def cases() -> Sequence[Case]:
    """Return the conditions."""
    sizes = {
        "9×9 states, 7×7 actions": ((9, 9), (7, 7)),
        "5×5 states, 3×3 actions": ((5, 5), (3, 3)),
    }
    base = replace(SETTINGS["infrared"], drive="wheels")
    cases: list[Case] = []
    for followers, steps in ((1, 100_000), (4, 400_000)):  # the same time for every follower
        for route in INFRARED:
            for name, (states, actions) in sizes.items():
                config = replace(
                    base,
                    followers=followers,
                    sensing=route,
                    state_tiles=states,
                    action_levels=actions,
                )
                label = {"followers": followers, "route": route, "table": name}
                cases.append((label, Trial(config=config, steps=steps, minutes=10.0)))
    return cases


STUDY = Study("infrared", __doc__, cases, function=measure_infrared)
