"""Range and bearing: what two robots hear of each other tells where and how the other stands."""

import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.formation.convoy import Convoy
from workbench.formation.senses.range_bearing import RangeBearingConfig
from workbench.formation.shapes import FormationConfig

TRACK = wb.TrackConfig(shape="eight", radius_m=1.0, judder="none")
EXACT = RangeBearingConfig(
    noise_range_m=0.0, noise_bearing_rad=0.0, sector_bias_rad=0.0, odometry_error=0.0, gain=1.0
)
BASE = wb.ConvoyConfig(
    drive="rolling",
    sensing="range-and-bearing",
    range_bearing=EXACT,
    track=TRACK,
    leader_speed_mps=0.05,
    wheel_speed_mps=(0.0, 0.12),
)
WEDGE = replace(BASE, formation=FormationConfig(shape="wedge", frame="heading"))


def _convoy(config, blocks=1):
    convoy = Convoy(config, [config.seed], periods=10**6, policy=wb.LAWS["carrot"](), threads=1)
    for _ in range(blocks):
        steps = convoy.run_block()[0].copy()
    return convoy, steps


def test_without_errors_it_is_the_truth():
    convoy, _ = _convoy(BASE)
    robots = convoy.robots[0]
    for i in range(1, 5):
        mine, its = robots[i]["pose"], robots[i - 1]["pose"]
        dx, dy = its["x"] - mine["x"], its["y"] - mine["y"]
        assert robots[i]["seen"]["distance"] == pytest.approx(math.hypot(dx, dy), abs=1e-9)
        turn = math.atan2(
            its["sin"] * mine["cos"] - its["cos"] * mine["sin"],
            its["cos"] * mine["cos"] + its["sin"] * mine["sin"],
        )
        assert robots[i]["board"]["heading"] == pytest.approx(turn, abs=1e-9)


def test_without_errors_the_virtual_leader_is_the_truth_s():
    convoy, steps = _convoy(WEDGE)
    for i in range(1, 5):
        robot = convoy.robots[0, i]
        dx = robot["place"]["ahead_x"] - robot["pose"]["x"]
        dy = robot["place"]["ahead_y"] - robot["pose"]["y"]
        assert robot["seen"]["distance"] == pytest.approx(math.hypot(dx, dy), abs=1e-6)
        bearing = math.atan2(dy, dx) - math.atan2(robot["pose"]["sin"], robot["pose"]["cos"])
        assert math.cos(robot["seen"]["bearing"] - bearing) == pytest.approx(1, abs=1e-9)
    assert not np.any(steps["event"][:, 1:] & 1)


def test_odometry_carries_on_where_messages_are_lost():
    told = replace(EXACT, message_loss=0.5)
    convoy, steps = _convoy(replace(WEDGE, range_bearing=told))
    assert not np.any(steps["event"][200:, 1:] & 1)
    wrong = replace(told, odometry_error=0.3)
    _, lame = _convoy(replace(WEDGE, range_bearing=wrong, seed=3))
    spread = [float(np.abs(one["distance_error"][500:, 1:]).mean()) for one in (steps, lame)]
    assert spread[1] > spread[0]


def test_a_filter_saves_what_noise_loses():
    noisy = replace(WEDGE, range_bearing=RangeBearingConfig())
    bare = replace(WEDGE, range_bearing=RangeBearingConfig(gain=1.0))
    lost = [np.count_nonzero(_convoy(config, 2)[1]["event"][:, 1:] & 1) for config in (noisy, bare)]
    assert lost[0] <= 1 and lost[1] > 20


def test_what_is_too_far_is_not_heard():
    near = replace(EXACT, range_m=0.1)
    convoy, steps = _convoy(replace(BASE, range_bearing=near))
    assert np.all(convoy.robots["board"]["any"][0, 1:] == 0)
    assert np.all(steps["state"][:, 1:] < 0)  # nobody has ever followed
    with pytest.raises(ValueError, match=r"range_m = 0.1 with a place 0.424 m from the leader"):
        replace(WEDGE, range_bearing=near)


def test_every_robot_s_receivers_are_its_own_and_stay():
    told = replace(EXACT, sector_bias_rad=0.02)
    one, two = (_convoy(replace(BASE, range_bearing=told))[0].robots["board"]["bias"] for _ in "ab")
    assert np.array_equal(one, two) and np.unique(one).size == one.size


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise_distance_m": 0.01}, "have noise of their own: see range_bearing"),
        ({"formation": FormationConfig(shape="wedge", frame="path")}, "keep no trail of its"),
    ],
)
def test_what_does_not_go_together_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(BASE, **changes)
