"""The drive "planar" (20 ms steps, for sweeps): x, y and yaw only.

Speed servos act at the two wheel points along the body and hold the axle's sideways speed at zero.
No wheel contact and no slip; robots still push each other, with servos that know no slip: while one
pushes another that holds still, the two overlap by up to 9 mm (2 mm on wheels). Servos of robots
other than the e-puck are scaled with mass.
"""

import math
from typing import Any

import mujoco

from workbench.arena.drives.drive import Drive
from workbench.compiled import compiled
from workbench.robot import geometry as g
from workbench.robot.description import RobotConfig

PLANAR_SERVO = 50.0  # N s/m: a time constant of 1.5 ms; our choice


def add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, robot: RobotConfig) -> None:
    """Add a body with three degrees of freedom and its servos."""
    for joint, kind, axis in (
        ("x", mujoco.mjtJoint.mjJNT_SLIDE, [1, 0, 0]),
        ("y", mujoco.mjtJoint.mjJNT_SLIDE, [0, 1, 0]),
        ("yaw", mujoco.mjtJoint.mjJNT_HINGE, [0, 0, 1]),
    ):
        body.add_joint(name=f"{name}/{joint}", type=kind, axis=axis)
    body.explicitinertial = True
    body.mass = robot.mass_kg
    body.inertia = list(robot.inertia_kg_m2)
    for side, y, gear in (
        ("left", robot.track_m / 2, [1, 0, 0, 0, 0, 0]),
        ("right", -robot.track_m / 2, [1, 0, 0, 0, 0, 0]),
        ("sideways", 0.0, [0, 1, 0, 0, 0, 0]),
    ):
        body.add_site(name=f"{name}/{side}", pos=[0, y, 0])
        motor = spec.add_actuator(
            name=f"{name}/{side}", target=f"{name}/{side}", trntype=mujoco.mjtTrn.mjTRN_SITE
        )
        motor.gear = gear
        motor.set_to_velocity(kv=robot.mass_kg / g.BODY_MASS * PLANAR_SERVO)


@compiled
def read(qpos: Any, robot: int) -> tuple[float, float, float, float]:
    """Return x, y in m and the cosine and sine of the heading of a robot."""
    k = 3 * robot
    return qpos[k], qpos[k + 1], math.cos(qpos[k + 2]), math.sin(qpos[k + 2])


PLANAR = Drive(
    "planar",
    timestep_s=0.02,
    qpos=3,  # x, y, yaw
    actuators=("left", "right", "sideways"),
    gravity=False,
    add=add,
    at_rest=lambda robot, x, y, heading: (x, y, heading),
    axle_m=lambda robot: robot.wheel_radius_m,
    per_step=lambda robot: robot.step_m,  # m
    read=read,
)
