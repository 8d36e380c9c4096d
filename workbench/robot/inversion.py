"""From two infrared readings to distance and bearing, and where that is possible (paper section
III-B, "preprocessing").

The left and the right front sensor look 17° to both sides. Their sum tells the distance, their
ratio the bearing:

    u = log(l + r + 2 n₀)      v = log(l + n₀) - log(r + n₀)

where n₀ = 3 counts keeps the noise of dark readings small.

``inversion_table`` inverts the mean response of a matched sensor pair once; ``invert`` looks a pair
up by bilinear interpolation. Beyond ±35° the ratio falls again, as both sensors lose the target:
there two readings determine nothing, and the inverse is clipped.

>>> from workbench.robot.infrared import InfraredConfig, front_pair
>>> table = inversion_table(InfraredConfig())
>>> distance, bearing = invert(table, *front_pair(0.105, math.radians(12), InfraredConfig()))
>>> round(distance, 3), round(math.degrees(bearing), 1)
(0.105, 12.0)

Contract: tables are read-only, (2, NODES, NODES): distance in m and bearing in rad over u and v.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled, compiled_with_arrays
from workbench.robot.infrared import (
    DARK,
    RAYS,
    Circles,
    InfraredConfig,
    circles_light,
    noise_sd,
    saturate,
    strength_of,
)

NODES = 65
FLOOR = 3.0  # counts: n₀
U = (math.log(2 * FLOOR), math.log(8000.0))
V = (-6.5, 6.5)
DISTANCES = (0.0715, 0.25)  # m between centres: from contact to the noise
WIDEST = math.radians(35)  # bearing at which the ratio of the front sensors is largest


@compiled
def pair_coordinates(left: float, right: float) -> tuple[float, float]:
    """Return u, which falls with distance, and v, which grows with bearing, of two calibrated
    readings in counts.
    """
    return math.log(left + right + 2 * FLOOR), math.log((left + FLOOR) / (right + FLOOR))


@compiled
def invert(table: Any, left: float, right: float) -> tuple[float, float]:
    """Return distance in m and bearing in rad for a left and a right reading in counts."""
    u, v = pair_coordinates(left, right)
    a = min(max((u - U[0]) / (U[1] - U[0]) * (NODES - 1), 0.0), NODES - 1.000001)
    b = min(max((v - V[0]) / (V[1] - V[0]) * (NODES - 1), 0.0), NODES - 1.000001)
    i, j = int(a), int(b)
    p, q = a - i, b - j
    w00 = (1 - p) * (1 - q)
    w01 = (1 - p) * q
    w10 = p * (1 - q)
    w11 = p * q
    distance: float = (
        w00 * table[0, i, j]
        + w01 * table[0, i, j + 1]
        + w10 * table[0, i + 1, j]
        + w11 * table[0, i + 1, j + 1]
    )
    bearing: float = (
        w00 * table[1, i, j]
        + w01 * table[1, i, j + 1]
        + w10 * table[1, i + 1, j]
        + w11 * table[1, i + 1, j + 1]
    )
    return distance, bearing


@compiled_with_arrays
def pairs(
    distances: Any, bearings: Any, radius: float, strength: float, beacon: int, out: Any
) -> None:
    """Write mean left and right front readings into out (2, distances, bearings) for a target of
    ``strength_of``.
    """
    cx = np.empty(1)
    cy = np.empty(1)
    target = Circles(cx, cy, 1, radius, strength, beacon, np.empty(RAYS))
    for i in range(distances.size):
        for j in range(bearings.size):
            cx[0] = distances[i] * math.cos(bearings[j])
            cy[0] = distances[i] * math.sin(bearings[j])
            for side, sensor in enumerate((7, 0)):
                light = circles_light(sensor, 0.0, 0.0, 1.0, 0.0, target)
                out[side, i, j] = saturate(light, DARK)


def mean_pairs(
    distances_m: NDArray[np.float64], bearings_rad: NDArray[np.float64], config: InfraredConfig
) -> NDArray[np.float64]:
    """Return mean left and right front readings of matched sensors, (2, distances, bearings) in
    counts.
    """
    out = np.empty((2, len(distances_m), len(bearings_rad)))
    pairs(
        np.asarray(distances_m, float), np.asarray(bearings_rad, float), *strength_of(config), out
    )
    return out


def inversion_table(config: InfraredConfig) -> NDArray[np.float64]:
    """Return the table that ``invert`` reads, for what a configuration's robots show; nothing else
    of it matters.
    """
    return _table(config.target, config.brightness)


@lru_cache(maxsize=32)
def _table(target: str, brightness: float) -> NDArray[np.float64]:
    distances = np.linspace(*DISTANCES, 240)
    bearings = np.linspace(-WIDEST, WIDEST, 141)
    left, right = mean_pairs(
        distances, bearings, InfraredConfig(target=target, brightness=brightness)
    )
    u, v = np.log(left + right + 2 * FLOOR), np.log((left + FLOOR) / (right + FLOOR))
    nodes_u = np.linspace(*U, NODES)
    nodes_v = np.linspace(*V, NODES)
    # along every distance, where on the curve of bearings is v? then, for that v, at which distance
    # is u?
    bearing_at = np.array([np.interp(nodes_v, np.maximum.accumulate(row), bearings) for row in v])
    u_at = np.array([np.interp(bearing_at[i], bearings, u[i]) for i in range(distances.size)])
    table = np.empty((2, NODES, NODES))
    for j in range(NODES):
        falling = np.minimum.accumulate(u_at[:, j])[::-1]
        table[0, :, j] = np.interp(nodes_u, falling, distances[::-1])
        table[1, :, j] = np.interp(table[0, :, j], distances, bearing_at[:, j])
    table.flags.writeable = False
    return table


def uncertainty(
    distances_m: NDArray[np.float64], bearings_rad: NDArray[np.float64], config: InfraredConfig
) -> NDArray[np.float64]:
    """Return the smallest standard deviations that any unbiased estimate from two readings can
    have, (2, D, B) in m and rad.

    The Cramér–Rao bound of independent noise on both readings, (Jᵀ Σ⁻¹ J)⁻¹, with the sensors'
    gains known. Infinite where the readings do not determine both.
    """
    # wide enough to bridge the 5° between two rays of the lobe
    h_d = 2e-3
    h_b = math.radians(2.5)
    d = np.asarray(distances_m, float)
    b = np.asarray(bearings_rad, float)
    known = replace(config, gain_spread=0.0)
    slope_d = (mean_pairs(d + h_d, b, known) - mean_pairs(d - h_d, b, known)) / (2 * h_d)
    slope_b = (mean_pairs(d, b + h_b, known) - mean_pairs(d, b - h_b, known)) / (2 * h_b)
    readings = mean_pairs(d, b, known)
    sd = np.vectorize(noise_sd)(readings)
    jacobian = np.stack([slope_d, slope_b], axis=-1) / sd[..., None]  # (2, D, B, 2)
    information = np.einsum("sabi,sabj->abij", jacobian, jacobian)
    determinant = np.linalg.det(information)
    safe = np.maximum(determinant, 1e-30)
    bound = np.stack([information[..., 1, 1] / safe, information[..., 0, 0] / safe])
    spread = config.noise / math.sqrt(config.samples)
    result: NDArray[np.float64] = np.where(determinant > 1e-11, spread * np.sqrt(bound), np.inf)
    return result
