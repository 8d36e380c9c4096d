"""Learners and laws of one's own, as plain Python objects, in the place of Greedy-GQ(λ): robots,
senses, bounds, the drive back after a loss and the records are the workbench's own.

    class Mine:
        def act(self, follower, seen): ...       # an action's number, or (left, right) in m/s
        def learn(self, follower, step): ...     # after every action
        def table(self): ...                     # (tables, rows, actions): what has been learned
    run = learn_own(Mine(), config, steps=50_000)

A law with a memory has ``act`` alone: ``evaluate_own``. A reward that knows actions or neighbours
is computed in ``learn``, from what the step holds.

Contract: Python is called once or twice a follower and control period, which takes some 10 µs where
the compiled loop takes 0.5; a reward or a law without memory is faster as a function (``learn``,
``OwnLaw``). One formation at a time, in this process; nothing is stored on the way.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.formation.follower import LEARNED, LOSS
from workbench.formation.laws.outside import Outside
from workbench.formation.policy import Policy
from workbench.lab.progress import Progress, report
from workbench.lab.records import Recorder
from workbench.lab.runs import Run
from workbench.robot.geometry import CONTROL_PERIOD


class Seen(NamedTuple):
    """What a follower has seen, and does.

    Attributes:
        state: number of its tile.
        distance_m, bearing_rad: of the robot in front.
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
    action: int | tuple[float, float]
    reward: float
    after: Seen | None
    others: tuple[Seen | None, ...]


class OwnController(Protocol):
    """A law, with a memory if it likes."""

    def act(self, follower: int, seen: Seen) -> int | tuple[float, float]:
        """Return an action's number, or left and right wheel speeds in m/s; followers count from
        0.
        """


class OwnLearner(OwnController, Protocol):
    """A learner."""

    def learn(self, follower: int, step: Step) -> None:
        """Learn from an action of a follower."""

    def table(self) -> NDArray[np.float64]:
        """Return action values, (1 or followers, rows, actions)."""


