"""Do two infrared sensors suffice to follow (N2)?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import dot_panels, one_note
from workbench.studies.infrared_trials import measure_infrared


def cases() -> Sequence[Case]:
    """Return the conditions."""
    sizes = {
        "9×9 states, 7×7 actions": ((9, 9), (7, 7)),
        "5×5 states, 3×3 actions": ((5, 5), (3, 3)),
    }
    cases: list[Case] = []
    # the same time for every follower
    for followers, steps, drive in ((1, 100_000, "wheels"), (4, 400_000, "rolling")):
        for route in INFRARED:
            for name, (states, actions) in sizes.items():
                config = replace(
                    SETTINGS["infrared"],
                    drive=drive,
                    followers=followers,
                    sensing=route,
                    state_tiles=states,
                    action_levels=actions,
                )
                label = {"followers": followers, "route": route, "table": name}
                cases.append((label, Trial(config=config, steps=steps, minutes=10.0)))
    return cases


VALUES = {
    "share_inside_last_third": "share inside, last third",
    "rms_distance_error_mm": "RMS distance error inside (mm)",
    "bearing_std_deg": "bearing inside, sd (°)",
}


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw time inside and errors by route, table and number of followers."""
    who = table["followers"].map({1: "1 follower", 4: "4 followers"})
    case = table["route"] + ", " + table["table"].str[:3] + ", " + who
    named = table.assign(condition=case)
    fig = dot_panels(named, "condition", VALUES, size=(9.6, 3.4))
    one_note(fig.axes)
    return fig, by_quantity(named, ["condition"], VALUES)


STUDY = Study(
    "infrared", __doc__, cases, function=measure_infrared, plots={"infrared_learning": plot}
)
