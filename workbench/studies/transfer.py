"""Do weights from the simulation drive an emulated reality (E8, E9, E11)?"""

from collections.abc import Sequence

from workbench.lab.study import Case, Study
from workbench.studies.conditions import travels
from workbench.studies.transfer_trials import (
    TRAININGS,
    Transfer,
    measure_transfer,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for label, config, steps in travels():
        for training in TRAININGS:
            there = steps if training == "there" else steps // 10
            trial = Transfer(
                config=config, steps=steps, there_steps=there, minutes=30.0, training=training
            )
            cases.append((label | {"training": training}, trial))
    return cases


STUDY = Study("transfer", __doc__, cases, function=measure_transfer)
