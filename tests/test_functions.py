"""Functions of the user's own in the compiled loop: the same as built in, at the same place, and
refused where they cannot be.
"""

import math
import types

import numba
import numpy as np
import pytest

import workbench as wb
from workbench.formation.own_reward import own_reward
from workbench.lab.runs import learn_seeds

CONFIG = wb.ConvoyConfig(drive="planar", seed=3)
SCALE = 2.0


def _quadratic(u, v):
    return -(u * u + v * v)


def _carrot(distance, bearing):
    return 2.0 * (distance - 0.15), 4.0 * bearing


def test_the_default_reward_written_as_a_function_learns_the_same_weights():
    built_in, own = (
        wb.learn(CONFIG, steps=4000, reward=reward, progress=False) for reward in (None, _quadratic)
    )
    np.testing.assert_array_equal(built_in.policy.theta, own.policy.theta)
    assert (
        own.config.reward == "own" and built_in.summary["mean_reward"] == own.summary["mean_reward"]
    )


def test_a_law_written_as_a_function_drives_as_the_built_in_one():
    carrot = wb.follow(wb.LAWS["carrot"](k_integral=0.0), CONFIG, minutes=1)
    own = wb.follow(wb.OwnLaw(function=_carrot), CONFIG, minutes=1)
    np.testing.assert_array_equal(carrot.position, own.position)


def test_other_rewards_and_laws_do_something_else():
    own = wb.learn(CONFIG, steps=4000, reward=lambda u, v: -(u * u + 9 * v * v), progress=False)
    default = wb.learn(CONFIG, steps=4000, progress=False)
    assert not np.array_equal(own.policy.theta, default.policy.theta)


def test_a_greedy_evaluation_needs_no_reward_and_says_that_it_knows_none():
    run = wb.learn(CONFIG, steps=4000, reward=_quadratic, progress=False)
    judged = wb.evaluate(run.policy, run.config, minutes=5, progress=False)
    assert judged.summary["mean_reward"] is None and judged.summary["rms_distance_error_mm"] > 0


def test_a_run_is_continued_only_with_the_same_reward(tmp_path):
    wb.learn(CONFIG, steps=3000, reward=_quadratic, out=tmp_path / "run", progress=False)
    (tmp_path / "run" / "summary.json").unlink()
    with pytest.raises(ValueError, match="was started with reward_sha256"):
        wb.learn(
            CONFIG,
            steps=3000,
            reward=lambda u, v: -abs(u),
            out=tmp_path / "run",
            resume=True,
            progress=False,
        )
    again = wb.learn(
        CONFIG, steps=3000, reward=_quadratic, out=tmp_path / "run", resume=True, progress=False
    )
    assert wb.load_run(tmp_path / "run").summary == again.summary


def test_the_hash_is_of_what_a_function_returns(monkeypatch):
    def scaled(u, v):
        return -SCALE * abs(u)

    first = own_reward(scaled).sha256
    assert first == own_reward(lambda u, v: -2.0 * abs(u)).sha256  # written otherwise, the same
    monkeypatch.setitem(globals(), "SCALE", 3.0)
    assert own_reward(scaled).sha256 != first
    chase = wb.OwnLaw(function=_carrot)
    assert chase.sha256() != wb.OwnLaw(function=lambda d, b: (0.05, 4.0 * b)).sha256()


def test_a_number_that_was_changed_outside_is_used_at_the_next_call(monkeypatch):
    def scaled(u, v):
        return -SCALE * abs(u)

    assert own_reward(scaled).worst == -2.0
    monkeypatch.setitem(globals(), "SCALE", 100.0)
    assert own_reward(scaled).worst == -100.0


def test_helpers_and_modules_are_taken_in_too(monkeypatch):
    module = types.ModuleType("mine")
    module.weight = 1.0

    @numba.njit
    def helper(x):
        return SCALE * x

    def by_helper(u, v):
        return -helper(abs(u))

    assert own_reward(by_helper).worst == -2.0
    monkeypatch.setitem(globals(), "SCALE", 5.0)
    assert own_reward(by_helper).worst == -5.0
    before = own_reward(lambda u, v: module.weight * u).sha256
    module.weight = 2.0
    assert own_reward(lambda u, v: module.weight * u).sha256 != before

    def made(factor):
        return numba.njit(lambda x: factor * x)

    def pair(f, g):
        return lambda u, v: -f(abs(u)) - g(abs(v))

    assert own_reward(pair(made(1.0), made(2.0))).worst == -3.0
    assert own_reward(pair(made(1.0), made(3.0))).worst == -4.0


def test_a_function_may_have_defaults_and_be_compiled_already():
    rewards = [own_reward(lambda u, v, k=k: -k * abs(u)).worst for k in (1.0, 3.0)]
    assert rewards == [-1.0, -3.0] and own_reward(numba.njit(_quadratic)).worst == -2.0


