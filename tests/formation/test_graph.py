"""Rewards on distances between robots: rigid graphs, what is refused, what followers are told."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

import workbench as wb
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LEARNED, LOSS
from workbench.formation.graph import rigid_rank, rigidity, shortest_rigid
from workbench.formation.shapes import FormationConfig, places

BASE = wb.ConvoyConfig(
    drive="rolling",
    track=wb.TrackConfig(shape="eight", radius_m=1.0, judder="none"),
    leader_speed_mps=0.05,
    wheel_speed_mps=(0.0, 0.12),
)


def _graph(shape, edges=(), **changes):
    told = FormationConfig(shape=shape, frame="heading", edges=edges)
    return replace(BASE, **({"formation": told, "reward": "graph"} | changes))


def _framework(shape, followers):
    return np.vstack([[0.0, 0.0], places(shape, followers, 0.15)])


@given(arrays(int, st.tuples(st.integers(3, 7), st.just(2)), elements=st.integers(-3, 3)))
def test_all_distances_have_the_rank_of_the_dense_matrix(points):
    points = 0.1 * points
    pairs = tuple(combinations(range(len(points)), 2))
    rows = np.zeros((len(pairs), len(points), 2))
    for row, (i, j) in zip(rows, pairs, strict=True):
        row[i], row[j] = points[i] - points[j], points[j] - points[i]
    assert rigidity(points, pairs) == np.linalg.matrix_rank(rows.reshape(len(pairs), -1), tol=1e-9)


@pytest.mark.parametrize("shape", ["wedge", "diamond", "circle"])
@pytest.mark.parametrize("followers", [2, 4, 9, 40])
def test_every_shape_that_is_no_line_has_a_shortest_rigid_graph(shape, followers):
    found = _framework(shape, followers)
    edges = shortest_rigid(found)
    assert len(edges) == rigid_rank(followers + 1) == rigidity(found, edges)
    for left_out in edges[:3]:  # none of them can be spared
        rest = tuple(edge for edge in edges if edge != left_out)
        assert rigidity(found, rest) == len(edges) - 1


@pytest.mark.parametrize("shape", ["column", "line"])
def test_robots_on_one_line_are_refused_whatever_the_edges(shape):
    every = tuple(combinations(range(5), 2))
    for edges in ((), every):
        with pytest.raises(ValueError, match="rank 4; .* from rank 2·5 - 3 = 7 on"):
            _graph(shape, edges)


@pytest.mark.parametrize(
    ("edges", "said"),
    [
        (((0, 1), (0, 2), (1, 3), (2, 4), (1, 2), (1, 4)), "rank 6"),
        (((0, 0),), r"\(0, 0\); expected two different places of 0"),
        (((0, 5),), r"\(0, 5\); expected .* to 4"),
        (((0, 1), (1, 0)), r"\(0, 1\) twice; expected each once"),
        (((0, 1.5),), "pairs of whole numbers"),
    ],
)
def test_graphs_that_hold_nothing_are_refused(edges, said):
    with pytest.raises((ValueError, TypeError), match=said):
        _graph("wedge", edges)


def test_it_needs_the_heading_and_edges_need_it():
    with pytest.raises(ValueError, match=r"expected formation.frame = 'heading'"):
        replace(BASE, reward="graph")
    with pytest.raises(ValueError, match="expected edges with reward = 'graph'"):
        _graph("wedge", ((0, 1),), reward="quadratic")


def _rewards(config, shape=None):
    """Return what followers were rewarded with, and what they should have been, (T, followers)."""
    convoy = Convoy(config, [3], steps=2000, threads=1)
    if shape is not None:
        convoy.instruct(shape)
        config = replace(config, formation=replace(config.formation, shape=shape))
    told, expected = [], []
    for t in range(300):
        steps = convoy.period(t)[0]
        robots = convoy.robots[0]
        place = robots["place"]
        who = np.concatenate([[0], place["holder"][1:]])
        wanted = np.zeros(config.followers + 1)
        for a, b in config.edges:
            i, j = who[a], who[b]
            d = math.dist(_at(steps, i), _at(steps, j))
            star = math.dist(*[(0.0, 0.0) if k == 0 else _place(place[k]) for k in (i, j)])
            u = np.clip((d - star) / config.half_range_m, -1, 1)
            wanted[[i, j]] -= u * u
        finished = (steps["event"] & LEARNED != 0) & (steps["event"] & LOSS == 0)
        told.append(np.where(finished, steps["reward"], np.nan)[1:])
        expected.append(np.where(finished, wanted, np.nan)[1:])
        convoy.world.step()
    return np.array(told), np.array(expected)


def _at(steps, i):
    return float(steps["x"][i]), float(steps["y"][i])


def _place(place):
    return float(place["x"]), float(place["y"])


@pytest.mark.parametrize("shape", [None, "wedge"])
def test_followers_are_told_the_errors_of_their_edges_whoever_has_which_place(shape):
    told, expected = _rewards(_graph("diamond"), shape)
    assert np.isfinite(told).sum() > 500
    np.testing.assert_allclose(told, expected, atol=2e-4)


def test_losing_never_pays_and_a_wedge_is_learned_from_distances_alone():
    config = _graph("random", followers=4, weights="shared", state_tiles=(5, 5), tilings=4)
    most = np.bincount(np.ravel(config.edges))[1:].max()
    run = wb.learn(config, steps=200_000, progress=False)
    terminal = Convoy(config, [1], steps=10).task["reward"]["terminal"][0]
    assert terminal == pytest.approx(-most / (1 - config.learner.gamma))
    told = FormationConfig(shape="wedge", frame="heading")
    kept = wb.evaluate(run, replace(config, formation=told), minutes=5, progress=False)
    assert kept.summary["losses"] == 0
