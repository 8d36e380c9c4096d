"""Doors for other people's learners: the follower's task as gymnasium and pettingzoo environments.

    FollowEnv         gymnasium.Env: one follower behind the leader; "workbench/Follow-v0" (planar),
                      "workbench/FollowWheels-v0"
    FollowVectorEnv   gymnasium.vector.VectorEnv: the same in many formations side by side; the same
                      ids with make_vec
    ConvoyEnv         pettingzoo.ParallelEnv: all followers of one formation, each an agent

Their options are said in their own documentation: ``help(FollowEnv)``.

>>> env = FollowEnv(observation="tiles", actions="discrete")
>>> state, _ = env.reset(seed=1)
>>> state, reward, terminated, truncated, _ = env.step(24)  # the middle of 7×7 speed pairs
>>> bool(-1.0 < reward <= 0.0), terminated, truncated
(True, False, False)

Everything below the choice of an action is the workbench's own: physics, senses with their noise,
tiles, rewards, terminal bounds and terminal reward. An episode begins with the followers in line
behind the leader, wherever it is on its track, at random places in the inner third of their bounds;
it is *terminated* when a follower loses its leader and *truncated* after a time. Followers are put
back by hand here, they do not drive back (paper II-C): that manoeuvre belongs to our own follower.

Contract: ``reset(seed=…)`` makes everything anew from that seed, track included; without a seed the
leader drives on (the very first time the configuration's seed counts, so that equal environments
side by side need seeds). Equal seeds and actions give equal results for an equal number of
formations.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from workbench.arena.picture import picture
from workbench.envs.formations import Flags, Floats, Formations
from workbench.envs.registration import register
from workbench.envs.window import Window
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.own_reward import Reward
from workbench.robot.geometry import CONTROL_PERIOD

_PLANAR = ConvoyConfig(drive="planar")
_OPTIONS = """

    Options, after the configuration (default: planar drive):
        observation: "errors": distance and bearing error in units of their bounds, clipped to ±2;
            "tiles": the number of the state tile, one more for outside the bounds; "infrared":
            eight proximity readings in counts (with infrared sensing).
        actions: "discrete": pairs of speed levels, a = i_left * levels + i_right; "continuous":
            left and right speed, from -1, the slowest level, to 1, the fastest.
        reward: a function of your own, r(u, v), see ``functions``; "shaping" or "shared-shaping":
            for progress, see ``envs.shaping``; default: the configuration's.
        seconds: of simulated time after which an episode is truncated.
        render_mode: "rgb_array": ``render`` returns a picture; "human": every step is shown, in a
            window of matplotlib's or below the cell of a notebook.

    What is so, whatever the senses say, is in ``info``: distance_m and bearing_rad of the robot in
    front, lost, and contact (the two touch). Copies (``copy.deepcopy``) and pickles go on as the
    original would.
    """
T = TypeVar("T", bound=type)


def _with_options(cls: T) -> T:
    """Add the options that all environments have to a class's documentation."""
    cls.__doc__ = f"{(cls.__doc__ or '').rstrip()}{_OPTIONS}"
    return cls


def _alone(config: ConvoyConfig) -> ConvoyConfig:
    """Return the configuration with the first follower only; what is none is refused later."""
    return config.alone() if isinstance(config, ConvoyConfig) else config


class _Shown:
    """An environment of one formation that can be looked at."""

    render_mode: str | None
    _core: Formations
    _window: Window

    @property
    def convoy(self) -> Convoy:
        """The formation, open to every use."""
        return self._core.convoy

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the arena, (240, 320, 3), with render_mode "rgb_array"."""
        return picture(self.convoy.world) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        self._window.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            self._window.show(picture(self.convoy.world))


@_with_options
class FollowEnv(_Shown, gymnasium.Env[Any, Any]):
    """One follower behind the leader, as a gymnasium environment; of a configuration's followers
    only the first is there.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": round(1 / CONTROL_PERIOD)}

    def __init__(
        self,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | str | None = None,
        seconds: float = 60.0,
        render_mode: str | None = None,
    ) -> None:
        _check_render(render_mode)
        self._core = Formations(_alone(config), 1, observation, actions, reward, seconds)
        self.config = self._core.config
        self.render_mode = render_mode
        self._window = Window()
        self._over = False
        self.observation_space = self._core.observation_space
        self.action_space = self._core.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; with a seed, make everything anew."""
        super().reset(seed=seed)
        _refuse(options)
        _begin(self._core, seed)
        self._over = False
        self._show()
        return self._see(), self._told()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out an action for 0.1 s."""
        if self._over:
            raise RuntimeError("the episode is over; call reset() first")
        reward, lost = self._core.act(np.asarray(action)[None, None])
        terminated = bool(lost[0, 0])
        truncated = bool(self._core.age[0] >= self._core.limit)
        self._over = terminated or truncated
        self._show()
        return self._see(), float(reward[0, 0]), terminated, truncated, self._told()

    def _told(self) -> dict[str, Any]:
        return {name: each[0, 0].item() for name, each in self._core.truth().items()}

    def _see(self) -> Any:
        seen = self._core.observe()[0, 0]
        return seen if self._core.observation != "tiles" else np.int64(seen)


