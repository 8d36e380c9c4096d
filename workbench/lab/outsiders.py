"""Learners and laws of one's own, as plain Python objects, in the place of Greedy-GQ(λ): robots,
senses, bounds, the drive back after a loss and the records are the workbench's own.

    class Mine:
        def act(self, follower, seen): ...       # an action's number, or (left, right) in m/s
        def learn(self, follower, step): ...     # what came of an action
        def table(self): ...                     # if there is one: (tables, rows, actions)
    run = learn_own(Mine(), config, steps=50_000)

Every control period all followers that follow learn from the action that ends, then choose the
next. A law with a memory has ``act`` alone: ``evaluate_own``, which also drives by what a learner
without a table has learned. A reward that knows actions or neighbours is computed in ``learn``,
from what the step holds. ``config.grid().centre(state)`` is where a tile's middle is.

Contract: Python is called once or twice a follower and control period, which takes some 10 µs where
the compiled loop takes 0.5; a reward or a law without memory is faster as a function (``learn``,
``OwnLaw``). One formation at a time, in this process; nothing is stored on the way.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy, longest
from workbench.formation.follower import LEARNED
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.outside import Outside
from workbench.formation.own_reward import check_reward
from workbench.formation.policy import Policy
from workbench.lab.progress import Progress, report
from workbench.lab.records import Recorder
from workbench.lab.runs import Run, periods_of

Action = int | tuple[float, float]


class Seen(NamedTuple):
    """What a follower sees, and does.

    Attributes:
        state: number of its tile.
        distance_m, bearing_rad: of the robot in front (left positive), after filter and prediction
            if there are.
        left_mps, right_mps: its own wheel speeds, as it was last told.
    """

    state: int
    distance_m: float
    bearing_rad: float
    left_mps: float
    right_mps: float


class Step(NamedTuple):
    """An action and what came of it.

    Attributes:
        seen: where it was chosen.
        action: what ``act`` returned.
        reward: the configuration's.
        after: what is seen now, None where the leader was lost.
        others: what all followers see now, None for those that drive back.
    """

    seen: Seen
    action: Action
    reward: float
    after: Seen | None
    others: tuple[Seen | None, ...]


class OwnController(Protocol):
    """A law, with a memory if it likes."""

    def act(self, follower: int, seen: Seen) -> Action:
        """Return an action's number, or left and right wheel speeds in m/s, which are cut to the
        configuration's wheel_speed_mps; followers count from 0.
        """


class OwnLearner(OwnController, Protocol):
    """A learner; ``table()``, if it has one, returns action values, (1 or followers, rows,
    actions).
    """

    def learn(self, follower: int, step: Step) -> None:
        """Learn from an action of a follower."""


class _Loop:
    """A formation whose followers are driven by a Python object."""

    def __init__(self, who: Any, config: ConvoyConfig, length: int) -> None:
        if config.actions != "wheels" or config.compute_time_s:
            raise ValueError(
                f"ConvoyConfig.actions = {config.actions!r}, compute_time_s = "
                f"{config.compute_time_s!r}; expected 'wheels' and 0: Python says wheel speeds, "
                "and is not waited for"
            )
        self.who = who
        self.config = config
        self.length = length
        self.convoy = Convoy(config, [config.seed], periods=10**12, policy=Outside(), threads=1)
        self.levels = config.levels()
        self.seen: list[Seen | None] = [None] * config.followers
        self.chosen: list[Action] = [0] * config.followers
        self.told = np.zeros((2, config.followers), np.int64)  # steps/s
        self.updates = 0

    def run(self, recorder: Recorder, more: Callable[[int], bool], tell: Any) -> None:
        """Drive until there is no more to do, told the periods and updates that are over."""
        convoy, t, start, before = self.convoy, 0, 0, 0
        while more(t):
            now = convoy.period(t)[0]
            self._learn(now)
            following = self._act(now)
            # those that drive back, or were put back, are told by their own manoeuvre
            for told, name in zip(self.told, ("left", "right"), strict=True):
                told[~following] = now[name][1:][~following]
                now[name][1:] = told
            convoy.command_all(self.told[:1], self.told[1:], t)
            convoy.world.step()
            t += 1
            if t % BLOCK == 0 or not more(t):
                convoy.world.check(0, t)
                done = (t - 1) % BLOCK + 1
                recorder.add(convoy.block[0, :done], start)
                tell(done, self.updates - before)
                start, before = self.updates or t, self.updates

    def _learn(self, now: Any) -> None:
        """Tell the learner what came of the actions that end, and keep what is seen."""
        robots = self.convoy.robots[0, 1:]
        ended = now["state"][1:] >= 0
        # a simulation that restarts has put everybody back already: what they saw stands there
        state = np.where(ended, robots["waiting"]["next_state"], robots["choice"]["state"])
        before, others = self.seen, self._look(state)
        self.seen = self._look(robots["choice"]["state"])
        learn = getattr(self.who, "learn", None)
        if learn is None:
            return
        rewards = now["reward"][1:].tolist()
        for k in np.flatnonzero(ended).tolist():
            seen, action = before[k], self.chosen[k]
            if seen is None or self.updates == self.length:
                now["state"][k + 1] = -1  # no update, no visit, as everywhere
                continue
            learn(k, Step(seen, action, rewards[k], others[k], tuple(others)))
            now["event"][k + 1] |= LEARNED
            now["action"][k + 1] = action if isinstance(action, int) else -1
            self.updates += 1

    def _look(self, state: NDArray[np.int64]) -> list[Seen | None]:
        """Return what every follower sees in its state, None where it has none."""
        seen = self.convoy.robots[0, 1:]["seen"]
        speeds = self.told * self.config.robot.step_m
        columns = (state, seen["perceived_distance"], seen["perceived_bearing"], *speeds)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [Seen(*row) if row[0] >= 0 else None for row in rows]

    def _act(self, now: Any) -> NDArray[np.bool_]:
        """Let all who follow choose, and say who they are."""
        for k, seen in enumerate(self.seen):
            if seen is not None:
                self.chosen[k], self.told[:, k] = self._checked(self.who.act(k, seen))
        return np.array([seen is not None for seen in self.seen])

    def _checked(self, action: Any) -> tuple[Action, tuple[int, int]]:
        """Return an action of its own, and as whole steps/s within the learner's range."""
        if isinstance(action, (int, np.integer)) and not isinstance(action, bool):
            if not 0 <= action < self.config.action_count:
                raise ValueError(
                    f"action = {action!r}; expected 0 to {self.config.action_count - 1}"
                )
            pair = divmod(int(action), len(self.levels[1]))
            return int(action), (int(self.levels[0][pair[0]]), int(self.levels[1][pair[1]]))
        try:
            left, right = (float(speed) for speed in action)
        except (TypeError, ValueError):
            left = right = math.nan
        if not (math.isfinite(left) and math.isfinite(right)):
            raise ValueError(
                f"action = {action!r}; expected an action's number, or left and right wheel speed "
                "in m/s"
            )
        low, high = self.config.wheel_speed_mps
        steps = np.round(np.clip((left, right), low, high) / self.config.robot.step_m)
        return (left, right), (int(steps[0]), int(steps[1]))


