"""How much more noise than they learned with do policies bear (E9)?"""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.study import Case, Rows, Study
from workbench.measures.comparisons import by_quantity
from workbench.plots.comparisons import curves, one_note
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
    "rms_distance_mm": "RMS distance error (mm)",
}


def by_noise(table: pd.DataFrame) -> pd.DataFrame:
    """Return share inside and RMS distance error by the factor on the noise, per case (route and
    training).
    """
    cased = table.assign(case=table["route"] + ", " + table["training"])
    cased = cased.sort_values("noise", kind="stable")
    parts = [by_quantity(part, ["case", "noise"], VALUES) for _, part in cased.groupby("noise")]
    return pd.concat(parts)


def losses_by_noise(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses over all seeds by the factor on the noise, per route and training."""
    lost = table.groupby(["route", "training", "noise"], sort=False)["losses"].sum().astype(int)
    return lost.unstack("noise").rename(columns=lambda factor: f"× {factor}")


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw time inside and errors against the factor on the noise."""
    noisy = by_noise(table)
    fig = Figure(figsize=(9.6, 3.9), layout="constrained")
    axes = fig.subplots(1, 2)
    for ax, (quantity, words) in zip(axes, VALUES.items(), strict=True):
        part = noisy[noisy["quantity"] == quantity]
        curves(part, "noise", by="case", xlabel="noise ×, simulated", ylabel=words, ax=ax)
    axes[1].get_legend().remove()
    one_note(axes)
    return fig, noisy


ROWS = Rows(("noise",), {(factor,): f"{{}}_noise_{factor}" for factor in NOISE_FACTORS})
STUDY = Study("gap", __doc__, cases, function=measure_gap, rows=ROWS, plots={"noise_gap": plot})
