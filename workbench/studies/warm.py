"""When do weights of other robots or another task help, and when do they harm (E7)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.arena.tracks import TrackConfig
from workbench.formation.body import BodyConfig
from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE, OTHER
from workbench.studies.transfer_trials import (
    measure_warm,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    tasks = {
        "other robots": replace(BASE, body=OTHER),
        "leader 20 % slower": replace(BASE, leader_speed_mps=0.048),
        "leader 20 % faster": replace(BASE, leader_speed_mps=0.072),
        "leader at half speed": replace(BASE, leader_speed_mps=0.03),
        "anticlockwise": replace(BASE, track=TrackConfig(direction="anticlockwise")),
        "figure eight": replace(BASE, track=TrackConfig(shape="eight")),
        "commands 0.2 s late": replace(BASE, body=BodyConfig(delay=2)),
    }
    return [({"task": name}, config) for name, config in tasks.items()]


STUDY = Study("warm", __doc__, cases, minutes=10.0, function=measure_warm)
