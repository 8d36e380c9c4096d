"""Pictures of what the overhead camera sees, and of how far it is off over the arena.

Contract: plot functions draw on the axes that they are given and return them; ``marked`` returns a
new picture.
"""

from collections.abc import Mapping

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from workbench.arena.camera.config import TABLE
from workbench.arena.camera.optics import Camera
from workbench.plots.style import CYCLE, MARKERS

_RED = (213, 94, 0)
_BLUE = (0, 114, 178)


def marked(
    image: NDArray[np.uint8], camera: Camera, found: Mapping[int, tuple[float, float, float]]
) -> NDArray[np.uint8]:
    """Return a picture in colour with every found marker's outline, number and heading, drawn from
    its pose.

    Args:
        image: (height, width) grey.
        camera: whose true projection puts poses into the picture.
        found: pose of every robot that was found, x, y in m and heading in rad.
    """
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    for number, pose in found.items():
        corners = np.round(camera.project(camera.marker_corners(*pose, grow=1.25))).astype(np.int32)
        cv2.polylines(colour, [corners], True, _RED, 3, cv2.LINE_AA)
        middle = corners.mean(axis=0)
        front = corners[:2].mean(axis=0)
        tip = middle + 2.2 * (front - middle)
        ends = [tuple(int(value) for value in point) for point in (middle, tip)]
        cv2.arrowedLine(colour, ends[0], ends[1], _BLUE, 3, cv2.LINE_AA, tipLength=0.3)
        beside = middle - 1.6 * (front - middle)
        cv2.putText(
            colour,
            str(number),
            (int(beside[0]) - 10, int(beside[1]) + 34),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.9,
            _BLUE,
            2,
            cv2.LINE_AA,
        )
    return np.asarray(colour, np.uint8)


def systematic_errors(camera: Camera) -> pd.DataFrame:
    """Return what a camera's calibration does to a marker over the view: x_m, y_m, error_mm,
    turn_deg (absolute).
    """
    table, (x0, x1, y0, y1) = camera.bias_table()
    x, y = np.meshgrid(np.linspace(x0, x1, TABLE), np.linspace(y0, y1, TABLE))
    error = 1000 * np.hypot(table[0], table[1])
    turn = np.degrees(np.abs(table[2]))
    return pd.DataFrame(
        {"x_m": x.ravel(), "y_m": y.ravel(), "error_mm": error.ravel(), "turn_deg": turn.ravel()}
    )


def error_map(
    table: pd.DataFrame, ax: Axes, *, column: str = "error_mm", label: str = "systematic error (mm)"
) -> Axes:
    """Draw a column of ``systematic_errors`` (or of its median over cameras) over the arena."""
    grid = table.pivot(index="y_m", columns="x_m", values=column)
    picture = ax.pcolormesh(grid.columns, grid.index, grid.to_numpy(), shading="nearest")
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")
    assert ax.figure is not None
    ax.figure.colorbar(picture, ax=ax, label=label, shrink=0.8)
    return ax


def budget(table: pd.DataFrame, ax: Axes, *, column: str, label: str) -> Axes:
    """Draw medians and 95 % quantiles per band of distance from the middle, for conditions with and
    without calibration errors.

    Args:
        table: data/validation/camera.csv.
        column: "position" or "heading" (…_median_…, …_p95_…).
    """
    unit = "mm" if column == "position" else "deg"
    names = [
        f"{low:g}–{high:g}" for low, high in table[["from_m", "to_m"]].drop_duplicates().to_numpy()
    ]
    for number, (key, part) in enumerate(table.groupby(["conditions", "calibration"], sort=False)):
        conditions, calibration = key
        x = np.arange(len(part)) + 0.16 * (number - 1.5)
        middle = part[f"{column}_median_{unit}"].to_numpy()
        high = part[f"{column}_p95_{unit}"].to_numpy()
        ax.errorbar(
            x,
            middle,
            yerr=[np.zeros(len(x)), high - middle],
            color=CYCLE[number],
            marker=MARKERS[number],
            linestyle="none",
            capsize=3,
            label=f"{conditions}, calibration {'exact' if calibration == 'exact' else 'off'}",
        )
    ax.set_xticks(range(len(names)), names)
    ax.set(xlabel="distance from the middle (m)", ylabel=label, ylim=(0, None))
    return ax
