"""Do followers that only hear range and bearing keep shapes, and what does filtering do?"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.senses.range_bearing import RangeBearingConfig
from workbench.lab.study import Case, Rows, Study
from workbench.measures.comparisons import by_condition
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import beside, dots, one_note
from workbench.studies.shape_trials import JUDGED, ShapeTrial, measure_shapes
from workbench.studies.shapes import PLACES, policies

# mm, degrees: standard deviations of range, of bearing, of what each receiver is off by for good
NOISES = {"5 mm, 2.5°": (0.005, 2.5), "10 mm, 5°": (0.010, 5.0), "15 mm, 10°": (0.015, 10.0)}
BIASES = (0.0, 1.0, 2.0)
MAIN_NOISE, MAIN_BIAS = "10 mm, 5°", 1.0
FILTERS = {"none": 1.0, "filtered": 0.1}
# noise swings what is seen about: the leader is lost farther aside than at 45°
BOUNDS: dict[str, Any] = {"bearing_limit_rad": math.radians(70), "state_tiles": (5, 7)}
# set before the data: share of the time within a body radius, and losses in 80 robot-minutes
BAR_SHARE, BAR_LOSSES = 0.99, 2.0
ROBOT_MINUTES = 60.0  # of a shape
QUANTITIES = {
    "place_rms_mm": "RMS distance from the place in mm",
    "away_percent": "time farther than a body radius in %",
    "losses": "losses in 60 robot-minutes",
}


def cases() -> Sequence[Case]:
    """Return the conditions: noise and filter, and what receivers are off by."""
    places, _ = policies()[PLACES]
    config = replace(places, **BOUNDS)
    asked = [(noise, MAIN_BIAS, name) for noise in NOISES for name in FILTERS]
    asked += [(MAIN_NOISE, bias, "filtered") for bias in BIASES if bias != MAIN_BIAS]
    found: list[Case] = []
    for noise, bias, name in asked:
        range_m, bearing_deg = NOISES[noise]
        told = RangeBearingConfig(
            noise_range_m=range_m,
            noise_bearing_rad=math.radians(bearing_deg),
            sector_bias_rad=math.radians(bias),
            gain=FILTERS[name],
        )
        heard = replace(config, sensing="range-and-bearing", range_bearing=told)
        trial = ShapeTrial(config=heard, steps=200_000, minutes=15.0)
        found.append(({"noise": noise, "bias_deg": bias, "filter": name}, trial))
    return found


def heard(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw errors, time out of place and losses."""
    rows = table[table["shape"].notna()]
    rows = rows.assign(
        away_percent=100 * (1 - rows["share_in_place"]),
        case=rows["noise"]
        + ", receivers ±"
        + rows["bias_deg"].map("{:g}°, ".format)
        + rows["filter"].replace({"none": "bare"})
        + ": "
        + rows["shape"],
    )
    fig = Figure(figsize=(12.0, 8.4), layout="constrained")
    fig.set_layout_engine("constrained", w_pad=0.15)  # inches: room for the longest name
    axes = list(fig.subplots(1, len(QUANTITIES)))
    parts = []
    for ax, (value, words) in zip(axes, QUANTITIES.items(), strict=True):
        summary = by_condition(rows, ["case"], value)
        summary["low"] = summary["low"].clip(lower=0.0)
        dots(summary, "case", xlabel=words, ax=ax)
        if value == "losses":
            ax.set_xscale("symlog", linthresh=1)
            ax.set(xlim=(-0.2, None), xticks=[0, 1, 10, 100, 1000])
        parts.append(summary.assign(quantity=value))
    beside(axes)
    one_note(axes)
    return fig, pd.concat(parts)


def keep_by_hearing(table: pd.DataFrame) -> Verdict:
    """Decide F1's last part."""
    rows = table[table["shape"].notna() & (table["noise"] == MAIN_NOISE)]
    rows = rows[rows["bias_deg"] == MAIN_BIAS]
    filtered, bare = (rows[rows["filter"] == name] for name in ("filtered", "none"))
    share = filtered.groupby("shape")["share_in_place"].mean().min()
    losses = filtered.groupby("shape")["losses"].mean().max() * 80 / ROBOT_MINUTES
    without = bare["losses"].mean() * 80 / ROBOT_MINUTES
    return Verdict(
        "F1, heard",
        "By range, bearing and messages, filtered, followers keep all four shapes.",
        ruling(bool(share >= BAR_SHARE), bool(losses <= BAR_LOSSES)),
        f"{MAIN_NOISE}, receivers off by {MAIN_BIAS:g}°, odometry by 2 %: {100 * share:.1f} % of "
        f"the time within a body radius in the worst of {len(JUDGED)} shapes, {losses:.1f} losses "
        f"in 80 robot-minutes there; without the filter {without:.0f} on average; "
        f"n = {filtered['seed'].nunique()}",
        f"a shape with less than {100 * BAR_SHARE:g} % in place; more than {BAR_LOSSES:g} losses "
        "leave it at mostly",
    )


STUDY = Study(
    "range-bearing",
    __doc__.strip(),
    cases,
    function=measure_shapes,
    rows=Rows(("shape",), {(shape,): shape + "_{}" for shape in JUDGED}),
    plots={"range_bearing": heard},
    verdicts={"F1, heard": keep_by_hearing},
)
