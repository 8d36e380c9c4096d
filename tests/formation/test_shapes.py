"""Shapes: where places are, who takes which, and that followers keep and change them."""

import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.formation.assignment import assign, auction, squared_distances
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.shapes import SHAPES, FormationConfig, places
from workbench.measures.motion import Motion
from workbench.measures.shapes import places_in_world, procrustes, reform_s, shape_errors

EIGHT = wb.TrackConfig(shape="eight", radius_m=1.0, judder="none")
BASE = wb.ConvoyConfig(
    drive="rolling", track=EIGHT, leader_speed_mps=0.05, wheel_speed_mps=(0.0, 0.12)
)


def _shaped(shape, frame="heading", **changes):
    return replace(BASE, formation=FormationConfig(shape=shape, frame=frame), **changes)


def _driven(policy, config, minutes):
    """Return the motion of a formation, the places that followers have taken, and the convoy."""
    law = policy if not hasattr(policy, "theta") else policy.theta
    convoy = Convoy(config, [config.seed], periods=round(600 * minutes), policy=law, threads=1)
    steps = convoy.whole()
    motion = Motion.of_steps(steps, convoy.world.tracks[0], config.robot)
    return motion, convoy.goals[0], convoy, steps


@pytest.mark.parametrize("shape", ["column", "line", "wedge", "diamond", "circle"])
@pytest.mark.parametrize("followers", [1, 2, 4, 7, 16])
def test_places_of_every_shape_have_room_and_none_is_ahead(shape, followers):
    found = places(shape, followers, 0.15)
    everybody = np.vstack([[0, 0], found])
    apart = np.linalg.norm(everybody[:, None] - everybody[None], axis=-1)
    assert apart[~np.eye(len(apart), dtype=bool)].min() >= 0.15 - 1e-9
    assert found[:, 0].max() <= 1e-9


def test_the_shapes_are_those_of_their_names():
    assert places("line", 4, 1.0).tolist() == [[0, 1], [0, -1], [0, 2], [0, -2]]
    assert places("column", 2, 0.5).tolist() == [[-0.5, 0], [-1, 0]]
    assert sorted(places("diamond", 4, 1.0).tolist()) == [[-2, 0], [-1, -1], [-1, 0], [-1, 1]]
    ring = np.vstack([[0, 0], places("circle", 5, 0.15)])
    centre = ring.mean(axis=0)
    radii = np.linalg.norm(ring - centre, axis=1)
    assert radii == pytest.approx(np.full(6, radii[0]))
    assert places("points", 1, 9.0, [(-1, 2)]).tolist() == [[-1, 2]]
    with pytest.raises(ValueError, match=r"points have shape \(1, 2\); expected \(2, 2\)"):
        places("points", 2, 9.0, [(-1, 2)])


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("robots", [4, 8, 16])
def test_an_auction_is_within_a_hundredth_of_the_optimum_also_with_lost_messages(robots, loss):
    chance = np.random.default_rng(robots)
    for _ in range(20):
        here, there = chance.uniform(-0.5, 0.5, (2, robots, 2))
        found = auction(here, there, loss=loss, chance=chance)
        assert sorted(found.place) == list(range(robots))
        best = assign("squared", here, there)
        least = squared_distances(here, there)[np.arange(robots), best].sum()
        assert least - 1e-12 <= found.cost_m2 <= 1.01 * least


def test_assignments_of_what_does_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"robots have shape \(1, 2\), goals \(2, 2\)"):
        assign("squared", [(0, 0)], [(0, 0), (1, 1)])
    with pytest.raises(ValueError, match="assignment = 'best'; expected one of squared, names"):
        assign("best", [(0, 0)], [(0, 0)])
    assert assign("names", [(0, 0), (5, 5)], [(5, 5), (0, 0)]).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("shape", "frame"),
    [
        ("column", "heading"),
        ("line", "heading"),
        ("wedge", "heading"),
        ("diamond", "heading"),
        ("circle", "heading"),
        ("column", "path"),
        ("wedge", "path"),
        ("diamond", "path"),
    ],
)
def test_a_law_drives_every_shape_on_a_figure_eight(shape, frame):
    config = _shaped(shape, frame)
    motion, offsets, _, steps = _driven(wb.LAWS["carrot"](), config, 5)
    found = shape_errors(motion, offsets, frame=frame)
    assert found["place_rms_mm"] < 4 and found["share_in_place"] == 1
    assert found["contacts"] == 0 and found["out_of_formation"] == 0
    assert not np.any(steps["event"] & 1)
    assert 0 <= found["reform_s"] < 60


