"""Is a policy's value known from a log that it did not make?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.studies.off_policy_trials import measure_off_policy


def cases() -> Sequence[Case]:
    """Return the conditions."""
    small = replace(
        SETTINGS["infrared"], drive="planar", followers=1, state_tiles=(5, 5), action_levels=(3, 3)
    )
    return [({"route": route}, replace(small, sensing=route)) for route in INFRARED]


STUDY = Study("off-policy", __doc__, cases, function=measure_off_policy, steps=100_000)
