"""The world: B formations of one model, stepped by MuJoCo on its own threads, or by a drive that
needs no engine.

A formation is a line of robots on a track of its own. Its whole physics is one row of ``states``
(where MuJoCo steps, mjSTATE_INTEGRATION, solver warm start included), so that a checkpoint of the
physics is an array copy.

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> track = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
>>> world = World(1, [track], drive="planar", spacing_m=0.15)
>>> world.command(0, 0, 466, 466); world.step()
>>> [round(v, 3) for v in world.pose(0, 0)]
[-0.408, -0.289, 2.199]

Contract: ``qpos``, ``ctrl`` and ``states`` are live views; a write is the state at the next step.
Results do not depend on the number of threads. A world is used by one Python thread at a time.
"""

import functools
import math
import os
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco import batch as mujoco_batch
from numpy.typing import NDArray

from workbench.arena.drives.table import DRIVE_NUMBERS, DRIVES, read
from workbench.arena.floor import draw_floors
from workbench.arena.library import former, stopwatches
from workbench.arena.model import build_model
from workbench.arena.tracks import Track
from workbench.compiled import compiled
from workbench.robot.description import EPUCK, RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.motors import wheel_speed

# what commands become: the drive, its actuators per robot, their units per step, steps/s at most,
# the timer's ticks per second
MOTORS = np.dtype(
    [
        ("drive", "i8"),
        ("actuators", "i8"),
        ("per_step", "f8"),
        ("most", "i8"),
        ("ticks", "i8"),
        ("step_m", "f8"),
        ("track_m", "f8"),
    ]
)


def motors_of(robot: RobotConfig, drive: str) -> dict[str, float]:
    """Return the fields of MOTORS for a robot and a drive."""
    return {
        "drive": DRIVE_NUMBERS[drive],
        "actuators": len(DRIVES[drive].actuators),
        "per_step": DRIVES[drive].per_step(robot),
        "most": robot.most_steps,
        "ticks": robot.timer_hz,
        "step_m": robot.step_m,
        "track_m": robot.track_m,
    }


@compiled
def read_pose(qpos: Any, robot: int, drive: int) -> tuple[float, float, float, float]:
    """Return x, y in m and the cosine and sine of the heading of a robot, from its formation's qpos
    row.
    """
    x, y, c, s = read(drive, qpos, robot)
    return x, y, c, s


@compiled
def write_command(ctrl: Any, motors: Any, robot: int, left: int, right: int) -> None:
    """Set a robot's wheel speeds in a formation's ctrl row, from whole steps/s through the
    firmware's quantisation.

    ``motors`` is a record of type MOTORS.
    """
    k = motors.actuators * robot
    ctrl[k] = wheel_speed(left, motors.most, motors.ticks) * motors.per_step
    ctrl[k + 1] = wheel_speed(right, motors.most, motors.ticks) * motors.per_step


@compiled
def _write(ctrl: Any, motors: Any, robot: int, left: int, right: int) -> None:
    write_command(ctrl, motors[0], robot, left, right)


