"""Tiles of raw infrared readings: one reading per dimension, no metres (paper section III-B,
"logarithmic tiles").

Edges run from what the sensor that looks away reads at the far bound to what the other one reads at
the near bound, as a matched sensor would, distorted as the readings are. The outermost cells are
open: to zero, and to the end of the converter.

Contract: nothing here is per robot; robots differ and the learner has to live with it.
"""

import numpy as np
from numpy.typing import NDArray

from workbench.learning.tiles import Tiling
from workbench.robot.infrared import ADC, WARPS, InfraredConfig, front_pair, warped
from workbench.robot.inversion import mean_pairs

LOWEST = 4.0  # counts: below, a reading is noise


def reading_tilings(
    infrared: InfraredConfig,
    distance_m: tuple[float, float],
    counts: tuple[int, int],
    kinds: tuple[str, str],
) -> tuple[Tiling, Tiling]:
    """Return the tilings of the left and the right front reading in (distorted) counts.

    Args:
        infrared: what is looked at, and the distortion.
        distance_m: near and far bound.
        counts: cells of the left and of the right reading.
        kinds: spacing of their edges, "uniform" or "logarithmic" (geometric).
    """
    near = mean_pairs(np.array([distance_m[0]]), np.radians(np.arange(-25.0, 26.0)), infrared)
    low, high = (
        warp_of(infrared, reading) for reading in (LOWEST, max(float(near.max()), 2 * LOWEST))
    )
    tilings = []
    for count, kind in zip(counts, kinds, strict=True):
        edges = (
            np.geomspace(low, high, count + 1)
            if kind == "logarithmic"
            else np.linspace(low, high, count + 1)
        )
        edges[0] = 0.0
        edges[-1] = warp_of(infrared, ADC) + 1.0
        tilings.append(Tiling(edges, kind))
    return tilings[0], tilings[1]


def warp_of(infrared: InfraredConfig, reading: float) -> float:
    """Return a calibrated reading in counts as the configuration distorts it."""
    return float(warped(reading, WARPS.index(infrared.warp)))


def raw_scales(
    infrared: InfraredConfig, distance_m: tuple[float, float], limit_rad: float, floor: float
) -> NDArray[np.float64]:
    """Return (4,) what ``senses.infrared.raw_errors`` scales with: the mean logarithm at d*, from
    there to the near and to the far bound straight ahead, and the difference of logarithms at the
    bearing's bound and d*.
    """
    middle = sum(distance_m) / 2

    def logs(distance: float, bearing: float) -> tuple[float, float]:
        left, right = (
            np.log(warp_of(infrared, reading) + floor)
            for reading in front_pair(distance, bearing, infrared)
        )
        return float(left), float(right)

    centre, near, far = (sum(logs(distance, 0.0)) / 2 for distance in (middle, *distance_m))
    left, right = logs(middle, limit_rad)
    return np.array([centre, near - centre, centre - far, left - right])
