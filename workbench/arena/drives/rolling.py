"""The drive "rolling": exact rolling without an engine, for sweeps.

In T seconds at commanded rim speeds of mean v and turning rate ω, after v₀ and ω₀, a robot rolls

    s = k_s T v - τ_s (v - v₀)  on an arc of the angle  a = k_ω T ω - τ_ω (ω - ω₀)

(its chord by a series that is right to 1 % up to |a| = 2; an e-puck reaches 0.5). The four
constants are a fit to the drive "wheels": two least squares over 4 000 control periods of random
7×7 commands (``measures.drives.fit_rolling``, which a test runs again), which leave 0.008 mm and
0.013° a period. Wheels get 0.6 % less way than exact rolling, and overshoot after a change of
speed, hence the negative τ_s. They are the e-puck's: a heavier robot takes longer to speed up.

Robots that overlap are pushed apart, half of it each, to just within touching, so that records show
them in contact. Nothing slips but by ``BodyConfig.slip``; there is no torque limit, no tilt, and
there are no walls.

Contract: rows of numbers are written in place, nothing is allocated.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.drives import planar
from workbench.arena.drives.drive import Drive
from workbench.arena.neighbours import sort_by_place
from workbench.compiled import compiled
from workbench.robot.description import RobotConfig

SPEED_GAIN = 0.9943  # k_s
SPEED_LAG = -0.00293  # s, τ_s
TURN_GAIN = 0.9977  # k_ω
TURN_LAG = 0.00147  # s, τ_ω
TOUCHING = 69.8 / 70.0  # of two radii, to which robots are pushed apart
PASSES = 4  # of pushing, at most, in a period
WIDTH = 6  # numbers of a robot in a row
PADDING = 16  # numbers that keep rows of two threads on different cache lines
TIMESTEP = 0.02  # s: what a compute time is a multiple of


@compiled
def read(qpos: Any, robot: int) -> tuple[float, float, float, float]:
    """Return x, y in m and the cosine and sine of the heading of a robot."""
    k = WIDTH * robot
    return qpos[k], qpos[k + 1], math.cos(qpos[k + 2]), math.sin(qpos[k + 2])


@compiled
def roll(qpos: Any, ctrl: Any, seconds: float, track_m: float, apart: float) -> None:
    """Let all robots of a formation roll for some seconds at the rim speeds in ``ctrl`` (m/s), and
    push those apart whose centres are less than ``apart`` (m) from each other.
    """
    robots = ctrl.size // 2
    _move(qpos, ctrl, robots, seconds, track_m)
    _part(qpos, robots, apart)
    qpos[WIDTH * robots] += seconds


@compiled
def _move(qpos: Any, ctrl: Any, robots: int, seconds: float, track_m: float) -> None:
    for i in range(robots):
        k = WIDTH * i
        speed = (ctrl[2 * i] + ctrl[2 * i + 1]) / 2
        turn = (ctrl[2 * i + 1] - ctrl[2 * i]) / track_m
        along = SPEED_GAIN * seconds * speed - SPEED_LAG * (speed - qpos[k + 3])
        half = (TURN_GAIN * seconds * turn - TURN_LAG * (turn - qpos[k + 4])) / 2
        chord = along * (1 - half * half / 6)
        heading = qpos[k + 2] + half
        qpos[k] += chord * math.cos(heading)
        qpos[k + 1] += chord * math.sin(heading)
        qpos[k + 2] = heading + half
        qpos[k + 3] = speed
        qpos[k + 4] = turn


@compiled
def _part(qpos: Any, robots: int, apart: float) -> None:
    """Push robots that overlap away from each other, half of what is missing each."""
    order = qpos[5 : WIDTH * robots : WIDTH]
    x = qpos[0 : WIDTH * robots : WIDTH]
    for _ in range(PASSES):
        sort_by_place(order, x)
        pushed = False
        for n in range(robots):
            i = WIDTH * int(order[n])
            # from left to right, only those close behind can touch it
            for m in range(n + 1, robots):
                j = WIDTH * int(order[m])
                dx = qpos[j] - qpos[i]
                if dx >= apart:
                    break
                dy = qpos[j + 1] - qpos[i + 1]
                square = dx * dx + dy * dy
                if square < apart * apart:
                    _push(qpos, i, j, dx, dy, math.sqrt(square), apart)
                    pushed = True
        if not pushed:
            return


@compiled
def _push(qpos: Any, i: int, j: int, dx: float, dy: float, gap: float, apart: float) -> None:
    share = (apart - gap) / 2
    if gap == 0.0:
        qpos[i] -= share
        qpos[j] += share
        return
    qpos[i] -= share * dx / gap
    qpos[i + 1] -= share * dy / gap
    qpos[j] += share * dx / gap
    qpos[j + 1] += share * dy / gap


@compiled
def _step(qpos: Any, ctrl: Any, ids: Any, seconds: float, track_m: float, apart: float) -> None:
    for b in ids:
        roll(qpos[b], ctrl[b], seconds, track_m, apart)


class Rolling:
    """B formations that roll, as ``mujoco.batch.Batch`` has them.

    Args:
        robot: what the robots are; robots: of a formation; formations: B.
    """

    def __init__(self, robot: RobotConfig, robots: int, formations: int) -> None:
        width = WIDTH * robots + 1  # the last one is the clock
        self.nstate = width + 2 * robots + PADDING
        states = np.zeros((formations, self.nstate))
        self._views = {
            "qpos": states[:, :width],
            "time": states[:, width - 1],
            "ctrl": states[:, width : width + 2 * robots],
            "qvel": states[:, :0],
        }
        self._views["qpos"][:, 5 : WIDTH * robots : WIDTH] = np.arange(robots)
        self._track_m = robot.track_m
        self._apart = apart_m(robot)

    def bind(self, name: str) -> NDArray[np.float64]:
        """Return a live view: "qpos", "ctrl", "qvel" or "time"."""
        if name not in self._views:
            raise ValueError(f"name = {name!r}; expected one of {', '.join(self._views)}")
        return self._views[name]

    def step(self, ids: NDArray[np.int64] | None = None, nstep: int = 1) -> None:
        """Advance all formations, or those named, by some time steps."""
        qpos, ctrl = self._views["qpos"], self._views["ctrl"]
        which = np.arange(len(qpos)) if ids is None else np.asarray(ids, np.int64)
        _step(qpos, ctrl, which, nstep * TIMESTEP, self._track_m, self._apart)


def apart_m(robot: RobotConfig) -> float:
    """Return the distance of two centres, in m, to which overlapping robots are pushed."""
    return TOUCHING * 2 * robot.body_radius_m


ROLLING = Drive(
    "rolling",
    timestep_s=TIMESTEP,
    qpos=WIDTH,  # x, y, yaw; speed and turning rate of the last command; who is n-th from the left
    actuators=("left", "right"),
    gravity=False,
    add=planar.add,  # to be looked at
    at_rest=lambda robot, x, y, heading: (x, y, heading, 0.0, 0.0),
    axle_m=lambda robot: robot.wheel_radius_m,
    per_step=lambda robot: robot.step_m,  # m
    read=read,
    joints=3,
    batch=Rolling,
)
