"""What moves the visits sideways (E3): tables from the runs of ``workbench.studies.paper``, and
curves per block.

A follower on a circle can keep its predecessor's circle and see it at asin(d / 2R) towards the
inside, or cut in to √(R² - d²) and see it straight ahead. These functions measure where it settled.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench.lab.records import SUMS, sampled_blocks
from workbench.lab.runs import Run
from workbench.lab.statistics import interval, share_of_block
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.paper import SHIFT_REWARDS, SHIFT_TRACKS


def keep_circle_bearing(distance_m: float, radius_m: float) -> float:
    """Return |bearing| in rad of a predecessor ahead on the same circle: asin(d / 2R)."""
    return math.asin(distance_m / (2 * radius_m))


def cut_in_radius(distance_m: float, radius_m: float) -> float:
    """Return the circle in m of a follower that keeps its predecessor at zero bearing: √(R² -
    d²).
    """
    return math.sqrt(radius_m**2 - distance_m**2)


def shift_table(runs: Mapping[str, Sequence[Run]]) -> pd.DataFrame:
    """Return one line per track and reward: mean bearing (deg) and share of visits right of the
    centre tile.

    Both are over the last third of a run, means over seeds with 95 % intervals.
    """
    lines = []
    for track in SHIFT_TRACKS:
        for reward in SHIFT_REWARDS:
            case = runs[f"shift/{track}/{reward}"]
            bearing = interval([run.summary["bearing_mean_deg_last_third"] for run in case])
            right = interval([_share_right(run) for run in case])
            lines.append((track, reward, len(case), *bearing, *right))
    names = [
        "track",
        "reward",
        "seeds",
        "bearing_deg",
        "low",
        "high",
        "share_right",
        "share_right_low",
        "share_right_high",
    ]
    return pd.DataFrame(lines, columns=names)


def inward_bearing(runs: Mapping[str, Sequence[Run]], reward: str) -> NDArray[np.float64]:
    """Return the mean bearing (deg) towards the inside of the loop in the last third, one value per
    run on a circle.
    """
    signs = {"clockwise": -1.0, "anticlockwise": 1.0}
    values = [
        sign * run.summary["bearing_mean_deg_last_third"]
        for track, sign in signs.items()
        for run in runs[f"shift/{track}/{reward}"]
    ]
    return np.array(values)


def settled(runs: Mapping[str, Sequence[Run]]) -> pd.DataFrame:
    """Return one line per seed on a circle: where follower 1 settled, from the last whole block of
    the run.

    Columns: reward, track, seed, inward_deg (mean bearing towards the inside of the loop), radius_m
    and leader_radius_m (mean distance of follower 1 and of the leader from the loop's centre),
    distance_m (mean distance between the two).
    """
    lines = []
    for track in ("clockwise", "anticlockwise"):
        for reward in SHIFT_REWARDS:
            for run in runs[f"shift/{track}/{reward}"]:
                _, block = sampled_blocks(run.records)[-1]
                at = block[block["state"][:, 1] >= 0][:, 1]
                leader, follower = np.hypot(block["x"], block["y"]).mean(axis=0, dtype=float)[:2]
                inward = (-1 if track == "clockwise" else 1) * np.degrees(
                    at["bearing"].mean(dtype=float)
                )
                distance = run.config.middle_m + at["distance_error"].mean(dtype=float)
                lines.append((reward, track, run.config.seed, inward, follower, leader, distance))
    return pd.DataFrame(
        lines,
        columns=[
            "reward",
            "track",
            "seed",
            "inward_deg",
            "radius_m",
            "leader_radius_m",
            "distance_m",
        ],
    )


def per_block(runs: Sequence[Run]) -> pd.DataFrame:
    """Return one line per run and whole block: losses per follower and hour, share of visits
    outside its best 3×3
    block, RMS distance error."""
    parts = []
    for run in runs:
        sums = run.records["sums"].sum(axis=1)
        hours = sums[:, SUMS.index("periods")] * CONTROL_PERIOD / 3600
        maps = run.records["visits"].sum(axis=1).reshape(-1, *run.config.state_tiles)
        outside = [1 - share_of_block(visits, run.summary["best_3x3"]) for visits in maps]
        columns = {
            "drive": run.config.drive,
            "seed": run.config.seed,
            "block": np.arange(len(hours)),
            "updates": run.records["starts"],
            "losses_per_hour": sums[:, SUMS.index("losses")] / hours,
            "share_outside": outside,
            "rms_distance_error_mm": 1000
            * np.sqrt(
                sums[:, SUMS.index("distance2")] / np.maximum(sums[:, SUMS.index("visits")], 1)
            ),
        }
        parts.append(
            pd.DataFrame(columns).iloc[: max(len(hours) - 1, 1)]
        )  # the very last block is short
    return pd.concat(parts, ignore_index=True)


def accumulated(runs: Sequence[Run]) -> pd.DataFrame:
    """Return one line per run, follower and block: losses, and visits outside the best 3×3 block of
    the run in percent of all of the follower's visits, both from the start on.
    """
    parts = []
    for run in runs:
        lost = run.records["sums"][:, :, SUMS.index("losses")].cumsum(axis=0)
        visits = run.records["visits"].reshape(*lost.shape, *run.config.state_tiles)
        row, column = run.summary["best_3x3"]
        whole = visits.sum(axis=(2, 3))
        inside = visits[:, :, row : row + 3, column : column + 3].sum(axis=(2, 3))
        outside = 100 * (whole - inside).cumsum(axis=0) / np.maximum(whole.sum(axis=0), 1)
        for k in range(lost.shape[1]):
            columns = {
                "drive": run.config.drive,
                "seed": run.config.seed,
                "follower": k + 1,
                "block": np.arange(len(lost)),
                "updates": np.append(run.records["starts"][1:], run.length),
                "losses": lost[:, k],
                "percent_outside": outside[:, k],
            }
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def smoothed(blocks: pd.DataFrame, columns: Sequence[str], *, width: int) -> pd.DataFrame:
    """Return the blocks with a running mean over ``width`` blocks (fewer at the start) of some
    columns, run by run.
    """
    result = blocks.copy()
    for column in columns:
        runs = blocks.groupby(["drive", "seed"], sort=False)[column]
        result[column] = runs.transform(lambda values: values.rolling(width, min_periods=1).mean())
    return result


def losses_before(run: Run, part: float) -> float:
    """Return the share of a run's losses that fall into its first part (by updates)."""
    losses: NDArray[np.float64] = run.records["sums"][:, :, SUMS.index("losses")].sum(axis=1)
    return float(losses[run.records["starts"] < part * run.length].sum() / max(losses.sum(), 1))


def _share_right(run: Run) -> float:
    late = run.records["starts"] >= 2 / 3 * run.length
    visits = run.records["visits"][late].sum(axis=(0, 1)).reshape(run.config.state_tiles)
    centre = run.config.state_tiles[1] // 2
    return float(visits[:, :centre].sum() / max(visits.sum(), 1))