class _Loop:
    """A formation whose followers are driven by a Python object."""

    def __init__(self, who: Any, config: ConvoyConfig) -> None:
        if config.actions != "wheels" or config.compute_time_s:
            raise ValueError(
                f"ConvoyConfig.actions = {config.actions!r}, compute_time_s = "
                f"{config.compute_time_s!r}; expected 'wheels' and 0: Python says wheel speeds, "
                "and is not waited for"
            )
        self.who = who
        self.config = config
        self.convoy = Convoy(config, [config.seed], periods=10**12, policy=Outside(), threads=1)
        self.levels = config.levels()
        self.seen: list[Seen | None] = [None] * config.followers
        self.chosen: list[Any] = [0] * config.followers
        self.updates = 0

    def run(self, recorder: Recorder, more: Callable[[int], bool], tell: Any) -> None:
        """Drive until there is no more to do, told the periods that are over."""
        convoy, t, start = self.convoy, 0, 0
        while more(t):
            now = convoy.period(t)[0]
            self._learn(now)
            left, right = self._act()
            convoy.command_all(left, right, t)
            now["left"][1:], now["right"][1:] = left[0], right[0]
            convoy.world.step()
            t += 1
            if t % BLOCK == 0 or not more(t):
                length = (t - 1) % BLOCK + 1
                recorder.add(convoy._block[0, :length], start)
                tell(length)
                start = self.updates or t

    def _learn(self, now: Any) -> None:
        """Tell the learner what came of the actions that are over, and look at what is seen."""
        before, self.seen = self.seen, self._look()
        learn = getattr(self.who, "learn", None)
        if learn is None:
            return
        others = tuple(self.seen)
        lost = (now["event"][1:] & LOSS != 0).tolist()
        rewards = now["reward"][1:].tolist()
        for k, ended in enumerate((now["state"][1:] >= 0).tolist()):
            seen = before[k]
            if ended and seen is not None:
                after = None if lost[k] else self.seen[k]
                learn(k, Step(seen, self.chosen[k], rewards[k], after, others))
                now["event"][k + 1] |= LEARNED
                self.updates += 1

    def _look(self) -> list[Seen | None]:
        """Return what every follower sees, None where it drives back."""
        robots, step_m = self.convoy.robots[0, 1:], self.config.robot.step_m
        columns = (
            robots["choice"]["state"].tolist(),
            robots["seen"]["distance"].tolist(),
            robots["seen"]["bearing"].tolist(),
            (robots["law"]["left"] * step_m).tolist(),
            (robots["law"]["right"] * step_m).tolist(),
        )
        return [Seen(*row) if row[0] >= 0 else None for row in zip(*columns, strict=True)]

    def _act(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return commands in steps/s, (1, followers) each."""
        found = np.zeros((2, 1, self.config.followers), np.int64)
        for k, seen in enumerate(self.seen):
            if seen is not None:
                self.chosen[k] = self.who.act(k, seen)
                found[:, 0, k] = self._steps(self.chosen[k])
        return found[0], found[1]

    def _steps(self, action: Any) -> tuple[int, int]:
        """Return an action as whole steps/s, within the learner's range."""
        if isinstance(action, (int, np.integer)) and not isinstance(action, bool):
            if not 0 <= action < self.config.action_count:
                raise ValueError(
                    f"action = {action!r}; expected 0 to {self.config.action_count - 1}"
                )
            left, right = divmod(int(action), len(self.levels[1]))
            return int(self.levels[0][left]), int(self.levels[1][right])
        speeds = np.asarray(action, dtype=float)
        if speeds.shape != (2,) or not np.all(np.isfinite(speeds)):
            raise ValueError(
                f"action = {action!r}; expected an action's number, or left and right wheel speed "
                "in m/s"
            )
        low, high = self.config.wheel_speed_mps
        left, right = np.round(np.clip(speeds, low, high) / self.config.robot.step_m)
        return int(left), int(right)


def learn_own(
    learner: OwnLearner, config: ConvoyConfig, *, steps: float, progress: Progress = True
) -> Run:
    """Let followers learn by a learner of one's own, over as many actions as ``steps`` says.

    Raises:
        TypeError: the learner lacks act, learn or table.
        ValueError: an action, or the table in the end, is not the configuration's.
    """
    _require(learner, "act", "learn", "table")
    length = fields.positive("steps", steps)
    loop, recorder = _Loop(learner, config), Recorder(config, length)
    with report(progress, length, "learn", 0, " updates") as tell:
        loop.run(recorder, lambda t: loop.updates < length, lambda _: tell(0))
        tell(loop.updates)
    theta = np.array(learner.table(), dtype=float)
    policy = Policy.of(config, theta)
    policy.check(config)
    return Run(
        "learn", config, length, loop.updates, policy, np.zeros_like(theta), recorder.records()
    )


def evaluate_own(
    law: OwnController, config: ConvoyConfig, *, minutes: float = 30.0, progress: Progress = True
) -> Run:
    """Let followers be driven by an object of one's own for a simulated time.

    Raises:
        TypeError: it has no ``act``.
        ValueError: an action is none of the configuration's.
    """
    _require(law, "act")
    if not 0 < minutes <= 1e5:
        raise ValueError(f"minutes = {minutes!r}; expected simulated minutes above 0")
    length = fields.positive("periods", round(minutes * 60 / CONTROL_PERIOD))
    loop, recorder = _Loop(_Frozen(law), config), Recorder(config, length)
    with report(progress, length, "evaluate", 0, " periods") as tell:
        loop.run(recorder, lambda t: t < length, tell)
    return Run("evaluate", config, length, 0, _Code(), np.zeros((0, 0, 0)), recorder.records())


class _Code(Outside):
    """Who drove, as far as a run knows."""

    def arrays(self) -> Any:
        """Refuse: an object is code, and files hold none."""
        raise ValueError(
            "a law of your own is code and is not stored; keep run.summary or run.records"
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
