"""Learners and laws of one's own as Python objects in the follower's place."""

import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.formation.laws.carrot import CarrotPI
from workbench.lab import outsiders
from workbench.lab.outsiders import Seen, Step

CONFIG = wb.ConvoyConfig(drive="rolling", followers=2, seed=1)


class Recorded:
    """Takes the middle action and writes down what it is told."""

    def __init__(self, config):
        self.config = config
        self.steps = []

    def act(self, follower, seen):
        assert follower in (0, 1) and isinstance(seen, Seen)
        return 24

    def learn(self, follower, step):
        self.steps.append((follower, step))

    def table(self):
        return np.zeros((1, self.config.rows, self.config.action_count))


def test_a_learner_is_told_every_action_and_what_came_of_it():
    learner = Recorded(CONFIG)
    run = wb.learn_own(learner, CONFIG, steps=1e3, progress=False)
    assert run.updates == len(learner.steps) == 1000
    assert run.summary["losses"] == sum(step.after is None for _, step in learner.steps) > 0
    grid = CONFIG.grid()
    for _, step in learner.steps:
        assert isinstance(step, Step) and step.action == 24 and len(step.others) == 2
        if step.after is None:
            assert step.reward == pytest.approx(-10.0)
            continue
        u = (step.after.distance_m - CONFIG.middle_m) / CONFIG.half_range_m
        v = step.after.bearing_rad / CONFIG.bearing_limit_rad
        assert step.reward == pytest.approx(-(u * u) - v * v, abs=1e-6)
        e_d = step.after.distance_m - CONFIG.middle_m
        assert step.after.state == grid.index(e_d, step.after.bearing_rad)
        assert step.after.left_mps == pytest.approx(0.06, abs=1e-3)  # the middle of the levels
    assert run.visits.sum() == run.updates


class TabularQ(Recorded):
    """Q-learning with a table for all."""

    def __init__(self, config):
        super().__init__(config)
        self.q = super().table()
        self.chance = np.random.default_rng(0)

    def act(self, follower, seen):
        if self.chance.random() < 0.05:
            return int(self.chance.integers(self.q.shape[2]))
        return self.q[0, seen.state].argmax()

    def learn(self, follower, step):
        ahead = 0.8 * self.q[0, step.after.state].max() if step.after else 0.0
        row = self.q[0, step.seen.state]
        row[step.action] += 0.1 * (step.reward + ahead - row[step.action])

    def table(self):
        return self.q


def test_a_learner_from_outside_learns_to_follow_and_its_run_is_like_any_other(tmp_path):
    config = replace(CONFIG, state_tiles=(5, 5), action_levels=(3, 3))
    run = wb.learn_own(TabularQ(config), config, steps=20_000, progress=False)
    late = wb.evaluate(run, minutes=5, progress=False).summary
    assert late["losses"] <= 1 and late["rms_distance_error_mm"] < 20
    run.save(tmp_path / "run")
    assert wb.load_run(tmp_path / "run").summary == run.summary


class Remembering:
    """A carrot with an integral of its own."""

    def __init__(self):
        self.sum = {}

    def act(self, follower, seen):
        error = seen.distance_m - 0.15
        self.sum[follower] = self.sum.get(follower, 0.0) + error
        speed = 0.06 + 2.0 * error + 0.02 * self.sum[follower]
        turn = 4.0 * seen.bearing_rad * 0.053 / 2
        return speed - turn, speed + turn


class Plain:
    def act(self, follower, seen):
        error, turn = seen.distance_m - 0.15, 4.0 * seen.bearing_rad * 0.053 / 2
        return 0.05 + error - turn, 0.05 + error + turn


def test_a_law_with_a_memory_takes_away_what_one_without_leaves():
    plain, remembering = (
        wb.evaluate_own(law, CONFIG, minutes=5, progress=False).summary
        for law in (Plain(), Remembering())
    )
    assert plain["losses"] == remembering["losses"] == 0
    assert remembering["bias_mm"] < 0.5 < 5 < plain["bias_mm"]