@pytest.mark.parametrize("shape", ["line", "wedge", "diamond"])
def test_what_was_learned_in_the_paper_s_worm_drives_shapes(shape):
    worm = replace(
        wb.SETTINGS["recommended"],
        drive="rolling",
        followers=1,
        track=EIGHT,
        leader_speed_mps=0.05,
        wheel_speed_mps=(0.0, 0.12),
    )
    policy = wb.learn(worm, steps=100_000, progress=False).policy
    told = FormationConfig(shape=shape, frame="heading")
    config = replace(worm, followers=4, seed=7, formation=told)
    motion, offsets, _, steps = _driven(policy, config, 5)
    found = shape_errors(motion, offsets)
    assert found["place_rms_mm"] < 7 and found["contacts"] == 0
    assert not np.any(steps["event"] & 1)


def test_a_leader_that_judders_throws_far_places_about_unless_they_are_along_its_path():
    rough = replace(EIGHT, judder="spectrum")
    errors = {}
    for frame in ("heading", "path"):
        config = _shaped("wedge", frame, track=rough)
        motion, offsets, _, _ = _driven(wb.LAWS["carrot"](), config, 5)
        errors[frame] = shape_errors(motion, offsets, frame=frame)["place_rms_mm"]
    assert errors["path"] < 6 and errors["heading"] > 4 * errors["path"]


def test_the_loop_s_virtual_leaders_are_where_the_equations_have_them():
    """d* ahead of the place, in the direction in which it moves: from the leader's motion alone."""
    for frame in ("heading", "path"):
        config = _shaped("wedge", frame)
        motion, offsets, convoy, _ = _driven(wb.LAWS["carrot"](), config, 3)
        place = convoy.robots["place"][0, 1:]
        there = places_in_world(motion, offsets, frame=frame)
        direction = np.stack([place["ahead_cos"], place["ahead_sin"]], axis=-1)
        assert convoy.places[0] == pytest.approx(there[-1], abs=2e-3)
        moved = there[-1] - there[-11]
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        assert np.sum(moved * direction, axis=1) == pytest.approx(np.ones(4), abs=5e-3)


def test_followers_of_the_robot_in_front_are_the_default_and_keep_no_places():
    config = replace(BASE, followers=3)
    convoy = Convoy(config, [1], periods=10, policy=wb.LAWS["carrot"]())
    assert convoy.robots["ahead"][0].tolist() == [-1, 0, 1, 2]
    assert Convoy(_shaped("wedge"), [1], periods=1, policy=wb.LAWS["carrot"]()).robots["ahead"][
        0
    ].tolist() == [-1, 0, 0, 0, 0]
    with pytest.raises(ValueError, match="followers of the robot in front keep no places"):
        convoy.instruct("column")


@pytest.mark.parametrize("followers", [4, 8])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_change_of_shape_while_driving_touches_nobody(followers, seed):
    config = _shaped("column", followers=followers, seed=seed)
    convoy = Convoy(config, [seed], periods=10**6, policy=wb.LAWS["carrot"](), threads=1)
    seen = []
    for shape in ("wedge", "line", "column"):
        convoy.instruct(shape)
        block = convoy.run_block()[0].copy()
        seen.append(block)
        motion = Motion.of_steps(block, None, config.robot)
        assert motion.gaps_m().min() > 0
        place = convoy.robots["place"][0, 1:]
        goals = np.stack([place["goal_x"], place["goal_y"]], axis=-1)
        wanted = places(shape, followers, config.middle_m)
        assert np.allclose(sorted(goals.tolist()), sorted(wanted.tolist()))
        assert np.hypot(place["x"] - place["goal_x"], place["y"] - place["goal_y"]).max() < 1e-3


def test_state_between_blocks_is_everything_with_a_shape_too():
    config = _shaped("wedge", "path")
    law = wb.LAWS["carrot"]()
    one, other = (Convoy(config, [1], periods=10**6, policy=law, threads=1) for _ in range(2))
    one.run_block()
    other.load(one.state())
    assert one.run_block().tobytes() == other.run_block().tobytes()


