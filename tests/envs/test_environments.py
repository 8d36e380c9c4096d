"""Environments for others' learners: the libraries' own checks, and what our own follower would
have seen and earned.
"""

import copy
import math
import pickle
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test

import workbench as wb
from workbench.arena.camera.config import CameraConfig
from workbench.envs.environments import FollowVectorEnv
from workbench.formation.body import BodyConfig
from workbench.robot.description import RobotConfig

PLANAR = wb.ConvoyConfig(drive="planar")
INFRARED = replace(wb.SETTINGS["infrared"], drive="planar")
KINDS = [
    (seen, actions)
    for seen in ("errors", "tiles", "infrared")
    for actions in ("discrete", "continuous")
]


@pytest.mark.parametrize(("observation", "actions"), KINDS)
def test_both_libraries_checkers_pass_without_a_warning(observation, actions):
    config = INFRARED if observation == "infrared" else PLANAR
    kind = {"observation": observation, "actions": actions}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(wb.FollowEnv(config, **kind), skip_render_check=True)
        parallel_api_test(wb.ConvoyEnv(config, **kind), num_cycles=300)
        parallel_seed_test(lambda: wb.ConvoyEnv(config, **kind), num_cycles=300)


@pytest.mark.parametrize("name", ["workbench/Follow-v0", "workbench/FollowWheels-v0"])
def test_registered_ids_make_environments_that_pass_with_their_pictures(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    with warnings.catch_warnings():  # here is no display
        warnings.filterwarnings("ignore", "render_mode = 'human' with matplotlib's backend")
        check_env(env.unwrapped)
    assert env.unwrapped.config.drive == ("planar" if name.endswith("Follow-v0") else "wheels")
    env.reset(seed=1)
    assert env.render().shape == (240, 320, 3)
    vector = gymnasium.make_vec(
        name, num_envs=3, vectorization_mode="vector_entry_point", render_mode="rgb_array"
    )
    seen, _ = vector.reset(seed=1)
    assert [shown.shape for shown in vector.render()] == [(240, 320, 3)] * 3
    assert isinstance(vector.unwrapped, FollowVectorEnv) and seen.shape == (3, 2)


def test_equal_seeds_and_actions_give_equal_episodes_and_other_seeds_others():
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 49, (300, 4))

    def play(seed):
        env = FollowVectorEnv(4)
        seen = [env.reset(seed=seed)[0]]
        earned = []
        for row in actions:
            observation, reward, *_ = env.step(row)
            seen.append(observation)
            earned.append(reward)
        return np.array(seen), np.array(earned)

    first = play(1)
    again = play(1)
    other = play(2)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert np.mean(first[0] == other[0]) < 0.1


def test_a_formation_does_the_same_alone_as_through_the_single_environment():
    env = wb.FollowEnv(PLANAR, observation="tiles")
    vector = FollowVectorEnv(1, PLANAR, observation="tiles")
    state = env.reset(seed=5)[0]
    (states, _) = vector.reset(seed=5)
    assert state == states[0]
    for action in (0, 24, 48, 24, 24, 6, 42, 24):
        state, reward, *_ = env.step(action)
        states, rewards, *_ = vector.step(np.array([action]))
        assert (state, reward) == (states[0], rewards[0])


def test_reward_state_and_end_are_those_of_the_errors_that_are_seen():
    env = wb.FollowEnv(PLANAR)
    (u, v), _ = env.reset(seed=2)
    done = False
    steps = 0
    while not done:
        (u, v), reward, done, truncated, _ = env.step(0)  # slowest: the leader drives away
        steps += 1
        assert not truncated
        if not done:
            assert reward == pytest.approx(-(float(u) ** 2 + float(v) ** 2), abs=1e-5)
    assert u >= 1.0 and reward == -10.0 and steps < 60
    (u, v), _ = env.reset()
    assert abs(u) <= 1 / 3 + 1e-6 and abs(v) <= 1 / 3 + 1e-6


