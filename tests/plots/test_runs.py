"""Plots draw what they are given: axes, labels, shares and directions, checked on the artists."""

import math

import numpy as np
import pandas as pd
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.formation.places import still_world
from workbench.formation.policy import Policy
from workbench.formation.senses.truth import observe
from workbench.lab.runs import learn
from workbench.plots import diagrams, runs as plots
from workbench.studies.sideways import losses_before, per_block, smoothed

CONFIG = ConvoyConfig(drive="planar")


def _texts(ax):
    return [text.get_text() for text in ax.texts]


def test_visit_map_has_physical_axes_right_on_the_right_and_percentages():
    visits = np.zeros((9, 9))
    visits[4, 3] = 740
    visits[4, 4] = 259
    visits[0, 0] = 1
    ax = plots.visit_map(visits, CONFIG)
    assert ax.get_xlim() == pytest.approx((45, -45)) and ax.get_ylim() == pytest.approx((80, 220))
    assert "degrees" in ax.get_xlabel() and "mm" in ax.get_ylabel()
    assert sorted(_texts(ax)) == ["0.1", "25.9", "74.0"]
    place = {text.get_text(): text.get_position() for text in ax.texts}
    assert place["74.0"] == pytest.approx(
        (-10, 150)
    )  # bearing tile 3 is 5° to 15° to the right: on the right side
    plots.frame_block(ax, CONFIG, (3, 2), 3, "block")
    assert len(ax.patches) == 1


def test_learning_curves_and_blocks_of_a_real_run():
    runs = [learn(CONFIG.with_seed(seed), steps=40_000, progress=False) for seed in (1, 2)]
    blocks = per_block(runs)
    assert set(blocks["seed"]) == {1, 2} and (blocks["share_outside"].between(0, 1)).all()
    assert losses_before(runs[0], 1.0) == 1.0 and 0 < losses_before(runs[0], 0.3) < 1
    running = smoothed(blocks, ["losses_per_hour"], width=2)
    one = blocks["seed"] == 1
    assert running[one]["losses_per_hour"].iloc[1] == pytest.approx(
        blocks[one]["losses_per_hour"].iloc[:2].mean()
    )
    ax = plots.learning_curves(
        blocks, "losses_per_hour", by="drive", ylabel="losses per follower and hour", symlog=1
    )
    assert len(ax.lines) == 3 and "n = 2 seeds" in ax.get_legend().get_texts()[0].get_text()


def test_policy_and_value_maps_show_the_greedy_action():
    theta = np.full((1, 81, 49), CONFIG.learner.theta0)
    theta[0, 40, 6] = 1.0  # left slowest, right fastest: a left turn at the mean speed
    policy = Policy.of(CONFIG, theta)
    ax = plots.policy_map(policy, CONFIG)
    shown = ax.collections[0].get_array().reshape(9, 9)
    assert shown[4, 4] == pytest.approx(60, abs=0.1) and shown.mask[0, 1] and not shown.mask[4, 4]
    values = plots.value_map(policy, CONFIG).collections[0].get_array()
    assert (
        np.ravel(values)[40] == 1.0 and np.ma.count(values) == 1
    )  # all others are not learned yet
    theta[0, 40, 7] = 0.75
    lead = plots.lead_map(Policy.of(CONFIG, theta), CONFIG).collections[0].get_array()
    assert np.ravel(lead)[40] == 0.25 and np.ma.count(lead) == 1


def test_error_measures_are_drawn_from_the_world_s_own_poses():
    world = still_world(CONFIG, np.zeros(0))
    world.place(0, 1, 0.0, 0.0, 0.1)
    world.place(0, 0, 0.15, 0.09, 0.4)
    distance, bearing = observe(0.0, 0.0, math.cos(0.1), math.sin(0.1), 0.15, 0.09)
    words = " ".join(_texts(diagrams.error_measures(world, CONFIG)))
    assert f"{1000 * distance:.0f} mm" in words and f"{math.degrees(bearing):+.1f}°" in words


def test_tile_fan_has_one_wedge_per_state():
    ax = diagrams.tile_fan(CONFIG)
    assert len(ax.collections[0].get_paths()) == 81


def test_circle_geometry_passes_through_keeping_the_circle_and_cutting_in():
    bearing, radius = diagrams.circle_geometry(0.5, 0.15)
    assert np.interp(0.5, radius, bearing) == pytest.approx(math.degrees(math.asin(0.15)), abs=0.01)
    assert np.interp(math.sqrt(0.25 - 0.0225), radius, bearing) == pytest.approx(0.0, abs=0.01)
    values = {"a": np.array([0.0, 5.0])}
    ax = diagrams.circle_following(
        values, {"a": np.array([0.48, 0.49])}, leader_radius_m=0.5, distance_m=0.15
    )
    assert "n = 2 runs" in ax.get_legend().get_texts()[-1].get_text()


def test_intervals_by_case_draw_every_pair():
    table = pd.DataFrame(
        {
            "track": ["x", "x", "y"],
            "reward": ["p", "q", "p"],
            "m": [1.0, 2, 3],
            "low": [0.5, 1, 2],
            "high": [2.0, 3, 4],
            "seeds": 10,
        }
    )
    ax = plots.intervals_by_case(table, "m", rows="track", colours="reward", lines={"zero": 0.0})
    assert [label.get_text() for label in ax.get_yticklabels()] == ["x", "y"]
    assert "95 % interval over 10 seeds" in ax.get_legend().get_title().get_text()


def test_trails_and_picture():
    run = learn(CONFIG, steps=400, progress=False)
    ax = plots.trails(run.records["samples"][:100], line=np.zeros((5, 2)))
    assert len(ax.get_legend().get_texts()) == 6
    assert plots.arena_picture(np.zeros((24, 32, 3), np.uint8)).images[0].get_array().shape == (
        24,
        32,
        3,
    )
