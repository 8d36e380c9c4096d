"""Physics in compiled code, so that a whole block of control periods needs no Python: MuJoCo by the
address of ``mj_step``, or a drive that needs no engine.

With MuJoCo a formation has an MjData of its own and two models: the world's, and the same without
contacts, for as long as no two robots can touch before the next look. What robots do is the same to
the last bit as by ``mujoco.batch`` (a test compares), which remains for machines where the address
is not found or does something else, and can be asked for by WORKBENCH_BATCH=1.

Contract: between blocks a formation's state is its row of ``World.states``; ``begin`` takes it from
there, ``end`` puts it back.
"""

import copy
import ctypes
import functools
import math
from typing import Any

import mujoco
import numpy as np

from workbench.arena.drives.rolling import apart_m, roll
from workbench.arena.library import former, library
from workbench.arena.model import build_model
from workbench.arena.world import World
from workbench.compiled import compiled, peek, poke, step_at
from workbench.robot.description import EPUCK

ENGINE = np.dtype(
    [
        ("step", "i8"),  # address of mj_step; 0: robots roll
        ("model", "i8"),  # addresses of what it takes
        ("free", "i8"),
        ("data", "i8"),
        ("qpos", "i8"),  # of numbers in it, and how many there are
        ("ctrl", "i8"),
        ("nq", "i8"),
        ("nu", "i8"),
        ("substeps", "i8"),  # physics steps per control period
        ("late", "i8"),  # those before the commands that waited take effect
        ("near", "f8"),  # m between two centres below which robots may touch; inf: always
        ("timestep", "f8"),  # s
        ("track", "f8"),  # m between the wheels of a robot
        ("apart", "f8"),  # m between centres of robots that roll and touch
    ]
)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
# m that two e-pucks can close in by within a period: 26 mm, 31 mm on the largest wheels that
# BodyConfig allows, and some more
_CLOSING = 0.035


@compiled
def advance(engine: Any, robots: Any, qpos: Any, ctrl: Any, waiting: Any) -> None:
    """Let a control period of physics pass.

    Args:
        engine: ENGINE record; robots: (robots,) ROBOT, their poses now.
        qpos, ctrl, waiting: rows of ``control.Arrays``.
    """
    if engine.step:
        _engine_steps(engine, robots, qpos, ctrl, waiting)
    else:
        _roll_on(engine, qpos, ctrl, waiting)


@compiled
def _roll_on(engine: Any, qpos: Any, ctrl: Any, waiting: Any) -> None:
    late = engine.late
    if late:
        roll(qpos, ctrl, late * engine.timestep, engine.track, engine.apart)
        for k in range(ctrl.size):
            ctrl[k] = waiting[k]
    if engine.substeps > late:
        rest = (engine.substeps - late) * engine.timestep
        roll(qpos, ctrl, rest, engine.track, engine.apart)


@compiled
def _engine_steps(engine: Any, robots: Any, qpos: Any, ctrl: Any, waiting: Any) -> None:
    model = engine.model if _may_touch(robots, engine.near) else engine.free
    for k in range(engine.nu):
        poke(engine.ctrl, k, ctrl[k])
    if engine.late:
        for _ in range(engine.late):
            step_at(engine.step, model, engine.data)
        for k in range(engine.nu):
            ctrl[k] = waiting[k]
            poke(engine.ctrl, k, ctrl[k])
    for _ in range(engine.substeps - engine.late):
        step_at(engine.step, model, engine.data)
    for k in range(engine.nq):
        qpos[k] = peek(engine.qpos, k)


@compiled
def _may_touch(robots: Any, near: float) -> bool:
    if near == math.inf:
        return True
    for i in range(1, robots.size):
        for j in range(i):
            dx = robots[i].pose.x - robots[j].pose.x
            dy = robots[i].pose.y - robots[j].pose.y
            if dx * dx + dy * dy < near * near:
                return True
    return False


@compiled
def _steps(step: int, model: int, data: int, count: int) -> None:
    for _ in range(count):
        step_at(step, model, data)


def address() -> int:
    """Return where ``mj_step`` is, 0 where it is not found, not what it should be or not wanted."""
    return 0 if former() else _address()


@functools.cache
def _address() -> int:
    found = library()
    if found is None or not hasattr(found, "mj_step"):
        return 0
    where = ctypes.cast(found.mj_step, ctypes.c_void_p).value or 0
    return where if where and _is_mj_step(where) else 0


def _is_mj_step(where: int) -> bool:
    """Return whether the function at an address does to a model what ``mujoco.mj_step`` does."""
    model = build_model(2, "planar")
    by_address, by_binding = mujoco.MjData(model), mujoco.MjData(model)
    for data in (by_address, by_binding):
        data.qpos[:] = 0.01, 0.0, 0.1, 0.06, 0.01, 0.0  # they touch
        data.ctrl[:] = 0.05
    mujoco.mj_step(model, by_binding, nstep=5)
    _steps(where, model._address, by_address._address, 5)
    same = np.array_equal(by_address.qpos, by_binding.qpos)
    return bool(same and by_address.time == by_binding.time and by_address.ncon > 0)


class Engine:
    """What lets time pass for B formations in compiled code; as it is, for drives without MuJoCo.

    Args:
        world: whose formations they are.
        late: physics steps of a control period before waiting commands take effect.

    Attributes:
        records: (B,) ENGINE.
    """

    def __init__(self, world: World, *, late: int) -> None:
        self.records = np.zeros(world.formations, ENGINE)
        self.records["substeps"] = world.substeps
        self.records["late"] = late
        self.records["timestep"] = world.drive.timestep_s
        self.records["track"] = world.robot.track_m
        self.records["apart"] = apart_m(world.robot)

    def begin(self, formation: int) -> None:
        """Take a formation's state from its row."""

    def end(self, formation: int) -> None:
        """Put a formation's state into its row; commands that nobody has carried out stay."""


class MuJoCo(Engine):
    """The same for MuJoCo, with an MjData a formation."""

    def __init__(self, world: World, *, late: int) -> None:
        super().__init__(world, late=late)
        robot = world.robot
        self._states = world.states
        self._ctrl = world.ctrl
        self._model = world.physics
        self._free = copy.copy(world.physics)
        self._free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self._data = [mujoco.MjData(self._model) for _ in self._states]
        assert mujoco.mj_stateSize(self._model, _STATE) == self._states.shape[1]
        always = world.drive.gravity or world.furnish is not None  # floor or walls are touched
        closing = _CLOSING * robot.most_mps / EPUCK.most_mps
        self.records["near"] = math.inf if always else 2 * robot.body_radius_m + closing
        self.records["step"] = address()
        self.records["model"] = self._model._address
        self.records["free"] = self._free._address
        self.records["nq"] = self._model.nq
        self.records["nu"] = self._model.nu
        for record, data in zip(self.records, self._data, strict=True):
            record["data"] = data._address
            record["qpos"] = data.qpos.ctypes.data
            record["ctrl"] = data.ctrl.ctypes.data

    def begin(self, formation: int) -> None:
        mujoco.mj_setState(self._model, self._data[formation], self._states[formation], _STATE)

    def end(self, formation: int) -> None:
        self._data[formation].ctrl[:] = self._ctrl[formation]
        mujoco.mj_getState(self._model, self._data[formation], self._states[formation], _STATE)


def engine_of(world: World, *, late: int) -> Engine | None:
    """Return a world's physics in compiled code, None where MuJoCo cannot be called from there."""
    if world.drive.batch is not None:
        return Engine(world, late=late)
    return MuJoCo(world, late=late) if address() else None