@_with_options
class FollowVectorEnv(VectorEnv[Any, Any, Any]):
    """Many followers, each in a formation and on a track of its own, as one gymnasium vector
    environment.

    Formations whose episode has ended begin anew at the next step, whose action they ignore
    (``AutoresetMode.NEXT_STEP``).
    """

    metadata = {
        "autoreset_mode": AutoresetMode.NEXT_STEP,
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        num_envs: int = 16,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | str | None = None,
        seconds: float = 60.0,
        render_mode: str | None = None,
    ) -> None:
        _check_render(render_mode)
        self._core = Formations(_alone(config), num_envs, observation, actions, reward, seconds)
        self.config = self._core.config
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._window = Window()
        self.single_observation_space = self._core.observation_space
        self.single_action_space = self._core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, bool)

    @property
    def convoy(self) -> Convoy:
        """The formations, open to every use."""
        return self._core.convoy

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every formation, or in those of ``options["reset_mask"]``, (num_envs)
        of bool. With a seed, make everything anew: formation k from seed + k, or from seed[k].
        """
        options = dict(options or {})
        mask = _mask(options.pop("reset_mask", None), self.num_envs, seed)
        seed = _seeds(seed, self.num_envs)
        super().reset(seed=seed if isinstance(seed, int) else None)
        _refuse(options)
        if mask is None or self._core.new:
            _begin(self._core, seed)
            self._ended[:] = False
        else:
            self._core.begin(np.flatnonzero(mask))
            self._ended[mask] = False
        self._show()
        return self._core.observe()[:, 0], self._told()

    def step(self, actions: Any) -> tuple[Any, Floats, Flags, Flags, dict[str, Any]]:
        """Carry out one action per formation for 0.1 s."""
        running = np.flatnonzero(~self._ended) if self._ended.any() else None
        if running is not None:
            self._core.begin(np.flatnonzero(self._ended))
        given = np.asarray(actions)
        if not given.ndim:
            raise ValueError(f"actions = {actions!r}; expected {self.num_envs}, one per formation")
        reward, lost = self._core.act(given[:, None], running)
        terminated = lost[:, 0]
        truncated = self._core.age >= self._core.limit
        self._ended = terminated | truncated
        self._show()
        return self._core.observe()[:, 0], reward[:, 0], terminated, truncated, self._told()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of every formation, (240, 320, 3) each, with render_mode "rgb_array"."""
        shown = self.render_mode == "rgb_array"
        return tuple(picture(self.convoy.world, b) for b in range(self.num_envs)) if shown else None

    def close_extras(self, **options: Any) -> None:
        """Close the window, if there is one."""
        self._window.close()

    def _show(self) -> None:
        if self.render_mode == "human":  # the first formation
            self._window.show(picture(self.convoy.world))

    def _told(self) -> dict[str, Any]:
        told = self._core.truth()
        every = np.ones(self.num_envs, bool)  # gymnasium's way to say which have it
        return {name: each[:, 0] for name, each in told.items()} | {f"_{n}": every for n in told}


