"""Tilings: partition of the range, half-open cells, and refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from workbench.learning.tiles import TileGrid, Tiling, offset_grids, tile_index


@given(st.floats(-5, 5), st.floats(0.01, 5), st.integers(1, 40), st.floats(0, 1, exclude_max=True))
def test_every_value_inside_the_bounds_has_exactly_one_cell(lo, width, n, part):
    tiles = Tiling.uniform(lo, lo + width, n)
    x = min(lo + part * width, math.nextafter(lo + width, -math.inf))
    k = tiles.index(x)
    assert 0 <= k < n
    low, high = tiles.bounds(k)
    assert low <= x < high


def test_cells_are_half_open_and_outside_is_minus_one():
    tiles = Tiling.uniform(0.0, 1.0, 4)
    assert [tiles.index(x) for x in (0.0, 0.25, 0.5, 0.75)] == [0, 1, 2, 3]
    assert [tiles.index(x) for x in (-1e-12, 1.0, 7.0)] == [-1, -1, -1]
    assert tiles.index(math.nextafter(0.25, 0)) == 0


@pytest.mark.parametrize("n", [2, 9, 40])
def test_geometric_edges_fall_into_the_cell_that_they_open(n):
    # floor(n log(x/lo) / log(hi/lo)) puts some edges into the cell below; a look-up in stored edges
    # does not
    tiles = Tiling.logarithmic(1.0, 4095.0, n)
    assert [tiles.index(edge) for edge in tiles.edges[:-1]] == list(range(n))
    ratio = tiles.edges[1:] / tiles.edges[:-1]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)


def test_symmetric_logarithmic_tiles_mirror_about_the_middle():
    tiles = Tiling.logarithmic(-0.07, 0.07, 9, inner=0.003)
    np.testing.assert_allclose(tiles.edges, -tiles.edges[::-1], rtol=0, atol=1e-17)
    assert tiles.bounds(4) == (-0.003, 0.003)
    assert np.all(np.diff(np.diff(tiles.edges)[5:]) > 0)


def test_compiled_and_vectorised_lookup_agree_with_the_method():
    tiles = Tiling.logarithmic(-1.0, 1.0, 7, inner=0.1)
    x = np.concatenate([np.linspace(-1.2, 1.2, 401), tiles.edges])
    one_by_one = [tiles.index(value) for value in x]
    assert tiles.indices(x).tolist() == one_by_one
    assert [tile_index(tiles.edges, tiles.n, value) for value in x] == one_by_one
    assert tile_index(tiles.edges, tiles.n, math.nan) == -1


@pytest.mark.parametrize(
    "tiling",
    [Tiling.uniform(-0.07, 0.07, 9), Tiling.logarithmic(-0.7, 0.7, 9, inner=0.03)],
    ids=["uniform", "logarithmic"],
)
def test_a_shifted_tiling_keeps_its_bounds_and_cuts_the_cells_at_the_ends(tiling):
    assert tiling.shifted(0.0) is tiling
    half = tiling.shifted(0.5)
    assert half.n == tiling.n + 1
    assert (half.edges[0], half.edges[-1]) == (tiling.edges[0], tiling.edges[-1])
    np.testing.assert_allclose(
        half.edges[1:-1], tiling.centres, atol=1e-15
    )  # edges of the half shift are the old middles
    with pytest.raises(ValueError, match="part = 1.0; expected a number from 0 to below 1"):
        tiling.shifted(1.0)


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_offset_grids_resolve_count_times_as_many_places_along_each_dimension(count):
    base = TileGrid(Tiling.uniform(0.0, 5.0, 5), Tiling.uniform(0.0, 5.0, 5))
    grids = offset_grids(base, count)
    assert len(grids) == count and grids[0].tilings == base.tilings
    for j in (0, 1):
        shifts = {round(float(grid.tilings[j].edges[1]), 9) for grid in grids}
        assert shifts == {
            round(1 - k / count, 9) for k in range(count)
        }  # first inner edge at 1 - k/count, all different
    line = np.linspace(0, 4.999, 997)
    codes = {tuple(grid.index(x, 2.2) for grid in grids) for x in line}
    assert len(codes) == 5 * count


def test_the_number_of_offset_tilings_must_be_a_power_of_two():
    with pytest.raises(ValueError, match="3 tilings; expected a power of two"):
        offset_grids(TileGrid(Tiling.uniform(0.0, 1.0, 2)), 3)


def test_grid_counts_the_last_tiling_fastest_and_knows_centres_and_bounds():
    grid = TileGrid(Tiling.uniform(-3.0, 3.0, 3), Tiling.uniform(0.0, 4.0, 2))
    assert (grid.shape, grid.n) == ((3, 2), 6)
    assert grid.index(0.0, 3.0) == 1 * 2 + 1  # row 1, column 1
    assert grid.index(0.0, 4.0) == -1
    assert grid.cells(5) == (2, 1)
    assert grid.centre(5) == (2.0, 3.0)
    assert grid.bounds(0) == ((-3.0, -1.0), (0.0, 2.0))
    assert [grid.index(*grid.centre(s)) for s in range(6)] == list(range(6))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Tiling.uniform(1.0, 1.0, 3), "lo = 1.0, hi = 1.0; expected lo < hi"),
        (lambda: Tiling.uniform(2.0, 1.0, 3), "expected lo < hi"),
        (
            lambda: Tiling.uniform(0.0, 1.0, 0),
            "n = 0; expected a whole number of cells, at least 1",
        ),
        (lambda: Tiling.uniform(0.0, 1.0, 2.5), "n = 2.5"),
        (lambda: Tiling.uniform(0.0, 1.0, math.nan), "n = nan"),
        (lambda: Tiling.uniform(math.nan, 1.0, 3), "lo = nan"),
        (lambda: Tiling.uniform(0.0, math.inf, 3), "hi = inf"),
        (lambda: Tiling.logarithmic(0.0, 1.0, 3), "need lo > 0"),
        (
            lambda: Tiling.logarithmic(-1.0, 1.0, 4, inner=0.1),
            "n = 4; with inner= the number of cells must be odd",
        ),
        (lambda: Tiling.logarithmic(-1.0, 1.0, 1, inner=0.1), "at least 3"),
        (
            lambda: Tiling.logarithmic(-1.0, 1.0, 5, inner=1.0),
            "inner = 1.0; expected a half width between 0 and 1",
        ),
        (lambda: Tiling.logarithmic(-1.0, 1.0, 5, inner=math.nan), "inner = nan"),
        (lambda: Tiling(np.array([0.0, 1.0, 1.0]), "uniform"), "strictly increasing"),
        (lambda: Tiling.uniform(0.0, 1.0, 3).index(math.nan), "x = nan has no cell"),
        (lambda: Tiling.uniform(0.0, 1.0, 3).indices([0.1, math.nan]), "1 of 2 values are nan"),
        (lambda: Tiling.uniform(0.0, 1.0, 3).bounds(3), "cell 3; the tiling has cells 0 to 2"),
        (TileGrid, "at least one tiling"),
        (lambda: TileGrid(Tiling.uniform(0, 1, 2)).index(0.1, 0.2), "2 values for 1 tilings"),
        (lambda: TileGrid(Tiling.uniform(0, 1, 2)).cells(2), "state 2; the grid has states 0 to 1"),
    ],
)
def test_bad_tilings_are_refused_with_the_value(build, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace(")", r"\)")):
        build()


def test_edges_cannot_be_changed_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        Tiling.uniform(0.0, 1.0, 3).edges[0] = 5.0
