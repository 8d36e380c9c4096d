"""What do several offset tilings do that the paper's single one does not?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import curve_panels
from workbench.studies.conditions import BASE, LOSSES_AND_GREEDY


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"tiles": f"{n}×{n}", "tilings": m}, replace(BASE, state_tiles=(n, n), tilings=m))
        for n in (3, 5, 7, 9)
        for m in (1, 2, 4, 8)
    ]


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors against the number of tilings."""
    panels = LOSSES_AND_GREEDY
    size = (10.8, 3.8)
    fig = curve_panels(table, "tiles", "tilings", panels, xlabel="tilings", size=size)
    return fig, by_quantity(table, ["tiles", "tilings"], panels)


STUDY = Study("offsets", __doc__, cases, plots={"offset_tilings": plot})