def test_in_a_vector_the_lost_begin_anew_at_the_next_step_and_the_others_go_on():
    env = FollowVectorEnv(2, PLANAR)
    env.reset(seed=1)
    carrot = 24
    ended = np.zeros(2, bool)
    for _ in range(60):
        seen, reward, ended, cut, _ = env.step(np.array([0, carrot]))
        if ended[0]:
            break
    assert ended[0] and not ended[1] and not cut.any() and reward[0] == -10.0
    clock = env.convoy.world.batch.bind("time").copy()
    seen, reward, ended, _, _ = env.step(np.array([48, carrot]))
    assert reward[0] == 0.0 and not ended[0] and abs(seen[0, 0]) <= 1 / 3 + 1e-6
    np.testing.assert_allclose(env.convoy.world.batch.bind("time") - clock, [0.0, 0.1], atol=1e-9)


def test_an_episode_is_cut_after_its_time_and_is_no_terminal():
    env = wb.FollowEnv(PLANAR, seconds=1.0)
    env.reset(seed=1)
    ends = [env.step(24)[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]


def test_who_loses_the_leader_is_terminated_and_the_line_behind_and_before_is_truncated():
    env = wb.ConvoyEnv(PLANAR, actions="continuous")
    seen, _ = env.reset(seed=1)
    while env.agents:
        agents = list(env.agents)
        actions = {agent: np.clip([2 * u - v, 2 * u + v], -1, 1) for agent, (u, v) in seen.items()}
        actions["follower_2"] = np.array([-1.0, -1.0])
        seen, rewards, terminated, truncated, _ = env.step(actions)
    assert terminated["follower_2"] and rewards["follower_2"] == -10.0
    assert all(terminated[agent] != truncated[agent] for agent in agents)
    with pytest.raises(ValueError, match=r"expected one for each of \[\] \(none: reset first\)"):
        env.step({"follower_1": np.zeros(2)})


def test_continuous_speeds_reach_the_ends_of_the_levels():
    slow, fast = (wb.FollowEnv(PLANAR, actions="continuous") for _ in range(2))
    for env, end in ((slow, -1.0), (fast, 1.0)):
        env.reset(seed=1)
        env.step(np.array([end, end], np.float32))
    levels = PLANAR.levels()[0]
    assert slow.convoy.robots["law"]["left"][0, 1] == levels[0]
    assert fast.convoy.robots["law"]["right"][0, 1] == levels[-1]


def test_a_reward_of_ones_own_is_what_is_earned():
    env = wb.FollowEnv(PLANAR, reward=lambda u, v: -abs(u) - 3.0)
    env.reset(seed=1)
    (u, _), reward, *_ = env.step(24)
    assert reward == pytest.approx(-abs(float(u)) - 3.0, abs=1e-5)
    assert env.config.reward == "own"


def _camera(**options):
    return replace(PLANAR, sensing="camera", camera=CameraConfig(**options))


@pytest.mark.parametrize(
    "config",
    [_camera(every=3), _camera(dropout=0.3), replace(PLANAR, noise_distance_m=0.03), INFRARED],
    ids=["every third picture", "a third hidden", "noise", "infrared"],
)
def test_every_episode_begins_with_the_leader_in_sight(config):
    env = wb.FollowEnv(config)
    vector = FollowVectorEnv(4, config)
    env.reset(seed=1)
    for _ in range(60):
        (u, v), _ = env.reset()
        assert abs(u) < 1 and abs(v) < 1
        assert env.step(24)[1] != 0.0
    vector.reset(seed=1)
    ended = np.zeros(4, bool)
    begun = 0
    for _ in range(150):
        seen, _, lost, cut, _ = vector.step(np.where(np.arange(4) % 2, 24, 0))
        assert np.all(np.abs(seen[ended]) < 1) and not np.any((lost | cut)[ended])
        begun = begun + int(ended.sum())
        ended = lost | cut
    assert begun > 4


def test_an_ignored_action_leaves_no_trace_even_where_commands_come_late():
    after = []
    for ignored in (0, 48):
        env = FollowVectorEnv(1, replace(PLANAR, body=BodyConfig(delay=2)))
        env.reset(seed=1)
        while not env.step(np.array([0]))[2][0]:
            pass
        env.step(np.array([ignored]))
        after.append([env.step(np.array([24]))[0] for _ in range(4)])
    np.testing.assert_array_equal(*after)


def test_noise_is_drawn_anew_at_a_reset():
    env = wb.FollowEnv(replace(PLANAR, noise_distance_m=0.005))
    env.reset(seed=1)

    def error(seen):
        (x, y), (ahead_x, ahead_y) = (env.convoy.world.pose(0, robot)[:2] for robot in (1, 0))
        return (
            float(seen[0]) * PLANAR.half_range_m
            + PLANAR.middle_m
            - np.hypot(ahead_x - x, ahead_y - y)
        )

    pairs = []
    for _ in range(60):
        last = error(env.step(24)[0])
        pairs.append((last, error(env.reset()[0])))
    assert abs(np.corrcoef(np.array(pairs).T)[0, 1]) < 0.4


def test_physics_that_became_unstable_stops_the_environment():
    wild = wb.ConvoyConfig().with_robot(
        RobotConfig(mass_kg=500.0, inertia_kg_m2=(1e-7, 1e-7, 1e-7))
    )
    env = FollowVectorEnv(2, wild)
    env.reset(seed=1)
    with pytest.raises(RuntimeError, match="the physics became unstable"):
        for _ in range(100):
            env.step(np.array([24, 24]))


@pytest.mark.parametrize(
    ("actions", "kind", "message"),
    [
        (-1, "discrete", r"actions = \[\[-1\]\]; expected whole numbers from 0 to 48"),
        (49, "discrete", "expected whole numbers from 0 to 48"),
        (2.5, "discrete", "expected whole numbers from 0 to 48"),
        (np.array([np.nan, 0.0]), "continuous", "expected finite numbers from -1 to 1"),
        (np.array([0.0]), "continuous", r"actions have shape \(1, 1, 1\); expected \(1, 1, 2\)"),
    ],
)
def test_actions_that_are_none_are_refused(actions, kind, message):
    env = wb.FollowEnv(PLANAR, actions=kind)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=message):
        env.step(actions)
    with pytest.raises(ValueError, match=r"actions have shape \(2, 1\); expected \(4, 1\)"):
        vector = FollowVectorEnv(4)
        vector.reset(seed=1)
        vector.step(np.array([24, 24]))


