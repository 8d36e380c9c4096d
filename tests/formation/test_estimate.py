"""The estimate of the predecessor: gains, filter, prediction over a delay."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import workbench as wb
from workbench.formation.body import BodyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.estimate import EstimateConfig, gains
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.table import quantised_carrot
from workbench.formation.solo import SoloFollower

BASE = wb.ConvoyConfig(followers=1, drive="rolling")


@pytest.mark.parametrize("noise", [1e-4, 2e-3, 2e-2])
@pytest.mark.parametrize("acceleration", [0.02, 0.1, 1.0])
def test_gains_are_kalatas(noise, acceleration):
    """Kalata (1984): the tracking index decides both gains of the steady filter."""
    index = acceleration * 0.1**2 / noise
    r = (4 + index - math.sqrt(8 * index + index**2)) / 4
    alpha = 1 - r**2
    beta = 2 * (2 - alpha) - 4 * math.sqrt(1 - alpha)
    assert_allclose(gains(noise, acceleration), (alpha, beta), rtol=1e-6)


def _predecessors(config, steps):
    """Return distance, bearing and speed as an estimate had them, beside the truth."""
    follower = SoloFollower(config, quantised_carrot(config))
    rng = np.random.default_rng(2)
    x = np.zeros(3)  # the robot's x, y, heading; its predecessor drives a circle
    found = []
    commands = [(0, 0)] * 10
    step_m, track = config.robot.step_m, config.robot.track_m
    for t in range(steps):
        angle = 0.12 * t / 10
        ahead = np.array([0.5 * math.sin(angle) + 0.15, 0.5 - 0.5 * math.cos(angle)])
        delta = ahead - x[:2]
        distance = math.hypot(*delta)
        bearing = (math.atan2(delta[1], delta[0]) - x[2] + math.pi) % (2 * math.pi) - math.pi
        told = (
            distance + config.noise_distance_m * rng.standard_normal(),
            bearing + config.noise_bearing_rad * rng.standard_normal(),
        )
        commands.insert(0, follower.decide(distance=told[0], bearing=told[1]))
        estimate = follower.record["estimate"]
        kept = math.hypot(estimate["x"], estimate["y"])
        found.append((distance, bearing, *told, kept, math.atan2(estimate["y"], estimate["x"])))
        left, right = commands[0]
        v, w = (left + right) * step_m / 2, (right - left) * step_m / track
        x[0] += 0.1 * v * math.cos(x[2] + 0.05 * w)
        x[1] += 0.1 * v * math.sin(x[2] + 0.05 * w)
        x[2] += 0.1 * w
    return np.array(found), float(follower.record["estimate"]["pace"])


def test_the_filter_takes_a_quarter_of_the_noise_at_least():
    config = replace(
        BASE, noise_distance_m=0.002, noise_bearing_rad=math.radians(2), filter="alpha-beta"
    )
    found, _ = _predecessors(config, 2000)
    true, told, kept = (found[200:, k : k + 2] for k in (0, 2, 4))
    assert (np.std(kept - true, axis=0) < 0.75 * np.std(told - true, axis=0)).all()


def test_the_pace_is_the_predecessors_speed():
    _, pace = _predecessors(replace(BASE, actions="relative"), 400)
    assert pace == pytest.approx(0.06, rel=0.03)


def test_without_a_delay_prediction_changes_nothing():
    policy = quantised_carrot(BASE)
    runs = [
        Convoy(replace(BASE, prediction=kind), [1], periods=300, policy=policy.theta).whole()
        for kind in ("own", "both")
    ]
    assert runs[0].tobytes() == runs[1].tobytes()
    plain = Convoy(BASE, [1], periods=300, policy=policy.theta).whole()
    # what is foreseen goes through a rotation and back
    assert_allclose(runs[0]["distance_error"], plain["distance_error"], atol=1e-6)
    assert (runs[0]["left"] == plain["left"]).mean() > 0.99


@pytest.mark.parametrize("late", [1.0, 2.0, 3.0, 2.5])
def test_a_foreseen_place_is_where_the_robot_will_be_when_its_command_arrives(late):
    """What a robot acts on, against what is true when its command begins to run; the predecessor
    swings from side to side, so that what is seen now is another place.
    """
    config = replace(BASE, prediction="both", estimate=EstimateConfig(delay_s=late / 10))
    follower = SoloFollower(config, quantised_carrot(config))
    parts = 20  # of a control period
    step_m, track = config.robot.step_m, config.robot.track_m
    x, y, heading = 0.0, 0.0, 0.0
    waiting = [(0, 0)] * 10
    acted, true = [], []
    ahead = np.array([0.15, 0.0])
    for t in range(1200 * parts):
        course = 0.6 * math.sin(0.5 * t * 0.1 / parts)
        ahead += 0.06 * 0.1 / parts * np.array([math.cos(course), math.sin(course)])
        distance = math.hypot(ahead[0] - x, ahead[1] - y)
        bearing = math.atan2(ahead[1] - y, ahead[0] - x) - heading
        true.append((distance - config.middle_m, bearing))
        if t % parts == 0:
            waiting.insert(0, follower.decide(distance=distance, bearing=bearing))
            acted.append(tuple(follower.record["learning"]["place"]))
        since = t % parts
        k = math.ceil(late - since / parts)
        left, right = waiting[k]
        v, w = (left + right) * step_m / 2, (right - left) * step_m / track
        x += 0.1 / parts * v * math.cos(heading)
        y += 0.1 / parts * v * math.sin(heading)
        heading += 0.1 / parts * w
    acted, true = np.array(acted)[200:-5], np.array(true)
    now = np.arange(200, 200 + len(acted)) * parts
    error = acted - true[now + round(late * parts)]
    stale = true[now] - true[now + round(late * parts)]
    rms = np.sqrt(np.mean(error**2, axis=0))
    assert (rms < 0.4 * np.sqrt(np.mean(stale**2, axis=0))).all()
    # a predecessor that bends its way is not where a straight one would be
    tile = 2 * config.half_range_m / 9, 2 * config.bearing_limit_rad / 9
    assert (rms < 0.25 * np.array(tile)).all()


def test_a_late_carrot_is_calm_again_with_prediction():
    late = replace(BASE, followers=4, body=BodyConfig(delay=3))
    law = CarrotPI(k_bearing=6.0)
    errors = {
        kind: wb.evaluate(law, replace(late, prediction=kind), minutes=5, progress=False).summary
        for kind in ("none", "own", "both")
    }
    spread = {kind: each["bearing_std_deg"] for kind, each in errors.items()}
    assert errors["both"]["losses"] == 0
    assert spread["both"] < 0.6 * spread["none"]


def test_a_given_delay_may_be_a_part_of_a_period():
    config = replace(
        BASE, body=BodyConfig(delay=2), prediction="both", estimate=EstimateConfig(delay_s=0.25)
    )
    assert config.late_s == 0.25
    assert replace(config, estimate=EstimateConfig()).late_s == pytest.approx(0.2)
    run = wb.evaluate(CarrotPI(), config, minutes=2, progress=False)
    assert run.summary["losses"] == 0


def test_the_time_of_computing_is_part_of_the_delay():
    config = replace(BASE, learner=wb.LearnerConfig(buffer=False), compute_time_s=0.04)
    assert config.late_s == pytest.approx(0.04)


@pytest.mark.parametrize("sensing", ["camera", "ir-metric"])
def test_a_filter_with_what_it_is_told_by_default_follows_no_worse_than_none(sensing):
    """Weights of 20 000 updates, the same world, with and without: within the margin of 0.5 mm."""
    base = wb.SETTINGS["infrared" if sensing == "ir-metric" else "recommended"]
    config = replace(base, drive="rolling", sensing=sensing, output="interpolated", trim=0.01)
    policy = wb.learn(config, steps=40_000, progress=False).policy
    summaries = [
        wb.evaluate(policy, replace(config, filter=kept), minutes=5, progress=False).summary
        for kept in ("none", "alpha-beta")
    ]
    plain, kept = (each["rms_distance_error_mm"] for each in summaries)
    assert kept <= plain + 0.5
    assert summaries[1]["losses"] <= summaries[0]["losses"]


def test_a_robot_that_is_put_somewhere_has_carried_out_nothing():
    config = replace(BASE, filter="alpha-beta", followers=2)
    convoy = Convoy(config, [1], periods=600, policy=quantised_carrot(config).theta)
    convoy.run_block()
    assert (convoy.robots["estimate"]["put"] == 0).all()
    convoy.begin_again(0)
    assert (convoy.robots["estimate"]["put"] == 1).all()
    follower = SoloFollower(config, quantised_carrot(config))
    for put, sent in ((0, 300), (1, 0)):
        follower.record["command"]["left"] = follower.record["command"]["right"] = 300
        follower.record["estimate"]["put"] = put
        follower.decide(distance=0.15, bearing=0.0)
        assert follower.record["estimate"]["sent"][0].tolist() == [sent, sent]


def test_between_readings_the_estimate_goes_on():
    config = replace(BASE, filter="alpha-beta")
    followers = [SoloFollower(config, quantised_carrot(config)) for _ in range(2)]
    for _ in range(30):
        for follower in followers:
            follower.decide(distance=0.15, bearing=0.05)
    # the same old reading, told as new and as old
    for follower, new in zip(followers, (True, False), strict=True):
        follower.record["command"]["left"] = follower.record["command"]["right"] = 0
        follower.decide(distance=0.5, bearing=0.05, new=new)
    told, old = (float(follower.record["estimate"]["x"]) for follower in followers)
    assert told > 0.15 + 0.01 and old < 0.15 + 0.01


def test_what_is_out_of_sight_is_forgotten():
    config = replace(BASE, filter="alpha-beta")
    follower = SoloFollower(config, quantised_carrot(config))
    for _ in range(5):
        follower.decide(distance=0.15, bearing=0.0)
    assert follower.record["estimate"]["any"] == 1
    follower.decide(distance=1e6, bearing=0.0)
    assert follower.record["estimate"]["any"] == 0
