"""The floor as the ground sensors see it: a raster of darkness, 0 on white and 1 on the black line.

The juddered line is drawn once per formation; the edge is softened by the radius of a ground sensor's spot, so that a
single look-up is the share of the spot that is black (exact for an edge much longer than the spot, our approximation at
line ends and crossings).

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> line = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
>>> floor = draw_floor(line, 0.015)
>>> [round(floor_darkness(floor.raster, floor.x0, floor.y0, x, 0.0), 2) for x in (0.5, 0.4)]
[1.0, 0.0]

Contract: the raster is uint8, row = y, column = x, cells of CELL metres; what lies outside is white.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workbench.arena.tracks import Track
from workbench.robot.ground import SPOT

CELL = 0.002  # m
_MARGIN = 0.05  # m of white around the line


@dataclass(frozen=True)
class Floor:
    """A raster (rows, columns) of darkness 0 to 255, whose cell [0, 0] has its centre at x0, y0 (m)."""

    raster: NDArray[np.uint8]
    x0: float
    y0: float


def draw_floor(track: Track, line_width_m: float) -> Floor:
    """Draw a track's line, line_width_m wide, into a new raster."""
    low = track.line.min(axis=0) - _MARGIN
    shape = np.ceil((track.line.max(axis=0) + _MARGIN - low) / CELL).astype(int) + 1
    return _draw(track, line_width_m, low, (int(shape[1]), int(shape[0])))


def draw_floors(tracks: list[Track], line_width_m: float) -> tuple[NDArray[np.uint8], float, float]:
    """Draw several lines into one stack of equal rasters.

    Returns:
        (stack, x0, y0): (B, rows, columns) uint8 and the place of cell [0, 0] in m.
    """
    low = np.min([track.line.min(axis=0) for track in tracks], axis=0) - _MARGIN
    high = np.max([track.line.max(axis=0) for track in tracks], axis=0) + _MARGIN
    columns, rows = (int(n) + 1 for n in np.ceil((high - low) / CELL))
    stack = np.stack([_draw(track, line_width_m, low, (rows, columns)).raster for track in tracks])
    return stack, float(low[0]), float(low[1])


def _draw(track: Track, line_width_m: float, low: NDArray[np.float64], shape: tuple[int, int]) -> Floor:
    reach = int(np.ceil((line_width_m / 2 + SPOT) / CELL)) + 1
    window = np.arange(-reach, reach + 1)
    nearest = np.full(shape, np.inf)
    cells = np.round((track.line - low) / CELL).astype(int)
    for dy in window:
        for dx in window:
            column, row = cells[:, 0] + dx, cells[:, 1] + dy
            gap = np.hypot(low[0] + column * CELL - track.line[:, 0], low[1] + row * CELL - track.line[:, 1])
            np.minimum.at(nearest, (row, column), gap)
    dark = np.clip((line_width_m / 2 + SPOT - nearest) / (2 * SPOT), 0.0, 1.0)
    return Floor(np.round(255 * dark).astype(np.uint8), float(low[0]), float(low[1]))


@njit(cache=True)
def floor_darkness(raster: Any, x0: float, y0: float, x: float, y: float) -> float:
    """Return the darkness in [0, 1] of the floor at x, y (m), bilinear between cells and white outside."""
    column, row = (x - x0) / CELL, (y - y0) / CELL
    if not (0.0 <= column < raster.shape[1] - 1 and 0.0 <= row < raster.shape[0] - 1):
        return 0.0
    i, j = int(row), int(column)
    v, u = row - i, column - j
    low = (1.0 - u) * raster[i, j] + u * raster[i, j + 1]
    high = (1.0 - u) * raster[i + 1, j] + u * raster[i + 1, j + 1]
    dark: float = ((1.0 - v) * low + v * high) / 255.0
    return dark
