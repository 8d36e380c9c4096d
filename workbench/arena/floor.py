"""The floor as the ground sensors see it: how far every place is from the edge of the black line.

The juddered line of every formation is drawn once, as a raster of distances from its edge, which is
smooth where darkness is not: read between cells, the edge is as sharp as a real sensor sees it
(``robot.ground.SPOT``). A look-up is the share of the sensor's spot that is black, exact for an
edge much longer than the spot, our approximation at crossings.

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> floor = draw_floors([make_track(TrackConfig(judder="none"), np.random.default_rng(0))], 0.015)
>>> floor.darkness(0, np.array([[0.5, 0.0], [0.4, 0.0]])).round(2).tolist()
[1.0, 0.0]

Contract: a raster is int16, micrometres, negative on black, row = y, column = x. Cell (i, j) has
its centre at x = (column0 + j) · CELL, y = (row0 + i) · CELL: the lattice is the same for all
floors, so that what a sensor reads does not depend on which other tracks share a batch.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.tracks import SPACING, Track
from workbench.compiled import compiled, compiled_with_arrays
from workbench.robot.ground import SPOT

CELL = 0.002  # m
FAR = 32767  # µm from the line, or farther
_MARGIN = 25  # cells of white around a narrow line


@dataclass(frozen=True)
class Floor:
    """Rasters (B, rows, columns) of distances from the line's edge in µm, and the lattice index of
    their first row and column.
    """

    raster: NDArray[np.int16]
    column0: int
    row0: int

    def darkness(self, formation: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the darkness in [0, 1] of points (n, 2) of a formation's floor in m."""
        dark: NDArray[np.float64] = _darkness(
            self.raster[formation], self.column0, self.row0, np.ascontiguousarray(points)
        )
        return dark


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
    raster = np.full((len(tracks), rows, columns), FAR, np.int16)
    square = np.full((rows, columns), np.inf)
    # fewer points do for a wide line: between two of them its edge is off by their distance squared
    # over eight times its half width, at most 20 µm
    every = max(1, int(math.sqrt(4 * line_width_m * 2e-5) / SPACING))
    for own, track in zip(raster, tracks, strict=True):
        line = np.ascontiguousarray(track.line[::every])
        square.fill(np.inf)
        _draw(own, square, line, line_width_m / 2, _reach(line_width_m), int(low[0]), int(low[1]))
    return Floor(raster, int(low[0]), int(low[1]))


def _reach(line_width_m: float) -> int:
    """Return how many cells from a point of the line a look-up may need a distance."""
    return math.ceil((line_width_m / 2 + SPOT) / CELL) + 2


@compiled
def _draw(
    raster: Any, square: Any, line: Any, half: float, reach: int, column0: int, row0: int
) -> None:
    """Write the distances of cells that are near a line (n, 2), half of whose width is given;
    ``square`` holds infinities and takes the squares of distances from its middle.
    """
    for n in range(line.shape[0]):
        x, y = line[n, 0], line[n, 1]
        column = int(round(x / CELL))
        row = int(round(y / CELL))
        for i in range(row - reach, row + reach + 1):
            dy = i * CELL - y
            for j in range(column - reach, column + reach + 1):
                dx = j * CELL - x
                away = dx * dx + dy * dy
                if away < square[i - row0, j - column0]:
                    square[i - row0, j - column0] = away
    for i in range(square.shape[0]):
        for j in range(square.shape[1]):
            if square[i, j] < math.inf:
                edge = 1e6 * (math.sqrt(square[i, j]) - half)
                raster[i, j] = int(round(min(max(edge, -FAR), FAR)))


@compiled
def floor_darkness(raster: Any, column0: int, row0: int, x: float, y: float) -> float:
    """Return the darkness in [0, 1] of one floor (rows, columns) at x, y (m): distances are read
    bilinearly; white outside.
    """
    column, row = math.floor(x / CELL), math.floor(y / CELL)
    j = column - column0
    i = row - row0
    if not (0 <= j < raster.shape[1] - 1 and 0 <= i < raster.shape[0] - 1):
        return 0.0
    u, v = x / CELL - column, y / CELL - row
    low = (1.0 - u) * raster[i, j] + u * raster[i, j + 1]
    high = (1.0 - u) * raster[i + 1, j] + u * raster[i + 1, j + 1]
    away = 1e-6 * ((1.0 - v) * low + v * high)
    dark: float = min(max(0.5 - away / (2.0 * SPOT), 0.0), 1.0)
    return dark


@compiled_with_arrays
def _darkness(raster: Any, column0: int, row0: int, points: Any) -> Any:
    dark = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        dark[n] = floor_darkness(raster, column0, row0, points[n, 0], points[n, 1])
    return dark
