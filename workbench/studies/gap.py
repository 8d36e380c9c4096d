"""How much more noise than they learned with do policies bear (E9)?"""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Rows, Study
from workbench.measures.comparisons import by_condition, by_quantity
from workbench.plots.comparisons import curves
from workbench.studies.conditions import (
    BASE,
    routes,
)
from workbench.studies.transfer_trials import (
    NOISE_FACTORS,
    Transfer,
    measure_gap,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    noisy = replace(BASE, noise_distance_m=0.001, noise_bearing_rad=math.radians(1))
    noisy_routes = {"absolute, 1 mm and 1°": (noisy, 200_000)} | {
        route: case for route, case in routes().items() if route != "camera"
    }
    return [
        (
            {"route": route, "training": training},
            Transfer(config=config, steps=steps, minutes=10.0, training=training),
        )
        for route, (config, steps) in noisy_routes.items()
        for training in ("nominal", "randomised")
    ]


VALUES = {
    "share_inside": "share of time inside the bounds",
    "rms_distance_error_mm": "RMS distance error (mm)",
}


def by_noise(table: pd.DataFrame) -> pd.DataFrame:
    """Return share inside and RMS distance error by the factor on the noise, per case (route and
    training).
    """
    groups = _cased(table).groupby("noise")
    return pd.concat(by_quantity(part, ["case", "noise"], VALUES) for _, part in groups)


def _cased(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(case=table["route"] + ", " + table["training"])


def losses_by_noise(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all seeds by the factor on the noise, per route and training."""
    lost = table.groupby(["route", "training", "noise"], sort=False)["losses"].sum().astype(int)
    return lost.unstack("noise").rename(columns=lambda factor: f"× {factor}")


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses and errors against the factor on the noise, a column per route."""
    shown = {"losses": "losses in 10 min", "rms_distance_error_mm": "RMS distance error (mm)"}
    routes_of = list(table["route"].unique())
    fig = Figure(figsize=(9.6, 5.2), layout="constrained")
    axes = fig.subplots(2, len(routes_of), sharex=True, sharey="row")
    for line, (value, words) in zip(axes, shown.items(), strict=True):
        lines = by_condition(table, ["route", "training", "noise"], value)
        for ax, route in zip(line, routes_of, strict=True):
            part = lines[lines["route"] == route]
            curves(part, "noise", by="training", xlabel="", ylabel="", ax=ax, legend=False)
            ax.set_title(route if value == "losses" else "", loc="left", fontsize=9)
            if value == "losses":
                ax.set_yscale("symlog", linthresh=1)
                ax.set(ylim=(0, 200), yticks=(0, 1, 10, 100))
                ax.set_yticklabels(["0", "1", "10", "100"])
                ax.minorticks_off()
        line[0].set_ylabel(words)
    for ax in axes[-1]:
        ax.set_xlabel("noise ×, simulated")
    handles = axes[0, 0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower center", ncols=2, title="weights learned with noise")
    return fig, by_noise(table)


ROWS = Rows(("noise",), {(factor,): f"{{}}_noise_{factor}" for factor in NOISE_FACTORS})
STUDY = Study("gap", __doc__, cases, function=measure_gap, rows=ROWS, plots={"noise_gap": plot})
