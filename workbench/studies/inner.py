"""How wide should the middle cell of logarithmic tiles be?"""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import curve_panels
from workbench.studies.conditions import (
    GREEDY,
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


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw errors and losses against the width of the middle cell."""
    x, panels = "inner_distance_mm", GREEDY | {"losses": "losses while learning"}
    label = "half width of the middle cell in mm"
    named = table.assign(spacing="logarithmic 9×9")
    fig = curve_panels(
        named, "spacing", x, panels, xlabel=label, size=(10.4, 3.6), even=False, legends=()
    )
    return fig, by_quantity(table, [x], panels)


STUDY = Study("inner", __doc__, cases, plots={"inner_cell": plot})