def test_random_places_are_learned_at():
    told = FormationConfig(shape="random", frame="heading", hold_s=5.0)
    config = replace(BASE, formation=told, weights="shared")
    convoy = Convoy(config, [1], steps=10**6, threads=1)
    goals = set()
    for _ in range(3):
        convoy.run_block()
        place = convoy.robots["place"][0, 1:]
        goals |= set(zip(place["goal_x"].tolist(), place["goal_y"].tolist(), strict=True))
        assert np.all(place["goal_x"] <= 0) and np.all(np.abs(place["goal_y"]) <= 0.3)
    assert len(goals) == 12


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"formation": FormationConfig(shape="line", frame="heading", spacing_m=0.05)}, "touch at"),
        (
            {"formation": FormationConfig(shape="line", frame="heading", spacing_m=0.1)},
            "clearance_m = 0.12 with places 0.1 m apart; they would part for ever",
        ),
        (
            {"formation": FormationConfig(shape="random", frame="heading", clearance_m=0.05)},
            "clearance_m = 0.05 with random places; robots touch at 0.07 m",
        ),
        (
            {
                "formation": FormationConfig(shape="points", points=((-11.0, 0.0),)),
                "followers": 1,
            },
            "a place 11 m back along a path that is remembered for 9.5 m",
        ),
        (
            {
                "formation": FormationConfig(shape="points", frame="heading", points=((-3, 0),)),
                "followers": 1,
            },
            "a place 0.0265 m aside, 3 m back drives 0.159 m/s",
        ),
        (
            {
                "formation": FormationConfig(
                    shape="points", frame="path", points=((0.2, 0), (-1, 0), (-2, 0), (-3, 0))
                )
            },
            "ahead of the leader with frame = 'path'",
        ),
        (
            {"formation": FormationConfig(shape="line", frame="heading"), "leader_speed_mps": 0.1},
            r"the outer wheel of a place 0.327 m aside, .* drives 0.133 m/s in curves of 1 m",
        ),
        (
            {"formation": FormationConfig(frame="heading"), "sensing": "camera"},
            "whom nobody sees past others",
        ),
        (
            {"formation": FormationConfig(shape="points", frame="heading", points=((-1, 0),))},
            r"points have shape \(1, 2\); expected \(4, 2\)",
        ),
    ],
)
def test_shapes_that_no_robot_can_keep_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(BASE, **changes)


def test_what_does_not_go_together_is_refused():
    with pytest.raises(ValueError, match="behind the robot in front there is a column only"):
        FormationConfig(shape="wedge", frame="predecessor")
    with pytest.raises(ValueError, match="expected points with shape = 'points', and only there"):
        FormationConfig(frame="heading", points=((0, 1),))
    with pytest.raises(ValueError, match="points = .*; expected pairs of numbers"):
        FormationConfig(frame="heading", shape="points", points=((0, 1, 2),))
    with pytest.raises(ValueError, match="'weedge'.*did you mean 'wedge'"):
        FormationConfig(frame="heading", shape="weedge")
    for shape, frame in (("column", "predecessor"), ("line", "heading"), ("wedge", "path")):
        assert FormationConfig(shape=shape).relative_to == frame
    beside = FormationConfig(shape="points", points=((0.0, 0.2),))
    assert beside.relative_to == "heading"
    assert set(SHAPES) >= {"column", "line", "wedge", "diamond", "circle", "points"}


def test_procrustes_does_not_see_shift_and_rotation():
    shape = places("wedge", 4, 0.15)
    c, s = math.cos(0.7), math.sin(0.7)
    turned = shape @ np.array([[c, s], [-s, c]]) + [3.0, -1.0]
    assert procrustes(turned[None], shape) == pytest.approx(0, abs=1e-9)
    assert procrustes(1.1 * shape[None], shape)[0] == pytest.approx(
        0.1 * np.sqrt(np.mean(np.sum((shape - shape.mean(axis=0)) ** 2, axis=1)))
    )


def test_a_formation_that_never_arrives_has_no_time():
    flags = np.ones((30, 2), bool)
    path = np.zeros((30, 2, 2))
    path[:, 1, 0] = -0.3
    path[:10, 1, 0] = -0.5
    motion = Motion(10.0, path, np.zeros((30, 2)), None, flags, ~flags)
    there = places_in_world(motion, [(-0.3, 0.0)])
    assert reform_s(motion, there) == 1.0
    assert math.isnan(reform_s(motion, there + 1.0))
    with pytest.raises(ValueError, match="expected a longer one"):
        shape_errors(motion, [(-0.3, 0.0)])


def test_sixty_four_followers_drive_a_wedge():
    track = replace(EIGHT, radius_m=7.0)
    config = _shaped("wedge", "path", followers=64, track=track)
    summary = wb.evaluate(wb.LAWS["carrot"](), config, minutes=3, progress=False).summary
    assert summary["losses"] == summary["collisions"] == 0


def test_agents_of_others_keep_places_by_the_errors_that_they_observe():
    env = wb.ConvoyEnv(_shaped("wedge"), actions="continuous", seconds=60)
    seen, _ = env.reset(seed=3)
    while env.agents:
        pairs = {
            agent: np.clip([2 * u - 2 * v - 0.15, 2 * u + 2 * v - 0.15], -1, 1)
            for agent, (u, v) in seen.items()
        }
        seen, _, terminated, _, _ = env.step(pairs)
    assert not any(terminated.values())
    place = env.convoy.robots["place"][0, 1:]
    assert np.hypot(place["x"] - place["goal_x"], place["y"] - place["goal_y"]).max() < 1e-3


