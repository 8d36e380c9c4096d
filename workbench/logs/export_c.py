"""A learned policy as one C99 file for the robot's own firmware: thresholds on raw counts in, wheel
speeds out.

``export_c`` writes the policy of one table, for weights that tile two raw infrared readings
(sensing "ir-raw"): there a firmware needs nothing but comparisons of whole counts. Offset tilings
are merged first: between neighbouring edges of all of them the greedy action is constant, so that
sums of weights need not travel. The file includes nothing but <stdint.h>, calls nothing, and knows
no floating point; tables are constant and small (the e-puck's dsPIC has 144 kB of flash).

    void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed);

With a configuration whose output is interpolated, or that trims (``formation.output``), the file
does that, too, in the same whole numbers; gq_begin() tells it where an episode begins.

Readings are calibrated counts (reading - free air, not below 0) of ps7 and ps0. The manoeuvre after
a loss is not part of it.

Contract: for whole counts from 0 to 4095, C and ``Policy`` choose the same action; a test compiles
and compares.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.output import PARTS, lattice_edges, place_on
from workbench.formation.policy import Policy
from workbench.formation.senses.infrared import (
    TRIM_BITS,
    TRIM_ONE,
    TRIM_SHIFT,
    TRIM_UNIT,
    log_counts,
)
from workbench.formation.task import fill_task
from workbench.lab.storage import write_bytes
from workbench.learning.tiles import TileGrid

MOST = 4095  # counts
# sums of commands begin so high that they are never negative: C rounds those towards zero
_SHIFT = 4096
_ZERO = PARTS * PARTS * _SHIFT + PARTS * PARTS // 2


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
        [[greedy_at(policy, grids, table, a, b) for b in lowest[1]] for a in lowest[0]]
    )
    return axes[0], axes[1], actions


def greedy_at(
    policy: Policy, grids: tuple[TileGrid, ...], table: int, left: float, right: float
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
    policy: Policy,
    path: str | Path,
    *,
    table: int = 0,
    source: str = "",
    config: ConvoyConfig | None = None,
) -> dict[str, int]:
    """Write a policy as a C99 file; return numbers of cells and of bytes that its tables take.

    Args:
        policy: learned with sensing "ir-raw".
        path: of the file, ends in .c.
        table: which follower's.
        source: what to say of where it comes from.
        config: output and trim to drive with; default: the greedy actions.

    Raises:
        ValueError: sensing has other units than counts; there is no such table; readings are
            distorted; the name is no .c file; the configuration is not the policy's.
    """
    place = Path(path).expanduser()
    _check(policy, place, table)
    if config is not None:
        policy.check(replace(config, followers=max(1, policy.theta.shape[0])))
    calm = config is not None and config.output == "interpolated"
    speeds = [(int(a), int(b)) for a in policy.left_steps for b in policy.right_steps]
    actions, find, tables = (_interpolated if calm else _greedy)(policy, table)
    integral = _Integral(policy, config) if config is not None and config.trim else None
    kind = "uint8_t" if len(speeds) <= 256 else "uint16_t"
    # a comment within a comment is none
    told = source.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ")
    text = _C.format(
        source=told or "a learned policy",
        tables="".join(text for text, _ in tables) + (integral.tables if integral else ""),
        table=f"static const {kind} action_of[{actions.shape[0]}][{actions.shape[1]}] = {{\n    "
        + ",\n    ".join(f"{{{_list(row)}}}" for row in actions)
        + "\n};\n",
        count=len(speeds),
        speeds=", ".join(f"{{{a}, {b}}}" for a, b in speeds),
        kept=_KEPT if integral else "",
        begin="    integral = 0;\n    begun = 0;\n" if integral else "",
        clamp=_CLAMP if calm or integral else "",
        trim=integral.trim if integral else "",
        find=find,
        end=integral.end if integral else "",
    )
    write_bytes(place, text.encode())
    size = actions.size * (2 if kind == "uint16_t" else 1) + 4 * len(speeds)
    size += sum(size for _, size in tables) + (2 * (MOST + 1) if integral else 0)
    return {"cells": int(actions.size), "table_bytes": size}


Parts = tuple[NDArray[np.int64], str, list[tuple[str, int]]]


def _greedy(policy: Policy, table: int) -> Parts:
    """Return actions, the search for a cell, and tables with their bytes, of the greedy policy."""
    left, right, actions = merged(policy, table)
    tables, searches = zip(
        *(_axis(name, edges) for name, edges in (("left", left), ("right", right))), strict=True
    )
    sizes = [2 * len(edges) for edges in (left, right)]
    return actions, _FIND.format(searches="".join(searches)), list(zip(tables, sizes, strict=True))


def _interpolated(policy: Policy, table: int) -> Parts:
    """Return actions, the way between cells, and tables with their bytes, of interpolated
    commands.
    """
    grids = policy.grids()
    axes = lattice_edges(grids)
    middles = [(edges[:-1] + edges[1:]) / 2 for edges in axes]
    actions = np.array(
        [[greedy_at(policy, grids, table, a, b) for b in middles[1]] for a in middles[0]]
    )
    tables = []
    for name, edges in zip(("left", "right"), axes, strict=True):
        places = np.array([place_on(edges, len(edges) - 1, float(c)) for c in range(MOST + 1)])
        kind, bytes_each = ("uint16_t", 2) if places.max() < 2**16 else ("uint32_t", 4)
        text = f"static const {kind} {name}_at[{MOST + 1}] = {{{_list(places)}}};\n"
        tables.append((text, bytes_each * places.size))
    return actions, _BETWEEN, tables


class _Integral:
    """The parts of the C file that integrate the error of the readings, see
    ``senses.infrared.trim_readings``.
    """

    def __init__(self, policy: Policy, config: ConvoyConfig) -> None:
        task = fill_task(config, 0)["infrared"][0]
        logs = np.array([log_counts(count) for count in range(MOST + 1)])
        left, right = policy.left_steps, policy.right_steps
        self.tables = f"static const uint16_t log_of[{MOST + 1}] = {{{_list(logs)}}};\n"
        self.end = "    last_left = *left_speed;\n    last_right = *right_speed;\n"
        self.trim = _TRIM.format(
            middle=int(task["trim_middle"]),
            gain=int(task["trim_gain"]),
            limit=int(task["trim_limit"]),
            fast=f"last_left >= {left[-1]} && last_right >= {right[-1]}",
            slow=f"last_left <= {left[0]} && last_right <= {right[0]}",
            one=2 * TRIM_ONE,
            unit=TRIM_UNIT,
            shift=TRIM_SHIFT,
            bits=TRIM_BITS,
            most=MOST,
        )


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


_FIND = """    uint16_t left_cell = 0, right_cell = 0, action;
    (void)left;
    (void)right;
{searches}    action = action_of[left_cell][right_cell];
    *left_speed = speed_of[action][0];
    *right_speed = speed_of[action][1];
