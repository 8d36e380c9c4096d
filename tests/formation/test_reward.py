"""Error measures (S1, S2) and reward presets: definitions, mirror symmetry, and that losing the
leader never pays.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from workbench.formation.config import ConvoyConfig
from workbench.formation.reward import PRESETS, step_reward, terminal_reward, worst_step_reward
from workbench.formation.senses.truth import observe
from workbench.studies.sideways import cut_in_radius, keep_circle_bearing

coordinate = st.floats(-2, 2)


@given(
    coordinate, coordinate, st.floats(-math.pi, math.pi), st.floats(0.05, 0.5), st.floats(-3.1, 3.1)
)
def test_distance_and_bearing_are_recovered_from_any_pose(x, y, heading, distance, bearing):
    ahead = x + distance * math.cos(heading + bearing), y + distance * math.sin(heading + bearing)
    measured = observe(x, y, math.cos(heading), math.sin(heading), *ahead)
    assert measured[0] == pytest.approx(distance, abs=1e-12)
    assert math.remainder(measured[1] - bearing, 2 * math.pi) == pytest.approx(0, abs=1e-9)


@given(coordinate, coordinate, st.floats(-math.pi, math.pi), coordinate, coordinate)
def test_errors_mirror_exactly(x, y, heading, ahead_x, ahead_y):
    assume(math.dist((x, y), (ahead_x, ahead_y)) > 1e-6)  # robots do not share a place
    c, s = math.cos(heading), math.sin(heading)
    here = observe(x, y, c, s, ahead_x, ahead_y)
    mirrored = observe(x, -y, c, -s, ahead_x, -ahead_y)
    assert here[0] == mirrored[0]
    assert here[1] == -mirrored[1] or abs(here[1]) == math.pi


@given(st.floats(0.0805, 0.2195), st.floats(-0.78, 0.78))
def test_states_mirror_away_from_tile_edges(distance, bearing):
    config = ConvoyConfig()
    grid = config.grid()
    edges = grid.tilings[1].edges
    if np.min(np.abs(edges - bearing)) < 1e-9:
        return
    row, column = grid.cells(grid.index(distance - config.middle_m, bearing))
    assert grid.cells(grid.index(distance - config.middle_m, -bearing)) == (
        row,
        config.state_tiles[1] - 1 - column,
    )


def test_wanted_distance_is_the_middle_of_the_bounds():
    config = ConvoyConfig(distance_m=(0.08, 0.13))
    assert config.middle_m == pytest.approx(0.105)
    assert config.half_range_m == pytest.approx(0.025)


def test_geometry_of_following_on_a_circle():
    # R 0.5 m, d 0.15 m: asin(0.15) = 8.627°, sqrt(0.25 - 0.0225) = 0.476970 m
    assert math.degrees(keep_circle_bearing(0.15, 0.5)) == pytest.approx(8.627, abs=1e-3)
    assert cut_in_radius(0.15, 0.5) == pytest.approx(0.476970, abs=1e-6)
    centre_to_centre = observe(0.5, 0.0, 0.0, 1.0, 0.5 * math.cos(0.3), 0.5 * math.sin(0.3))
    assert centre_to_centre[1] == pytest.approx(keep_circle_bearing(centre_to_centre[0], 0.5))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.8, 0.99])
def test_losing_the_leader_never_pays(preset, gamma):
    at = np.linspace(-1, 1, 41)
    steps = np.array([[step_reward(PRESETS.index(preset), u, v) for u in at] for v in at])
    worst = worst_step_reward(preset)
    assert steps.min() >= worst - 1e-12
    assert steps.min() == pytest.approx(worst, abs=1e-12)
    terminal = terminal_reward(worst, gamma, 1.0)
    staying_at_the_worst = steps.min() / (1 - gamma)
    assert terminal <= staying_at_the_worst + 1e-9
    assert terminal_reward(worst, gamma, 2.0) <= terminal
    assert np.unravel_index(steps.argmax(), steps.shape)[1] == 20  # best at zero distance error


def test_presets_by_hand():
    values = {preset: step_reward(PRESETS.index(preset), 0.5, -0.25) for preset in PRESETS}
    # 0.25 + 0.0625 = 0.3125; 0.75; 0.25; 1 - 0.15625
    assert values == {"quadratic": -0.3125, "absolute": -0.75, "distance": -0.25, "alive": 0.84375}