def test_what_has_not_begun_or_is_over_says_so():
    env = wb.FollowEnv(PLANAR, seconds=0.1)
    for call in (lambda: env.step(24), lambda: env.convoy):
        with pytest.raises(RuntimeError, match="call reset\\(\\) first"):
            call()
    env.reset(seed=1)
    assert env.step(24)[3]
    with pytest.raises(RuntimeError, match="the episode is over; call reset"):
        env.step(24)
    with pytest.raises(TypeError, match="config is a dict; expected a ConvoyConfig"):
        wb.FollowEnv({})
    with pytest.raises(ValueError, match="expected one whole number"):
        FollowVectorEnv(2).reset(seed=[1, 2, 3])


def test_a_reward_that_fails_says_where_at_once_and_is_forgotten_at_a_reset():
    def sudden(u, v):
        return (
            math.nan if u > 0.3 and 0.1 < (u * 50.0) % 1.0 < 0.9 else -u * u
        )  # between the points of the grid

    env = wb.FollowEnv(PLANAR, reward=sudden)
    env.reset(seed=2)
    with pytest.raises(ValueError, match="reward 'sudden' is not finite at u = 0.[3-9]"):
        for _ in range(60):
            env.step(0)
    assert env.convoy.robots["failure"]["any"].any()
    env.reset()
    assert not env.convoy.robots["failure"]["any"].any()


def test_a_restart_of_the_simulation_is_not_for_environments():
    env = wb.FollowEnv(replace(PLANAR, reset="restart"))
    assert env.config.reset == "manoeuvre"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"observation": "pixels"},
            "observation = 'pixels'; expected one of 'errors', 'tiles', 'infrared'",
        ),
        ({"actions": "torque"}, "actions = 'torque'; expected one of 'discrete', 'continuous'"),
        (
            {"observation": "infrared"},
            "with sensing = 'truth'; expected sensing = 'ir-metric' or 'ir-raw'",
        ),
        ({"seconds": 0.0}, "seconds = 0.0; expected at least 1, and more than 0"),
        ({"render_mode": "ansi"}, "render_mode = 'ansi'; expected None, 'rgb_array' or 'human'"),
    ],
)
def test_refusals_name_what_was_given_and_what_is_expected(options, message):
    for config, said in (
        (replace(PLANAR, reward="own"), "expected reward=, the function of the run"),
        (replace(PLANAR, compute_time_s=0.04), "does not know how long its learner computes"),
    ):
        with pytest.raises(ValueError, match=said):
            wb.FollowEnv(config)
    with pytest.raises(ValueError, match=message):
        wb.FollowEnv(PLANAR, **options)


