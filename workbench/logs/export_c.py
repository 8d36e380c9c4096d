"""A learned policy as one C99 file for the robot's own firmware: thresholds on raw counts in, wheel
speeds out.

``export_c`` writes the greedy policy of one table, for weights that tile two raw infrared readings
(sensing "ir-raw"): there a firmware needs nothing but comparisons of whole counts. Offset tilings
are merged first: between neighbouring edges of all of them the greedy action is constant, so that
sums of weights need not travel. The file includes nothing but <stdint.h>, calls nothing, and knows
no floating point; tables are constant and small (the e-puck's dsPIC has 144 kB of flash).

    void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed);

Readings are calibrated counts (reading - free air, not below 0) of ps7 and ps0. The manoeuvre after
a loss is not part of it.

Contract: for whole counts from 0 to 4095, C and ``Policy`` choose the same action; a test compiles
and compares.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.formation.policy import Policy
from workbench.lab.storage import write_bytes
from workbench.learning.tiles import TileGrid

MOST = 4095  # counts


def merged(
    policy: Policy, table: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the thresholds of both readings in whole counts and the greedy actions between them.

    Returns:
        (left (n,), right (m,), actions (n + 1, m + 1)): reading x lies in cell k of an axis if k
        thresholds are at most x.
    """
    grids = policy.grids()
    axes = [_thresholds([grid.tilings[axis].edges for grid in grids]) for axis in (0, 1)]
    lowest = [np.concatenate([[0], edges]) for edges in axes]  # one reading in each cell
    actions = np.array(
        [[greedy_at(policy, grids, table, int(a), int(b)) for b in lowest[1]] for a in lowest[0]]
    )
    return axes[0], axes[1], actions


def greedy_at(
    policy: Policy, grids: tuple[TileGrid, ...], table: int, left: int, right: int
) -> int:
    """Return the greedy action at two readings, the lowest index on ties, as the compiled follower
    chooses it.
    """
    value = np.zeros(policy.theta.shape[2])
    first = 0
    for grid in grids:
        value = value + policy.theta[table, first + grid.index(float(left), float(right))]
        first += grid.n
    return int(np.argmax(value))


def export_c(
    policy: Policy, path: str | Path, *, table: int = 0, source: str = ""
) -> dict[str, int]:
    """Write a policy as a C99 file; return numbers of cells and of bytes that its tables take.

    Args:
        policy: learned with sensing "ir-raw".
        path: of the file, ends in .c.
        table: which follower's.
        source: what to say of where it comes from.

    Raises:
        ValueError: sensing has other units than counts; there is no such table; readings are
            distorted; the name is no .c file.
    """
    place = Path(path).expanduser()
    _check(policy, place, table)
    left, right, actions = merged(policy, table)
    speeds = [(int(a), int(b)) for a in policy.left_steps for b in policy.right_steps]
    kind = "uint8_t" if len(speeds) <= 256 else "uint16_t"
    tables, searches = zip(
        *(_axis(name, edges) for name, edges in (("left", left), ("right", right))), strict=True
    )
    told = (
        source.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ")
    )  # a comment within a comment is none
    text = _C.format(
        source=told or "a learned policy",
        kind=kind,
        count=len(speeds),
        rows=len(left) + 1,
        columns=len(right) + 1,
        actions=",\n    ".join(f"{{{_list(row)}}}" for row in actions),
        speeds=", ".join(f"{{{a}, {b}}}" for a, b in speeds),
        tables="".join(tables),
        searches="".join(searches),
    )
    write_bytes(place, text.encode())
    size = (
        2 * (len(left) + len(right))
        + actions.size * int(kind == "uint16_t")
        + actions.size
        + 4 * len(speeds)
    )
    return {"cells": int(actions.size), "table_bytes": size}


def _check(policy: Policy, place: Path, table: int) -> None:
    """Refuse a policy or a place of which no firmware can be made."""
    if place.suffix != ".c":
        raise ValueError(f"path = {str(place)!r}; expected a name that ends in .c")
    if not place.parent.is_dir():
        raise FileNotFoundError(f"{place.parent} does not exist; make the folder first")
    if policy.units != ("counts", "counts"):
        raise ValueError(
            f"the policy has sensing = {str(policy.sensing)!r}, tiles in "
            f"{' and '.join(policy.units)}; expected counts: a "
            "firmware without floating point compares raw readings. Learn with sensing='ir-raw'"
        )
    ends = [float(edges[-1]) for edges in (policy.distance_edges, policy.bearing_edges)]
    if ends != [MOST + 1.0] * 2:
        raise ValueError(
            f"the policy's tiles end at {ends} counts; expected {MOST + 1}, the end of the "
            "converter: it was learned on "
            "distorted readings (infrared.warp), which no robot has"
        )
    if not 0 <= table < policy.theta.shape[0]:
        raise ValueError(
            f"table = {table!r}; the policy has tables 0 to {policy.theta.shape[0] - 1}"
        )


def _thresholds(edges: list[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Return where cells begin in whole counts, for all tilings of an axis; what lies beyond the
    converter is left out.
    """
    inner = np.concatenate([each[1:-1] for each in edges])
    whole = np.unique(np.ceil(inner).astype(np.int64))
    kept: NDArray[np.int64] = whole[(whole > 0) & (whole <= MOST)]
    return kept


def _axis(name: str, thresholds: NDArray[np.int64]) -> tuple[str, str]:
    """Return the C table of an axis and the search in it; nothing of either where there is one cell
    only.
    """
    if not len(thresholds):
        return "", ""
    count = len(thresholds)
    search = (
        f"    while ({name}_cell < {count} && {name} >= {name}_from[{name}_cell]) {{ "
        f"{name}_cell++; }}\n"
    )
    return f"static const uint16_t {name}_from[{count}] = {{{_list(thresholds)}}};\n", search


def _list(values: NDArray[np.int64]) -> str:
    return ", ".join(str(int(value)) for value in values)


_C = """/* Greedy policy of a line formation follower, exported from {source}.
 *
 * Readings: calibrated counts, 0 to 4095, of the left (ps7) and the right (ps0) front proximity
 * sensor. Speeds: motor steps/s. C99, whole numbers only, no library calls. Written by a program;
 * change the policy instead.
 */
#include <stdint.h>

{tables}static const {kind} action_of[{rows}][{columns}] = {{
    {actions}
}};
static const int16_t speed_of[{count}][2] = {{{speeds}}};

void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed);

void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed)
{{
    uint16_t left_cell = 0, right_cell = 0, action;
    (void)left;
    (void)right;
{searches}    action = action_of[left_cell][right_cell];
    *left_speed = speed_of[action][0];
    *right_speed = speed_of[action][1];
}}
"""
