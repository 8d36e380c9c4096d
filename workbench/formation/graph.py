"""Rewards on distances between robots: what a shape is without any frame.

With edges ij between places (0 is the leader's), distances d_ij between the robots that hold them
and d*_ij between the places, follower i's reward of a step is

    -Σ u_ij²   over its edges      u_ij = (d_ij - d*_ij) / e_max, in [-1, 1]

so that the worst is minus its number of edges, which the terminal reward is made from. What is
tiled stays as it is. Our choice; the graph theory is that of rigid frameworks: distances hold N
robots near a shape, up to a shift and a turn, where the rigidity matrix (row of edge ij: p_i - p_j
in i's columns, the negative in j's) has the rank 2N - 3; another shape far from it may have the
same lengths. Three and more robots on one line never
have it: their distances do not feel displacements across (nor much where they are nearly in line: a
thousandth of an edge counts as nothing).

>>> square = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
>>> rigidity(square, ((0, 1), (1, 2), (2, 3), (3, 0))), rigid_rank(4)
(4, 5)
>>> shortest_rigid(square)
((0, 1), (0, 3), (1, 2), (2, 3), (0, 2))

Contract: ``grade`` is of the loop: it writes in place and allocates nothing.
"""

import math
from collections import Counter
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled

MAX_EDGES = 512  # of the shortest rigid graph of 256 followers: 511
EDGES = np.dtype([("count", "i8"), ("ends", "i8", (MAX_EDGES, 2))])  # of TASK; 0: no such reward
_FLAT = 1e-3  # of an edge's row; where less of it is new it adds nothing to the rank

Edges = tuple[tuple[int, int], ...]


@compiled
def grade(task: Any, robots: Any) -> None:
    """Write every robot's reward on distances, once all places have been moved on."""
    for i in range(robots.size):
        robots[i].graph_reward = 0.0
    for k in range(task.graph.count):
        one = robots[robots[task.graph.ends[k, 0]].place.holder]
        other = robots[robots[task.graph.ends[k, 1]].place.holder]
        now = math.hypot(one.pose.x - other.pose.x, one.pose.y - other.pose.y)
        # the leader's own place is always 0, 0
        wanted = math.hypot(one.place.x - other.place.x, one.place.y - other.place.y)
        u = max(-1.0, min(1.0, (now - wanted) / task.bounds.half_range))
        one.graph_reward -= u * u
        other.graph_reward -= u * u


def rigid_rank(robots: int) -> int:
    """Return the rank that the rigidity matrix of a rigid graph in the plane has."""
    return 2 * robots - 3


def rigidity(points: NDArray[np.float64], edges: Edges) -> int:
    """Return the rank of the rigidity matrix of points (N, 2) in m, at most 2N - 3."""
    return len(_independent(points, edges))


def shortest_rigid(points: NDArray[np.float64]) -> Edges:
    """Return edges that make points (N, 2) rigid, shortest first, each of which adds to the rank;
    of points on one line as many as do.
    """
    pairs = list(combinations(range(len(points)), 2))
    lengths = [round(float(np.linalg.norm(points[i] - points[j])), 9) for i, j in pairs]
    in_order = tuple(pair for _, pair in sorted(zip(lengths, pairs, strict=True)))
    return tuple(in_order[k] for k in _independent(points, in_order))


def _independent(points: NDArray[np.float64], edges: Edges) -> list[int]:
    """Return which edges add to the rank of those before them (Gram-Schmidt, done twice)."""
    basis = np.zeros((0, 2 * len(points)))
    found = []
    for k, (i, j) in enumerate(edges):
        row = np.zeros(2 * len(points))
        apart = points[i] - points[j]
        row[2 * i : 2 * i + 2], row[2 * j : 2 * j + 2] = apart, -apart
        whole = float(np.linalg.norm(row))
        for _ in range(2):
            row -= basis.T @ (basis @ row)
        length = float(np.linalg.norm(row))
        if length > _FLAT * whole:
            basis = np.vstack([basis, row / length])
            found.append(k)
            if len(found) == rigid_rank(len(points)):
                break
    return found


def worst_step(edges: Edges, robots: int) -> float:
    """Return the smallest reward that a step can have: of the follower with most edges."""
    return -float(np.bincount(np.ravel(edges).astype(np.int64), minlength=robots)[1:].max())


def check_graph(points: NDArray[np.float64], edges: Edges) -> None:
    """Refuse pairs that are no edges, and graphs that do not hold points (N, 2).

    Raises:
        ValueError: with the value, what was expected, and the remedy.
    """
    robots = len(points)
    for i, j in edges:
        if i == j or max(i, j) >= robots:
            raise ValueError(
                f"FormationConfig.edges: {(i, j)}; expected two different places of 0 (the "
                f"leader's) to {robots - 1}"
            )
    twice = [edge for edge, count in Counter(tuple(sorted(e)) for e in edges).items() if count > 1]
    if twice or len(edges) > MAX_EDGES:
        found = f"{twice[0]} twice" if twice else f"{len(edges)} edges"
        raise ValueError(f"FormationConfig.edges: {found}; expected each once, at most {MAX_EDGES}")
    rank = rigidity(points, edges)
    if rank < rigid_rank(robots):
        raise ValueError(
            f"ConvoyConfig.reward = 'graph' with a rigidity matrix of rank {rank}; distances hold "
            f"{robots} robots in a shape from rank 2·{robots} - 3 = {rigid_rank(robots)} on: "
            "expected more FormationConfig.edges, robots that are not all on one line (wedge, "
            "diamond, circle, points, random), or another reward"
        )
