"""The true errors of followers, in one place: how far the robot in front is, at which bearing, and
what that comes to over a drive.

>>> t = np.arange(100) / 10
>>> line = np.stack([np.stack([0.06 * t + 0.16, 0 * t], 1), np.stack([0.06 * t, 0 * t], 1)], 1)
>>> distance, bearing = Motion.of_path(line, fs=10.0).errors()
>>> found = summary(distance, bearing, np.ones_like(distance, bool), wanted_m=0.15)
>>> round(found["rms_distance_mm"], 6), round(found["bearing_std_deg"], 6)
(10.0, 0.0)

Lengths in mm, angles in degrees; errors where nobody was chosen are NaN.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.measures.motion import Motion

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def true_errors(steps: NDArray[np.void]) -> tuple[Floats, Floats]:
    """Return true distance in m and bearing in rad of every follower's predecessor, (periods,
    followers) each, from PERIOD records.
    """
    return Motion.of_steps(steps).errors()


def within(config: ConvoyConfig, distance: Floats, bearing: Floats) -> Flags:
    """Return whether distances and bearings lie inside a configuration's bounds."""
    low, high = config.distance_m
    inside: Flags = (
        (distance >= low) & (distance < high) & (np.abs(bearing) < config.bearing_limit_rad)
    )
    return inside


def summary(
    distance: Floats, bearing: Floats, chosen: Flags, *, wanted_m: float
) -> dict[str, float]:
    """Return what errors come to over all chosen periods and followers together.

    Args:
        distance, bearing, chosen: (periods, followers) in m and rad.
        wanted_m: the distance that followers are to keep.

    Returns:
        rms_distance_mm, rms_bearing_deg and bearing_std_deg, the bearing's spread about its mean.
    """
    if not chosen.any():
        return dict.fromkeys(("rms_distance_mm", "rms_bearing_deg", "bearing_std_deg"), math.nan)
    error_mm = 1000 * (distance[chosen] - wanted_m)
    angle_deg = np.degrees(bearing[chosen])
    return {
        "rms_distance_mm": math.sqrt(float(np.mean(error_mm**2))),
        "rms_bearing_deg": math.sqrt(float(np.mean(angle_deg**2))),
        "bearing_std_deg": float(angle_deg.std()),
    }
