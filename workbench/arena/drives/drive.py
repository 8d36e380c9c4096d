"""A drive: a fidelity of the simulated robot, as MuJoCo and the compiled loop need it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco

from workbench.robot.description import RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD

# collision classes
FLOOR = 1
FOOT = 2
BODY = 4


@dataclass(frozen=True)
class Drive:
    """One drive.

    Attributes:
        name: of the drive.
        timestep_s: of the physics.
        qpos: numbers per robot; at_rest: those of a robot at x, y (m) with a heading (rad).
        actuators: per robot; the first two set the speeds of the left and the right wheel.
        gravity: whether robots stand by their weight; axle_m: height of the axle in the body's
            frame.
        per_step: what an actuator's unit per second is for one step/s of a wheel.
        add: adds the body with its actuators to a specification.
        read: compiled (qpos, robot) -> x, y in m, cosine and sine of the heading.
        joints: of qpos that MuJoCo's model of the robot has, the first ones; 0: all.
        batch: (robot, robots, formations) -> what steps them in the place of MuJoCo's batch.
    """

    name: str
    timestep_s: float
    qpos: int
    actuators: tuple[str, ...]
    gravity: bool
    add: Callable[[mujoco.MjSpec, mujoco.MjsBody, str, RobotConfig], None]
    at_rest: Callable[[RobotConfig, float, float, float], tuple[float, ...]]
    axle_m: Callable[[RobotConfig], float]
    per_step: Callable[[RobotConfig], float]
    read: Any
    joints: int = 0
    batch: Callable[[RobotConfig, int, int], Any] | None = None

    def __post_init__(self) -> None:
        steps = CONTROL_PERIOD / self.timestep_s
        if abs(steps - round(steps)) > 1e-9:
            raise ValueError(
                f"Drive.timestep_s = {self.timestep_s!r}; expected a whole number of steps per "
                f"control period of {CONTROL_PERIOD:g} s"
            )


def add_sphere(
    body: mujoco.MjsBody, name: str, radius: float, pos: list[float], **kinds: object
) -> None:
    """Add a sphere that takes part in contacts and weighs nothing."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0, 0],
        pos=pos,
        mass=0,
        group=3,
        **kinds,
    )
