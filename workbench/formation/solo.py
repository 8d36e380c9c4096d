"""One follower that drives one robot through the robot API: the same sense, tile, act, learn as in
the compiled convoy.

    follower = SoloFollower(config, policy)                 # greedy, or steps=… to learn
    left, right = follower.decide(readings)                 # and follower.learn(), while it runs

``decide`` calls ``formation.follower.act`` on one record, ``learn`` calls
``formation.follower.learn``; with the same readings and the same seed the commands are those of the
compiled convoy, bit for bit. The loop around it is ``logs.driving``.

Contract: readings are eight calibrated counts, or distance and bearing.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled
from workbench.formation import follower as kernel
from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import LEARNED
from workbench.formation.policy import Policy
from workbench.formation.records import PERIOD, ROBOT
from workbench.formation.reward import OWN
from workbench.formation.senses.infrared import look
from workbench.formation.senses.table import INFRARED
from workbench.formation.streams import children
from workbench.formation.task import fill_task
from workbench.learning.behaviour import epsilon_at
from workbench.learning.kernel import new_trace
from workbench.robot.infrared import DARK, SENSORS


@compiled
def _decide(task: Any, follower: Any, period: Any, memory: Any) -> tuple[int, int, bool]:
    if task[0].infrared.sees:
        seen = follower[0].seen
        seen.distance, seen.bearing = look(task[0], follower[0])
    left, right, finite = kernel.act(task[0], follower[0], period[0], memory)
    kernel.remember(follower[0], left, right)
    return left, right, finite


@compiled
def _learn(task: Any, follower: Any, memory: Any) -> bool:
    return kernel.learn(task[0], follower[0], memory)


def _check_alone(config: ConvoyConfig, policy: Policy | None, steps: int) -> None:
    """Refuse what no follower alone can do."""
    if steps < 0:
        raise ValueError(
            f"steps = {steps!r}; expected 0 to follow greedily, or a number of learning updates"
        )
    if policy is None and not steps:
        raise ValueError("a follower without a policy has to learn; give policy= or steps=")
    if config.formation.shaped:
        raise ValueError(
            f"ConvoyConfig.formation.frame = {config.formation.relative_to!r}; a robot alone "
            "is not told its leader's speed and turning rate: expected 'predecessor'"
        )
    if policy is not None:
        policy.check(config)
    if steps and config.reward == OWN:
        raise ValueError(
            f"ConvoyConfig.reward = {OWN!r} with steps = {steps!r}; a function can only "
            "be given to learn()"
        )


class SoloFollower:
    """A follower outside a convoy.

    Args:
        config: task, tiles, actions, learner and seed; of its convoy only what one follower needs.
        policy: main weights to start from or to follow; one table, or that of the first follower.
        steps: learning updates over which it learns, 0 to follow the policy greedily.

    Attributes:
        record: () of type ROBOT, step: () of type PERIOD: what it saw and did at the last
            decision.
        weights: (2, rows * actions) main and secondary weights.
        updates: learning updates done.
        epsilon: how often it explores where it does not learn.
    """

    def __init__(
        self, config: ConvoyConfig, policy: Policy | None = None, *, steps: int = 0
    ) -> None:
        _check_alone(config, policy, steps)
        self.config = config
        self.steps = steps
        self.updates = 0
        self._task = fill_task(config, steps)
        pairs = config.rows * config.action_count
        self._record = np.zeros(1, ROBOT)
        self._step = np.zeros(1, PERIOD)
        self._record["choice"]["state"] = -1
        self._record["learning"]["learns"] = steps > 0
        self._record["infrared"]["headroom"] = DARK
        self.weights = np.zeros((2, pairs))
        self.weights[0] = (
            config.learner.theta0 / config.tilings if policy is None else policy.theta[0].ravel()
        )
        index, values, slot = new_trace(pairs)
        ids = np.stack([index, slot, index])
        self._memory = kernel.Memory(self.weights, ids, np.stack([values, values]))
        self._chance = children(config.seed)["policy"]
        self.probability = 1.0
        self.epsilon = 0.0
        # not while a robot waits
        what = (self._task, self._record, self._step, self._memory)
        _decide.compile(tuple(numba.typeof(value) for value in what))
        _learn.compile(tuple(numba.typeof(what[k]) for k in (0, 1, 3)))

    @property
    def record(self) -> Any:
        """The follower's record, type ROBOT."""
        return self._record[0]

    @property
    def step(self) -> Any:
        """What happened at the last decision, type PERIOD."""
        return self._step[0]

    @property
    def policy(self) -> Policy:
        """Return what it knows now."""
        return Policy.of(
            self.config, self.weights[0].reshape(1, self.config.rows, self.config.action_count)
        )

    def decide(
        self,
        readings: NDArray[np.float64] | tuple[float, ...] | None = None,
        light: tuple[float, ...] | None = None,
        *,
        distance: float = 0.0,
        bearing: float = 0.0,
        new: bool = True,
    ) -> tuple[int, int]:
        """Return wheel speeds in whole steps/s.

        Args:
            readings: (8,) calibrated counts, with sensing by infrared.
            light: (8,) ambient readings, by which it notices when it is blinded.
            distance, bearing: of the robot in front in m and rad, with other sensing.
            new: whether they have arrived since the last decision; a filter goes on without them.

        Raises:
            FloatingPointError: learning diverged.
            ValueError: readings are missing or not eight finite numbers.
        """
        self._notice(readings, light, distance, bearing)
        self._record["seen"]["silent"] = not new
        epsilon = self._exploration()
        learning = self._record["learning"]
        learning["epsilon"] = epsilon
        learning["chance"] = self._chance.random()
        learning["room"] = self.updates < self.steps
        left, right, finite = _decide(self._task, self._record, self._step, self._memory)
        event = int(self._step["event"][0])
        if event & LEARNED:
            self.updates += 1
        if not finite:
            raise FloatingPointError(
                f"learning diverged at update {self.updates}; lower the step sizes"
            )
        explored = epsilon / self.config.action_count
        greedy = 1.0 - epsilon if event & kernel.EXPLORED == 0 else 0.0
        follows = self._record["choice"]["state"][0] >= 0
        self.probability = explored + greedy if follows else 1.0
        return int(left), int(right)

    def _notice(
        self, readings: Any, light: tuple[float, ...] | None, distance: float, bearing: float
    ) -> None:
        """Write what it is told into its record."""
        if self.config.sensing in INFRARED:
            if readings is None or len(readings) != SENSORS or not np.all(np.isfinite(readings)):
                raise ValueError(f"readings = {readings!r}; expected {SENSORS} finite counts")
            self._record["infrared"]["readings"][0] = readings
            if light is not None:
                self._record["infrared"]["headroom"][0] = light
        elif not (np.isfinite(distance) and np.isfinite(bearing)):
            raise ValueError(
                f"distance = {distance!r}, bearing = {bearing!r}; expected finite numbers"
            )
        self._record["seen"]["distance"] = distance
        self._record["seen"]["bearing"] = bearing

    def _exploration(self) -> float:
        """Return ε of this moment: by its schedule while it learns, else what it was told."""
        if not self.steps:
            return self.epsilon
        learner = self._task["learner"][0]
        epsilon: float = epsilon_at(
            int(learner["schedule"]),
            float(learner["epsilon"]),
            float(learner["epsilon_final"]),
            float(learner["epsilon_horizon"]),
            float(self.updates),
        )
        return epsilon

    def learn(self) -> None:
        """Learn the transition that has just ended, if there is one."""
        if not _learn(self._task, self._record, self._memory):
            raise FloatingPointError(
                f"learning diverged at update {self.updates}; lower the step sizes"
            )
