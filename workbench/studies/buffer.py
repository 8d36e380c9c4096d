"""From which compute time on does the update buffer matter?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE, COMPUTE_TIMES_S, ROBOT, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases = []
    for table, config in (("9×9 states, 7×7 actions", BASE), ("5×5 states, 3×3 actions", ROBOT)):
        cases.append(
            ({"table": table, "buffer": "on", "compute_time_s": 0.0}, config)
        )  # the same at every compute time
        for seconds in COMPUTE_TIMES_S:
            timed = replace(with_learner(config, buffer=False), compute_time_s=seconds)
            cases.append(({"table": table, "buffer": "off", "compute_time_s": seconds}, timed))
    return cases


STUDY = Study("buffer", __doc__, cases)