def test_a_law_from_outside_does_what_its_compiled_twin_does():
    """The same function, once in the loop and once called from Python."""

    def twin(distance, bearing):
        return 0.06 + 2.0 * (distance - 0.15), 4.0 * bearing

    class FromOutside:
        def act(self, follower, seen):
            v, w = twin(seen.distance_m, seen.bearing_rad)
            half = w * CONFIG.robot.track_m / 2
            return v - half, v + half

    inside = wb.evaluate(wb.OwnLaw(function=twin), CONFIG, minutes=2, progress=False).summary
    outside = wb.evaluate_own(FromOutside(), CONFIG, minutes=2, progress=False).summary
    for name in ("losses", "rms_distance_error_mm", "bearing_std_deg"):
        assert outside[name] == pytest.approx(inside[name], rel=0.02), name


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (49, "action = 49; expected 0 to 48"),
        ((0.05, math.nan), "expected an action's number, or left and right wheel speed"),
        (None, "action = None; expected an action's number"),
    ],
)
def test_actions_that_are_none_are_refused(action, message):
    class Wrong:
        def act(self, follower, seen):
            return action

    with pytest.raises(ValueError, match=message):
        wb.evaluate_own(Wrong(), CONFIG, minutes=0.1, progress=False)


def test_what_cannot_be_is_refused_at_once(tmp_path):
    with pytest.raises(TypeError, match="Plain lacks learn; expected an object with"):
        wb.learn_own(Plain(), CONFIG, steps=100)
    with pytest.raises(TypeError, match=r"law is a CarrotPI, which evaluate\(law, config\) drives"):
        wb.evaluate_own(CarrotPI(), CONFIG)
    with pytest.raises(ValueError, match="expected 'wheels' and 0: Python says wheel speeds"):
        wb.evaluate_own(Plain(), replace(CONFIG, actions="relative"))
    run = wb.evaluate_own(Plain(), CONFIG, minutes=0.2, progress=False)
    with pytest.raises(ValueError, match="an object of your own is code and is not stored"):
        run.save(tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ValueError, match=r"does not keep: call evaluate_own\(object, config\)"):
        wb.evaluate(run, minutes=1)
    with pytest.raises(TypeError, match=r"or evaluate_own\(object, config\) for an object"):
        wb.evaluate(Plain(), CONFIG)
    for changes, message in (
        ({"reward": "own"}, "with the function None"),
        ({"weights": "first"}, "expected 'own' and 'table'"),
        ({"learn_by": "output", "output": "interpolated"}, "expected 'own' and 'table'"),
    ):
        with pytest.raises(ValueError, match=message):
            wb.learn_own(Recorded(CONFIG), replace(CONFIG, **changes), steps=100)


def test_a_wrong_table_is_refused_before_anybody_drives():
    class Wrong(Recorded):
        def act(self, follower, seen):
            raise AssertionError("somebody drives")

        def table(self):
            return np.zeros((81, 49))

    with pytest.raises(ValueError, match="its tiles and levels ask for"):
        wb.learn_own(Wrong(CONFIG), CONFIG, steps=100)


