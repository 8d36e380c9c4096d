"""The lean loop: what it does is the whole loop's to the last bit, and who gets it."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.arena.tracks import TrackConfig
from workbench.formation import convoy as module
from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.own_reward import own_reward
from workbench.formation.shapes import FormationConfig
from workbench.learning.config import LearnerConfig

ROLLING = ConvoyConfig(drive="rolling")
WEDGE = FormationConfig(shape="wedge", frame="heading")
EIGHT = TrackConfig(shape="eight", radius_m=1.0)
PLAIN = {
    "paper": ROLLING,
    "planar": ConvoyConfig(drive="planar"),
    "recommended": replace(SETTINGS["recommended"], drive="rolling"),
    "relative": replace(ROLLING, sensing="truth-relative"),
    "noise": replace(ROLLING, noise_distance_m=0.002, noise_bearing_rad=0.03),
    "restart": replace(ROLLING, reset="restart"),
    "shared": replace(ROLLING, weights="shared"),
    "wide": replace(ROLLING, track=TrackConfig(line_width_m=0.03)),
    "qrc": replace(ROLLING, learner=LearnerConfig(rule="qrc", eta=1.0)),
    "wedge": replace(ROLLING, formation=WEDGE, track=EIGHT, leader_speed_mps=0.05),
    "path": replace(
        ROLLING, formation=replace(WEDGE, frame="path"), track=EIGHT, leader_speed_mps=0.05
    ),
    "sarsa": replace(ROLLING, learner=LearnerConfig(rule="expected-sarsa")),
}


@pytest.mark.parametrize("name", PLAIN)
def test_the_lean_loop_does_what_the_whole_one_does(name, monkeypatch):
    lean = Convoy(PLAIN[name], [1, 2], steps=10_000)
    assert lean.plain
    records = lean.run_block().tobytes()
    monkeypatch.setattr(module, "is_plain", lambda config, law: False)
    whole = Convoy(PLAIN[name], [1, 2], steps=10_000)
    assert not whole.plain and whole.run_block().tobytes() == records
    np.testing.assert_array_equal(lean.weights, whole.weights)


def test_whoever_needs_more_gets_the_whole_loop():
    more = {
        "camera": replace(ROLLING, sensing="camera"),
        "infrared": SETTINGS["infrared"],
        "body": replace(ROLLING, body=BodyConfig(slip=0.1)),
        "no buffer": replace(ROLLING, learner=LearnerConfig(buffer=False)),
        "rule": replace(ROLLING, learner=LearnerConfig(rule="true-online-sarsa")),
    }
    for config in more.values():
        assert not Convoy(config, [1], steps=1).plain
    assert not Convoy(ROLLING, [1], periods=1, policy=CarrotPI()).plain


def test_a_law_drives_beside_a_reward_of_one_s_own():
    reward = own_reward(lambda u, v: -abs(u) - abs(v))
    config = replace(ROLLING, followers=2, reward="own")
    own = Convoy(config, [1], periods=200, policy=CarrotPI(), reward=reward)
    usual = Convoy(replace(config, reward="quadratic"), [1], periods=200, policy=CarrotPI())
    np.testing.assert_array_equal(own.whole()["left"], usual.whole()["left"])