def test_options_of_a_reset_that_nothing_would_follow_are_refused():
    for env in (wb.FollowEnv(), FollowVectorEnv(2), wb.ConvoyEnv()):
        with pytest.raises(ValueError, match="options = {'speed': 1}; expected none"):
            env.reset(seed=1, options={"speed": 1})


def test_info_says_what_is_so_whatever_the_senses_say():
    noisy = replace(PLANAR, noise_distance_m=0.01)
    env = wb.FollowEnv(noisy)
    _, told = env.reset(seed=2)
    assert set(told) == {"distance_m", "bearing_rad", "lost", "contact"}
    for _ in range(50):
        seen, _, over, _, told = env.step(24)
        world = env.convoy.world
        (x, y, _), (a, b, heading) = world.pose(0, 0), world.pose(0, 1)
        assert told["distance_m"] == pytest.approx(math.hypot(x - a, y - b), abs=1e-6)
        bearing = math.atan2(y - b, x - a) - heading
        assert math.cos(told["bearing_rad"] - bearing) == pytest.approx(1, abs=1e-9)
        assert told["lost"] is over and told["contact"] is False
        if over:
            break
    away = seen[0] * noisy.half_range_m + noisy.middle_m - told["distance_m"]
    assert 1e-5 < abs(away) < 0.06  # what is seen is not what is so

    vector = FollowVectorEnv(3, PLANAR)
    _, told = vector.reset(seed=2)
    assert told["distance_m"].shape == (3,) and told["_distance_m"].all()
    agents = wb.ConvoyEnv(PLANAR)
    _, told = agents.reset(seed=2)
    assert set(told) == set(agents.agents) and told["follower_4"]["distance_m"] > 0.08


def _drive(env, actions):
    return [env.step(action) for action in actions]


@pytest.mark.parametrize("how", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("drive", ["planar", "rolling", "wheels"])
def test_a_copy_goes_on_as_the_original_would(how, drive):
    config = replace(PLANAR, drive=drive, noise_distance_m=0.002, body=BodyConfig(slip=0.02))
    env = FollowVectorEnv(2, config)
    env.reset(seed=5)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 49, (60, 2))
    _drive(env, actions[:30])
    other = how(env)
    for own, copied in zip(_drive(env, actions[30:]), _drive(other, actions[30:]), strict=True):
        np.testing.assert_array_equal(own[0], copied[0])
        np.testing.assert_array_equal(own[1], copied[1])
    again = how(FollowVectorEnv(2, config))  # one that has not begun
    np.testing.assert_array_equal(again.reset(seed=5)[0], env.reset(seed=5)[0])


