"""Motion of runs, recordings and arrays, and the measures of restless motion, on motions made by
hand.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import EXPLORED
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.table import quantised_carrot
from workbench.formation.places import track_of
from workbench.formation.records import PERIOD
from workbench.formation.reset import FOLLOW, TURN
from workbench.lab.runs import evaluate
from workbench.measures.motion import Motion, as_motion, chatter, follow
from workbench.measures.smoothness import ldlj_vector
from workbench.robot.geometry import BODY_RADIUS, STEP as STEP_M

PLANAR = ConvoyConfig(followers=2, drive="planar", seed=2)


def _straight(commands, *, phase=FOLLOW, explored=()):
    """Step records of a leader and one follower that drive straight at 60 mm/s; the follower's
    commands are given.
    """
    steps = np.zeros((len(commands), 2), PERIOD)
    steps["x"] = 0.006 * np.arange(len(commands))[:, None] + [0.15, 0.0]
    steps["left"][:, 1] = steps["right"][:, 1] = commands
    steps["phase"] = FOLLOW
    steps["phase"][:, 1] = phase
    steps["event"][list(explored), 1] = EXPLORED
    return steps


def test_switches_and_variation_per_metre_by_hand():
    # 101 samples, 0.6 m; the command alternates every sample between 400 and 500: 100 changes of
    # 100 on both wheels
    commands = np.where(np.arange(101) % 2, 500, 400)
    line = chatter(Motion.of_steps(_straight(commands))).iloc[1]
    assert line["distance_m"] == pytest.approx(0.6, rel=1e-5)
    assert line["switches_per_m"] == pytest.approx(100 / 0.6, rel=1e-5)
    assert line["variation_mm_s_per_m"] == pytest.approx(100 * 200 * STEP_M * 1000 / 0.6, rel=1e-5)
    assert chatter(Motion.of_steps(_straight(np.full(101, 466))))["switches_per_m"][1] == 0.0


def test_random_actions_are_told_from_the_policy_s_own_switches():
    commands = np.full(101, 466)
    commands[[20, 60]] = 300  # two random actions: four changes, none of them the policy's own
    line = chatter(Motion.of_steps(_straight(commands, explored=(20, 60)))).iloc[1]
    assert (
        line["switches_per_m"] == pytest.approx(4 / 0.6, rel=1e-5)
        and line["policy_switches_per_m"] == 0.0
    )
    commands[80] = (
        # one that was not random: two changes on the 96 stretches between commands of which none
        # was random
        300
    )
    line = chatter(Motion.of_steps(_straight(commands, explored=(20, 60)))).iloc[1]
    assert line["policy_switches_per_m"] == pytest.approx(2 / (96 * 0.006), rel=1e-4)


def test_driving_back_after_a_loss_counts_no_switches():
    commands = np.where(np.arange(101) % 2, 500, 400)
    phase = np.where(np.arange(101) < 50, TURN, FOLLOW)
    line = chatter(Motion.of_steps(_straight(commands, phase=phase))).iloc[1]
    assert line["switches_per_m"] == pytest.approx(1 / 0.006, rel=1e-4)  # per metre of following
    assert np.isnan(chatter(Motion.of_steps(_straight(commands, phase=TURN)))["switches_per_m"][1])


def test_fast_turning_is_chatter_and_slow_turning_is_the_way():
    t = np.arange(2001) / 10
    headings = {
        "slow": 0.3 * np.sin(2 * np.pi * 0.5 * t),
        "fast": 0.1 * np.sin(2 * np.pi * 2.0 * t),
    }
    found = {}
    for name, heading in headings.items():
        steps = np.cumsum(0.006 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
        motion = replace(Motion.of_path(steps, 10.0), heading=heading[:, None])
        found[name] = chatter(motion)["turn_rms_deg_s"][0]
    # d/dt of 0.1 sin(4πt) has an RMS of 0.1 · 4π / √2; a difference over 0.1 s sees sinc(0.2) =
    # 0.935 of it
    assert found["fast"] == pytest.approx(
        math.degrees(0.1 * 4 * np.pi / math.sqrt(2)) * np.sinc(0.2), rel=0.01
    )
    assert found["slow"] < 0.02 * found["fast"]


def test_jerk_is_the_mean_over_windows_of_20_seconds():
    rng = np.random.default_rng(0)
    path = np.cumsum(np.stack([np.full(401, 0.006), rng.normal(0, 0.0005, 401)], axis=1), axis=0)
    velocity = np.diff(path, axis=0) * 10
    expected = np.mean([ldlj_vector(velocity[:200], 10), ldlj_vector(velocity[200:400], 10)])
    assert chatter(Motion.of_path(path, 10.0))["ldlj_vector"][0] == pytest.approx(
        expected, abs=1e-9
    )


def test_true_errors_and_gaps_by_hand():
    steps = _straight(np.full(5, 466))
    steps["heading"][:, 1] = 0.2
    motion = Motion.of_steps(steps)
    distance, bearing = motion.errors()
    np.testing.assert_allclose(distance, 0.15, atol=1e-6)
    np.testing.assert_allclose(bearing, -0.2, atol=1e-6)
    np.testing.assert_allclose(motion.gaps_m(), 0.15 - 2 * BODY_RADIUS, atol=1e-6)
    assert motion.gaps_m().shape == (5, 1) and Motion.of_steps(
        np.zeros((3, 5), PERIOD)
    ).gaps_m().shape == (3, 10)


def test_following_greedily_is_what_evaluate_does_and_knows_its_track():
    policy = quantised_carrot(PLANAR)
    run = evaluate(policy, PLANAR, minutes=1, progress=False)
    motion = follow(policy, PLANAR, minutes=1)
    from_run = as_motion(run)
    np.testing.assert_array_equal(motion.position, from_run.position)
    np.testing.assert_array_equal(motion.command, from_run.command)
    np.testing.assert_array_equal(motion.track.line, track_of(PLANAR).line)
    assert as_motion(motion) is motion and motion.fs == 10.0
    assert Convoy(PLANAR, [2], periods=600, policy=CarrotPI()).whole().shape == (600, 3)


def test_a_shorter_run_with_the_horizon_of_a_longer_one_is_how_that_one_begins():
    long = Convoy(PLANAR, [3], steps=12_000, horizon=40_000, threads=1).whole()
    short = Convoy(PLANAR, [3], steps=4_000, horizon=40_000, threads=1).whole()
    other = Convoy(PLANAR, [3], steps=4_000, threads=1).whole()  # its ε falls sooner
    assert short[:-1].tobytes() == long[: len(short) - 1].tobytes()
    assert other[: len(short)].tobytes() != short.tobytes()


def test_what_is_no_motion_or_no_controller_is_refused_with_a_hint():
    with pytest.raises(
        TypeError, match=r"source is a ndarray; expected .* arrays: Motion.of_path\(xy, fs\)"
    ):
        chatter(np.zeros((50, 2)))
    for wrong in ("carrot", CarrotPI):
        for call in (follow, evaluate):
            with pytest.raises(TypeError, match=r"LAWS\['carrot'\]\(\)"):
                call(wrong, PLANAR, minutes=1)


def test_a_restart_is_no_way_and_no_chatter():
    steps = _straight(np.full(601, 466))
    quiet = chatter(Motion.of_steps(steps)).iloc[1]
    steps["x"][300:] -= 1.5  # put back to the start
    restarted = chatter(Motion.of_steps(steps)).iloc[1]
    assert restarted["distance_m"] == pytest.approx(quiet["distance_m"] - 0.006, abs=1e-4)
    assert restarted["ldlj_vector"] == pytest.approx(quiet["ldlj_vector"], abs=1.0)
    assert restarted["turn_rms_deg_s"] == quiet["turn_rms_deg_s"] == 0.0


def test_what_cannot_be_told_is_not_told():
    t = np.arange(150) / 10
    path = 0.5 * np.stack([np.cos(0.12 * t), np.sin(0.12 * t)], axis=1)
    assert np.isnan(
        chatter(Motion.of_path(path, 10.0))["ldlj_vector"][0]
    )  # 15 s: windows of 20 s are compared
    assert np.isnan(
        chatter(Motion.of_path(path, 2.0))["turn_rms_deg_s"][0]
    )  # nothing above 1 Hz is sampled


def _recording():
    t = np.arange(30) / 10
    robots = {0: 0.15, 1: 0.0}
    parts = [
        pd.DataFrame({"time_s": t, "robot": name, "x_m": 0.06 * t + x, "y_m": 0.0})
        for name, x in robots.items()
    ]
    return pd.concat(parts, ignore_index=True)


def test_a_recording_is_a_motion_whatever_the_order_of_its_lines():
    table = _recording()
    motion = as_motion(table)
    assert (
        motion.position.shape == (30, 2, 2)
        and motion.fs == pytest.approx(10.0)
        and motion.command is None
    )
    np.testing.assert_allclose(motion.heading, 0.0, atol=1e-9)
    shuffled = as_motion(table.sample(frac=1, random_state=0))
    np.testing.assert_array_equal(shuffled.position, motion.position)
    assert "switches_per_m" not in chatter(motion)
    known = as_motion(table.assign(left_steps=466, right_steps=466, heading_rad=0.1))
    assert chatter(known)["switches_per_m"].tolist() == [0.0, 0.0] and known.heading[0, 0] == 0.1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: Motion.of_path(np.ones((5, 3)), 10.0),
            r"position has shape \(5, 3\); expected \(T, 2\)",
        ),
        (lambda: Motion.of_path(np.full((5, 2), np.nan), 10.0), "not finite"),
        (
            lambda: as_motion(_recording().drop(columns="y_m")),
            "the recording lacks y_m; it has time_s, robot, x_m",
        ),
        (
            lambda: as_motion(_recording().replace({"robot": {1: 2}})),
            "robots are 0, 2; expected 0 for the leader",
        ),
        (
            lambda: as_motion(_recording().assign(robot="a")),
            "robots are a; expected 0 for the leader",
        ),
        (
            lambda: as_motion(_recording().assign(left_steps=1.0, right_steps=np.nan)),
            "no number in row 0, column right_steps",
        ),
        (
            lambda: follow(CarrotPI(), PLANAR, minutes=0),
            "minutes = 0; expected simulated minutes, from a control period",
        ),
        (lambda: follow(CarrotPI(), PLANAR, minutes=float("nan")), "minutes = nan"),
        (
            lambda: as_motion(_recording().iloc[:-1]),
            "59 lines for 30 times and 2 robots; expected one of each",
        ),
        (
            lambda: as_motion(_recording()[lambda t: t["time_s"] != 1.0]),
            "a gap after 0.9 s; resample",
        ),
        (
            lambda: as_motion(_recording()[lambda t: t["time_s"] < 0.15]),
            "2 times; expected at least 3",
        ),
        (
            lambda: follow(quantised_carrot(ConvoyConfig(state_tiles=(5, 5))), PLANAR),
            "the policy has distance_edges",
        ),
    ],
)
def test_bad_input_is_refused_with_the_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