def learn_own(
    learner: OwnLearner, config: ConvoyConfig, *, steps: float, progress: Progress = True
) -> Run:
    """Let followers learn by a learner of one's own, over as many actions as ``steps`` says:

        class Mine:
            def act(self, follower, seen): ...    # an action's number, or (left, right) in m/s
            def learn(self, follower, step): ...  # what came of an action
            def table(self): ...                  # if there is one: (tables, rows, actions)

    ``seen`` has state, distance_m, bearing_rad (left positive), left_mps, right_mps; ``step`` has
    seen, action, reward, after (None: the leader was lost), others.

    The run's policy is the learner's table, where it has one; its kind is "learn-own", so that
    nobody takes it for Greedy-GQ's.

    Raises:
        TypeError: the learner lacks act or learn.
        ValueError: an action, or the table, is not the configuration's.
        RuntimeError: hardly anybody follows any more.
    """
    _require(learner, "act", "learn")
    check_reward(config, None, learning=True)
    if config.weights != "own" or config.learn_by != "table":
        raise ValueError(
            f"ConvoyConfig.weights = {config.weights!r}, learn_by = {config.learn_by!r}; expected "
            "'own' and 'table': who shares what, and what is commanded, is up to the learner"
        )
    length = fields.positive("steps", steps)
    tell_table = getattr(learner, "table", None)
    if tell_table is not None:
        _table(tell_table, config)  # what is wrong with it is known before anybody drives
    loop, recorder = _Loop(learner, config, length), Recorder(config, length)
    most = longest(length, config.followers)
    with report(progress, length, "learn", 0, " updates") as tell:
        loop.run(
            recorder,
            lambda t: loop.updates < length and t < most,
            lambda periods, updates: tell(updates),
        )
    if loop.updates < length:
        raise RuntimeError(
            f"only {loop.updates} of {length} updates in {most} control periods; expected "
            "followers that find their leader again: wider bounds, a slower leader, or reset = "
            "'restart'"
        )
    policy = _table(tell_table, config) if tell_table is not None else _Code()
    theta = policy.theta if isinstance(policy, Policy) else np.zeros((0, 0, 0))
    return Run(
        "learn-own", config, length, loop.updates, policy, np.zeros_like(theta), recorder.records()
    )