"""

_BETWEEN = f"""    uint32_t row = left_at[left] / {PARTS}u, column = right_at[right] / {PARTS}u;
    int32_t x = (int32_t)(left_at[left] % {PARTS}u), y = (int32_t)(right_at[right] % {PARTS}u);
    int32_t left_sum = {_ZERO}, right_sum = {_ZERO};
    uint16_t below, beside, action;
    for (below = 0; below < 2; below++) {{
        for (beside = 0; beside < 2; beside++) {{
            int32_t weight = (below ? x : {PARTS} - x) * (beside ? y : {PARTS} - y);
            if (weight > 0) {{
                action = action_of[row + below][column + beside];
                left_sum += weight * speed_of[action][0];
                right_sum += weight * speed_of[action][1];
            }}
        }}
    }}
    *left_speed = (int16_t)(left_sum / {PARTS * PARTS} - {_SHIFT});
    *right_speed = (int16_t)(right_sum / {PARTS * PARTS} - {_SHIFT});
"""

_KEPT = """
/* The integral of the error of the readings. */
static int32_t integral = 0, begun = 0;
static int16_t last_left = 0, last_right = 0;
"""

_CLAMP = f"""    left = left > {MOST} ? {MOST} : left;
    right = right > {MOST} ? {MOST} : right;
"""

_TRIM = """    int32_t error, spent, factor;
    uint32_t near;
    if (begun) {{
        error = {middle} - (int32_t)log_of[left] - (int32_t)log_of[right];
        spent = error > 0 ? {fast} : {slow};
        if (!spent) {{
            integral += {gain} * error;
            integral = integral > {limit} ? {limit} : integral < -{limit} ? -{limit} : integral;
        }}
        factor = {one} - ((integral + {unit}) >> {shift});
        near = ((uint32_t)left * (uint32_t)factor) >> {bits};
        left = (uint16_t)(near > {most} ? {most} : near);
        near = ((uint32_t)right * (uint32_t)factor) >> {bits};
        right = (uint16_t)(near > {most} ? {most} : near);
    }}
    begun = 1;
"""

_C = """/* Policy of a line formation follower, exported from {source}.
 *
 * Readings: calibrated counts, 0 to 4095, of the left (ps7) and the right (ps0) front proximity
 * sensor. Speeds: motor steps/s. C99, whole numbers only, no library calls. Written by a program;
 * change the policy instead.
 */
#include <stdint.h>

{tables}{table}static const int16_t speed_of[{count}][2] = {{{speeds}}};
{kept}
void gq_begin(void);
void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed);

/* Call it where an episode begins. */
void gq_begin(void)
{{
{begin}}}

void gq_policy(uint16_t left, uint16_t right, int16_t *left_speed, int16_t *right_speed)
{{
{clamp}{trim}{find}{end}}}
"""
