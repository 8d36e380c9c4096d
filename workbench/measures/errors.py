"""The true errors of followers, in one place: how far the robot in front is, at which bearing, and
what that comes to over a drive.

>>> t = np.arange(100) / 10
>>> line = np.stack([np.stack([0.06 * t + 0.16, 0 * t], 1), np.stack([0.06 * t, 0 * t], 1)], 1)
>>> distance, bearing = Motion.of_path(line, fs=10.0).errors()
>>> found = summary(distance, bearing, np.ones_like(distance, bool), wanted_m=0.15)
>>> round(found["rms_distance_error_mm"], 6), round(found["bearing_std_deg"], 6)
(10.0, 0.0)

Lengths in mm, angles in degrees; errors where nobody was chosen are NaN.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.measures.motion import Motion

SUMMARY = (
    "rms_distance_error_mm",
    "rms_bearing_deg",
    "bearing_std_deg",
    "bias_mm",
    "ripple_mm",
    "bearing_ripple_deg",
)
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
        rms_distance_error_mm, rms_bearing_deg and bearing_std_deg, the bearing's spread about its
        mean;
        bias_mm and ripple_mm, of which the former is how far followers stand off on average (RMS of
        their means) and the latter how far they move about that: bias² + ripple² = rms²; and
        bearing_ripple_deg, the same of the bearing.
    """
    if not chosen.any():
        return dict.fromkeys(SUMMARY, math.nan)
    error_mm = 1000 * (distance[chosen] - wanted_m)
    angle_deg = np.degrees(bearing[chosen])
    bias, ripple = bias_and_ripple(1000 * (distance - wanted_m), chosen)
    _, sway = bias_and_ripple(np.degrees(bearing), chosen)
    values = (
        math.sqrt(float(np.mean(error_mm**2))),
        math.sqrt(float(np.mean(angle_deg**2))),
        float(angle_deg.std()),
        bias,
        ripple,
        sway,
    )
    return dict(zip(SUMMARY, values, strict=True))


def bias_and_ripple(errors: Floats, chosen: Flags) -> tuple[float, float]:
    """Return the RMS over followers of their mean errors, and of their spread about these, weighted
    by how long each was chosen; both (periods, followers).
    """
    counts = chosen.sum(axis=0)
    kept = np.where(chosen, errors, 0.0)
    means = kept.sum(axis=0) / np.maximum(counts, 1)
    spread = np.where(chosen, errors - means, 0.0)
    bias = float(np.sum(counts * means**2) / counts.sum())
    ripple = float(np.sum(spread**2) / counts.sum())
    return math.sqrt(bias), math.sqrt(ripple)
