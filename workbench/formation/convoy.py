"""The convoy: joins world, leader, followers and learners, and yields blocks of step records.

A convoy runs B formations side by side, one per seed, each with its own track, chance, weights and
physics. One compiled call per formation (``formation.control.run_formation``) does a whole block:
every robot senses, acts and learns, and MuJoCo steps. With pictures, and for who drives a robot
from outside, one compiled call per control period does it all but the physics.

Chance: named generators of every formation's seed (``formation.streams``), drawn in advance for a
whole block.

>>> convoy = Convoy(ConvoyConfig(followers=1, drive="planar"), [1], steps=50)
>>> block = convoy.run_block()
>>> int(convoy.updates[0]), block.shape
(50, (1, 2500, 2))

Contract: arrays are written, never replaced. The block is the same array at every call, (B, BLOCK,
followers + 1) of type PERIOD, robot 0 the leader; copy what you keep. Steps after a formation has
finished have phase -1. ``state`` between blocks is everything: ``load`` continues as if never
stopped.
"""

import functools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any

import mujoco
import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.arena.camera.eyes import Eyes
from workbench.arena.engine import ENGINE, Engine, engine_of
from workbench.arena.world import World
from workbench.formation.assignment import assign
from workbench.formation.body import draw_bodies
from workbench.formation.config import ConvoyConfig
from workbench.formation.control import (
    DIVERGED,
    Arrays,
    carry_out,
    carry_out_all,
    control_step,
    halves,
    run_formation,
)
from workbench.formation.follower import begin_episode
from workbench.formation.initial_weights import first_weights
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.outside import Outside
from workbench.formation.laws.table import check_law
from workbench.formation.leader import GONE
from workbench.formation.lean import is_plain, lean
from workbench.formation.own_reward import OwnReward, check_reward, trouble
from workbench.formation.places import track_of
from workbench.formation.records import CHANCE, FORMATION, PERIOD, ROBOT
from workbench.formation.reset import FOLLOW
from workbench.formation.reward import GRAPH
from workbench.formation.senses.infrared import equip as fit_sensors
from workbench.formation.senses.sense import EVERYBODY, FOLLOWERS, LEADER, Draw
from workbench.formation.senses.table import SENSES
from workbench.formation.shapes import places
from workbench.formation.streams import CHILDREN, children
from workbench.formation.task import fill_task, graph_of, terminal_of
from workbench.formation.virtual import CRUMBS
from workbench.learning.gq import not_finite
from workbench.learning.kernel import new_trace
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.ground import MODULES, WHITE

BLOCK = 2500  # control periods

_ENTRIES: dict[Any, Any] = {}  # compiled functions by what they are called with

_UNUSED = np.zeros((), PERIOD)
_UNUSED["phase"] = _UNUSED["state"] = _UNUSED["action"] = -1


def longest(steps: int, learners: int) -> int:
    """Return the control periods after which learning is given up: twenty times what undisturbed
    learning needs, and some.
    """
    return 20 * math.ceil(steps / learners) + 10 * BLOCK


