"""Classical followers: equations against independent vectors, one follower for all, and what each
is told.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from workbench.arena.tracks import TrackConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS, RECOVERED, Memory, act
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.l_psi import LPsi, l_psi
from workbench.formation.laws.leader_frame import LeaderFrame, leader_frame
from workbench.formation.laws.path import PathReconstruction
from workbench.formation.laws.pursuit import PurePursuit, pursuit_turn
from workbench.formation.laws.table import (
    LAWS,
    check_law,
    controller_from_arrays,
    quantised_carrot,
)
from workbench.formation.records import PERIOD, ROBOT
from workbench.formation.reset import FOLLOW
from workbench.formation.senses.table import INFRARED, SENSING
from workbench.formation.shapes import FormationConfig
from workbench.lab.runs import evaluate, evaluate_seeds, load_run
from workbench.learning.kernel import new_trace
from workbench.measures.motion import Motion, follow
from workbench.measures.shapes import shape_errors
from workbench.robot.geometry import STEP as STEP_M, TRACK
from workbench.robot.motors import twist

ORACLE = json.loads((Path(__file__).parents[1] / "data" / "smoothness.json").read_text())[
    "controllers"
]
PLANAR = ConvoyConfig(followers=2, drive="planar", seed=5)


def _seen(leader, own):
    """Distance, bearing and relative heading of a leader's pose (x, y, heading) from a
    follower's.
    """
    dx, dy = leader[0] - own[0], leader[1] - own[1]
    return math.hypot(dx, dy), math.atan2(dy, dx) - own[2], leader[2] - own[2]


@pytest.mark.parametrize("case", ORACLE["lpsi_vectors"], ids=range(len(ORACLE["lpsi_vectors"])))
def test_l_psi_equals_the_oracle(case):
    distance, bearing, heading = _seen(case["leader_pose"], case["follower_pose"])
    told = (
        distance,
        bearing,
        heading,
        case["v1"],
        case["w1"],
        case["l_des"],
        case["psi_des"],
        case["d"],
    )
    found = l_psi(*told, float(case["alpha1"]), float(case["alpha2"]))
    np.testing.assert_allclose(found, (case["v"], case["w"]), rtol=0, atol=1e-9)


def test_l_psi_errors_decay_exponentially_in_the_closed_loop():
    case = ORACLE["lpsi_closed_loop"]
    omega1 = case["V"] / case["R"]
    dt = 0.001
    pose = np.array(case["start_pose"])
    found = []
    for k in range(5001):
        t = k * dt
        leader = (
            case["R"] * math.cos(omega1 * t),
            case["R"] * math.sin(omega1 * t),
            omega1 * t + math.pi / 2,
        )
        distance, bearing, heading = _seen(leader, pose)
        if round(t, 6) in case["t"]:
            x, y = case["d"] - distance * math.cos(bearing), -distance * math.sin(bearing)
            found.append(case["l_des"] - math.hypot(x, y))
        v, omega = l_psi(
            distance,
            bearing,
            heading,
            case["V"],
            omega1,
            case["l_des"],
            case["psi_des"],
            case["d"],
            1.0,
            1.0,
        )
        middle = pose[2] + omega * dt / 2
        pose += [v * dt * math.cos(middle), v * dt * math.sin(middle), omega * dt]
    np.testing.assert_allclose(np.array(found) / found[0], case["expected"], atol=2e-3)


@pytest.mark.parametrize(
    "case", ORACLE["pure_pursuit_vectors"], ids=range(len(ORACLE["pure_pursuit_vectors"]))
)
def test_pure_pursuit_equals_the_oracle(case):
    distance, bearing, _ = _seen((*case["target"], 0.0), case["pose"])
    turn = pursuit_turn(distance * math.cos(bearing), distance * math.sin(bearing), case["v"])
    assert turn == pytest.approx(case["w"], abs=1e-9)


def test_leader_frame_control_makes_both_errors_decay_at_their_rates():
    distance = 0.17
    bearing = 0.3
    heading = 0.5
    v1 = 0.05
    k1 = 2.0
    k2 = 4.0
    v, omega = leader_frame(distance, bearing, heading, v1, distance - 0.15, k1, k2)
    beta = heading - bearing  # ḋ = v1 cos β - v2 cos φ; φ̇ = -ω + (v2 sin φ + v1 sin β) / d
    assert v1 * math.cos(beta) - v * math.cos(bearing) == pytest.approx(-k1 * 0.02, abs=1e-12)
    change = -omega + (v * math.sin(bearing) + v1 * math.sin(beta)) / distance
    assert change == pytest.approx(-k2 * bearing, abs=1e-12)


@njit
def _act(task, follower, step, memory, distance, bearing):
    follower[0].seen.distance = distance
    follower[0].seen.bearing = bearing
    return act(task[0], follower[0], step[0], memory)


class _Driven:
    """One follower that a law drives, observation by observation."""

    def __init__(self, law, **changes):
        self.config = ConvoyConfig(followers=1, drive="planar", **changes)
        self.task = Convoy(self.config, [1], periods=1, policy=law).task
        self.follower = np.zeros(1, ROBOT)
        self.step = np.zeros(1, PERIOD)
        self.follower["choice"]["state"] = -1
        empty = new_trace(self.config.rows * self.config.action_count)
        self.memory = Memory(
            np.zeros((2, empty[1].size)),
            np.stack([empty[0], empty[2], empty[0]]),
            np.stack([empty[1], empty[1]]),
        )

    def act(self, distance, bearing):
        left, right, _ = _act(
            self.task, self.follower, self.step, self.memory, float(distance), float(bearing)
        )
        return left, right


def test_the_carrot_s_commands_by_hand():
    robot = _Driven(CarrotPI(k_integral=1.0))
    v, omega = 2.0 * 0.03 + 1.0 * 0.0, 4.0 * 0.1  # first step: no integral yet
    wheels = (v - omega * TRACK / 2) / STEP_M, (v + omega * TRACK / 2) / STEP_M
    assert robot.act(0.18, 0.1) == (round(wheels[0]), round(wheels[1]))
    v = 2.0 * 0.03 + 1.0 * 0.03 * 0.1  # 0.1 s later
    assert robot.act(0.18, 0.0) == (round(v / STEP_M), round(v / STEP_M))


def test_commands_stay_in_the_learner_s_range_and_keep_the_turn_as_long_as_they_can():
    robot = _Driven(CarrotPI())
    low, high = robot.config.levels()[0][[0, -1]]
    left, right = robot.act(0.2199, 0.05)  # v = 0.14 m/s is too fast: both wheels are slowed alike
    assert right == high and twist(left, right)[1] == pytest.approx(4.0 * 0.05, abs=0.003)
    assert robot.act(0.0801, 0.0) == (low, low)
    left, right = robot.act(0.15, 0.78)  # 3.1 rad/s are more than the range allows
    assert (left, right) == (low, high)


def test_the_range_is_the_learner_s_even_where_it_has_one_level():
    whole = _Driven(CarrotPI())
    single = _Driven(CarrotPI(), action_levels=(1, 7))
    assert whole.act(0.19, 0.02) == single.act(0.19, 0.02)


def test_the_integral_waits_where_the_range_ends():
    robot = _Driven(CarrotPI())
    for _ in range(50):
        robot.act(0.2199, 0.0)
    assert robot.follower["law"]["integral"][0] == 0.0
    for _ in range(50):
        robot.act(0.16, 0.0)
    assert robot.follower["law"]["integral"][0] > 0.04


def test_an_episode_begins_with_an_empty_memory():
    robot = _Driven(PathReconstruction())
    for _ in range(30):
        robot.act(0.16, 0.0)
    assert (
        robot.follower["law"]["way"]["count"][0] == 30 and robot.follower["law"]["integral"][0] > 0
    )
    robot.act(0.3, 0.0)
    assert robot.step["event"][0] & LOSS and robot.step["phase"][0] != FOLLOW
    robot.act(0.16, 0.0)
    assert robot.step["event"][0] & RECOVERED
    assert robot.follower["law"]["way"]["count"][0] == 1 and robot.follower["law"]["integral"][
        0
    ] == pytest.approx(0.001)


def test_breadcrumbs_lie_where_the_predecessor_was():
    # the follower drives straight at the levels of its commands, the predecessor stays where it is:
    # all crumbs are one point
    robot = _Driven(PurePursuit())
    x = 0.0
    for _ in range(12):
        left, right = robot.act(0.2 - x, 0.0)
        assert left == right
        x += twist(10_000 / (10_000 // left), 10_000 / (10_000 // right))[0] * 0.1
    trail = robot.follower["law"]["way"]["trail"][0][:12]
    np.testing.assert_allclose(trail, np.tile([0.2, 0.0], (12, 1)), atol=1e-9)


@pytest.mark.parametrize("direction", ["clockwise", "anticlockwise"])
@pytest.mark.parametrize("name", LAWS)
def test_laws_settle_where_geometry_puts_them_on_a_quiet_circle(name, direction):
    config = replace(PLANAR, followers=1, track=TrackConfig(judder="none", direction=direction))
    law = LAWS[name]()
    motion = follow(law, config, minutes=3)
    distance, bearing = (values[600:, 0] for values in motion.errors())
    lead, radius = np.hypot(*motion.position[600:].T).mean(axis=1)
    assert motion.following.all() and distance.std() < 0.003
    side = -1 if direction == "clockwise" else 1
    if isinstance(
        law, LPsi
    ):  # its point trails on the leader's tangent: √(R² + l²) for the point, and the axle behind it
        assert radius == pytest.approx(
            math.sqrt(lead**2 + (0.15 - law.ahead_m) ** 2 - law.ahead_m**2), abs=0.004
        )
        return
    assert distance.mean() == pytest.approx(0.15, abs=0.002)
    if isinstance(law, (CarrotPI, LeaderFrame)):  # points at its predecessor: cuts in to √(R² - d²)
        assert radius == pytest.approx(math.sqrt(lead**2 - 0.15**2), abs=0.006)
    else:  # keeps its predecessor's circle, and sees it at asin(d / 2R) towards the inside
        assert bearing.mean() * side == pytest.approx(math.asin(0.15 / (2 * lead)), abs=0.02)
        assert radius == pytest.approx(lead, abs=0.003)


def test_the_reconstructed_path_is_the_predecessor_s_path():
    config = replace(PLANAR, followers=1, track=TrackConfig(judder="none", shape="stadium"))
    motion = follow(PathReconstruction(), config, minutes=3)
    away = np.abs(motion.track.deviation(motion.position[600:, 1], nominal=True))
    assert motion.following.all() and away.max() < 0.008  # also where straights become bends
    carrot = follow(CarrotPI(), config, minutes=3)
    assert (
        np.abs(carrot.track.deviation(carrot.position[600:, 1], nominal=True)).max()
        > 2 * away.max()
    )  # cuts in


def test_without_the_integral_the_carrot_trails_by_speed_over_gain():
    config = replace(PLANAR, followers=1, track=TrackConfig(judder="none"))
    motion = follow(CarrotPI(k_distance=2.0, k_integral=0.0), config, minutes=2)
    speed = np.linalg.norm(np.diff(motion.position[600:, 1], axis=0), axis=1).mean() * 10
    assert (motion.errors()[0][600:].mean() - 0.15) * 2.0 == pytest.approx(speed, rel=0.03)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("sensing", SENSING)
def test_a_law_runs_exactly_where_its_needs_are_met(name, sensing):
    base = (
        replace(SETTINGS["infrared"], followers=2, drive="planar")
        if sensing in INFRARED
        else PLANAR
    )
    law = LAWS[name]()
    config = replace(base, sensing=sensing)
    missing = [need for need in law.needs if need not in SENSING[sensing]]
    if not missing:
        assert evaluate(law, config, minutes=0.2, progress=False).summary[
            "simulated_minutes"
        ] == pytest.approx(0.2)
        return
    with pytest.raises(
        ValueError,
        match=f"law '{name}' needs the predecessor's {', '.join(missing)}, which sensing = "
        f"'{sensing}'",
    ):
        evaluate(law, config, minutes=0.2, progress=False)
    less = "(or a law that needs less: carrot, pursuit, path|no law does with less)"
    with pytest.raises(ValueError, match=f"use sensing = 'truth'.*, {less}"):
        Convoy(config, [1], periods=10, policy=law)


def test_laws_that_need_no_more_do_not_notice_the_reduced_mode():
    for law in (CarrotPI(), PathReconstruction()):
        runs = [
            follow(law, replace(PLANAR, sensing=sensing), minutes=0.5)
            for sensing in ("truth", "truth-relative")
        ]
        np.testing.assert_array_equal(runs[0].position, runs[1].position)


def test_learners_and_laws_sense_with_the_same_noise():
    noisy = replace(PLANAR, noise_distance_m=0.002, noise_bearing_rad=0.03)
    clean, sensed = (follow(CarrotPI(), config, minutes=1) for config in (PLANAR, noisy))
    assert np.abs(clean.position - sensed.position).max() > 1e-4
    np.testing.assert_array_equal(
        follow(CarrotPI(), noisy, minutes=1).position, sensed.position
    )  # same seed, same noise
    seen = []
    for policy in (
        CarrotPI(),
        quantised_carrot(noisy),
    ):  # what the follower was told, against where it really was
        law = policy if isinstance(policy, CarrotPI) else None
        convoy = Convoy(noisy, [5], periods=600, policy=law or policy.theta)
        block = convoy.run_block()[0][:600]
        gap = np.hypot(block["x"][:, 0] - block["x"][:, 1], block["y"][:, 0] - block["y"][:, 1])
        told = (
            block["distance_error"][1:, 1] + 0.15
        )  # a finished transition shows the observation that it began with
        seen.append((told - gap[:-1])[block["state"][1:, 1] >= 0])
    assert np.std(seen[0]) == pytest.approx(0.002, rel=0.1)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-6)


def test_noise_of_one_formation_does_not_depend_on_the_batch():
    noisy = replace(PLANAR, noise_distance_m=0.002, noise_bearing_rad=0.03)
    alone = evaluate(CarrotPI(), noisy.with_seed(7), minutes=1, progress=False)
    beside = evaluate_seeds([CarrotPI()] * 3, noisy, [6, 7, 8], minutes=1, progress=False)[1]
    np.testing.assert_array_equal(alone.records["samples"], beside.records["samples"])


def test_a_law_s_run_is_stored_loaded_and_resumed_like_any_other(tmp_path):
    law = LPsi(ahead_m=0.075)
    run = evaluate(law, PLANAR, minutes=0.5, out=tmp_path / "run", progress=False)
    loaded = load_run(tmp_path / "run")
    assert loaded.policy == law and loaded.summary == run.summary
    again = evaluate(law, PLANAR, minutes=0.5, out=tmp_path / "run", resume=True, progress=False)
    assert again.summary == run.summary
    with pytest.raises(ValueError, match="policy_sha256"):
        evaluate(LPsi(), PLANAR, minutes=0.5, out=tmp_path / "run", resume=True, progress=False)


@pytest.mark.parametrize("name", LAWS)
def test_laws_survive_their_arrays(name):
    law = LAWS[name]()
    assert controller_from_arrays(law.arrays()) == law
    assert len({LAWS[other]().sha256() for other in LAWS}) == len(LAWS)
    broken = law.arrays() | {"law": np.array("carrots")}
    with pytest.raises(
        ValueError, match="not a control law of schema 1: 'carrots'; expected one of carrot"
    ):
        controller_from_arrays(broken)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: CarrotPI(k_distance=-1.0),
            "CarrotPI.k_distance = -1.0; expected a number from 0 to 20 1/s",
        ),
        (lambda: CarrotPI(k=1.0), "CarrotPI has no field 'k'"),
        (
            lambda: check_law(LPsi(ahead_m=0.16), PLANAR),
            r"LPsi.ahead_m = 0.16; expected less than the wanted distance d\* = 0.15 m",
        ),
        (
            lambda: Convoy(PLANAR, [1], steps=10, policy=CarrotPI()),
            "a law has no weights and does not learn",
        ),
        (
            lambda: evaluate_seeds([CarrotPI(), LPsi()], PLANAR, [1, 2], minutes=1),
            "or are different laws",
        ),
        (
            lambda: evaluate_seeds(
                [CarrotPI(), quantised_carrot(PLANAR)], PLANAR, [1, 2], minutes=1
            ),
            "or are different laws",
        ),
    ],
)
def test_bad_input_is_refused_with_the_value(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


@pytest.mark.parametrize("setting", ["paper", "paper-robot", "recommended"])
def test_the_quantised_carrot_takes_the_action_nearest_to_the_carrot_s(setting):
    config = SETTINGS[setting]
    policy = quantised_carrot(config)
    policy.check(config)
    left, right = policy.left_steps.astype(float), policy.right_steps.astype(float)
    grids = config.grids()
    for state in range(0, config.grid().n, 7):
        e_d, bearing = config.grid().centre(state)
        places = [
            grid.centre(grid.index(e_d, bearing)) for grid in grids
        ]  # one per tiling: the mean of what they stand for
        v = config.leader_speed_mps + 2.0 * np.mean([place[0] for place in places])
        omega = 4.0 * np.mean([place[1] for place in places])
        wanted = np.array([v - omega * TRACK / 2, v + omega * TRACK / 2]) / STEP_M
        nearest = np.argmin(np.abs(left - wanted[0])), np.argmin(np.abs(right - wanted[1]))
        gap = np.hypot(left[nearest[0]] - wanted[0], right[nearest[1]] - wanted[1])
        chosen = divmod(int(policy.greedy()[0, state]), right.size)
        assert np.hypot(left[chosen[0]] - wanted[0], right[chosen[1]] - wanted[1]) == pytest.approx(
            gap, abs=1e-6
        )


def test_a_restart_voids_what_was_measured_of_the_predecessor():
    config = replace(
        PLANAR, reset="restart", distance_m=(0.14, 0.16), track=TrackConfig(judder="none")
    )
    convoy = Convoy(
        config, [1], periods=3000, policy=LPsi(k_length=0.0)
    )  # its distance is not controlled: it will be lost
    lost = 0
    while not convoy.finished:
        block = convoy.run_block()[0]
        lost += np.count_nonzero(block["event"] & LOSS)
        assert (
            np.abs(convoy.robots["motion"]["speed"]).max() < 0.15
        )  # a jump back to the start would be read as metres per second
    assert lost > 3


def test_l_psi_keeps_a_place_beside_the_leader_itself_or_says_why_not():
    told = FormationConfig(shape="line", frame="heading")
    calm = TrackConfig(shape="eight", radius_m=1.0, judder="none")
    config = ConvoyConfig(
        drive="rolling",
        formation=told,
        track=calm,
        leader_speed_mps=0.05,
        wheel_speed_mps=(0.0, 0.12),
    )
    law = LPsi(leader=True)
    convoy = Convoy(config, [3], periods=3000, policy=law, threads=1)
    motion = Motion.of_steps(convoy.whole(), None, config.robot)
    assert shape_errors(motion, convoy.goals[0])["place_rms_mm"] < 2.0
    for changes, said in (
        ({"formation": FormationConfig(shape="wedge", frame="path")}, "expected frame = 'heading'"),
        ({"formation": FormationConfig()}, "frame = 'predecessor'; .* expected frame = 'heading'"),
        ({"noise_distance_m": 0.001}, "expected sensing = 'truth' without noise or filter"),
        ({"filter": "alpha-beta"}, "expected sensing = 'truth' without noise or filter"),
    ):
        with pytest.raises(ValueError, match=said):
            law.check(replace(config, **changes))
