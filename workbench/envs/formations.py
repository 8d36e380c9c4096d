"""Formations whose followers are told what to do, period by period: what all environments have in
common.

>>> formations = Formations(ConvoyConfig(drive="planar"), 2, "errors", "discrete", None, 60.0)
>>> formations.build(seed=1)
>>> reward, lost = formations.act(np.full((2, 4), 24))
>>> reward.shape, bool(lost.any()), formations.observe().shape
((2, 4), False, (2, 4, 2))

Contract: formations are made from seed, seed + 1, …; ``act`` and ``begin`` may be called for some
of them, others stand still.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from workbench.envs import shaping
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.laws.outside import Outside
from workbench.formation.own_reward import Reward, trouble, with_reward
from workbench.formation.reward import OWN
from workbench.formation.senses.table import INFRARED
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.infrared import ADC, SENSORS

OBSERVATIONS = ("errors", "tiles", "infrared")
ACTIONS = ("discrete", "continuous")
_MADE = ("_convoy", "_clock", "own")  # not kept with a copy
CLIP = 2.0  # errors in units of their bounds, at most
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]


class Formations:
    """B formations whose followers are told what to do, period by period; options as in
    ``envs.environments``.
    """

    def __init__(
        self,
        config: ConvoyConfig,
        formations: int,
        observation: str,
        actions: str,
        reward: Reward | str | None,
        seconds: float,
    ) -> None:
        _check(config, formations, observation, actions, reward, seconds)
        self._convoy: Convoy | None = None
        self._shaping = reward if isinstance(reward, str) and reward in shaping.REWARDS else ""
        own: Any = None if self._shaping else reward
        self._reward = own
        config, self.own = with_reward(config, own)
        # who puts followers back is the environment: a formation must not restart by itself
        self.config = replace(config, reset="manoeuvre")
        self.formations = formations
        self.observation = observation
        self.discrete = actions == "discrete"
        self.limit = max(1, round(seconds / CONTROL_PERIOD))
        self.left_steps, self.right_steps = config.levels()
        self.states = config.grid().n
        self.observation_space: spaces.Space[Any]
        if observation == "tiles":
            self.observation_space = spaces.Discrete(self.states + 1)
        elif observation == "errors":
            self.observation_space = spaces.Box(-CLIP, CLIP, (2,), np.float32)
        else:
            self.observation_space = spaces.Box(0.0, ADC, (SENSORS,), np.float32)
        self.action_space: spaces.Space[Any] = (
            spaces.Discrete(config.action_count)
            if self.discrete
            else spaces.Box(-1.0, 1.0, (2,), np.float32)
        )

    @property
    def new(self) -> bool:
        """Whether it has never begun."""
        return self._convoy is None

    @property
    def convoy(self) -> Convoy:
        """The formations, open to every use."""
        if self._convoy is None:
            raise RuntimeError("the environment has not begun; call reset() first")
        return self._convoy

    def build(self, seed: int | Sequence[int]) -> None:
        """Make all formations anew, formation k from seed + k or from seed[k], and begin an episode
        in each.
        """
        alone = isinstance(seed, int)
        seeds = [seed + k for k in range(self.formations)] if isinstance(seed, int) else seed
        self._make(seeds)
        self.rng = np.random.default_rng([seeds[0], 1] if alone else [*seeds, 1])
        self.t = 0
        self.age = np.zeros(self.formations, np.int64)
        self._lost = np.zeros((self.formations, self.config.followers), bool)
        self._far = np.zeros((self.formations, self.config.followers))
        self.begin(np.arange(self.formations))

    def _make(self, seeds: Sequence[int]) -> None:
        """Make the formations of these seeds."""
        self._convoy = Convoy(
            self.config, seeds, periods=10**12, policy=Outside(), reward=self.own, threads=1
        )
        self._clock = self._convoy.world.batch.bind("time")

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy, or a file, needs: compiled code and the physics are made anew."""
        state = {name: value for name, value in vars(self).items() if name not in _MADE}
        if self._convoy is not None:
            convoy = self._convoy
            state["running"] = convoy.seeds, convoy.state(), convoy.drawn.copy()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        running = state.pop("running", None)
        vars(self).update(state)
        self._convoy = None
        self.own = with_reward(self.config, self._reward)[1]
        if running is not None:
            seeds, told, drawn = running
            self._make(seeds)
            self.convoy.load(told)
            self.convoy.drawn[:] = drawn

    def begin(self, which: NDArray[np.int64]) -> None:
        """Begin an episode in some formations: line them up until every follower sees the one in
        front within its bounds.

        Raises:
            RuntimeError: it does not in a hundred attempts.
        """
        convoy = self.convoy
        waiting = which
        self.age[which] = 0
        self._lost[which] = False
        for attempt in range(100):
            if (
                attempt % 10 == 0
            ):  # in between they look again: a camera may show nothing in some periods
                for b in waiting.tolist():
                    self._line_up(b)
            for b in waiting.tolist():
                convoy.begin_again(b, forget=attempt % 10 == 0)
                convoy.robots["body"]["queue"][b] = 0
                convoy.robots["command"][b] = (0, 0)
                convoy.robots["failure"]["any"][b] = 0
            self._only(waiting)
            self.sense()
            waiting = waiting[np.any(convoy.robots["choice"]["state"][waiting, 1:] < 0, axis=1)]
            if not len(waiting):
                self._only(None)
                if self._shaping:
                    self._far[which] = self._far_now(self.truth())[which]
                return
        raise RuntimeError(
            f"formations {waiting.tolist()}: followers that stand within the bounds do not "
            "see the robot in front there in a "
            "hundred attempts; expected less noise or a better camera, or wider bounds"
        )

    def _only(self, which: NDArray[np.int64] | None) -> None:
        """Let only some formations take part, or all."""
        self.convoy.resting[:] = which is not None
        if which is not None:
            self.convoy.resting[which] = 0

    def _line_up(self, b: int) -> None:
        """Put the followers of formation b behind its leader, at random places in the inner third
        of their bounds.
        """
        config = self.config
        world = self.convoy.world
        x, y, heading = world.pose(b, 0)
        for robot in range(1, world.robots):
            if robot > 1:  # further behind the line runs as the loop does
                near = world.tracks[b].nearest((x, y), heading)
                heading = world.tracks[b].pose(float(world.tracks[b].s[near]))[2]
            gap, aspect, bearing = self.rng.uniform(-1 / 3, 1 / 3, 3)
            distance = config.middle_m + gap * config.half_range_m
            towards = heading + aspect * config.bearing_limit_rad
            x, y = x - distance * math.cos(towards), y - distance * math.sin(towards)
            heading = towards - bearing * config.bearing_limit_rad
            world.place(b, robot, x, y, heading)

    def sense(self) -> tuple[Floats, Flags]:
        """Let everybody who takes part sense; return rewards and losses of actions that end now,
        (B, followers) each.
        """
        steps = self.convoy.period(self.t)
        self.t += 1
        resting = self.convoy.resting[:, None] != 0
        reward = steps["reward"][:, 1:].astype(np.float64)
        lost = (steps["event"][:, 1:] & LOSS != 0) & ~resting
        self._lost = np.where(resting, self._lost, lost)
        return np.where(resting, 0.0, reward), lost

    def truth(self) -> dict[str, NDArray[Any]]:
        """Return what is so, whatever the senses say, (B, followers) each: distance in m and
        bearing in rad of the robot that is followed (with a shape: the leader), whether it was lost
        by the last action, whether any robot is touched.
        """
        pose = self.convoy.robots["pose"]
        ahead = self.convoy.robots["ahead"][0, 1:]
        dx, dy = (pose[name][:, ahead] - pose[name][:, 1:] for name in ("x", "y"))
        distance = np.hypot(dx, dy)
        x, y = (pose[name][:, :, None] - pose[name][:, None] for name in ("x", "y"))
        apart = np.hypot(x, y) + np.where(np.eye(pose.shape[1]), np.inf, 0.0)
        cos, sin = pose["cos"][:, 1:], pose["sin"][:, 1:]
        touch = 2 * self.config.robot.body_radius_m
        return {
            "distance_m": distance,
            "bearing_rad": np.arctan2(dy * cos - dx * sin, dx * cos + dy * sin),
            "lost": self._lost.copy(),
            "contact": apart[:, 1:].min(axis=2) < touch,
        }

    def act(
        self, actions: NDArray[Any], running: NDArray[np.int64] | None = None
    ) -> tuple[Floats, Flags]:
        """Carry out actions (B, followers[, 2]) for one control period, in all formations or those
        named; see ``sense``.

        Raises:
            ValueError: not one action for every follower, or one that is none.
            RuntimeError: the physics became unstable.
        """
        left, right = self._commands(actions, running)
        self._only(running)
        self.convoy.command_all(left, right, self.t - 1)
        world = self.convoy.world
        moved = slice(None) if running is None else running
        before = self._clock[moved].copy()
        world.step(running)
        self.age[moved] += 1
        if not np.allclose(self._clock[moved] - before, CONTROL_PERIOD, atol=1e-6):
            raise RuntimeError(
                "the physics became unstable: a clock of MuJoCo was set back; what follows "
                "would be meaningless. Check the "
                "robot's numbers (mass, inertia, wheels)"
            )
        reward, lost = self.sense()
        self._only(None)
        if self._shaping:
            reward = self._progress(moved)
        if said := trouble(self.convoy.robots, self.own):
            raise ValueError(said)
        return reward, lost

    def _far_now(self, truth: dict[str, NDArray[Any]]) -> Floats:
        """Return how far followers are from their places, (B, followers) m."""
        return shaping.far_m(self.convoy, truth["distance_m"], truth["bearing_rad"])

    def _progress(self, moved: Any) -> Floats:
        """Return rewards for the progress of formations that have moved, 0 for others."""
        truth = self.truth()
        now = self._far_now(truth)
        found = np.zeros_like(now)
        found[moved] = shaping.progress(self._shaping, self._far, now, truth["contact"])[moved]
        self._far[moved] = now[moved]
        return found

    def _commands(
        self, actions: NDArray[Any], running: NDArray[np.int64] | None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        followers = (self.formations, self.config.followers)
        shape = followers if self.discrete else (*followers, 2)
        if actions.shape != shape:
            raise ValueError(
                f"actions have shape {actions.shape}; expected {shape}, one for each of "
                "(formations, followers)"
            )
        if running is not None:  # what the others were told is ignored, whatever it is
            given = actions
            actions = np.zeros_like(actions)
            actions[running] = given[running]
        if self.discrete:
            if (
                not np.issubdtype(actions.dtype, np.integer)
                or actions.min() < 0
                or actions.max() >= self.config.action_count
            ):
                raise ValueError(
                    f"actions = {actions.tolist()!r}; expected whole numbers from 0 to "
                    f"{self.config.action_count - 1}"
                )
            pairs = np.divmod(actions.astype(np.int64), len(self.right_steps))
            return self.left_steps[pairs[0]], self.right_steps[pairs[1]]
        if not np.all(np.isfinite(actions)):
            raise ValueError(
                f"actions = {actions.tolist()!r}; expected finite numbers from -1 to 1"
            )
        low, high = self.config.wheel_speed_mps
        speeds = low + (np.clip(actions.astype(np.float64), -1.0, 1.0) + 1.0) / 2 * (high - low)
        left, right = np.moveaxis(
            np.round(speeds / self.config.robot.step_m).astype(np.int64), -1, 0
        )
        return np.ascontiguousarray(left), np.ascontiguousarray(right)

    def observe(self) -> NDArray[Any]:
        """Return what the followers see, (B, followers) or (B, followers, n)."""
        robots = self.convoy.robots[:, 1:]
        if self.observation == "tiles":
            state = robots["choice"]["state"]
            return np.where(state < 0, self.states, state)
        if self.observation == "infrared":
            return robots["infrared"]["readings"].astype(np.float32)
        seen = robots["seen"]
        u = (seen["perceived_distance"] - self.config.middle_m) / self.config.half_range_m
        v = seen["perceived_bearing"] / self.config.bearing_limit_rad
        return np.clip(np.stack([u, v], axis=-1), -CLIP, CLIP).astype(np.float32)


def _check(
    config: object,
    formations: int,
    observation: str,
    actions: str,
    reward: Reward | str | None,
    seconds: float,
) -> None:
    """Refuse what no environment can be made of."""
    if not isinstance(config, ConvoyConfig):
        raise TypeError(f"config is a {type(config).__name__}; expected a ConvoyConfig")
    for name, value, options in (
        ("observation", observation, OBSERVATIONS),
        ("actions", actions, ACTIONS),
    ):
        if value not in options:
            raise ValueError(f"{name} = {value!r}; expected one of {', '.join(map(repr, options))}")
    if observation == "infrared" and config.sensing not in INFRARED:
        raise ValueError(
            f"observation = {observation!r} with sensing = {config.sensing!r}; expected "
            "sensing = 'ir-metric' or 'ir-raw': "
            "then the bounds are judged by what the robot sees, too"
        )
    _check_reward(config, reward)
    if config.actions != "wheels":
        raise ValueError(
            f"ConvoyConfig.actions = {config.actions!r}; an environment's actions are speeds of "
            "the wheels: expected 'wheels'"
        )
    if config.compute_time_s:
        raise ValueError(
            f"ConvoyConfig.compute_time_s = {config.compute_time_s!r}; an environment "
            "does not know how long its learner "
            "computes: expected 0, or body.delay for commands that are late"
        )
    if formations < 1 or not 0 < seconds < math.inf:
        raise ValueError(
            f"formations = {formations!r}, seconds = {seconds!r}; expected at least 1, "
            "and more than 0"
        )


def _check_reward(config: ConvoyConfig, reward: Reward | str | None) -> None:
    """Refuse a word that is no reward, and a reward of one's own that is not there."""
    if isinstance(reward, str) and reward not in shaping.REWARDS:
        raise ValueError(
            f"reward = {reward!r}; expected a function of u and v, or one of "
            f"{', '.join(map(repr, shaping.REWARDS))}; a preset is named by "
            f"ConvoyConfig(reward={reward!r})"
        )
    if config.reward == OWN and reward is None:
        raise ValueError(
            f"ConvoyConfig.reward = {OWN!r} without a function; expected reward=, the "
            "function of the run"
        )
