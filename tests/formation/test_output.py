"""What becomes of a table's actions: interpolation, trim, relative levels; learning with them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import workbench as wb
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LEARNED
from workbench.formation.laws.table import quantised_carrot
from workbench.formation.output import PARTS, lattice_edges, place_on
from workbench.formation.solo import SoloFollower
from workbench.learning.config import LearnerConfig

CALM = wb.ConvoyConfig(followers=2, drive="rolling", output="interpolated")
SETTINGS = {
    "paper": CALM,
    "logarithmic": replace(CALM, distance_tiling="logarithmic", bearing_tiling="logarithmic"),
    "recommended": replace(CALM, state_tiles=(5, 5), tilings=4),
    "one tile": replace(CALM, state_tiles=(1, 3)),
}


def _policy(config, seed=3):
    theta = np.random.default_rng(seed).normal(size=(1, config.rows, config.action_count))
    return wb.Policy.of(config, theta)


def _by_hand(policy, first, second):
    """Return the bilinear mean of the greedy commands of the nearest middles, in plain Python."""
    grids = policy.grids()
    axes = lattice_edges(grids)

    def corners(edges, x):
        middles = (edges[:-1] + edges[1:]) / 2
        cell = int(np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(middles) - 1))
        s = cell + (x - edges[cell]) / (edges[cell + 1] - edges[cell]) - 0.5
        s = min(max(s, 0.0), len(middles) - 1.0)
        low = min(int(s), max(len(middles) - 2, 0))
        return [(middles[low], 1 - (s - low))] + (
            [(middles[low + 1], s - low)] if len(middles) > 1 else []
        )

    total = np.zeros(2)
    for a, wa in corners(axes[0], first):
        for b, wb_ in corners(axes[1], second):
            value, row = np.zeros(policy.theta.shape[2]), 0
            for grid in grids:
                value = value + policy.theta[0, row + grid.index(a, b)]
                row += grid.n
            action = int(np.argmax(value))
            levels = len(policy.right_steps)
            speeds = policy.left_steps[action // levels], policy.right_steps[action % levels]
            total += wa * wb_ * np.array(speeds)
    return total


@pytest.mark.parametrize("name", SETTINGS)
def test_commands_are_the_bilinear_mean_of_the_nearest_middles(name):
    config = replace(SETTINGS[name], followers=1)
    policy = _policy(config)
    rng = np.random.default_rng(1)
    for _ in range(200):
        follower = SoloFollower(config, policy)
        e_d = rng.uniform(-0.069, 0.069)
        bearing = rng.uniform(-0.78, 0.78)
        left, right = follower.decide(distance=config.middle_m + e_d, bearing=bearing)
        e_d = config.middle_m + e_d - config.middle_m
        # the ways between middles are whole parts, commands whole steps/s
        assert_allclose((left, right), _by_hand(policy, e_d, bearing), atol=0.6 + 720 / PARTS)


def test_in_the_middle_of_a_cell_the_command_is_the_greedy_one():
    config = replace(CALM, followers=1)
    policy = _policy(config)
    greedy = replace(config, output="greedy")
    for state in range(config.grid().n):
        e_d, bearing = config.grid().centre(state)
        seen = {"distance": config.middle_m + e_d, "bearing": bearing}
        calm = SoloFollower(config, policy).decide(**seen)
        assert calm == SoloFollower(greedy, policy).decide(**seen)


def test_places_between_middles_are_continuous_and_end_at_the_outermost():
    edges = np.array([0.0, 1.0, 3.0, 4.0])
    xs = np.linspace(-1.0, 5.0, 6001)
    places = np.array([place_on(edges, 3, x) for x in xs])
    assert places[0] == 0 and places[-1] == 2 * PARTS
    assert np.diff(places).min() >= 0 and np.diff(places).max() <= 1
    assert place_on(edges, 3, 0.5) == 0 and place_on(edges, 3, 2.0) == PARTS


@pytest.mark.parametrize("sensing", ["truth", "camera", "ir-metric", "ir-raw"])
def test_interpolated_output_serves_every_sensing_mode(sensing):
    base = wb.SETTINGS["infrared"] if sensing.startswith("ir") else CALM
    config = replace(
        base, drive="rolling", sensing=sensing, followers=2, output="interpolated", trim=0.01
    )
    policy = _policy(config)
    steps = Convoy(config, [1], periods=100, policy=policy.theta).whole()
    between = ~np.isin(steps["left"][:, 1:], policy.left_steps)
    assert between[steps["phase"][:, 1:] == 0].any()


def test_who_learns_drives_by_the_tables_own_actions_unless_told_otherwise():
    config = replace(CALM, output="interpolated", trim=0.01)
    plain = replace(CALM, output="greedy")
    runs = [Convoy(c, [1], steps=4000) for c in (plain, config, replace(config, learn_by="output"))]
    steps = [run.whole() for run in runs]
    assert steps[0].tobytes() == steps[1].tobytes()
    levels = config.levels()[0]
    learned = steps[2]["event"][:, 1:] & LEARNED != 0
    assert not np.isin(steps[2]["left"][:, 1:][learned], levels).all()


def test_an_action_that_explores_is_carried_out_as_it_is():
    learner = LearnerConfig(epsilon=0.3, epsilon_schedule="constant")
    config = replace(CALM, learn_by="output", learner=learner)
    steps = Convoy(config, [1], steps=2000).whole()
    following = steps["phase"][:, 1:] == 0
    explored = steps["event"][:, 1:] & 32 != 0
    assert explored.any()
    assert np.isin(steps["left"][:, 1:][following & explored], config.levels()[0]).all()


def test_rho_is_that_of_the_choice_whatever_the_output_makes_of_it():
    config = replace(CALM, followers=1, learn_by="output")
    epsilon, actions = 0.2, config.action_count
    follower = SoloFollower(
        replace(config, learner=LearnerConfig(epsilon=epsilon, epsilon_schedule="constant")),
        _policy(config),
        steps=1000,
    )
    ratios = set()
    for _ in range(300):
        follower.decide(distance=0.15, bearing=0.0)
        ratios.add(round(float(follower.record["choice"]["rho"]), 6))
    assert ratios == {0.0, round(1 / (1 - epsilon + epsilon / actions), 6)}


# trim


def _trimmed(config, errors, **seen):
    """Return the trim after every decision at these distance errors."""
    follower = SoloFollower(config, quantised_carrot(config))
    found = []
    for error in errors:
        follower.decide(distance=config.middle_m + error, bearing=0.0, **seen)
        found.append(float(follower.record["output"]["trim"]))
    return np.array(found)


def test_trim_is_the_integral_of_the_error_within_its_limit():
    config = replace(CALM, followers=1, trim=0.01, trim_limit_m=0.002)
    assert_allclose(_trimmed(config, [0.005] * 4), [0, 5e-5, 1e-4, 1.5e-4], atol=1e-15)
    wound = _trimmed(config, [0.005] * 100)
    assert wound.max() == 0.002


def test_trim_rests_while_the_wheels_have_nothing_left_to_give():
    """Beside a leader that stands a follower is too near, at its slowest: what it integrated then
    would have to be unwound when the leader drives on.
    """
    config = replace(CALM, followers=1, trim=0.01, wheel_speed_mps=(0.0, 0.12))
    still = _trimmed(config, [-0.069] * 200)
    assert_array_equal(still[1:], still[1])
    assert abs(still[1]) < 0.001


def test_trim_begins_anew_with_every_episode():
    config = replace(CALM, followers=1, trim=0.01)
    errors = [0.005] * 50 + [0.2] + [0.0] * 3
    found = _trimmed(config, errors)
    assert found[49] > 0.002
    assert found[-1] == 0.0


def test_trim_takes_away_a_constant_offset():
    """A table on wheels that are 5 % too small stands off; with trim it does not."""
    from workbench.formation.body import BodyConfig

    base = replace(CALM, drive="rolling", followers=1, body=BodyConfig(wheel_spread=0.1), fleet=4)
    table = quantised_carrot(base)
    without, trimmed = (
        wb.evaluate(table, replace(base, trim=gain), minutes=3, progress=False).summary
        for gain in (0.0, 0.01)
    )
    assert abs(without["mean_distance_error_mm"]) > 1.0
    assert abs(trimmed["mean_distance_error_mm"]) < abs(without["mean_distance_error_mm"]) / 3


# relative actions


def test_relative_levels_are_added_to_the_speed_of_the_predecessor():
    config = replace(CALM, followers=1, output="greedy", actions="relative")
    assert config.levels()[0].tolist() == [-233, -155, -78, 0, 78, 155, 233]
    policy = quantised_carrot(config)
    steps = Convoy(config, [1], periods=600, policy=policy.theta).whole()
    late = steps[300:, 1]
    assert_allclose(late["left"].mean(), config.leader_speed_mps / config.robot.step_m, rtol=0.05)
    run = wb.evaluate(policy, config, minutes=5, progress=False)
    assert run.summary["losses"] == 0


def test_relative_and_wheel_tables_are_not_mixed_up(tmp_path):
    wheels = replace(CALM, followers=1)
    relative = replace(wheels, actions="relative")
    with pytest.raises(ValueError, match="kind = 'relative', the configuration 'wheels'"):
        quantised_carrot(relative).check(wheels)
    arrays = quantised_carrot(wheels).arrays()
    old = {name: array for name, array in arrays.items() if name != "kind"}
    assert wb.Policy.from_arrays(old).sha256() == quantised_carrot(wheels).sha256()


def test_what_has_no_metres_cannot_be_driven_relative():
    raw = replace(wb.SETTINGS["infrared"], sensing="ir-raw")
    for changes in ({"actions": "relative"}, {"filter": "alpha-beta"}, {"prediction": "both"}):
        with pytest.raises(ValueError, match="nobody knows how they change with the place"):
            replace(raw, **changes)


def test_one_robot_does_what_the_convoy_does_with_all_of_it():
    """The loop that drives one robot through the robot API, against the compiled convoy."""
    config = replace(
        CALM,
        followers=1,
        trim=0.01,
        filter="alpha-beta",
        prediction="both",
        actions="relative",
        noise_distance_m=0.001,
        noise_bearing_rad=math.radians(1),
    )
    policy = quantised_carrot(config)
    steps = Convoy(config, [config.seed], periods=400, policy=policy.theta).whole()
    follower = SoloFollower(config, policy)
    with wb.open_robot("sim:", config=config) as robot:
        for step in steps:
            robot.step()
            distance, bearing = robot.observe()
            command = follower.decide(distance=distance, bearing=bearing)
            robot.set_motors_speed(*command)
            assert command == (step["left"][1], step["right"][1])