class Convoy:
    """B formations of one leader and its followers, one per seed, learning or exploiting.

    Args:
        config: everything but the seed, which is replaced by each entry of ``seeds``.
        seeds: (B,) one seed per formation.
        steps: learning updates per formation, summed over its followers; 0 for a greedy, frozen
            evaluation.
        periods: control periods at most; default for learning: twenty times what undisturbed
            learning needs.
        policy: (tables, rows, actions) main weights to start from or to exploit, or one such array
            per seed, (B, …); or, without learning, a classical law that drives all followers.
        reward: the user's own reward, where the configuration says reward = "own".
        horizon: updates over which schedules are stretched, default ``steps``; a shorter run is
            then how a longer one begins.
        external: a robot that somebody else drives, period by period (``period``); 0 is the leader.
        furnish: adds walls and boxes to the world; robots bump into them, but only
            ``SimulatedRobot`` sees them.
        threads: for the formations, 0 for one per core.

    Attributes:
        world: the physics, open to every use.
        weights: (B, tables, 2, rows * actions) main and secondary weights.
        task: (1,) record of type TASK.
        robots: (B, followers + 1) records of type ROBOT, robot 0 the leader.
        updates: (B,) learning updates done.
        finished: whether all formations have used up their steps or periods.
    """

    def __init__(
        self,
        config: ConvoyConfig,
        seeds: Sequence[int],
        *,
        steps: int = 0,
        periods: int | None = None,
        policy: NDArray[np.float64] | ControlLaw | None = None,
        reward: OwnReward | None = None,
        horizon: int | None = None,
        external: int | None = None,
        furnish: Callable[[mujoco.MjSpec], None] | None = None,
        threads: int = 0,
    ) -> None:
        if not seeds:
            raise ValueError("seeds is empty; expected at least one seed")
        _check_length(steps, periods)
        law = policy if isinstance(policy, ControlLaw) else None
        theta = None if isinstance(policy, ControlLaw) else policy
        if law is not None:
            _check_lawful(law, config, steps)
        check_reward(config, reward, learning=steps > 0)
        self.config = config
        self.seeds = tuple(seeds)
        self._learning = steps > 0
        self._law = law
        self._owner = reward or law  # of what may fail in the loop
        self.rngs = [children(seed, config.fleet) for seed in seeds]
        tracks = [track_of(config, rng["track"]) for rng in self.rngs]
        self.world = World(
            config.followers,
            tracks,
            drive=config.drive,
            spacing_m=config.middle_m,
            line_width_m=config.track.line_width_m,
            robot=config.robot,
            threads=threads,
            furnish=furnish,
        )
        self.weights = first_weights(config, len(seeds), theta, learning=self._learning)
        self.task = fill_task(config, horizon or steps, law, reward)
        self.task["leader"]["column0"] = self.world.floor.column0
        self.task["leader"]["row0"] = self.world.floor.row0
        self.robots = self._fleet(steps)
        self._formations = self._counters(steps, periods)
        self._equip(external)
        self._draws = self._what_is_drawn()
        self._bind()
        if config.formation.shaped:
            self.instruct(config.formation.shape, config.formation.points)

    def instruct(self, shape: str, points: ArrayLike = ()) -> None:
        """Ask all formations for a shape; places move there while robots drive on.

        Args:
            shape: one of ``shapes.SHAPES``; points: of shape "points", (followers, 2) m forward and
                left of the leader.

        Raises:
            ValueError: an unknown shape, places that no robot can keep, or followers that keep no
                places (``ConvoyConfig.formation.frame``).
        """
        frame = self.config.formation.relative_to
        if frame == "predecessor":
            raise ValueError(
                f"formation.frame = {frame!r}; followers of the robot in front keep no places: "
                "expected 'heading' or 'path'"
            )
        if shape == "random" and not self.task["shape"]["width"][0]:
            raise ValueError(
                "shape = 'random'; places are drawn in convoys that are made so: expected "
                "ConvoyConfig.formation.shape = 'random' from the start"
            )
        told = replace(self.config.formation, shape=shape, points=_pairs(points), frame=frame)
        config = replace(self.config, formation=told)
        goals = places(shape, config.followers, config.spacing_m, points)
        self.task["shape"]["hold"] = told.hold_periods if shape == "random" else 0
        for name, value in graph_of(config).items():
            self.task["graph"][name] = value
        if config.reward == GRAPH:
            self.task["reward"]["terminal"] = terminal_of(config)
        for b, place in enumerate(self.robots["place"][:, 1:]):
            here = np.stack([place["x"], place["y"]], axis=-1)
            if not self._formations["crumbs"][b]:  # they line up in a column
                here = places("column", config.followers, config.middle_m)
            order = assign(told.assignment, here, goals)
            place["goal_x"], place["goal_y"] = goals[order].T
            place["holder"][order] = np.arange(1, config.followers + 1)

    @property
    def goals(self) -> NDArray[np.float64]:
        """(B, followers, 2) where places are, or move to, in the leader's frame, m."""
        place = self.robots["place"][:, 1:]
        return np.stack([place["goal_x"], place["goal_y"]], axis=-1)

    @property
    def places(self) -> NDArray[np.float64]:
        """(B, followers, 2) where places are now on the floor, m."""
        place = self.robots["place"][:, 1:]
        ahead = np.stack([place["ahead_x"], place["ahead_y"]], axis=-1)
        towards = np.stack([place["ahead_cos"], place["ahead_sin"]], axis=-1)
        return ahead - self.config.middle_m * towards

    @property
    def block(self) -> NDArray[np.void]:
        """(B, BLOCK, followers + 1) of type PERIOD, the block that runs."""
        return self._block

    def _equip(self, external: int | None) -> None:
        """Give the robots what they sense with; note who is driven from outside."""
        if external is not None:
            self._leave_to_others(external)
        # somebody outside may look at all that a robot has
        self.task["infrared"]["all"] = external is not None or isinstance(self._law, Outside)
        self.has_sensors = False
        self.eyes = list[Eyes]()
        self.lens = np.zeros((len(self.seeds), 3, 2, 2))
        SENSES[self.config.sensing].equip(self)
        if external is not None and not self.has_sensors:
            fit_sensors(self)

    def _leave_to_others(self, robot: int) -> None:
        """Note which robot somebody else drives."""
        if not 0 <= robot <= self.config.followers:
            raise ValueError(
                f"external = {robot!r}; this convoy has robots 0 (the leader) to "
                f"{self.config.followers}"
            )
        self.task["run"]["external"] = robot
        self.task["run"]["moving"] = self.config.followers + 1

    def _fleet(self, steps: int) -> NDArray[np.void]:
        """Return the robots' records, (B, followers + 1), as they are before anything happens."""
        config = self.config
        robots = np.zeros((len(self.seeds), config.followers + 1), ROBOT)
        robots["choice"]["state"] = -1
        robots["ahead"] = np.arange(-1, config.followers)
        robots["place"]["holder"] = np.arange(config.followers + 1)
        if config.formation.shaped:
            robots["ahead"][:, 1:] = 0
        self._first_side = -1.0 if config.track.direction == "clockwise" else 1.0
        ground = robots["ground"]
        ground["line_side"] = self._first_side
        black = MODULES[config.ground]
        ground["white"] = ground["knows_white"] = WHITE
        ground["black"] = black
        ground["knows_black"] = black if config.ground_calibrated else MODULES["a"]
        learning = robots["learning"]
        if self.weights.shape[1] > 1:
            learning["table"][:, 1:] = np.arange(config.followers)
        if steps:
            learning["learns"][:, 1:] = 1
            if config.weights == "first":
                learning["learns"][:, 2:] = 0
        if not config.body.nominal:
            for own, rng in zip(robots["body"], self.rngs, strict=True):
                wheel, axle = draw_bodies(rng["bodies"], config.body, config.followers + 1)
                own["wheel"] = wheel
                own["axle"] = axle
        return robots

    def _counters(self, steps: int, periods: int | None) -> NDArray[np.void]:
        """Return the formations' counters, (B,), with how many updates and periods they may do."""
        counters = np.zeros(len(self.seeds), FORMATION)
        counters["budget"] = steps if steps else np.iinfo(np.int64).max
        learners = 1 if self.config.weights == "first" else self.config.followers
        counters["last_period"] = periods or longest(steps, learners)
        return counters

    def _what_is_drawn(self) -> list[Draw]:
        """Return what is drawn in advance for a block. The order decides nothing: every stream is
        its own.
        """
        config = self.config
        draws = [
            Draw("ground", (3,), "sensor", LEADER),
            Draw("explore", (), "policy", FOLLOWERS, uniform=True),
        ]
        if config.noisy:
            draws.append(Draw("noise", (2,), "noise", FOLLOWERS))
        draws += SENSES[config.sensing].draws
        if not config.body.nominal:
            draws.append(Draw("slip", (2,), "slip", EVERYBODY))
            draws.append(Draw("silence", (), "silence", EVERYBODY, uniform=True))
        if self.task["shape"]["hold"][0]:
            draws.append(Draw("place", (2,), "places", FOLLOWERS, uniform=True))
        return draws

    def _bind(self) -> None:
        """Bring together all that the loop reads and writes, and compile it for these types."""
        config = self.config
        count = len(self.seeds)
        n = config.followers
        index, _, slot = new_trace(config.rows * config.action_count)
        self._trace_ids = np.tile(np.stack([index, slot, index]), (count, n, 1, 1))
        self._trace_values = np.zeros((count, n, 2, index.size))
        self._waiting = np.zeros_like(self.world.ctrl)  # commands that wait for an update
        self._chance = np.zeros((count, BLOCK, n + 1), CHANCE)
        self._block = np.full((count, BLOCK, n + 1), _UNUSED)
        self._sights = np.zeros((count, n + 1, 4))
        self._trail = np.zeros((count, CRUMBS if config.formation.shaped else 1, 3))
        self._arrays = Arrays(
            task=self.task,
            qpos=self.world.qpos,
            ctrl=self.world.ctrl,
            waiting=self._waiting,
            floor=self.world.floor.raster,
            formations=self._formations,
            robots=self.robots,
            weights=self.weights,
            trace_ids=self._trace_ids,
            trace_values=self._trace_values,
            chance=self._chance,
            block=self._block,
            sights=self._sights,
            lens=self.lens,
            engines=np.zeros(count, ENGINE),
            trail=self._trail,
        )
        if self.task["run"]["external"][0] >= 0:  # nobody on a wire waits for a compiler
            _ = self._act_all

    # what a convoy runs by is compiled, and made, when it is first needed: whole blocks, or periods

    @functools.cached_property
    def _act_all(self) -> Any:
        """The compiled control period of all formations, all but the physics."""
        # period by period something else takes the time: shapes get no lean loop of their own there
        lean_one = self.plain and not self.config.formation.shaped
        step = lean(control_step, shaped=False) if lean_one else control_step
        return _for_types(step, 0, self._arrays)

    @functools.cached_property
    def _run_formation(self) -> Any:
        """The compiled block of one formation, physics included."""
        return _for_types(self._of_loop(run_formation), 0, False, 0, self._arrays)

    @property
    def plain(self) -> bool:
        """Whether the lean loop does what is asked for, see ``formation.lean``."""
        return is_plain(self.config, self._law)

    def compile(self, *, periods: bool = False) -> None:
        """Compile what whole blocks are run by, and single periods if asked for; it is done anyhow
        when it is needed.
        """
        _ = self._run_formation if self._engine is not None else self._act_all
        if periods:
            _ = self._act_all

    @property
    def loop(self) -> Any:
        """The compiled function that does a block of one formation; None where Python goes from
        period to period.
        """
        return self._of_loop(run_formation) if self._engine is not None else None

    def parts(self, half: int) -> list[tuple[Any, tuple[Any, ...]]]:
        """Return the compiled functions of half 0 or 1 of the loop, and their types."""
        return [
            (self._of_loop(part), tuple(numba.typeof(argument) for argument in arguments))
            for part, arguments in halves(self._arrays, lean=self.plain)[half]
        ]

    def _of_loop(self, function: Any) -> Any:
        """Return a function of ``control`` as the loop has it."""
        return lean(function, shaped=self.config.formation.shaped) if self.plain else function

    @functools.cached_property
    def _pool(self) -> ThreadPoolExecutor:
        """The threads that run formations."""
        return ThreadPoolExecutor(self.world.threads)

    @functools.cached_property
    def _engine(self) -> Engine | None:
        """The physics in compiled code; None with pictures, which need Python in every period, and
        where MuJoCo cannot be called from there.
        """
        engine = None if self.eyes else engine_of(self.world, late=self.config.delay_steps)
        if engine is not None:
            self._arrays.engines[:] = engine.records
        return engine

    @property
    def updates(self) -> NDArray[np.int64]:
        """(B,) learning updates done so far."""
        updates: NDArray[np.int64] = self._formations["updates"]
        return updates

    @property
    def periods(self) -> NDArray[np.int64]:
        """(B,) control periods done so far."""
        periods: NDArray[np.int64] = self._formations["periods"]
        return periods

    @property
    def resting(self) -> NDArray[np.int64]:
        """(B,) 1 for formations that take no part in ``period`` and ``command_all``, a live view:
        set it to leave some out.
        """
        resting: NDArray[np.int64] = self._formations["done"]
        return resting

    @property
    def finished(self) -> bool:
        """Whether every formation has used up its steps or periods."""
        return bool(np.all(self._formations["done"]))

    @property
    def trace_entries(self) -> NDArray[np.int64]:
        """(B, followers) entries of each follower's eligibility trace now."""
        entries: NDArray[np.int64] = self.robots["learning"]["trace"][:, 1:].copy()
        return entries

    def steps(self) -> Iterator[list[NDArray[np.void]]]:
        """Run to the end, block by block: the one loop of every run. Who drives a robot from
        outside goes on period by period (``period``).

        Yields:
            What happened, (periods, followers + 1) of PERIOD a formation: views of the block, so
            copy what you keep. Formations that have finished have no periods.
        """
        while not self.finished:
            before = self.periods.copy()
            block = self.run_block()
            yield [block[b, :done] for b, done in enumerate(self.periods - before)]

    def whole(self) -> NDArray[np.void]:
        """Run one formation to the end and return all that happened, (T, followers + 1)."""
        kept: NDArray[np.void] = np.concatenate([steps.copy() for [steps] in self.steps()])
        return kept

    def run_block(self) -> NDArray[np.void]:
        """Run up to BLOCK control periods and return their records, (B, BLOCK, followers + 1) of
        type PERIOD.

        Raises:
            FloatingPointError: learning diverged; the message names seed, update, norms and step
                sizes.
            RuntimeError: the physics became unstable.
        """
        before = self.periods.copy()
        engine = self._engine
        if engine is not None:
            self._run_formations(engine)
        else:
            self._draw_all()
            self._run_periods()
        for b, done in enumerate(self.periods - before):
            self._block[b, done:] = _UNUSED
            if done:  # a formation that has just finished took no step after its last commands
                self.world.check(b, int(self.periods[b]) - int(self._formations["done"][b]))
        self._check_leaders()
        return self._block

    def _check_leaders(self) -> None:
        """Raise RuntimeError if a leader that drives by itself has stopped, as its ground sensors
        see no line any more.
        """
        gone = np.flatnonzero(self.robots["reset"]["timer"][:, 0] > GONE)
        if not gone.size or self.task["run"]["external"][0] == 0:
            return
        b = int(gone[0])
        pose = self.robots["pose"][b, 0]
        away = abs(float(self.world.tracks[b].deviation([(pose["x"], pose["y"])])[0]))
        raise RuntimeError(
            f"seed {self.seeds[b]}: the leader has lost its line and stopped, {away:.3f} m from "
            f"it, within {int(self.periods[b]) * CONTROL_PERIOD:.0f} s: expected a slower "
            "leader_speed_mps, wider curves (track.radius_m), less judder, or a robot whose sizes "
            "fit each other (RobotConfig)"
        )

    def _run_formations(self, physics: Engine) -> None:
        """Run a block formation by formation, physics in compiled code, on as many threads as the
        world has.
        """
        _ = self._run_formation  # compiled once, before threads ask for it
        waiting = np.flatnonzero(self._formations["done"] == 0).tolist()
        threads = min(self.world.threads, len(waiting))
        if threads < 2:
            for b in waiting:
                self._run_one(physics, b)
            return
        running = [self._pool.submit(self._run_one, physics, b) for b in waiting]
        try:
            for formation in running:
                formation.result()
        finally:  # what fails, or is interrupted, leaves nobody running
            for formation in running:
                formation.cancel()
            wait(running)

    def _run_one(self, physics: Engine, b: int) -> None:
        """Run a block of one formation."""
        self._draw(b)
        physics.begin(b)
        t, flags = self._run_formation(0, False, b, self._arrays)
        while flags:
            physics.end(b)
            self._attend(flags, t, [b])
            physics.begin(b)
            t, flags = self._run_formation(t, True, b, self._arrays)
        physics.end(b)

    def _run_periods(self) -> None:
        """Run a block period by period, all formations side by side."""
        act_all = self._act_all
        arrays = self._arrays
        substeps = self.world.substeps
        step = self.world.batch.step
        running = self._running()
        delay = self.config.delay_steps
        ctrl = self.world.ctrl
        for t in range(BLOCK):
            if self.eyes:
                self.look()
            flags = act_all(t, arrays)
            if flags:
                self._attend(flags, t, range(len(self.seeds)))
                running = self._running()
                if self.finished:
                    break
            if delay:
                step(running, nstep=delay)
                _release(ctrl, self._waiting, running)
            if substeps > delay:
                step(running, nstep=substeps - delay)

    def period(self, t: int) -> NDArray[np.void]:
        """Sense, act and learn once, without physics: for a convoy with an external robot;
        ``world.step`` advances it.

        Args:
            t: control periods since the start; chance is drawn anew at every multiple of BLOCK.

        Returns:
            (B, followers + 1) of type PERIOD, a view: what happened.
        """
        if t % BLOCK == 0:
            self._draw_all()
        if self.eyes:
            self.look()
        flags = self._act_all(t % BLOCK, self._arrays)
        if flags:
            self._attend(flags, t % BLOCK, range(len(self.seeds)))
        self._check_leaders()
        steps: NDArray[np.void] = self._block[:, t % BLOCK]
        return steps

    def command(self, robot: int, left: int, right: int, t: int) -> None:
        """Tell a robot that somebody else drives its wheel speeds in steps/s for period t, as its
        body carries them out.
        """
        for b in range(len(self.seeds)):
            carry_out(
                self.task,
                self.robots[b],
                self.world.ctrl[b],
                robot,
                left,
                right,
                self._chance[b, t % BLOCK],
            )

    def command_all(self, left: NDArray[np.int64], right: NDArray[np.int64], t: int) -> None:
        """Tell all followers that are driven from outside (law ``Outside``) their wheel speeds for
        period t.

        Args:
            left, right: (B, followers) whole steps/s; those of a follower that is driving back, or
                of a formation that rests, are ignored.

        Raises:
            ValueError: another shape.
        """
        shape = (len(self.seeds), self.config.followers)
        if left.shape != shape or right.shape != shape:
            raise ValueError(
                f"left and right have shapes {left.shape} and {right.shape}; expected {shape}"
            )
        carry_out_all(
            self.task,
            self._formations,
            self.robots,
            self.world.ctrl,
            left,
            right,
            self._chance[:, t % BLOCK],
        )

    def begin_again(self, formation: int, *, forget: bool = True) -> None:
        """Let all followers of a formation that was put somewhere else begin a new episode there;
        ``forget`` what they saw.
        """
        robots = self.robots[formation]
        if forget:
            self._waiting[formation] = 0
            robots["motion"]["from_cos"] = robots["motion"]["from_sin"] = (
                0.0  # what was measured of the last period is void
            )
            robots["camera"]["tracked"] = robots["body"]["queue"] = robots["seen"]["heard"] = 0
            robots["estimate"] = np.zeros((), ROBOT["estimate"])
            robots["board"]["any"] = 0
            self._formations["crumbs"][formation] = 0
            robots["estimate"]["put"] = 1
        for robot, ids in zip(robots[1:], self._trace_ids[formation], strict=True):
            begin_episode(robot, ids)
            robot["reset"]["phase"] = FOLLOW
            robot["reset"]["timer"] = 0

    def _draw_all(self) -> None:
        """Draw the chance of one block for all formations."""
        for b in range(len(self.seeds)):
            self._draw(b)

    def _draw(self, b: int) -> None:
        """Draw a formation's chance of one block."""
        for draw in self._draws:
            stream = self.rngs[b][draw.stream]
            into = self._chance[draw.field][b, :, draw.robots]
            into[:] = (stream.random if draw.uniform else stream.standard_normal)(into.shape)

    @property
    def drawn(self) -> NDArray[np.void]:
        """The chance of the running block, (B, BLOCK, followers + 1) of type CHANCE: what goes on
        within a block depends on it, too.
        """
        return self._chance

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return everything that the next block depends on, as copies of plain arrays."""
        chance = [{name: rng[name].bit_generator.state for name in CHILDREN} for rng in self.rngs]
        return {
            "physics": self.world.states.copy(),
            "robots": self.robots.copy(),
            "formations": self._formations.copy(),
            "trail": self._trail.copy(),
            "hold": self.task["shape"]["hold"].copy(),
            "graph": self.task["graph"].copy(),
            "terminal": self.task["reward"]["terminal"].copy(),
            "weights": self.weights.copy(),
            "trace_ids": self._trace_ids[:, :, :2].copy(),  # the rest is room for φ̄
            "trace_values": self._trace_values[:, :, :1].copy(),
            "chance": np.array(json.dumps(chance)),
        }

    def load(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Continue from a state of a convoy with the same configuration, seeds and steps.

        Raises:
            ValueError: an array is missing, has another shape or other fields; nothing is changed
                then.
        """
        own = self.state()
        for name, array in own.items():
            if name not in state or state[name].shape != array.shape:
                found = state[name].shape if name in state else "nothing"
                raise ValueError(
                    f"state[{name!r}] is {found}, expected {array.shape}; load into an equal convoy"
                )
            if array.dtype.names and array.dtype != state[name].dtype:
                raise ValueError(
                    f"state[{name!r}] has other fields than this version of the workbench: "
                    "expected a state that it has made"
                )
        self.world.states[:] = state["physics"]
        self.robots[:] = state["robots"]
        self._formations[:] = state["formations"]
        self._trail[:] = state["trail"]
        self.task["shape"]["hold"] = state["hold"]
        self.task["graph"] = state["graph"]
        self.task["reward"]["terminal"] = state["terminal"]
        self.weights[:] = state["weights"]
        self._trace_ids[:, :, :2] = state["trace_ids"]
        self._trace_values[:, :, :1] = state["trace_values"]
        for rng, stored in zip(self.rngs, json.loads(str(state["chance"])), strict=True):
            for name in CHILDREN:
                rng[name].bit_generator.state = stored[name]

    def tables(self, formation: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return copies of a formation's main and secondary weights, each (tables, rows,
        actions).
        """
        shape = (-1, self.config.rows, self.config.action_count)
        theta, w = (self.weights[formation, :, k].reshape(shape).copy() for k in (0, 1))
        return theta, w

    def look(self) -> None:
        """Draw and search a picture of every formation that still runs; with sensing "pixels"
        only.
        """
        for b, eyes in enumerate(self.eyes):
            if not self._formations[b]["done"]:
                poses = np.array([self.world.pose(b, robot) for robot in range(self.world.robots)])
                eyes.look(
                    int(self._formations[b]["periods"]), self.robots[b], poses, self._sights[b]
                )

    def _running(self) -> NDArray[np.int64] | None:
        done = self._formations["done"]
        return np.flatnonzero(done == 0) if np.any(done) else None

    def _attend(self, flags: int, t: int, formations: Iterable[int]) -> None:
        """Do what compiled code cannot, for some formations in period t of the block."""
        if flags & DIVERGED:
            if said := trouble(self.robots, self._owner):
                raise ValueError(said)
            for b in formations:
                seed = self.seeds[b]
                if not np.all(np.isfinite(self.weights[b])):
                    learner = self.config.learner
                    message = not_finite(
                        int(self.updates[b]),
                        self.weights[b, :, 0],
                        self.weights[b, :, 1],
                        learner.alpha,
                        learner.beta,
                    )
                    raise FloatingPointError(f"seed {seed}: {message}")
            raise FloatingPointError(
                "a temporal-difference error is not finite; lower the step sizes"
            )
        for b in formations:
            if not self._formations["restart"][b]:
                continue
            self.world.restart(b)
            self._block[b, t]["left"] = self._block[b, t]["right"] = (
                0  # at rest: these commands never ran
            )
            self.robots[b, 0]["ground"]["line_side"] = self._first_side
            self.robots[b, 0]["reset"]["timer"] = 0
            self.begin_again(b)
            self._formations["restart"][b] = 0


def _pairs(points: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Return points as a configuration has them."""
    return tuple((float(x), float(y)) for x, y in np.asarray(points, dtype=float).reshape(-1, 2))