@_with_options
class ConvoyEnv(_Shown, ParallelEnv[str, Any, Any]):
    """All followers of one formation, each an agent that follows the one in front, as a pettingzoo
    parallel environment.

    When one loses its leader its episode is terminated, with the terminal reward; those of the
    others are truncated with it, as a broken line is put together again before anybody goes on.
    """

    metadata = {
        "name": "convoy_v0",
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        config: ConvoyConfig = _PLANAR,
        *,
        observation: str = "errors",
        actions: str = "discrete",
        reward: Reward | str | None = None,
        seconds: float = 60.0,
        render_mode: str | None = None,
    ) -> None:
        _check_render(render_mode)
        self._core = Formations(config, 1, observation, actions, reward, seconds)
        self.config = self._core.config
        self.render_mode = render_mode
        self._window = Window()
        self.possible_agents = [f"follower_{k}" for k in range(1, config.followers + 1)]
        self.agents: list[str] = []
        one = self._core.observation_space
        other = self._core.action_space
        self.observation_spaces = {agent: _copy(one) for agent in self.possible_agents}
        self.action_spaces = {agent: _copy(other) for agent in self.possible_agents}

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
        if options != {"options": 1}:  # with which pettingzoo's own checker resets
            _refuse(options)
        _begin(self._core, _seeds(seed, 1))
        self.agents = list(self.possible_agents)
        self._show()
        return self._see(), self._told()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Carry out every agent's action for 0.1 s."""
        if set(actions) != set(self.agents) or not self.agents:
            raise ValueError(
                f"actions for {sorted(actions)}; expected one for each of {self.agents} "
                "(none: reset first)"
            )
        reward, lost = self._core.act(
            np.stack([np.asarray(actions[agent]) for agent in self.agents])[None]
        )
        over = bool(lost.any() or self._core.age[0] >= self._core.limit)
        agents = self.agents
        seen = self._see()
        rewards = dict(zip(agents, reward[0].tolist(), strict=True))
        terminated = dict(zip(agents, lost[0].tolist(), strict=True))
        truncated = {agent: over and not terminated[agent] for agent in agents}
        if over:
            self.agents = []
        self._show()
        return seen, rewards, terminated, truncated, self._told()

    def _told(self) -> dict[str, dict[str, Any]]:
        told = self._core.truth()
        return {
            agent: {name: each[0, k].item() for name, each in told.items()}
            for k, agent in enumerate(self.possible_agents)
        }

    def _see(self) -> dict[str, Any]:
        seen = self._core.observe()[0]
        return {
            agent: np.int64(row) if row.ndim == 0 else row
            for agent, row in zip(self.possible_agents, seen, strict=True)
        }


def _seeds(seed: Any, count: int) -> int | list[int] | None:
    """Return a seed, or one for each of several formations.

    Raises:
        ValueError: it is nothing of these.
    """
    alone = seed is None or isinstance(seed, (int, np.integer))
    several = [seed or 0] if alone else _listed(seed)
    whole = all(isinstance(each, (int, np.integer)) and each >= 0 for each in several)
    if alone and whole:
        return None if seed is None else int(seed)
    if len(several) != count or not whole:
        raise ValueError(
            f"seed = {seed!r}; expected one whole number from 0 on (formation k is made from "
            f"seed + k), or {count} of them"
        )
    return [int(each) for each in several]


def _listed(seed: Any) -> list[Any]:
    return list(seed) if isinstance(seed, (list, tuple, np.ndarray)) else []


def _mask(mask: Any, count: int, seed: Any) -> Flags | None:
    """Return which formations begin anew, None for all.

    Raises:
        ValueError: it is no mask, or comes with a seed.
    """
    if mask is None:
        return None
    found = np.asarray(mask)
    if found.shape != (count,) or found.dtype != np.bool_:
        raise ValueError(f"options['reset_mask'] = {mask!r}; expected ({count},) of True or False")
    if seed is not None:
        raise ValueError(
            f"seed = {seed!r} with options['reset_mask']; expected one or the other: a seed makes "
            "all formations anew"
        )
    return found


def _begin(core: Formations, seed: int | list[int] | None) -> None:
    """Begin episodes; the first time, or with a seed, make everything anew."""
    if seed is not None or core.new:
        core.build(core.config.seed if seed is None else seed)
    else:
        core.begin(np.arange(core.formations))


def _refuse(options: dict[str, Any] | None) -> None:
    """Refuse options of a reset: none would be followed."""
    if options:
        raise ValueError(
            f"options = {options!r}; expected none (of many formations, reset_mask): what an "
            "episode is like is said when the environment is made (config, seconds), its chance "
            "by seed"
        )


def _check_render(render_mode: str | None) -> None:
    if render_mode not in (None, "rgb_array", "human"):
        raise ValueError(f"render_mode = {render_mode!r}; expected None, 'rgb_array' or 'human'")


def _copy(space: spaces.Space[Any]) -> spaces.Space[Any]:
    """Return an equal space with a random state of its own."""
    if isinstance(space, spaces.Discrete):
        return spaces.Discrete(int(space.n))
    assert isinstance(space, spaces.Box)
    return spaces.Box(space.low, space.high, space.shape, np.float32)


_WHEELS = ConvoyConfig(drive="wheels")


def follow_on_wheels(config: ConvoyConfig = _WHEELS, **options: Any) -> FollowEnv:
    """Return a FollowEnv, on wheels by default."""
    return FollowEnv(config, **options)


def follow_on_wheels_vector(
    num_envs: int = 16, config: ConvoyConfig = _WHEELS, **options: Any
) -> FollowVectorEnv:
    """Return a FollowVectorEnv, on wheels by default."""
    return FollowVectorEnv(num_envs, config, **options)


register()