class OneStepQ(Recorded):
    """What the compiled rule watkins-q does with λ = 0, ε = 0 and no update buffer."""

    def __init__(self, config):
        super().__init__(config)
        self.learner = config.learner
        shape = (config.followers, config.rows, config.action_count)
        self.q = np.full(shape, self.learner.theta0)

    def act(self, follower, seen):
        return int(self.q[follower, seen.state].argmax())

    def learn(self, follower, step):
        q = self.q[follower]
        ahead = 0.0 if step.after is None else self.learner.gamma * q[step.after.state].max()
        value = q[step.seen.state, step.action]
        q[step.seen.state, step.action] += self.learner.alpha * (step.reward + ahead - value)

    def table(self):
        return self.q


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"reset": "restart", "followers": 4},
        {"noise_distance_m": 0.02, "filter": "alpha-beta"},
        {"body": wb.ConvoyConfig().body.__class__(delay=2), "prediction": "both"},
        {"sensing": "camera"},
    ],
    ids=["plain", "restart", "filter", "prediction", "camera"],
)
def test_the_compiled_rule_written_as_an_object_learns_the_same(changes):
    rule = wb.LearnerConfig(rule="watkins-q", lam=0.0, epsilon=0.0, epsilon_final=0.0, buffer=False)
    config = replace(CONFIG, learner=rule, **changes)
    length = 500 * config.followers
    inside = wb.learn(config, steps=length, progress=False)
    outside = wb.learn_own(OneStepQ(config), config, steps=length, progress=False)
    np.testing.assert_allclose(outside.policy.theta, inside.policy.theta, atol=1e-6)
    for name in ("losses", "rms_distance_error_mm", "bearing_std_deg"):
        assert outside.summary[name] == pytest.approx(inside.summary[name], rel=1e-6), name


def test_what_is_seen_is_what_the_tile_is_of():
    class Looks(Recorded):
        def act(self, follower, seen):
            e_d = seen.distance_m - CONFIG.middle_m
            assert CONFIG.grid().index(e_d, seen.bearing_rad) == seen.state
            return 24

    config = replace(CONFIG, noise_distance_m=0.02, filter="alpha-beta", prediction="both")
    wb.learn_own(Looks(config), config, steps=500, progress=False)


def test_records_have_the_commands_also_of_those_that_drive_back():
    run = wb.learn_own(Recorded(CONFIG), CONFIG, steps=2000, progress=False)
    samples = run.records["samples"]
    away = samples["phase"][:, 1:] != 0
    assert away.any() and np.all(samples["left"][:, 1:][away] != 0)
    done = samples["state"][:, 1:] >= 0
    assert set(samples["action"][:, 1:][done]) == {24}


def test_a_learner_without_a_table_is_judged_by_driving():
    class Nobody:
        def act(self, follower, seen):
            return Plain().act(follower, seen)

        def learn(self, follower, step):
            self.last = step

    learner = Nobody()
    told = []
    run = wb.learn_own(learner, CONFIG, steps=6000, progress=told.append)
    assert run.kind == "learn-own" and sum(told) == 6000 and told[0] > 0
    assert wb.evaluate_own(learner, CONFIG, minutes=1, progress=False).summary["losses"] == 0
    with pytest.raises(ValueError, match="does not keep"):
        wb.evaluate(run, minutes=1)


def test_an_own_learner_s_run_is_not_taken_for_another_s(tmp_path):
    run = wb.learn_own(Recorded(CONFIG), CONFIG, steps=300, progress=False)
    run.save(tmp_path / "run")
    assert wb.load_run(tmp_path / "run").kind == "learn-own"
    with pytest.raises(ValueError, match="kind"):
        wb.learn(CONFIG, steps=300, out=tmp_path / "run", resume=True, progress=False)


def test_learning_that_goes_nowhere_ends(monkeypatch):
    monkeypatch.setattr(outsiders, "longest", lambda steps, learners: 25_000)

    class Stands(Recorded):
        def act(self, follower, seen):
            return (0.0, 0.0)

    config = replace(CONFIG, followers=1, sight_m=0.221, wheel_speed_mps=(0.0, 0.1))
    with pytest.raises(RuntimeError, match=r"only \d+ of 5000 updates in 25000 control periods"):
        wb.learn_own(Stands(config), config, steps=5000, progress=False)


def test_an_action_that_is_reused_is_kept_as_it_was():
    class Reuses(Recorded):
        speeds = np.zeros(2)

        def act(self, follower, seen):
            self.speeds[:] = 0.05 + 0.01 * follower
            return self.speeds

    learner = Reuses(CONFIG)
    wb.learn_own(learner, CONFIG, steps=50, progress=False)
    assert {(k, *np.round(step.action, 6)) for k, step in learner.steps} == {
        (0, 0.05, 0.05),
        (1, 0.06, 0.06),
    }
