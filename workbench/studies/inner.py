"""How wide should the middle cell of logarithmic tiles be?"""

import math
from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.studies.conditions import (
    LOGARITHMIC,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases = []
    for mm, degrees in ((1.0, 0.7), (2.0, 1.3), (3.0, 2.0), (4.5, 3.0), (6.0, 4.0), (7.8, 5.0)):
        config = replace(
            LOGARITHMIC, inner_distance_m=mm / 1000, inner_bearing_rad=math.radians(degrees)
        )
        cases.append(({"inner_distance_mm": mm, "inner_bearing_deg": degrees}, config))
    return cases


STUDY = Study("inner", __doc__, cases)
