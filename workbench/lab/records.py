"""What is kept of a run: per block and follower the visits, errors, losses and rewards, and whole
sampled blocks.

``Recorder`` consumes the blocks that a convoy yields, one formation each. ``summarise`` makes the
numbers of a run from its records, so that they can always be computed again from the stored file.

Contract: every array is plain, without pickle. Lengths in m, angles in rad; the summary converts to
mm and degrees.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.neighbours import sort_by_place
from workbench.compiled import compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import GAVE_UP, LOSS, RECOVERED, TIMED_OUT
from workbench.formation.records import PERIOD
from workbench.formation.reset import FOLLOW, LOST
from workbench.lab.statistics import best_block, best_cell, moments
from workbench.lab.storage import plain
from workbench.robot.geometry import CONTROL_PERIOD

SAMPLED = (
    0.0,
    0.01,
    0.1,
    0.5,
)  # parts of the run after which a whole block is kept; the last whole one is kept too
SUMS = (
    "visits",
    "distance",
    "distance2",
    "bearing",
    "bearing2",
    "reward",
    "losses",
    "recovered",
    "timed_out",
    "gave_up",
    "periods",
    "away",
    "lost",
    "collisions",
)
_EVENTS = (LOSS, RECOVERED, TIMED_OUT, GAVE_UP)
RECORDS = ("starts", "sums", "visits", "samples", "sample_lengths", "sample_starts")
Records = dict[str, NDArray[Any]]


class Recorder:
    """Collect the blocks of one formation.

    Args:
        config: of the convoy.
        length: learning updates (or control periods) of the whole run, against which progress is
            measured.
    """

    def __init__(self, config: ConvoyConfig, length: int) -> None:
        self.config = config
        self.length = length
        self._states = config.grid().n
        self._rows: list[NDArray[np.float64]] = []
        self._visits: list[NDArray[np.int32]] = []
        self._starts: list[int] = []
        self._samples: list[NDArray[np.void]] = []
        self._sample_starts: list[int] = []
        self._last: NDArray[np.void] = np.zeros((0, config.followers + 1), PERIOD)
        self._last_start = 0

    def add(self, block: NDArray[np.void], start: int) -> None:
        """Record one block (periods, followers + 1) of PERIOD that began after ``start`` updates
        (or periods).
        """
        block = block[
            : np.count_nonzero(block["phase"][:, 0] >= 0)
        ]  # a formation that finished stays finished
        sums = np.zeros((self.config.followers, len(SUMS)))
        visits = np.zeros((self.config.followers, self._states), np.int32)
        _reduce(block, sums, visits)
        count_collisions(
            block,
            self._last[-1:],
            sums[:, SUMS.index("collisions")],
            2 * self.config.robot.body_radius_m,
            np.arange(self.config.followers + 1),
            np.zeros((2, self.config.followers + 1)),
        )
        self._rows.append(sums)
        self._visits.append(visits)
        due = (
            len(self._samples) < len(SAMPLED) and start >= SAMPLED[len(self._samples)] * self.length
        )
        if due:
            self._samples.append(block.copy())
            self._sample_starts.append(start)
        if len(block) >= len(self._last):  # a run's very last block may be short
            self._last = block.copy()
            self._last_start = start
        self._starts.append(start)

    def records(self) -> Records:
        """Return everything recorded so far.

        Returns:
            starts: (K,) updates (periods) before each block.
            sums: (K, followers, len(SUMS)) see SUMS: visits, sums of errors and their squares (m,
                rad) and of rewards, event counts, control periods in all, away from following, and
                lost among them, and collisions: how often the robot began to touch one in front of
                    it in line (seen once per control period).
            visits: (K, followers, states).
            samples: (P, followers + 1) of PERIOD, all sampled blocks one after the other, the last
                whole block at the end.
            sample_lengths, sample_starts: (M,) periods of each sampled block, updates (periods)
                before it.
        """
        n = self.config.followers
        samples = [*self._samples, self._last]
        starts = [*self._sample_starts, self._last_start]
        return {
            "starts": np.array(self._starts, dtype=np.int64),
            "sums": np.array(self._rows).reshape(-1, n, len(SUMS)),
            "visits": np.array(self._visits, dtype=np.int32).reshape(-1, n, self._states),
            "samples": np.concatenate(samples),
            "sample_lengths": np.array([len(block) for block in samples], dtype=np.int64),
            "sample_starts": np.array(starts, dtype=np.int64),
        }

    def load(self, records: Mapping[str, NDArray[Any]]) -> None:
        """Continue from ``records``."""
        self._starts = [int(start) for start in records["starts"]]
        self._rows = list(records["sums"])
        self._visits = list(records["visits"])
        blocks = np.split(records["samples"], np.cumsum(records["sample_lengths"])[:-1])
        starts = [int(start) for start in records["sample_starts"]]
        self._samples = blocks[:-1]
        self._last = blocks[-1]
        self._sample_starts = starts[:-1]
        self._last_start = starts[-1]


@compiled
def _reduce(block: Any, sums: Any, visits: Any) -> None:
    """Add up a block's followers: sums (followers, len(SUMS)) and visits (followers, states), in
    the order of SUMS.
    """
    for t in range(block.shape[0]):
        for i in range(1, block.shape[1]):
            step = block[t, i]
            row = sums[i - 1]
            if step.state >= 0:
                e_d = float(step.distance_error)
                o_err = float(step.bearing)
                visits[i - 1, step.state] += 1
                row[0] += 1
                row[1] += e_d
                row[2] += e_d * e_d
                row[3] += o_err
                row[4] += o_err * o_err
                row[5] += float(step.reward)
            for k in range(4):
                if step.event & _EVENTS[k]:
                    row[6 + k] += 1
            row[10] += 1
            row[11] += step.phase != FOLLOW
            row[12] += step.phase == LOST


@compiled
def count_collisions(
    block: Any, before: Any, counts: Any, touch: float, order: Any, places: Any
) -> None:
    """Add to counts (followers,) how often each began to touch a robot in front of it in line.

    Args:
        block: (periods, robots) of PERIOD; before: (0 or 1, robots), the period before it.
        touch: distance between centres in m below which two robots touch.
        order: (robots,) int64, the numbers of all robots; places: (2, robots) of float64; to work
            with.
    """
    robots = block.shape[1]
    x, y = places[0], places[1]
    for t in range(block.shape[0]):
        for i in range(robots):
            x[i], y[i] = block[t, i].x, block[t, i].y
        sort_by_place(order, x)
        # from left to right, only those close behind can touch it
        for n in range(robots):
            for m in range(n + 1, robots):
                i, j = order[n], order[m]
                if i < j:
                    i, j = j, i
                dx, dy = x[i] - x[j], y[i] - y[j]
                if abs(dx) >= touch:
                    break
                if dx * dx + dy * dy < touch * touch:
                    if t:
                        touched = _touching(block[t - 1, i], block[t - 1, j], touch)
                    else:
                        touched = before.shape[0] > 0 and _touching(
                            before[0, i], before[0, j], touch
                        )
                    counts[i - 1] += not touched


@compiled
def _touching(a: Any, b: Any, touch: float) -> bool:
    dx, dy = float(a.x) - float(b.x), float(a.y) - float(b.y)
    return dx * dx + dy * dy < touch * touch


def sampled_blocks(records: Mapping[str, NDArray[Any]]) -> list[tuple[int, NDArray[np.void]]]:
    """Return the sampled blocks as (updates or periods before it, (periods, followers + 1) of
    PERIOD).
    """
    blocks = np.split(records["samples"], np.cumsum(records["sample_lengths"])[:-1])
    return [
        (int(start), block) for start, block in zip(records["sample_starts"], blocks, strict=True)
    ]


def summarise(
    config: ConvoyConfig, length: int, updates: int, records: Mapping[str, NDArray[Any]]
) -> dict[str, Any]:
    """Return the numbers of a run as plain values; shares and errors are pooled over the followers.

    Keys ending in ``_last_third`` cover the blocks that began in the last third of the run,
    ``_all_time`` the same share with reset and lost time in the denominator. A number that no visit
    decides, such as the errors of a last third without a block, is None. Errors are as the
    followers sensed them, noise included. ``bias_mm`` is how far followers stand off the wanted
    distance on average (RMS of their means), ``ripple_mm`` how far they move about that, and
    ``bearing_ripple_deg`` the same of the bearing: bias² + ripple² = rms².
    """
    late = records["starts"] >= 2 / 3 * length
    whole = _numbers(config, records["visits"], records["sums"])
    third = _numbers(config, records["visits"][late], records["sums"][late])
    wanted = (
        "share_best_cell",
        "share_best_3x3",
        "share_best_3x3_all_time",
        "share_best_cell_all_time",
        "losses",
        "losses_per_hour",
        "collisions",
        "rms_distance_error_mm",
        "bias_mm",
        "ripple_mm",
        "bearing_mean_deg",
        "bearing_std_deg",
        "bearing_ripple_deg",
    )
    return plain(  # type: ignore[no-any-return]  # a dict of plain values
        {
            "steps": updates,
            "seed": config.seed,
            "followers": config.followers,
            "drive": config.drive,
        }
        | whole
        | {f"{key}_last_third": third[key] for key in wanted}
    )


def _numbers(
    config: ConvoyConfig, visits: NDArray[np.int32], sums: NDArray[np.float64]
) -> dict[str, Any]:
    pooled = visits.sum(axis=(0, 1)).reshape(config.state_tiles)
    column = {name: sums[:, :, k] for k, name in enumerate(SUMS)}
    cell, cell_place = best_cell(pooled)
    block, block_place = best_block(pooled)
    if not pooled.any():
        cell = block = math.nan
    following = pooled.sum() / max(column["periods"].sum(), 1)
    e_mean, _, e_rms = moments(column["visits"], column["distance"], column["distance2"])
    o_mean, o_std, _ = moments(column["visits"], column["bearing"], column["bearing2"])
    bias, ripple = _apart(column["visits"], column["distance"], column["distance2"])
    _, sway = _apart(column["visits"], column["bearing"], column["bearing2"])
    hours = float(column["periods"].sum()) * CONTROL_PERIOD / 3600
    losses = int(column["losses"].sum())
    return {
        "share_best_cell": cell,
        "share_best_3x3": block,
        "share_best_cell_all_time": float(cell * following),
        "share_best_3x3_all_time": float(block * following),
        "best_cell": list(cell_place),
        "best_3x3": list(block_place),
        "losses": losses,
        "losses_per_hour": losses / hours if hours else math.nan,  # per hour of one follower
        "time_outs": int(column["timed_out"].sum()),
        "gave_up": int(column["gave_up"].sum()),
        "collisions": int(column["collisions"].sum()),
        "mean_distance_error_mm": 1000 * e_mean,
        "rms_distance_error_mm": 1000 * e_rms,
        "bias_mm": 1000 * bias,
        "ripple_mm": 1000 * ripple,
        "bearing_mean_deg": math.degrees(o_mean),
        "bearing_std_deg": math.degrees(o_std),
        "bearing_ripple_deg": math.degrees(sway),
        "mean_reward": moments(column["visits"], column["reward"], 0)[0],
        "share_of_time_away": float(column["away"].sum() / max(column["periods"].sum(), 1)),
        "simulated_minutes": hours * 60 / config.followers,
    }


def _apart(
    counts: NDArray[np.float64], totals: NDArray[np.float64], squares: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the RMS over followers of their means, and of their spread about these, of (blocks,
    followers) numbers, sums and sums of squares; NaN if there are none.
    """
    n, total, square = (np.sum(part, axis=0) for part in (counts, totals, squares))
    if not n.sum():
        return math.nan, math.nan
    means = total / np.maximum(n, 1)
    bias = float(np.sum(n * means**2) / n.sum())
    power = float(square.sum() / n.sum())
    return math.sqrt(bias), math.sqrt(max(power - bias, 0.0))
