"""Tile coding: one tiling turns a number into the index of its cell, a grid turns several into a
state.

The paper uses "static binary single feature tile coding" (section I-A, II-A): exactly one feature,
the cell, is active. Cells are half open, [edge_k, edge_{k+1}); what lies outside all cells has
index -1 and ends an episode. The edges are computed once; looking a value up never evaluates a
logarithm, which would put values on an edge into the wrong cell.

>>> tiles = Tiling.uniform(-0.07, 0.07, 9)
>>> tiles.index(0.0), tiles.index(-0.07), tiles.index(0.07)
(4, 0, -1)
>>> fine = Tiling.logarithmic(-0.07, 0.07, 5, inner=0.003)
>>> [round(1000 * float(edge), 1) for edge in fine.edges]
[-70.0, -14.5, -3.0, 3.0, 14.5, 70.0]

Several offset tilings of one range, each shifted by a part of a cell, make one value active in
several features: coarse cells generalise, their overlaps resolve (Sutton & Barto, 2nd ed., section
9.5.4). The paper uses one; ``offset_grids`` gives more.

Contract: tilings are immutable and their arrays are read-only.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.compiled import compiled

MAX_TILES = (
    64  # per dimension; how many of them, and tilings, the records of the loop have room for
)
MAX_TILINGS = 8


@compiled
def tile_index(edges: NDArray[np.float64], n: int, x: float) -> int:
    """Return k with edges[k] <= x < edges[k+1] among the first n cells, or -1 (also for NaN)."""
    if not (x >= edges[0] and x < edges[n]):
        return -1
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if x >= edges[middle]:
            low = middle
        else:
            high = middle
    return low


@dataclass(frozen=True, eq=False)
class Tiling:
    """One partition of [lo, hi) into cells. Build it with ``uniform`` or ``logarithmic``.

    Attributes:
        edges: (n + 1,) increasing cell borders, in the unit of the value.
        kind: "uniform" or "logarithmic".
    """

    edges: NDArray[np.float64]
    kind: str

    def __post_init__(self) -> None:
        edges = np.array(self.edges, dtype=np.float64)
        if (
            edges.ndim != 1
            or edges.size < 2
            or not np.all(np.isfinite(edges))
            or not np.all(np.diff(edges) > 0)
        ):
            raise ValueError(
                f"edges = {self.edges!r}; expected at least two finite, strictly increasing numbers"
            )
        edges.flags.writeable = False
        object.__setattr__(self, "edges", edges)

    @classmethod
    def uniform(cls, lo: float, hi: float, n: int) -> "Tiling":
        """Return n cells of equal width on [lo, hi).

        Raises:
            ValueError: lo >= hi, n < 1, or a bound is not finite.
        """
        _check_range(lo, hi, n)
        return cls(np.linspace(lo, hi, n + 1), "uniform")

    @classmethod
    def logarithmic(cls, lo: float, hi: float, n: int, *, inner: float | None = None) -> "Tiling":
        """Return n cells whose edges grow geometrically.

        Without ``inner`` the edges are geometric from lo > 0 to hi, for raw readings. With
        ``inner`` the tiling is symmetric about the middle of [lo, hi), for errors: the middle cell
        has half width ``inner`` and the edges on both sides grow geometrically from there to the
        bounds.

        Raises:
            ValueError: lo >= hi, n < 1, a bound is not finite, lo <= 0 without ``inner``; with
                ``inner``: n even or below 3, or ``inner`` outside (0, (hi - lo) / 2).
        """
        _check_range(lo, hi, n)
        if inner is None:
            if lo <= 0:
                raise ValueError(
                    f"lo = {lo!r}; geometric edges need lo > 0. For errors around a middle "
                    "give inner="
                )
            edges = np.geomspace(lo, hi, n + 1)
        else:
            half = (hi - lo) / 2
            if n % 2 == 0 or n < 3:
                raise ValueError(
                    f"n = {n!r}; with inner= the number of cells must be odd and at least 3"
                )
            if not 0 < inner < half:
                raise ValueError(f"inner = {inner!r}; expected a half width between 0 and {half:g}")
            side = np.geomspace(inner, half, (n - 1) // 2 + 1)
            edges = (lo + hi) / 2 + np.concatenate([-side[::-1], side])
        edges[0] = lo
        edges[-1] = hi
        return cls(edges, "logarithmic")

    def shifted(self, part: float) -> "Tiling":
        """Return the tiling moved down by a part of a cell in [0, 1), with the same bounds: one
        more cell, those at the ends cut.

        Raises:
            ValueError: part outside [0, 1).
        """
        if not 0.0 <= part < 1.0:
            raise ValueError(f"part = {part!r}; expected a number from 0 to below 1")
        if part == 0.0:
            return self
        inner = np.interp(np.arange(1, self.n + 1) - part, np.arange(self.n + 1), self.edges)
        return Tiling(np.concatenate([self.edges[:1], inner, self.edges[-1:]]), self.kind)

    @property
    def n(self) -> int:
        """Number of cells."""
        return self.edges.size - 1

    @property
    def centres(self) -> NDArray[np.float64]:
        """(n,) middles of the cells."""
        centres: NDArray[np.float64] = (self.edges[:-1] + self.edges[1:]) / 2
        return centres

    def bounds(self, k: int) -> tuple[float, float]:
        """Return the lower and upper border of cell k."""
        if not 0 <= k < self.n:
            raise ValueError(f"cell {k!r}; the tiling has cells 0 to {self.n - 1}")
        return float(self.edges[k]), float(self.edges[k + 1])

    def index(self, x: float) -> int:
        """Return the cell that holds x, or -1 outside [lo, hi).

        Raises:
            ValueError: x is NaN, which is a broken reading and not a place.
        """
        if math.isnan(x):
            raise ValueError("x = nan has no cell; check the sensor that it comes from")
        return int(tile_index(self.edges, self.n, float(x)))

    def indices(self, x: ArrayLike) -> NDArray[np.int64]:
        """Return the cell of every entry of x, -1 outside; same shape as x.

        NaN raises ValueError.
        """
        values = np.asarray(x, dtype=np.float64)
        if np.any(np.isnan(values)):
            raise ValueError(
                f"{int(np.isnan(values).sum())} of {values.size} values are nan and have no cell"
            )
        found = np.searchsorted(self.edges, values, side="right") - 1
        return np.where((values >= self.edges[0]) & (values < self.edges[-1]), found, -1)


class TileGrid:
    """The product of several tilings: one state index for one value per tiling, the last one
    fastest.

    Args:
        tilings: one or more tilings, in the order of the state index.
    """

    def __init__(self, *tilings: Tiling) -> None:
        if not tilings:
            raise ValueError("a grid needs at least one tiling")
        self.tilings = tilings
        self.shape = tuple(tiling.n for tiling in tilings)
        self.n = math.prod(self.shape)

    def index(self, *values: float) -> int:
        """Return the state of one value per tiling, or -1 if any of them lies outside its
        tiling.
        """
        if len(values) != len(self.tilings):
            raise ValueError(
                f"{len(values)} values for {len(self.tilings)} tilings; give one value per tiling"
            )
        state = 0
        for tiling, value in zip(self.tilings, values, strict=True):
            cell = tiling.index(value)
            if cell < 0:
                return -1
            state = state * tiling.n + cell
        return state

    def cells(self, state: int) -> tuple[int, ...]:
        """Return the cell of every tiling for a state."""
        if not 0 <= state < self.n:
            raise ValueError(f"state {state!r}; the grid has states 0 to {self.n - 1}")
        return tuple(int(cell) for cell in np.unravel_index(state, self.shape))

    def centre(self, state: int) -> tuple[float, ...]:
        """Return the middle of a state, one value per tiling."""
        return tuple(
            float(t.centres[k]) for t, k in zip(self.tilings, self.cells(state), strict=True)
        )

    def bounds(self, state: int) -> tuple[tuple[float, float], ...]:
        """Return the borders of a state, (lower, upper) per tiling."""
        return tuple(t.bounds(k) for t, k in zip(self.tilings, self.cells(state), strict=True))


def offset_grids(grid: TileGrid, count: int) -> tuple[TileGrid, ...]:
    """Return ``count`` grids over the same bounds, the first one ``grid`` itself, the k-th shifted
    by parts of a cell.

    Along dimension j the shift is k (2j + 1) / count modulo 1: the displacement by odd numbers that
    Sutton & Barto recommend.

    Raises:
        ValueError: count is not a power of two, for which these shifts are all different.
    """
    if count < 1 or count & (count - 1):
        raise ValueError(f"{count!r} tilings; expected a power of two")
    return tuple(
        TileGrid(
            *(
                tiling.shifted(k * (2 * j + 1) / count % 1.0)
                for j, tiling in enumerate(grid.tilings)
            )
        )
        for k in range(count)
    )


def _check_range(lo: float, hi: float, n: int) -> None:
    if not (math.isfinite(lo) and math.isfinite(hi)):
        raise ValueError(f"lo = {lo!r}, hi = {hi!r}; expected two finite numbers")
    if lo >= hi:
        raise ValueError(f"lo = {lo!r}, hi = {hi!r}; expected lo < hi")
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
        raise ValueError(f"n = {n!r}; expected a whole number of cells, at least 1")
