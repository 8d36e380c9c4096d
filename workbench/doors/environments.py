"""Doors for other people's learners: the follower's task as gymnasium and pettingzoo environments.

    FollowEnv         gymnasium.Env: one follower behind the leader; "workbench/Follow-v0" (planar), "workbench/FollowWheels-v0"
    FollowVectorEnv   gymnasium.vector.VectorEnv: the same in many formations side by side; the same ids with make_vec
    ConvoyEnv         pettingzoo.ParallelEnv: all followers of one formation, each an agent

Options of all three, after the configuration (default: planar drive):

    observation   "errors": distance and bearing error in units of their bounds, clipped to ±2; "tiles": the number of the state
                  tile, one more for outside the bounds; "infrared": eight proximity readings in counts (with infrared sensing)
    actions       "discrete": pairs of speed levels, a = i_left * levels + i_right; "continuous": left and right speed, from
                  -1, the slowest level, to 1, the fastest
    reward        a function of your own, r(u, v), see ``workbench.formation.own``; default: the configuration's
    seconds       of simulated time after which an episode is truncated

>>> env = FollowEnv(observation="tiles", actions="discrete")
>>> state, _ = env.reset(seed=1)
>>> state, reward, terminated, truncated, _ = env.step(24)  # the middle of 7×7 speed pairs
>>> bool(-1.0 < reward <= 0.0), terminated, truncated
(True, False, False)

Everything below the choice of an action is the workbench's own: physics, senses with their noise, tiles, rewards, terminal bounds
and terminal reward. An episode begins with the followers in line behind the leader, wherever it is on its track, at random places
in the inner third of their bounds; it is *terminated* when a follower loses its leader and *truncated* after a time. Followers
are put back by hand here, they do not drive back (paper II-C): that manoeuvre belongs to our own follower.

Contract: ``reset(seed=…)`` makes everything anew from that seed, track included; without a seed the leader drives on. Equal seeds
and actions give equal results for an equal number of formations.
"""

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from workbench.arena.picture import picture
from workbench.formation.classical import Outside
from workbench.formation.config import INFRARED, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.own import Reward, own_reward
from workbench.formation.reward import OWN
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.infrared import ADC, SENSORS

OBSERVATIONS = ("errors", "tiles", "infrared")
ACTIONS = ("discrete", "continuous")
CLIP = 2.0  # errors in units of their bounds, at most
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]


