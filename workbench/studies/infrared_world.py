"""What do targets, mismatch, light and distortion change for infrared (N4, N5, N7)?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import by_condition, difference, said
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import beside, dots
from workbench.studies.conditions import with_infrared
from workbench.studies.infrared_trials import measure_infrared


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for route in INFRARED:
        base = replace(SETTINGS["infrared"], drive="rolling", followers=1, sensing=route)
        worlds = {
            "as assumed": base,
            "linear tiles": replace(base, distance_tiling="uniform", bearing_tiling="uniform"),
        }
        if route == "ir-raw":
            worlds |= {
                f"{warp} distortion": with_infrared(base, warp=warp)
                for warp in ("logarithmic", "offset", "saturating")
            }
        worlds |= {
            "matched sensors": with_infrared(base, gain_spread=0.0),
            "gain spread 30 %": with_infrared(base, gain_spread=0.3),
            "noise × 2": with_infrared(base, noise=2.0),
            "offsets not calibrated": with_infrared(base, calibrated=False),
            "bare shell, to 115 mm": with_infrared(
                replace(base, distance_m=(0.08, 0.115)), target="shell"
            ),
            "light from one side": with_infrared(base, ambient_counts=3000.0),
            "blinding light": with_infrared(base, ambient_counts=4000.0),
            "active beacon": with_infrared(base, target="beacon"),
        }
        cases += [({"route": route, "world": world}, config) for world, config in worlds.items()]
    return cases


HOPELESS = ("offsets not calibrated", "blinding light")  # worlds in which nobody follows
# of the claim that counts do not matter: share, mm (half the middle metric tile), degrees
MARGINS = {"share_inside_last_third": 0.01, "rms_distance_error_mm": 2.0, "bearing_std_deg": 1.0}
ASSUMED = {"world": "as assumed"}


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw time outside, and errors where somebody follows, world by world."""
    away = table.assign(outside=100 * (1 - table["share_inside_last_third"]))
    rest = away[~away["world"].isin(HOPELESS)]
    words = {
        "outside": "time outside, last third (%)",
        "rms_distance_error_mm": "RMS distance error (mm)",
    }
    lines = {value: by_condition(rest, ["route", "world"], value) for value in words}
    fig = Figure(figsize=(9.6, 6.6), layout="constrained")
    grid = fig.subplots(2, 2, sharex="col")
    for number, (axes, route) in enumerate(zip(grid, ("ir-metric", "ir-raw"), strict=True)):
        for ax, (value, name) in zip(axes, words.items(), strict=True):
            part = lines[value][lines[value]["route"] == route]
            dots(part, "world", xlabel=name, ax=ax, number=number)
            ax.set_xlim(left=0)
        axes[0].set_title(route, loc="left", fontsize=9)
        axes[1].set_title("", loc="left")
        beside(axes)
    gone = away[away["world"].isin(HOPELESS)]["share_inside_last_third"].max()
    lost = " and ".join(HOPELESS)
    fig.supxlabel(
        f"mean, 95 % interval over seeds, n = {STUDY.seeds}; not drawn: {lost}, inside for at most "
        f"{100 * gone:.0f} %",
        fontsize=8,
    )
    return fig, pd.concat(lines, names=["quantity"]).reset_index(level=0)


def counts_do_not_matter(table: pd.DataFrame) -> Verdict:
    """Decide N5: under three distortions of raw readings nothing changes by more than a margin."""
    warps = [f"{warp} distortion" for warp in ("logarithmic", "offset", "saturating")]
    raw = table[(table["route"] == "ir-raw") & table["world"].isin(["as assumed", *warps])]
    change = {
        value: difference(raw, ["world"], value, ASSUMED).set_index("world").loc[warps]
        for value in MARGINS
    }
    same = [
        bool((change[value][["low", "high"]].abs() <= margin).all().all())
        for value, margin in MARGINS.items()
    ]
    each = "; ".join(
        f"{warp} {said(line, 'mm')}" for warp, line in change["rms_distance_error_mm"].iterrows()
    )
    turned = change["bearing_std_deg"][["low", "high"]].abs().max().max()
    far = 100 * change["share_inside_last_third"][["low", "high"]].abs().max().max()
    words = (
        f"share inside within {far:.2f} points, bearing spread within {turned:.1f}° (ends of all "
        f"intervals); RMS distance error: {each}; margins: "
        f"{100 * MARGINS['share_inside_last_third']:g} point, "
        f"{MARGINS['rms_distance_error_mm']:g} mm (half width of the middle metric tile), "
        f"{MARGINS['bearing_std_deg']:g}°"
    )
    claim = "The absolute counts do not matter, as the learner adapts."
    fails = "an interval of the share inside that leaves its margin; then one of an error"
    return Verdict("N5", claim, ruling(*same), words, fails)


def logarithmic_tiles(table: pd.DataFrame) -> Verdict:
    """Decide S3: with linear tiles both errors are larger, on both routes."""
    pairs = table[table["world"].isin(["as assumed", "linear tiles"])]
    lines = {}
    for route, part in pairs.groupby("route"):
        for value in ("rms_distance_error_mm", "bearing_std_deg"):
            found = difference(part, ["world"], value, ASSUMED).set_index("world")
            lines[f"{route}, {value.split('_')[0]}", value.split("_")[-1]] = found.loc[
                "linear tiles"
            ]
    words = "; ".join(f"{name}: {said(line, unit)}" for (name, unit), line in lines.items())
    claim = (
        "For raw readings logarithmic tiling is of much better use. It also yielded better "
        "results for the angle."
    )
    better = [bool(line["low"] > 0) for line in lines.values()]
    because = (
        f"clearly larger errors with linear tiles: {sum(better)} of {len(better)}; linear minus "
        f"logarithmic, paired by seed: {words}"
    )
    fails = (
        "errors in distance of raw readings that are not clearly larger with linear tiles; then "
        "those of the angle, or of the other route"
    )
    raw = [bool(lines[key]["low"] > 0) for key in lines if key[0] == "ir-raw, rms"]
    return Verdict("S3", claim, ruling(*raw, *better), because, fails)


STUDY = Study(
    "infrared-world",
    __doc__,
    cases,
    function=measure_infrared,
    steps=100_000,
    minutes=4.0,
    plots={"infrared_world": plot},
    verdicts={"N5": counts_do_not_matter, "S3": logarithmic_tiles},
)