class World:
    """B formations of the same number of robots, each on a track of its own.

    Args:
        followers: robots behind the leader; a formation has followers + 1 robots.
        tracks: one track per formation; B is their number.
        drive: one of ``drives.table.DRIVES``.
        spacing_m: distance between neighbours at the start.
        line_width_m: width of the black line.
        robot: what the robots are; default the e-puck.
        furnish: adds what else stands in the arena to the model's specification, see
            ``arena.proximity.add_box``.
        threads: MuJoCo's threads; 0 takes one per formation, at most one per core.

    Attributes:
        robot, drive, furnish: what the robots are, how they are driven, what else is there.
        batch: MuJoCo's own, open to every use, or a drive's that does the same.
        physics: MuJoCo's model; ``model`` has looks, too.
        qpos, ctrl: live (B, nq) and (B, nu) views.
        states: live (B, nstate) rows that hold the whole physics.
        floor: the rasters of the lines, see ``workbench.arena.floor``.
    """

    def __init__(
        self,
        followers: int,
        tracks: list[Track],
        *,
        drive: str,
        spacing_m: float,
        line_width_m: float = 0.015,
        robot: RobotConfig = EPUCK,
        threads: int = 0,
        furnish: Callable[[mujoco.MjSpec], None] | None = None,
    ) -> None:
        stopwatches(former())
        self.robot = robot
        self.furnish = furnish
        self._motors = np.zeros(1, MOTORS)
        for name, value in motors_of(robot, drive).items():
            self._motors[name] = value
        self.drive = DRIVES[drive]
        self.robots = followers + 1
        self.tracks = tracks
        self.substeps = round(CONTROL_PERIOD / self.drive.timestep_s)
        cores = (
            len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count() or 1
        )
        self.threads = max(1, min(threads or cores, len(tracks)))
        self.batch = self._make_batch()
        self.qpos: NDArray[np.float64] = self.batch.bind("qpos")
        self.ctrl: NDArray[np.float64] = self.batch.bind("ctrl")
        # both are views of the rows
        self.states: NDArray[np.float64] = self.qpos.base
        assert self.states.shape == (len(tracks), self.batch.nstate)
        self.floor = draw_floors(tracks, line_width_m)
        for formation, track in enumerate(tracks):
            self._line_up(formation, track, spacing_m)
        self._time: NDArray[np.float64] = self.batch.bind("time")
        self._start = self.states.copy()

    def _make_batch(self) -> Any:
        """Return what steps the formations."""
        if self.drive.batch is None:
            return mujoco_batch.Batch(self.physics, self.formations, self.threads)
        if self.furnish is not None:
            raise ValueError(
                f"drive = {self.drive.name!r} with furniture; nothing stops a robot there: "
                "expected 'planar' or 'wheels'"
            )
        closing = 2 * self.robot.most_mps * CONTROL_PERIOD
        if closing > self.robot.body_radius_m:
            raise ValueError(
                f"drive = {self.drive.name!r} with robots of {self.robot.body_radius_m:g} m radius "
                f"that close in by up to {closing:.2f} m in a control period; they would drive "
                "through each other: expected 'planar' or 'wheels', or slower robots"
            )
        return self.drive.batch(self.robot, self.robots, self.formations)

    @functools.cached_property
    def physics(self) -> mujoco.MjModel:
        """The model that MuJoCo steps. What furnishes may know robots by their looks."""
        looks = self.furnish is not None or former()
        return build_model(self.robots, self.drive.name, self.furnish, self.robot, looks=looks)

    def joints(self, formation: int) -> NDArray[np.float64]:
        """Return the qpos that pose ``model`` as a formation stands."""
        rows = self.qpos[formation, : self.robots * self.drive.qpos]
        kept = self.drive.joints or self.drive.qpos
        posed: NDArray[np.float64] = rows.reshape(self.robots, -1)[:, :kept].ravel()
        return posed

    @functools.cached_property
    def model(self) -> mujoco.MjModel:
        """The model with all that is seen of robots, made when somebody looks."""
        return build_model(self.robots, self.drive.name, self.furnish, self.robot)

    @property
    def formations(self) -> int:
        """Number of formations, B."""
        return len(self.tracks)

    def step(self, ids: NDArray[np.int64] | None = None) -> None:
        """Advance all formations, or those named, by one control period (0.1 s)."""
        self.batch.step(ids, nstep=self.substeps)

    def restart(self, formation: int) -> None:
        """Put a formation back to where it started, at rest; its clock goes on."""
        now = self._time[formation].copy()
        self.states[formation] = self._start[formation]
        self._time[formation] = now

    def check(self, formation: int, periods: int) -> None:
        """Raise RuntimeError if MuJoCo gave up on a formation (it then resets it, clock
        included), or a robot is nowhere.
        """
        if not np.isfinite(self.qpos[formation]).all():
            raise RuntimeError(f"formation {formation} has a robot whose place is not a number")
        now = float(self._time[formation].item())
        if not math.isclose(now, periods * CONTROL_PERIOD, rel_tol=1e-6):
            raise RuntimeError(
                f"the physics of formation {formation} became unstable: its clock stands at "
                f"{now:g} s after {periods} control "
                f"periods of {CONTROL_PERIOD:g} s; results from here on would be meaningless"
            )

    def command(self, formation: int, robot: int, left: int, right: int) -> None:
        """Set a robot's wheel speeds in whole steps/s (robot 0 leads)."""
        _write(self.ctrl[formation], self._motors, robot, left, right)

    def pose(self, formation: int, robot: int) -> tuple[float, float, float]:
        """Return a robot's x, y in m and heading in rad."""
        x, y, c, s = read_pose(self.qpos[formation], robot, DRIVE_NUMBERS[self.drive.name])
        return x, y, math.atan2(s, c)

    def place(self, formation: int, robot: int, x: float, y: float, heading: float) -> None:
        """Put a robot at rest at x, y (m) with a heading (rad)."""
        at_rest = self.drive.at_rest(self.robot, x, y, heading)
        begin = self.drive.qpos * robot
        self.qpos[formation, begin : begin + len(at_rest)] = at_rest
        speeds = self.batch.bind("qvel")[formation]
        dofs = speeds.size // self.robots
        speeds[dofs * robot : dofs * (robot + 1)] = 0
        count = len(self.drive.actuators)
        self.ctrl[formation, count * robot : count * (robot + 1)] = 0

    def _line_up(self, formation: int, track: Track, spacing_m: float) -> None:
        """Place the robots on the nominal loop, each looking at its predecessor from spacing_m
        behind it.
        """
        s = 0.4 * track.length_m
        x, y, heading = track.pose(s)
        self.place(formation, 0, x, y, heading)
        for robot in range(1, self.robots):
            ahead = (x, y)
            low, high = s - 2 * spacing_m, s
            for _ in range(50):  # bisection for the point at the wanted straight distance
                middle = (low + high) / 2
                x, y = track.point(middle)
                if math.dist((x, y), ahead) > spacing_m:
                    low = middle
                else:
                    high = middle
            s = (low + high) / 2
            x, y = track.point(s)
            self.place(formation, robot, x, y, math.atan2(ahead[1] - y, ahead[0] - x))
