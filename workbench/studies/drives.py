"""Does a formation on a cheaper drive learn, follow and move as on wheels?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.arena.drives.table import DRIVES
from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.lab.trial import Trial
from workbench.measures.comparisons import by_quantity, difference
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import dot_panels
from workbench.studies.motion_trials import measure_rival

# who drives: the learner in three settings, and a classical law
INFRARED = replace(SETTINGS["infrared"], followers=1)
WHO = {
    "paper": Trial(config=SETTINGS["paper"], minutes=20.0),
    "offset": Trial(config=SETTINGS["offset"], minutes=20.0),
    "infrared": Trial(config=INFRARED, steps=100_000, minutes=20.0),
    "carrot": Trial(config=SETTINGS["paper"], controller="carrot", minutes=20.0),
}
# what a drive may differ by from wheels, set before the data: words, margin, whether it is a share
MARGINS = {
    "learning_losses": ("losses while learning", 0.25, True),
    "following_rms_distance_error_mm": ("RMS distance error (mm)", 0.5, False),
    "following_bearing_std_deg": ("bearing spread (°)", 0.25, False),
    "judder_mm_1": ("judder of follower 1 (mm)", 0.25, False),
    "turn_rms_deg_s_1": ("turning above 1 Hz (°/s)", 0.25, True),
}


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"driver": who, "drive": drive}, replace(trial, config=replace(trial.config, drive=drive)))
        for who, trial in WHO.items()
        for drive in DRIVES
    ]


def from_wheels(table: pd.DataFrame) -> pd.DataFrame:
    """Return differences from wheels by quantity, driver and drive, with their margin, and whether
    the whole interval lies within it.
    """
    parts = []
    for quantity, (_, margin, share) in MARGINS.items():
        of = table.dropna(subset=[quantity])
        wheels = of[of["drive"] == "wheels"].groupby("driver")[quantity].mean()
        apart = difference(of, ["driver", "drive"], quantity, {"drive": "wheels"})
        unit = apart["driver"].map(wheels) if share else 1.0
        parts.append(apart.assign(quantity=quantity, margin=margin * unit))
    lines = pd.concat(parts, ignore_index=True)
    lines = lines[lines["drive"] != "wheels"]
    outside = lines[["low", "high"]].abs().max(axis=1) > lines["margin"]
    return lines.assign(within=~outside).set_index(["quantity", "driver", "drive"])


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw how drives differ in following and moving; the numbers have losses, too."""
    driver = table["driver"].replace("offset", "4 tilings")
    named = table.assign(condition=driver + ", " + table["drive"])
    shown = {name: words for name, (words, _, _) in MARGINS.items() if name in PANELS}
    fig = dot_panels(named, "condition", shown, size=(11.4, 3.4))
    for ax in fig.axes:
        ax.set_xlim(left=0)
    keys = ["driver", "drive"]
    parts = [by_quantity(table.dropna(subset=[name]), keys, [name]) for name in MARGINS]
    return fig, pd.concat(parts, ignore_index=True)


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide whether every interval of rolling's differences lies within its margin."""
    rolling = from_wheels(table).xs("rolling", level="drive")
    words = []
    for (quantity, driver), line in rolling[~rolling["within"]].iterrows():
        apart = f"{line['value']:+.2f} [{line['low']:+.2f}, {line['high']:+.2f}]"
        words.append(f"{driver}, {MARGINS[quantity][0]}: {apart}, margin {line['margin']:.2f}")
    outside = f"; not: {'; '.join(words)}" if words else ""
    because = (
        f"{int(rolling['within'].sum())} of {len(rolling)} intervals of the difference lie within "
        f"their margins{outside}; n = {STUDY.seeds} seeds"
    )
    claim = "A formation that rolls without an engine learns, follows and moves as one on wheels."
    errors = ["following_rms_distance_error_mm", "following_bearing_std_deg"]
    main = rolling.loc[errors]["within"]
    others = rolling.drop(index=errors, level="quantity")["within"]
    fails = "an error's interval that leaves its margin; then one of losses, judder or turning"
    return Verdict("drives", claim, ruling(bool(main.all()), *others), because, fails)


PANELS = ("following_rms_distance_error_mm", "following_bearing_std_deg", "turn_rms_deg_s_1")
STUDY = Study(
    "drives",
    __doc__,
    cases,
    function=measure_rival,
    seeds=20,
    plots={"drives_learning": plot},
    verdicts={"drives": verdict},
)