def test_some_formations_begin_anew_and_the_others_go_on():
    env = FollowVectorEnv(3, PLANAR)
    env.reset(seed=1)
    before, *_ = _drive(env, [np.full(3, 24)] * 20)[-1]
    seen, _ = env.reset(options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(seen[[0, 2]], before[[0, 2]])
    assert not np.array_equal(seen[1], before[1]) and env._core.age.tolist() == [20, 0, 20]
    for mask in ([True], np.array([1, 0, 1])):
        with pytest.raises(ValueError, match=r"reset_mask.*expected \(3,\) of True or False"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="a seed makes all formations anew"):
        env.reset(seed=1, options={"reset_mask": np.array([True] * 3)})


def test_every_formation_may_have_a_seed_of_its_own():
    env = FollowVectorEnv(2, PLANAR)
    together, _ = env.reset(seed=[7, 3])
    tracks = [track.line.copy() for track in env.convoy.world.tracks]
    env.reset(seed=[3, 7])
    np.testing.assert_array_equal(env.convoy.world.tracks[1].line, tracks[0])
    again, _ = env.reset(seed=np.array([7, 3]))
    np.testing.assert_array_equal(again, together)
    for wrong in ([1], ["a", "b"], 1.5):
        with pytest.raises(ValueError, match="expected one whole number .* or 2 of them"):
            env.reset(seed=wrong)


def test_a_person_is_shown_what_happens():
    matplotlib = pytest.importorskip("matplotlib")
    assert matplotlib.get_backend().lower() == "agg"
    env = wb.FollowEnv(PLANAR, render_mode="human")
    with pytest.warns(UserWarning, match="'agg', which has no window: run it in a notebook"):
        env.reset(seed=1)
    first = env._window._image.get_array().copy()
    _drive(env, [24] * 20)
    assert env.render() is None
    assert not np.array_equal(env._window._image.get_array(), first)
    env.close()
    assert env._window._image is None


def test_options_are_in_the_help_of_every_environment():
    for kind in (wb.FollowEnv, FollowVectorEnv, wb.ConvoyEnv):
        for option in ("observation:", "actions:", "reward:", "seconds:", "render_mode:"):
            assert option in kind.__doc__


def test_info_is_of_now_also_where_a_formation_begins_anew_or_rests():
    env = FollowVectorEnv(6, seconds=2.0)
    env.reset(seed=1)
    env.action_space.seed(3)

    def check(info):
        for b in range(6):
            (x, y, _), (u, v, heading) = (env.convoy.world.pose(b, robot) for robot in (0, 1))
            assert info["distance_m"][b] == pytest.approx(math.hypot(x - u, y - v))
            towards = math.atan2(y - v, x - u)
            apart = (info["bearing_rad"][b] - towards + heading + math.pi) % (2 * math.pi)
            assert apart == pytest.approx(math.pi, abs=1e-6)
        assert not info["contact"].any()

    for _ in range(60):
        *_, terminated, _, info = env.step(env.action_space.sample())
        check(info)
        assert info["lost"].tolist() == terminated.tolist()
    _, info = env.reset(options={"reset_mask": np.array([True] + 5 * [False])})
    check(info)


def test_errors_that_are_observed_are_those_of_the_tile_and_the_reward():
    config = replace(
        wb.ConvoyConfig(drive="rolling", followers=1), noise_distance_m=0.02, filter="alpha-beta"
    )
    env = wb.FollowEnv(config)
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(200):
        (u, v), reward, lost, cut, _ = env.step(env.action_space.sample())
        if lost or cut:
            env.reset()
            continue
        assert reward == pytest.approx(-(float(u) ** 2) - float(v) ** 2, abs=1e-5)
        e_d, bearing = float(u) * config.half_range_m, float(v) * config.bearing_limit_rad
        assert config.grid().index(e_d, bearing) == env.convoy.robots["choice"]["state"][0, 1]


def test_a_leader_that_has_stopped_is_no_environment():
    rough = replace(wb.ConvoyConfig().track, judder_rms_m=0.05)
    env = wb.FollowEnv(wb.ConvoyConfig(drive="planar", followers=1, track=rough), seconds=1000.0)
    env.reset(seed=1)
    with pytest.raises(RuntimeError, match="the leader has lost its line and stopped"):
        for _ in range(2000):
            *_, lost, _, _ = env.step(24)
            if lost:
                env.reset()


def test_the_line_behind_a_leader_runs_as_its_loop_does_so_that_a_camera_sees_everybody():
    env = wb.ConvoyEnv(replace(PLANAR, sensing="camera"))
    for seed in (5, 12, 15, np.int64(22)):  # straight behind, the last stood beside the picture
        env.reset(seed=seed)
        track = env.convoy.world.tracks[0]
        last = env.convoy.world.pose(0, 4)
        assert abs(float(track.deviation([last[:2]])[0])) < 0.25


@pytest.mark.parametrize("seed", [-1, [-1], 1.5, [1, 2]])
def test_seeds_that_are_none_are_refused(seed):
    with pytest.raises(ValueError, match="expected one whole number from 0 on"):
        wb.ConvoyEnv().reset(seed=seed)
