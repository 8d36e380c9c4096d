"""From a table to calm and exact commands: interpolation between cells, trim, relative actions.

A greedy table jumps at the edges of its cells. With ``output="interpolated"`` the command is the
bilinear mean of the greedy commands in the middles of the four nearest cells, on the lattice of all
edges of all tilings: practice of look-up-table control, nothing is learned for it. Beyond the
outermost middles nothing changes any more.

``trim`` adds the integral of the distance error to what is tiled, which takes away the constant
offset that a table without memory cannot: I ← I + k e_d within ± a limit, tiled is e_d + I. It
rests while the wheels have nothing left to give, and begins at 0 with every episode.

With ``actions="relative"`` levels are added to the estimated speed of the predecessor.

Who learns drives by the table's own actions, unless ``learn_by="output"`` says that it
interpolates, too: the greedy action of a cell then stands for what the output makes of it there,
and ρ, which is a ratio of choices, stays as it is. What an action means then changes as its
neighbours learn. Trim rests while a follower learns: a table that is told a wrong error learns to
live with it.

Contract: compiled, whole numbers where commands are made, so that a firmware without floating point
does the same to the last bit (``logs.export_c``).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled
from workbench.learning.behaviour import greedy_of_sum
from workbench.learning.tiles import MAX_TILES, MAX_TILINGS, TileGrid, tile_index

OUTPUTS = ("greedy", "interpolated")
ACTIONS = ("wheels", "relative")
LEARN_BY = ("table", "output")
PARTS = 256  # of the way from one middle to the next
_HALF = PARTS * PARTS // 2
MOST_CELLS = MAX_TILES * MAX_TILINGS + 2  # of the lattice, per dimension

_PLACES = ("i2", (MAX_TILINGS, MOST_CELLS))
LATTICE = np.dtype(
    [
        ("distance_edges", "f8", (MOST_CELLS,)),
        ("bearing_edges", "f8", (MOST_CELLS,)),
        ("distance_cells", "i8"),
        ("bearing_cells", "i8"),
        ("distance_tiles", *_PLACES),  # of every tiling, where a cell of the lattice lies
        ("bearing_tiles", *_PLACES),
    ]
)
OUTPUT_TASK = np.dtype(
    [
        ("interpolated", "i8"),
        ("relative", "i8"),
        ("learning", "i8"),  # whether who learns interpolates, too
        ("trim", "f8"),  # gain per control period, limit in m
        ("trim_limit", "f8"),
        ("lattice", LATTICE),
    ]
)
# what is added to the distance error, m; of raw readings, see ``senses.infrared``
OUTPUT = np.dtype(
    [
        ("trim", "f8"),
        ("left", "i8"),  # the last command of the table, steps/s
        ("right", "i8"),
        ("cells", "i8", (MAX_TILINGS,)),
    ]
)


def lattice_edges(grids: tuple[TileGrid, ...]) -> tuple[NDArray[np.float64], ...]:
    """Return the edges of all tilings together, per dimension: between them nothing changes."""
    return tuple(
        np.unique(np.concatenate([grid.tilings[axis].edges for grid in grids])) for axis in (0, 1)
    )


def lattice_fields(grids: tuple[TileGrid, ...]) -> dict[str, NDArray[np.generic] | int]:
    """Return the fields of LATTICE for offset grids."""
    found: dict[str, NDArray[np.generic] | int] = {}
    for axis, name in enumerate(("distance", "bearing")):
        edges = lattice_edges(grids)[axis]
        middles = (edges[:-1] + edges[1:]) / 2
        places = np.zeros(LATTICE[f"{name}_tiles"].shape, np.int16)
        for k, grid in enumerate(grids):
            places[k, : len(middles)] = grid.tilings[axis].indices(middles)
        found[f"{name}_edges"] = np.pad(edges, (0, MOST_CELLS - len(edges)))
        found[f"{name}_cells"] = len(middles)
        found[f"{name}_tiles"] = places
    return found


@compiled
def place_on(edges: Any, cells: int, x: float) -> int:
    """Return where x lies between the middles of cells, in PARTS of the way from one to the next:
    0 at the first middle and below, PARTS (cells - 1) at the last one and above.
    """
    cell = tile_index(edges, cells, x)
    if cell < 0:
        return 0 if x < edges[0] else PARTS * (cells - 1)
    way = cell - 0.5 + (x - edges[cell]) / (edges[cell + 1] - edges[cell])
    return int(min(max(way, 0.0), cells - 1.0) * PARTS + 0.5)


@compiled
def interpolate(task: Any, follower: Any, theta: Any) -> tuple[int, int]:
    """Return the mean of the greedy commands around the tiled place, in steps/s.

    Args:
        task, follower: records of type TASK and ROBOT; ``follower.learning.place`` is tiled.
        theta: main weights of the follower's table.
    """
    grid = task.grid
    lattice = task.output.lattice
    place = follower.learning.place
    row = place_on(lattice.distance_edges, lattice.distance_cells, place[0])
    column = place_on(lattice.bearing_edges, lattice.bearing_cells, place[1])
    x, y = row % PARTS, column % PARTS
    left = right = 0
    for below in range(2):
        for beside in range(2):
            weight = (x if below else PARTS - x) * (y if beside else PARTS - y)
            if weight == 0:
                continue
            action = _greedy_at(
                grid,
                lattice,
                follower.output.cells,
                theta,
                row // PARTS + below,
                column // PARTS + beside,
            )
            left += weight * grid.left_steps[action // grid.right_levels]
            right += weight * grid.right_steps[action % grid.right_levels]
    return (left + _HALF) // (PARTS * PARTS), (right + _HALF) // (PARTS * PARTS)


@compiled
def _greedy_at(grid: Any, lattice: Any, cells: Any, theta: Any, row: int, column: int) -> int:
    """Return the greedy action in a cell of the lattice."""
    for k in range(grid.tilings):
        cell = lattice.distance_tiles[k, row] * grid.bearing_tiles[k]
        cell += lattice.bearing_tiles[k, column]
        cells[k] = (grid.first_row[k] + cell) * grid.actions
    return greedy_of_sum(theta, cells, grid.tilings, grid.actions)


@compiled
def spent(task: Any, follower: Any, e_d: float) -> bool:
    """Return whether the wheels have nothing left to give against a distance error of this sign:
    an integral must not go on.
    """
    levels = task.grid.right_levels
    left = task.grid.left_steps
    right = task.grid.right_steps
    left_levels = task.grid.actions // levels
    output = follower.output
    if e_d > 0.0:
        return bool(output.left >= left[left_levels - 1] and output.right >= right[levels - 1])
    return bool(output.left <= left[0] and output.right <= right[0])


@compiled
def trim_error(task: Any, follower: Any, e_d: float, first: float, second: float) -> Any:
    """Return what is tiled instead of errors in m and rad once the integral has gone on: the
    distance error with it, kept inside the bounds.
    """
    output = follower.output
    if not spent(task, follower, e_d):
        limit = task.output.trim_limit
        output.trim = min(max(output.trim + task.output.trim * e_d, -limit), limit)
    most = task.bounds.half_range * (1.0 - 1e-9)
    return min(max(first + output.trim, -most), most), second


@compiled
def about(task: Any, pace: float, turn: float, left: int, right: int) -> tuple[int, int]:
    """Return wheel commands about a pace in m/s and a turning rate in rad/s, in whole steps/s."""
    most = task.motors.most
    aside = turn * task.motors.track_m / 2
    inner = int(math.floor((pace - aside) / task.motors.step_m + 0.5))
    outer = int(math.floor((pace + aside) / task.motors.step_m + 0.5))
    return min(max(inner + left, -most), most), min(max(outer + right, -most), most)