class _Formations:
    """B formations whose followers are told what to do, period by period: what all environments here have in common."""

    def __init__(
        self, config: ConvoyConfig, formations: int, observation: str, actions: str, reward: Reward | None, seconds: float
    ) -> None:
        for name, value, options in (("observation", observation, OBSERVATIONS), ("actions", actions, ACTIONS)):
            if value not in options:
                raise ValueError(f"{name} = {value!r}; expected one of {', '.join(map(repr, options))}")
        if observation == "infrared" and config.sensing not in INFRARED:
            raise ValueError(
                f"observation = {observation!r} with sensing = {config.sensing!r}; expected sensing = 'ir-metric' or 'ir-raw': "
                "then the bounds are judged by what the robot sees, too"
            )
        if formations < 1 or not 0 < seconds < math.inf:
            raise ValueError(f"formations = {formations!r}, seconds = {seconds!r}; expected at least 1, and more than 0")
        self.own = own_reward(reward) if reward is not None else None
        self.config = replace(config, reward=OWN) if self.own is not None else config
        self.formations, self.observation, self.discrete = formations, observation, actions == "discrete"
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
            spaces.Discrete(config.actions) if self.discrete else spaces.Box(-1.0, 1.0, (2,), np.float32)
        )

    def build(self, seed: int, rng: np.random.Generator) -> None:
        """Make all formations anew and begin an episode in each."""
        seeds = [seed + k for k in range(self.formations)]
        self.convoy = Convoy(self.config, seeds, periods=10**12, law=Outside(), reward=self.own, threads=1)
        self.rng, self.t = rng, 0
        self.age = np.zeros(self.formations, np.int64)
        for b in range(self.formations):
            self.line_up(b)
        self.sense()

    def line_up(self, b: int) -> None:
        """Put the followers of formation b behind its leader, at random places in the inner third of their bounds."""
        config, world = self.config, self.convoy.world
        x, y, heading = world.pose(b, 0)
        for robot in range(1, world.robots):
            gap, aspect, bearing = self.rng.uniform(-1 / 3, 1 / 3, 3)
            distance = config.middle_m + gap * config.half_range_m
            towards = heading + aspect * config.bearing_limit_rad
            x, y = x - distance * math.cos(towards), y - distance * math.sin(towards)
            heading = towards - bearing * config.bearing_limit_rad
            world.place(b, robot, x, y, heading)
        self.convoy.begin_again(b)
        self.age[b] = 0

    def sense(self) -> tuple[Floats, Flags]:
        """Let everybody sense; return rewards and losses of the actions that end now, (B, followers) each."""
        steps = self.convoy.period(self.t)
        return steps["reward"][:, 1:].astype(np.float64), steps["event"][:, 1:] & LOSS != 0

    def act(self, actions: NDArray[Any], running: NDArray[np.int64] | None = None) -> tuple[Floats, Flags]:
        """Carry out actions (B, followers[, 2]) for one control period, in all formations or those named; see ``sense``."""
        if self.discrete:
            number = actions.astype(np.int64)
            left = self.left_steps[number // len(self.right_steps)]
            right = self.right_steps[number % len(self.right_steps)]
        else:
            low, high = self.config.wheel_speed_mps
            speeds = low + (np.clip(actions.astype(np.float64), -1.0, 1.0) + 1.0) / 2 * (high - low)
            left, right = np.moveaxis(np.round(speeds / self.config.robot.step_m).astype(np.int64), -1, 0)
        self.convoy.command_all(np.ascontiguousarray(left), np.ascontiguousarray(right), self.t)
        self.convoy.world.step(running)
        self.t += 1
        self.age[slice(None) if running is None else running] += 1
        return self.sense()

    def observe(self) -> NDArray[Any]:
        """Return what the followers see, (B, followers) or (B, followers, n)."""
        robots = self.convoy.robots[:, 1:]
        if self.observation == "tiles":
            state = robots["state"]
            return np.where(state < 0, self.states, state)
        if self.observation == "infrared":
            return robots["prox"].astype(np.float32)
        u = (robots["seen_distance"] - self.config.middle_m) / self.config.half_range_m
        v = robots["seen_bearing"] / self.config.bearing_limit_rad
        return np.clip(np.stack([u, v], axis=-1), -CLIP, CLIP).astype(np.float32)


_PLANAR = ConvoyConfig(drive="planar")


class FollowEnv(gymnasium.Env[Any, Any]):
    """One follower behind the leader, as a gymnasium environment; of a configuration's followers only the first is there."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1 / CONTROL_PERIOD)}

    def __init__(
        self,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | None = None,
        seconds: float = 60.0,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}; expected None or 'rgb_array'")
        self._core = _Formations(replace(config, followers=1), 1, observation, actions, reward, seconds)
        self.config, self.render_mode = self._core.config, render_mode
        self.observation_space, self.action_space = self._core.observation_space, self._core.action_space

    @property
    def convoy(self) -> Convoy:
        """The formation, open to every use."""
        return self._core.convoy

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; with a seed, make everything anew."""
        super().reset(seed=seed)
        if seed is not None or not hasattr(self._core, "convoy"):
            self._core.build(self.config.seed if seed is None else seed, self.np_random)
        else:
            self._core.line_up(0)
            self._core.sense()
        return self._see(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out an action for 0.1 s."""
        reward, lost = self._core.act(np.asarray(action)[None, None])
        return self._see(), float(reward[0, 0]), bool(lost[0, 0]), bool(self._core.age[0] >= self._core.limit), {}

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the arena, (240, 320, 3), with render_mode "rgb_array"."""
        return picture(self.convoy.world) if self.render_mode else None

    def _see(self) -> Any:
        seen = self._core.observe()[0, 0]
        return seen if self._core.observation != "tiles" else np.int64(seen)


class FollowVectorEnv(VectorEnv[Any, Any, Any]):
    """Many followers, each in a formation and on a track of its own, as one gymnasium vector environment.

    Formations whose episode has ended begin anew at the next step, whose action they ignore (``AutoresetMode.NEXT_STEP``).
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 16,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | None = None,
        seconds: float = 60.0,
    ) -> None:
        self._core = _Formations(replace(config, followers=1), num_envs, observation, actions, reward, seconds)
        self.config, self.num_envs = self._core.config, num_envs
        self.single_observation_space, self.single_action_space = self._core.observation_space, self._core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, bool)

    @property
    def convoy(self) -> Convoy:
        """The formations, open to every use."""
        return self._core.convoy

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every formation; with a seed, make everything anew: formation k from seed + k."""
        if isinstance(seed, list):
            if [None if one is None else one - k for k, one in enumerate(seed)] != [seed[0]] * self.num_envs:
                raise ValueError(f"seed = {seed!r}; expected one number, for formation k it is seed + k")
            seed = seed[0]
        super().reset(seed=seed)
        if seed is not None or not hasattr(self._core, "convoy"):
            self._core.build(self.config.seed if seed is None else seed, self.np_random)
        else:
            for b in range(self.num_envs):
                self._core.line_up(b)
            self._core.sense()
        self._ended[:] = False
        return self._core.observe()[:, 0], {}

    def step(self, actions: Any) -> tuple[Any, Floats, Flags, Flags, dict[str, Any]]:
        """Carry out one action per formation for 0.1 s."""
        running = np.flatnonzero(~self._ended) if self._ended.any() else None
        for b in np.flatnonzero(self._ended).tolist():
            self._core.line_up(b)
        reward, lost = self._core.act(np.asarray(actions)[:, None], running)
        terminated, truncated = lost[:, 0], self._core.age >= self._core.limit
        self._ended = terminated | truncated
        return self._core.observe()[:, 0], reward[:, 0], terminated, truncated, {}


class ConvoyEnv(ParallelEnv[str, Any, Any]):
    """All followers of one formation, each an agent that follows the one in front, as a pettingzoo parallel environment.

    When one loses its leader its episode is terminated, with the terminal reward; those of the others are truncated with it, as a
    broken line is put together again before anybody goes on.
    """

    metadata = {
        "name": "convoy_v0", "render_modes": ["rgb_array"], "render_fps": round(1 / CONTROL_PERIOD)
    }  # fmt: skip

    def __init__(
        self,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | None = None,
        seconds: float = 60.0,
        render_mode: str | None = None,
    ) -> None:
        self._core = _Formations(config, 1, observation, actions, reward, seconds)
        self.config, self.render_mode = self._core.config, render_mode
        self.possible_agents = [f"follower_{k}" for k in range(1, config.followers + 1)]
        self.agents: list[str] = []
        one, other = self._core.observation_space, self._core.action_space
        self.observation_spaces = {agent: _copy(one) for agent in self.possible_agents}
        self.action_spaces = {agent: _copy(other) for agent in self.possible_agents}

    @property
    def convoy(self) -> Convoy:
        """The formation, open to every use."""
        return self._core.convoy

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode; with a seed, make everything anew."""
        if seed is not None or not hasattr(self._core, "convoy"):
            start = self.config.seed if seed is None else seed
            self._core.build(start, np.random.default_rng(start))
        else:
            self._core.line_up(0)
            self._core.sense()
        self.agents = list(self.possible_agents)
        return self._see(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Carry out every agent's action for 0.1 s."""
        if set(actions) != set(self.agents) or not self.agents:
            raise ValueError(f"actions for {sorted(actions)}; expected one for each of {self.agents} (none: reset first)")
        reward, lost = self._core.act(np.stack([np.asarray(actions[agent]) for agent in self.agents])[None])
        over = bool(lost.any() or self._core.age[0] >= self._core.limit)
        agents, seen = self.agents, self._see()
        rewards = dict(zip(agents, reward[0].tolist(), strict=True))
        terminated = dict(zip(agents, lost[0].tolist(), strict=True))
        truncated = {agent: over and not terminated[agent] for agent in agents}
        if over:
            self.agents = []
        return seen, rewards, terminated, truncated, {agent: {} for agent in agents}

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the arena, (240, 320, 3), with render_mode "rgb_array"."""
        return picture(self.convoy.world) if self.render_mode else None

    def _see(self) -> dict[str, Any]:
        seen = self._core.observe()[0]
        return {agent: np.int64(row) if row.ndim == 0 else row for agent, row in zip(self.possible_agents, seen, strict=True)}


def _copy(space: spaces.Space[Any]) -> spaces.Space[Any]:
    """Return an equal space with a random state of its own."""
    if isinstance(space, spaces.Discrete):
        return spaces.Discrete(int(space.n))
    assert isinstance(space, spaces.Box)
    return spaces.Box(space.low, space.high, space.shape, np.float32)


for _id, _drive in (("workbench/Follow-v0", "planar"), ("workbench/FollowWheels-v0", "wheels")):
    if _id not in gymnasium.registry:
        gymnasium.register(
            _id,
            entry_point=f"{__name__}:FollowEnv",
            vector_entry_point=f"{__name__}:FollowVectorEnv",
            kwargs={"config": ConvoyConfig(drive=_drive)},
        )