def _table(table: Callable[[], Any], config: ConvoyConfig) -> Policy:
    policy = Policy.of(config, np.array(table(), dtype=float))
    policy.check(config)
    return policy


def evaluate_own(
    law: OwnController, config: ConvoyConfig, *, minutes: float = 30.0, progress: Progress = True
) -> Run:
    """Let followers be driven by an object of one's own for a simulated time: its method ``act``,
    see ``learn_own``. It is not told to learn, nor that it is judged: whoever explores turns that
    off before.

    Raises:
        TypeError: it has no ``act``.
        ValueError: an action is none of the configuration's.
    """
    if isinstance(law, ControlLaw):
        raise TypeError(f"law is a {type(law).__name__}, which evaluate(law, config) drives")
    _require(law, "act")
    length = periods_of(minutes)
    loop, recorder = _Loop(_Frozen(law), config, 0), Recorder(config, length)
    with report(progress, length, "evaluate", 0, " periods") as tell:
        loop.run(recorder, lambda t: t < length, lambda periods, updates: tell(periods))
    return Run("evaluate", config, length, 0, _Code(), np.zeros((0, 0, 0)), recorder.records())


class _Code(Outside):
    """Who drove, as far as a run knows."""

    def check(self, config: ConvoyConfig) -> None:
        """Refuse to drive.

        Raises:
            ValueError: always.
        """
        raise ValueError(
            "this run was driven by an object of your own, which it does not keep: call "
            "evaluate_own(object, config)"
        )

    def arrays(self) -> Any:
        """Refuse: an object is code, and files hold none."""
        raise ValueError(
            "an object of your own is code and is not stored; keep run.summary or run.records"
        )


class _Frozen:
    """Somebody who acts and does not learn."""

    def __init__(self, law: OwnController) -> None:
        self.act = law.act


def _require(who: Any, *methods: str) -> None:
    lacking = [name for name in methods if not callable(getattr(who, name, None))]
    if lacking:
        raise TypeError(
            f"{type(who).__name__} lacks {', '.join(lacking)}; expected an object with the methods "
            f"{', '.join(methods)}"
        )
