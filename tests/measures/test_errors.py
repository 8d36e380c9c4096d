"""True errors and what they come to over a drive, by hand."""

import numpy as np
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.formation.records import PERIOD
from workbench.measures.errors import summary, true_errors, within


def _steps(pose_ahead, pose):
    steps = np.zeros((3, 2), PERIOD)
    for robot, (x, y, heading) in enumerate((pose_ahead, pose)):
        steps["x"][:, robot] = x
        steps["y"][:, robot] = y
        steps["heading"][:, robot] = heading
    return steps


@pytest.mark.parametrize(
    ("ahead", "pose", "distance", "bearing"),
    [
        ((0.3, 0.4, 0.0), (0.0, 0.0, 0.0), 0.5, np.arctan2(4, 3)),
        ((-0.2, 0.0, 0.0), (0.0, 0.0, 3.0), 0.2, np.pi - 3.0),  # behind in the room, ahead of it
        ((-0.2, 0.0, 0.0), (0.0, 0.0, -3.0), 0.2, 3.0 - np.pi),  # the short way round
    ],
)
def test_distance_and_bearing_are_seen_from_the_robot_behind(ahead, pose, distance, bearing):
    found = true_errors(_steps(ahead, pose))
    np.testing.assert_allclose(found[0], distance, rtol=1e-6)
    np.testing.assert_allclose(found[1], bearing, rtol=1e-6)


def test_bounds_include_the_near_end_and_exclude_the_far_one():
    config = ConvoyConfig()
    near, far = config.distance_m
    limit = config.bearing_limit_rad
    distance = np.array([near, far, config.middle_m, config.middle_m])
    inside = within(config, distance, np.array([0.0, 0.0, limit, -0.99 * limit]))
    assert inside.tolist() == [True, False, False, True]


def test_a_summary_is_of_the_chosen_and_nothing_is_no_number():
    distance = np.array([[0.16, 0.5], [0.14, 0.5]])
    bearing = np.radians([[3.0, 90.0], [1.0, 90.0]])
    chosen = np.array([[True, False], [True, False]])
    found = summary(distance, bearing, chosen, wanted_m=0.15)
    assert found["rms_distance_error_mm"] == pytest.approx(10)
    assert found["rms_bearing_deg"] == pytest.approx(np.sqrt(5))
    assert found["bearing_std_deg"] == pytest.approx(1)
    assert all(np.isnan(list(summary(distance, bearing, ~chosen & chosen, wanted_m=1.0).values())))
