"""Who takes which place, when a formation is asked for a shape.

    names     everybody the place of its number
    squared   the least sum of squared distances: ways cross least
    auction   the same, found by the robots themselves: bids by broadcast (Bertsekas 1988)

>>> assign("squared", [(0, 0), (1, 0)], [(1.1, 0), (0.1, 0)]).tolist()
[1, 0]

Contract: returned is the place of every robot; robots and places are as many.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.int64]
EPSILON_M2 = 1e-3  # what a bid is raised by at least


class Auction(NamedTuple):
    """What came of an auction.

    Attributes:
        place: (N,) of every robot.
        rounds: of bids until all had one.
        cost_m2: the sum of squared distances.
    """

    place: Places
    rounds: int
    cost_m2: float


def assign(rule: str, robots: ArrayLike, goals: ArrayLike) -> Places:
    """Return the place of every robot.

    Args:
        rule: one of ASSIGNMENTS.
        robots, goals: (N, 2) m.

    Raises:
        ValueError: they are not as many, or the rule is unknown.
    """
    here, there = (np.asarray(each, dtype=np.float64) for each in (robots, goals))
    if here.shape != there.shape or here.ndim != 2 or here.shape[1] != 2:
        raise ValueError(
            f"robots have shape {here.shape}, goals {there.shape}; expected (N, 2) both"
        )
    if rule not in ASSIGNMENTS:
        raise ValueError(f"assignment = {rule!r}; expected one of {', '.join(ASSIGNMENTS)}")
    return ASSIGNMENTS[rule](here, there)


def squared_distances(robots: Floats, goals: Floats) -> Floats:
    """Return (robots, goals) in m²."""
    apart: Floats = np.sum((robots[:, None] - goals[None]) ** 2, axis=-1)
    return apart


def _names(robots: Floats, goals: Floats) -> Places:
    return np.arange(len(robots))


def _squared(robots: Floats, goals: Floats) -> Places:
    from scipy.optimize import linear_sum_assignment

    _, columns = linear_sum_assignment(squared_distances(robots, goals))
    return np.asarray(columns, dtype=np.int64)


def _auction(robots: Floats, goals: Floats) -> Places:
    return auction(robots, goals).place


def auction(
    robots: ArrayLike,
    goals: ArrayLike,
    *,
    epsilon_m2: float = EPSILON_M2,
    loss: float = 0.0,
    chance: np.random.Generator | None = None,
) -> Auction:
    """Let robots bid for places by broadcast until everybody has one.

    In a round every robot that holds no place bids for the one that is best for it at the prices
    that it has heard of, and all robots hear all bids, but for messages that are lost. A robot that
    hears of a higher bid for its place gives the place up; a holder repeats its bid every round, so
    that what was lost is heard later. It ends once all hold different places and nobody bids.

    Args:
        robots, goals: (N, 2) m.
        epsilon_m2: what a bid is raised by at least; the cost is at most N times that above the
            optimum.
        loss: share of messages that do not arrive, per receiver.
        chance: for these.

    Raises:
        RuntimeError: it does not end in 100 000 rounds.
    """
    here, there = (np.asarray(each, dtype=np.float64) for each in (robots, goals))
    n = len(here)
    cost = squared_distances(here, there)
    draw = chance if chance is not None else np.random.default_rng(0)
    price = np.zeros((n, n))  # what robot i has heard of place j, and who bid that
    owner = np.full((n, n), -1)
    me = np.arange(n)
    for rounds in range(1, 100_000):
        held = np.where(
            (owner == me[:, None]).any(axis=1), (owner == me[:, None]).argmax(axis=1), -1
        )
        if np.all(held >= 0) and len(set(held.tolist())) == n:
            return Auction(held, rounds - 1, float(cost[me, held].sum()))
        # who holds nothing bids
        for i in np.flatnonzero(held < 0).tolist():
            value = -cost[i] - price[i]
            first = int(value.argmax())
            second = np.partition(value, -2)[-2] if n > 1 else value[first]
            price[i, first] += value[first] - second + epsilon_m2
            owner[i, first] = i
            held[i] = first
        # everybody says what it bid; a higher price, or the same of a lower number, is believed
        offers = price[me, held]
        for i in range(n):
            for j in range(n):
                if i == j or (loss and draw.random() < loss):
                    continue
                place = held[j]
                mine, theirs = price[i, place], offers[j]
                if theirs > mine or (theirs == mine and j < owner[i, place]):
                    price[i, place], owner[i, place] = theirs, j
    raise RuntimeError(f"no auction of {n} robots ends in 100 000 rounds with loss = {loss!r}")


ASSIGNMENTS: dict[str, Callable[[Floats, Floats], Places]] = {
    "squared": _squared,
    "names": _names,
    "auction": _auction,
}