def test_a_restart_of_the_simulation_begins_in_a_column_and_flows_again():
    config = _shaped("wedge", reset="restart", weights="shared", seed=2)
    convoy = Convoy(config, [2], steps=3000, threads=1)
    steps = convoy.whole()
    lost = np.flatnonzero(np.any(steps["event"][:, 1:] & 1, axis=1))
    assert lost.size
    after = steps[lost[0] + 1]
    gaps = np.hypot(np.diff(after["x"]), np.diff(after["y"]))
    assert gaps == pytest.approx(np.full(4, config.middle_m), abs=0.02)
    # nobody is lost sooner than a robot can turn away by 45°, at two wheels' 120 mm/s
    assert np.diff(lost).min() >= math.radians(45) / (0.12 / config.robot.track_m) / 0.1 - 1


def test_a_convoy_goes_on_from_its_state_also_after_other_instructions():
    told = FormationConfig(shape="random", frame="heading", spacing_m=0.15)
    config = replace(BASE, formation=told)
    law = wb.LAWS["carrot"]()
    one, other = (Convoy(config, [1], periods=10**6, policy=law, threads=1) for _ in range(2))
    one.run_block()
    one.instruct("wedge")
    other.load(one.state())
    assert one.run_block().tobytes() == other.run_block().tobytes()
    fixed = Convoy(_shaped("wedge"), [1], periods=10**6, policy=law, threads=1)
    with pytest.raises(ValueError, match="places are drawn in convoys that are made so"):
        fixed.instruct("random")


def test_a_column_that_begins_in_a_curve_is_not_lost_there():
    circle = wb.TrackConfig(radius_m=1.0, judder="none")
    for reset in ("restart", "manoeuvre"):
        config = _shaped("column", followers=8, track=circle, reset=reset)
        convoy = Convoy(config, [1], periods=2500, policy=wb.LAWS["carrot"](), threads=1)
        assert not np.any(convoy.whole()["event"] & 1)


def test_a_larger_robot_has_a_larger_formation():
    # its leader steers more coarsely, so that its turning rate is averaged for longer
    told = FormationConfig(shape="wedge", frame="heading", smooth_s=3.0)
    config = replace(BASE, formation=told).with_robot(wb.load_robot("large"))
    growth = wb.load_robot("large").body_radius_m / BASE.robot.body_radius_m
    assert config.formation.clearance_m == pytest.approx(0.12 * growth)
    assert config.range_bearing.range_m == pytest.approx(0.8 * growth)
    summary = wb.evaluate(wb.LAWS["carrot"](), config, minutes=8, progress=False).summary
    assert summary["losses"] == summary["collisions"] == 0


def test_a_leader_that_goes_back_and_forth_keeps_its_followers_by_its_path():
    config = _shaped("wedge", "path")
    convoy = Convoy(config, [1], periods=10**6, policy=wb.LAWS["carrot"](), external=0, threads=1)
    before, jumps = None, []
    for t, speed in enumerate([400] * 300 + [-300] * 60 + [400] * 200):
        convoy.period(t)
        convoy.command(0, speed, speed, t)
        convoy.world.step()
        here = convoy.places[0].T.copy()
        if before is not None:
            jumps.append(np.hypot(*(here - before)).max())
        before = here
    assert max(jumps[1:]) < 0.02


def test_contacts_of_info_are_with_anybody():
    env = wb.ConvoyEnv(_shaped("wedge"), seconds=60)
    env.reset(seed=1)
    x, y, heading = env.convoy.world.pose(0, 1)
    env.convoy.world.place(0, 4, x + 0.03, y, heading)
    middle = int(env.config.action_count // 2)
    _, _, _, _, told = env.step(dict.fromkeys(env.agents, middle))
    assert told["follower_1"]["contact"] and told["follower_4"]["contact"]
    assert not told["follower_3"]["contact"]


def test_in_its_own_frame_a_follower_keeps_the_leader_at_a_distance_and_a_bearing():
    point = (-0.15 * math.cos(math.pi / 3), 0.15 * math.sin(math.pi / 3))  # the leader 60° right
    told = FormationConfig(shape="points", frame="follower", points=(point,))
    config = replace(BASE, followers=1, formation=told, sensing="truth-relative")
    motion, goals, _, steps = _driven(wb.LAWS["carrot"](), config, 4)
    distance, bearing = (part[600:, 0] for part in motion.errors())
    assert not np.any(steps["event"] & LOSS)
    assert distance.mean() == pytest.approx(0.15, abs=0.003)
    assert np.degrees(bearing.mean()) == pytest.approx(-60, abs=2)
    # the place of the same name by the leader's heading is another one in a curve
    by_heading = shape_errors(motion, goals)
    assert by_heading["place_rms_mm"] > 5