def test_a_failure_between_the_points_that_were_looked_at_stops_the_run_and_says_where():
    def sudden(u, v):
        if 0.0 < abs(u) < 0.005:
            raise ValueError("sudden")
        return -u * u

    def blind(distance, bearing):
        return 0.06, math.nan if 0.0 < abs(bearing) < 0.01 else 4.0 * bearing

    with pytest.raises(
        ValueError,
        match="reward 'sudden' is not finite at u = [-0-9.e]+, v = .*; expected a finite number",
    ):
        wb.learn(CONFIG, steps=20_000, reward=sudden, progress=False)
    with pytest.raises(
        ValueError, match="law 'blind' is not finite at distance = [0-9.]+ m, bearing = "
    ):
        wb.follow(wb.OwnLaw(function=blind), CONFIG, minutes=5)


def test_a_run_in_memory_can_be_saved_and_continued_with_its_reward(tmp_path):
    run = wb.learn(CONFIG, steps=2000, reward=_quadratic, progress=False)
    run.save(tmp_path / "run")
    again = wb.learn(
        CONFIG, steps=2000, reward=_quadratic, out=tmp_path / "run", resume=True, progress=False
    )
    assert again.summary == run.summary and again.reward_sha256 == run.reward_sha256
    seeds = learn_seeds(CONFIG, [3, 4], steps=2000, reward=_quadratic, progress=False)
    np.testing.assert_array_equal(seeds[0].policy.theta, run.policy.theta)


def test_worst_is_the_smallest_value_within_the_bounds():
    assert own_reward(_quadratic).worst == -2.0
    assert own_reward(lambda u, v: 1.0 + u).worst == 0.0


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        (
            lambda u, v: math.log(u),
            ValueError,
            "reward '<lambda>' is not finite at u = -1, v = -1; expected a finite number",
        ),
        (
            lambda u, v: 1 / u,
            ValueError,
            "reward '<lambda>' is not finite at u = 0, v = -1; expected",
        ),
        (
            lambda u, v: np.random.normal(),  # noqa: NPY002
            ValueError,
            "does not return the same for the same arguments",
        ),  # noqa: NPY002
        (lambda u, v: 1j * u, TypeError, "returns complex128; expected a number"),
        (
            lambda u, v: float("nan"),
            ValueError,
            "is not finite at u = -1, v = -1; expected a finite number for all u, v",
        ),
        (lambda u: u, TypeError, "cannot be compiled"),
        (lambda u, v: (u, v), TypeError, "returns .*; expected a number"),
        (lambda u, v: [u].pop().strip(), TypeError, "cannot be compiled"),
        (3.0, TypeError, "reward = 3.0; expected a plain Python function of two numbers"),
        ([], TypeError, r"reward = \[\]; expected a plain Python function"),
    ],
)
def test_rewards_that_cannot_be_are_refused(function, error, message):
    with pytest.raises(error, match=message):
        wb.learn(CONFIG, steps=1000, reward=function, progress=False)


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        (lambda d, b: d, TypeError, "law '<lambda>' returns float64; expected two numbers"),
        (lambda d, b: (d, b, b), TypeError, "expected two numbers"),
        (
            lambda d, b: (1.0 / b, 0.0),
            ValueError,
            "law '<lambda>' is not finite at distance = 0.08 m, bearing = 0 rad",
        ),
    ],
)
def test_laws_that_cannot_be_are_refused_before_anything_runs(function, error, message):
    with pytest.raises(error, match=message):
        wb.follow(wb.OwnLaw(function=function), CONFIG, minutes=1)


def test_a_law_of_ones_own_is_not_stored_and_a_reward_not_forgotten(tmp_path):
    with pytest.raises(ValueError, match="leave out= out"):
        wb.evaluate(
            wb.OwnLaw(function=_carrot), CONFIG, minutes=1, out=tmp_path / "run", progress=False
        )
    assert not (tmp_path / "run").exists()
    run = wb.learn(CONFIG, steps=1000, reward=_quadratic, progress=False)
    with pytest.raises(ValueError, match=r"reward = 'own' with the function None"):
        wb.learn(run.config, steps=1000, progress=False)


def test_an_index_out_of_range_is_refused_with_its_place():
    table = np.array([-1.0, -2.0, -3.0])

    def past_the_end(u, v):
        return table[int(3 * abs(u))]  # u = ±1 is one too far

    with pytest.raises(ValueError, match=r"reads beyond the end of an array at u = -1, v = -1"):
        own_reward(past_the_end)

    def far(distance, bearing):
        return table[int(100 * distance)] + 3.0, 0.0

    with pytest.raises(ValueError, match=r"law 'far' reads beyond.* at distance = 0.08 m"):
        wb.follow(wb.OwnLaw(function=far), CONFIG, minutes=1)
