"""The floor as the ground sensors see it: rasters of darkness, 0 on white and 1 on the black line.

The juddered line of every formation is drawn once; its edge is softened by the radius of a ground
sensor's spot, so that a single look-up is the share of the spot that is black (exact for an edge
much longer than the spot, our approximation at crossings).

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> floor = draw_floors([make_track(TrackConfig(judder="none"), np.random.default_rng(0))], 0.015)
>>> at = (floor.raster[0], floor.column0, floor.row0)
>>> [round(floor_darkness(*at, x, 0.0), 2) for x in (0.5, 0.4)]
[1.0, 0.0]

Contract: a raster is uint8, row = y, column = x. Cell (i, j) has its centre at x = (column0 + j) ·
CELL, y = (row0 + i) · CELL: the lattice is the same for all floors, so that what a sensor reads
does not depend on which other tracks share a batch.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.tracks import SPACING, Track
from workbench.compiled import compiled
from workbench.robot.ground import SPOT

CELL = 0.002  # m
_MARGIN = 25  # cells of white around a narrow line


@dataclass(frozen=True)
class Floor:
    """Rasters (B, rows, columns) of darkness 0 to 255, and the lattice index of their first row and
    column.
    """

    raster: NDArray[np.uint8]
    column0: int
    row0: int


def draw_floors(tracks: Sequence[Track], line_width_m: float) -> Floor:
    """Draw the line of every track, line_width_m wide, into rasters of equal size."""
    margin = max(_MARGIN, _reach(line_width_m) + 1)
    low = (
        np.floor(np.min([track.line.min(axis=0) for track in tracks], axis=0) / CELL).astype(int)
        - margin
    )
    high = (
        np.ceil(np.max([track.line.max(axis=0) for track in tracks], axis=0) / CELL).astype(int)
        + margin
    )
    columns, rows = (int(n) + 1 for n in high - low)
    raster = np.stack([_draw(track, line_width_m, low, (rows, columns)) for track in tracks])
    return Floor(raster, int(low[0]), int(low[1]))


def _reach(line_width_m: float) -> int:
    """Return how many cells from a point of the line there may be darkness."""
    return math.ceil((line_width_m / 2 + SPOT) / CELL) + 1


def _draw(
    track: Track, line_width_m: float, low: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.uint8]:
    reach = _reach(line_width_m)
    window = range(-reach, reach + 1)
    nearest = np.full(shape, np.inf)
    line = track.line[
        :: max(1, int(line_width_m / 2 / SPACING / 6))
    ]  # fewer points do for a wide line
    cells = np.round(line / CELL).astype(int)
    for dy in window:
        for dx in window:
            column, row = cells[:, 0] + dx, cells[:, 1] + dy
            gap = np.hypot(column * CELL - line[:, 0], row * CELL - line[:, 1])
            np.minimum.at(nearest, (row - low[1], column - low[0]), gap)
    dark = np.clip((line_width_m / 2 + SPOT - nearest) / (2 * SPOT), 0.0, 1.0)
    return np.round(255 * dark).astype(np.uint8)


@compiled
def floor_darkness(raster: Any, column0: int, row0: int, x: float, y: float) -> float:
    """Return the darkness in [0, 1] of one floor (rows, columns) at x, y (m): bilinear, white
    outside.
    """
    column, row = math.floor(x / CELL), math.floor(y / CELL)
    j = column - column0
    i = row - row0
    if not (0 <= j < raster.shape[1] - 1 and 0 <= i < raster.shape[0] - 1):
        return 0.0
    u, v = x / CELL - column, y / CELL - row
    low = (1.0 - u) * raster[i, j] + u * raster[i, j + 1]
    high = (1.0 - u) * raster[i + 1, j] + u * raster[i + 1, j + 1]
    dark: float = ((1.0 - v) * low + v * high) / 255.0
    return dark
