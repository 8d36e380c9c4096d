"""How late may commands come for weights from the simulation (E8, E9)?"""

from collections.abc import Sequence

from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.studies.conditions import travels
from workbench.studies.transfer_trials import (
    measure_delays,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (label, Trial(config=config, steps=steps, minutes=30.0))
        for label, config, steps in travels()
    ]


STUDY = Study("delays", __doc__, cases, function=measure_delays)
