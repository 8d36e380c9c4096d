"""Robots that are not nominal, and a link that is not perfect: what a policy meets when it travels.

Wheels and axles differ from robot to robot, wheels slip, commands arrive some control periods late,
and now and then no reading arrives. All of it is off by default and all sizes are our assumptions;
the paper only says that motors and sensors vary.

The same kinematics serves all drives: a robot with wheels of (1 + a) times the nominal radius on
an axle of (1 + b) times the nominal width moves as the nominal one would with mean speed (1 + a) v
and difference of speeds (1 + a) / (1 + b) Δv.

Contract: compiled functions write a formation's ctrl row and the robot's record, and allocate
nothing.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import write_command
from workbench.compiled import compiled
from workbench.fields import configuration, integer, real

LONGEST_DELAY = 4  # control periods
BODY = np.dtype(  # against the nominal ones; commands on their way, steps/s, the newest first
    [("wheel", "f8"), ("axle", "f8"), ("queue", "i8", (LONGEST_DELAY, 2))]
)
BODY_TASK = np.dtype(  # whether anything is not nominal; share; control periods; share
    [("any", "i8"), ("slip", "f8"), ("delay", "i8"), ("silence", "f8")]
)


@configuration
class BodyConfig:
    """How robots differ from the nominal e-puck, and how late and how completely they are told and
    read.
    """

    wheel_spread: float = real(
        0.0, 0.2, "", "largest relative error of a wheel radius, uniform to both sides", default=0.0
    )
    axle_spread: float = real(
        0.0, 0.2, "", "largest relative error of an axle width, uniform to both sides", default=0.0
    )
    slip: float = real(
        0.0,
        0.5,
        "",
        "what share of its speed a wheel loses in a control period, half-normal spread",
        default=0.0,
    )
    delay: int = integer(
        0, LONGEST_DELAY, "control periods", "from a follower's command to its wheels", default=0
    )
    missed: float = real(
        0.0,
        0.9,
        "",
        "share of control periods in which a follower's readings do not arrive",
        default=0.0,
    )

    @property
    def nominal(self) -> bool:
        """Whether nothing of it is in use."""
        return self == BodyConfig()


def draw_bodies(
    rng: np.random.Generator, config: BodyConfig, robots: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw wheel radii and axle widths relative to the nominal ones, each (robots,)."""
    wheel, axle = rng.uniform(-1.0, 1.0, (2, robots))
    return 1.0 + config.wheel_spread * wheel, 1.0 + config.axle_spread * axle


@compiled
def drive_body(
    task: Any, robot: Any, ctrl: Any, i: int, left: int, right: int, z_left: float, z_right: float
) -> None:
    """Write what a command makes of the wheels of robot i in a formation's ctrl row.

    Args:
        task, robot: records of type TASK and ROBOT; its ``body.queue`` holds commands on
            their way.
        left, right: the command in steps/s.
        z_left, z_right: standard normal numbers of this period's slip.
    """
    if i > 0:
        for k in range(task.body.delay):
            robot.body.queue[k, 0], left = left, robot.body.queue[k, 0]
            robot.body.queue[k, 1], right = right, robot.body.queue[k, 1]
    write_command(ctrl, task.motors, i, left, right)
    k = task.motors.actuators * i
    mean = (ctrl[k] + ctrl[k + 1]) / 2
    half = (ctrl[k + 1] - ctrl[k]) / 2
    ctrl[k] = (
        robot.body.wheel
        * (mean - half / robot.body.axle)
        * (1.0 - min(task.body.slip * abs(z_left), 1.0))
    )
    ctrl[k + 1] = (
        robot.body.wheel
        * (mean + half / robot.body.axle)
        * (1.0 - min(task.body.slip * abs(z_right), 1.0))
    )