def _for_types(function: Any, *arguments: Any) -> Any:
    """Return a compiled function for exactly these arguments: numba's look-up at every call would
    cost as much as a call.
    """
    kinds = tuple(_kind(argument) for argument in arguments)
    known = _ENTRIES.get((function, kinds))
    if known is None:
        types = tuple(numba.typeof(argument) for argument in arguments)
        function.compile(types)
        known = _ENTRIES[function, kinds] = function.overloads[types].entry_point
    return known


def _kind(argument: Any) -> Any:
    """Return what decides the compiled type of an argument; to ask numba takes milliseconds."""
    if isinstance(argument, Arrays):
        return tuple(_kind(array) for array in argument)
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        return argument.dtype, argument.ndim, flags.c_contiguous, flags.aligned, flags.writeable
    return type(argument)


def _check_length(steps: int, periods: int | None) -> None:
    if steps < 0 or not (steps or periods):
        raise ValueError(
            f"steps = {steps!r}, periods = {periods!r}; expected steps >= 1 or periods >= 1"
        )


def _check_lawful(law: ControlLaw, config: ConvoyConfig, steps: int) -> None:
    if steps:
        raise ValueError(
            f"steps = {steps!r} with policy = {law!r}; a law has no weights and does not "
            "learn: give periods"
        )
    check_law(law, config)


def _release(
    ctrl: NDArray[np.float64], waiting: NDArray[np.float64], running: NDArray[np.int64] | None
) -> None:
    """Let the commands that waited take effect, in formations that still run."""
    if running is None:
        ctrl[:] = waiting
    else:
        ctrl[running] = waiting[running]
