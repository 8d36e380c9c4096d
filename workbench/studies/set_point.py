"""Why does a place beside the leader need the leader's heading?"""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.shapes import FormationConfig
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_quantity
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curve_panels
from workbench.studies.shape_trials import ShapeTrial, measure_place
from workbench.studies.shapes import PLACES, policies

ANGLES = (0, 15, 30, 45, 60, 75, 90)  # degrees between "straight ahead" and the leader
FRAMES = {"follower": "distance and bearing alone", "heading": "with the leader's heading"}
ALONE, KNOWN = FRAMES.values()
DISTANCE_M = 0.15
# set before the data: by how much more it loses beside the leader, and up to where it does not
BAR_BESIDE, BAR_BEHIND, BEHIND = 2.0, 1.5, 60
QUANTITIES = {
    "learning_losses": "losses while learning",
    "place_rms_mm": "RMS distance from the place in mm",
}


def cases() -> Sequence[Case]:
    """Return the conditions: one follower learns at one place."""
    base, _ = policies()[PLACES]
    found: list[Case] = []
    for angle in ANGLES:
        at = math.radians(angle)
        point = (-DISTANCE_M * math.cos(at), DISTANCE_M * math.sin(at))
        for frame, name in FRAMES.items():
            told = FormationConfig(shape="points", frame=frame, points=(point,))
            # whoever does not know the heading does not find back to a place beside the leader
            config = replace(base, formation=told, reset="restart")
            trial = ShapeTrial(config=config, steps=100_000, minutes=20.0)
            found.append(({"angle_deg": angle, "errors": name}, trial))
    return found


def beside_the_leader(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors against where the leader is."""
    label = "bearing at which the leader is to be kept, degrees"
    fig = curve_panels(
        table, "errors", "angle_deg", QUANTITIES, xlabel=label, size=(10.4, 3.9), legends=(0,)
    )
    return fig, by_quantity(table, ["errors", "angle_deg"], QUANTITIES)


def heading_is_needed(table: pd.DataFrame) -> Verdict:
    """Decide F2's reason."""
    median = table.groupby(["errors", "angle_deg"])["learning_losses"].median()
    more = {angle: median[ALONE, angle] / median[KNOWN, angle] for angle in ANGLES}
    behind = max(value for angle, value in more.items() if angle <= BEHIND)
    place = table.groupby(["errors", "angle_deg"])["place_rms_mm"].median()
    return Verdict(
        "F2, why",
        "To learn a place beside its leader a follower needs the leader's heading; behind it, "
        "distance and bearing are enough not to lose it.",
        ruling(more[90] >= BAR_BESIDE, behind <= BAR_BEHIND),
        f"losses while learning at 90°: {median[ALONE, 90]:.0f} without, {median[KNOWN, 90]:.0f} "
        f"with it ({more[90]:.1f} ×); up to {BEHIND}° at most {behind:.1f} ×; RMS from the place "
        f"at 90° {place[ALONE, 90]:.0f} and {place[KNOWN, 90]:.1f} mm; medians, "
        f"n = {table['seed'].nunique()}",
        f"less than {BAR_BESIDE:g} × the losses at 90°; more than {BAR_BEHIND:g} × up to "
        f"{BEHIND}° leaves it at mostly",
    )


STUDY = Study(
    "set-point",
    __doc__.strip(),
    cases,
    function=measure_place,
    plots={"set_point": beside_the_leader},
    verdicts={"F2, why": heading_is_needed},
)
