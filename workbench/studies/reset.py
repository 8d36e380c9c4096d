"""What does restarting the simulation do to sections that are seldom reached?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.arena.tracks import TrackConfig
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial, measure_sections
from workbench.studies.conditions import BASE


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (
            {"track": shape, "reset": reset, "steps": steps},
            Trial(
                config=replace(BASE, reset=reset, track=TrackConfig(shape=shape)),
                steps=steps,
                minutes=20.0,
            ),
        )
        for shape in ("circle", "eight")
        for steps in (2_500, 5_000, 10_000, 20_000, 40_000, 80_000)
        for reset in ("manoeuvre", "restart")
    ]


STUDY = Study("reset", __doc__, cases, function=measure_sections)
