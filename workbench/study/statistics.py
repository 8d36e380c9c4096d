"""Numbers from records: shares of visits, errors, losses, and intervals over seeds.

A "share" is a part of all visits; one visit is one finished transition, counted in the state in which its action was
chosen. "All time" puts reset and lost time into the denominator too. The best 3×3 block is the block of neighbouring cells
with the most visits, as in the paper's Fig. 4.

>>> visits = np.zeros((9, 9)); visits[4, 3:6] = [80, 15, 5]
>>> best_cell(visits), best_block(visits)
((0.8, (4, 3)), (1.0, (2, 3)))
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Place = tuple[int, int]


def best_cell(visits: ArrayLike) -> tuple[float, Place]:
    """Return the share of the most visited cell of (rows, columns) counts, and its row and column."""
    counts = _counts(visits)
    row, column = np.unravel_index(int(np.argmax(counts)), counts.shape)
    return float(counts[row, column] / max(counts.sum(), 1)), (int(row), int(column))


def best_block(visits: ArrayLike, size: int = 3) -> tuple[float, Place]:
    """Return the share of the most visited size × size block, and its first row and column."""
    counts = _counts(visits)
    rows, columns = (min(size, n) for n in counts.shape)
    windows = np.lib.stride_tricks.sliding_window_view(counts, (rows, columns)).sum(axis=(2, 3))
    row, column = np.unravel_index(int(np.argmax(windows)), windows.shape)
    return float(windows[row, column] / max(counts.sum(), 1)), (int(row), int(column))


def share_of_block(visits: ArrayLike, place: Place, size: int = 3) -> float:
    """Return the share of the size × size block that starts at a given row and column."""
    counts = _counts(visits)
    row, column = place
    return float(counts[row : row + size, column : column + size].sum() / max(counts.sum(), 1))


def interval(values: ArrayLike, *, level: float = 0.95, seed: int = 0) -> tuple[float, float, float]:
    """Return mean and bootstrap interval (percentile, 10 000 resamples) over seeds.

    Raises:
        ValueError: fewer than two values, which have no interval.
    """
    sample = np.asarray(values, dtype=np.float64).ravel()
    if sample.size < 2:
        raise ValueError(f"{sample.size} values have no interval; run at least two seeds, ten for a claim")
    mean = float(sample.mean())
    if np.all(sample == sample[0]):
        return mean, mean, mean
    result = stats.bootstrap(
        (sample,), np.mean, confidence_level=level, n_resamples=10_000, method="percentile", rng=np.random.default_rng(seed)
    )
    return mean, float(result.confidence_interval.low), float(result.confidence_interval.high)


def moments(count: ArrayLike, total: ArrayLike, squares: ArrayLike) -> tuple[float, float, float]:
    """Return mean, standard deviation and RMS of values given by their number, sum and sum of squares (NaN if none)."""
    n, first, second = (float(np.sum(part)) for part in (count, total, squares))
    if n == 0:
        return math.nan, math.nan, math.nan
    mean, power = first / n, second / n
    return mean, math.sqrt(max(power - mean**2, 0.0)), math.sqrt(power)


def median_and_worst(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the smallest of some shares."""
    return float(np.median(values)), float(np.min(values))


def _counts(visits: ArrayLike) -> NDArray[np.float64]:
    counts = np.asarray(visits, dtype=np.float64)
    if counts.ndim != 2:
        raise ValueError(f"visits have shape {counts.shape}; expected (rows, columns), e.g. run.visits.sum(axis=0)")
    return counts
