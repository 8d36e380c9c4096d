"""The drive "wheels" (10 ms steps): a free body on two driven wheels and two passive sliders.

A wheel touches the floor in one point (a sphere of the wheel's radius): point contact, Coulomb
friction, slip. It rolls on a hinge with a velocity servo, as stepper motors impose a speed. The
rear slider carries a little of the weight and slides without friction; the front one hangs 0.3 mm
above the floor and catches the body when it brakes hard. Servos of robots other than the e-puck are
scaled with mass and wheels.
"""

import math
from typing import Any

import mujoco

from workbench.arena.drives.drive import FLOOR, FOOT, Drive, add_sphere
from workbench.compiled import compiled
from workbench.robot import geometry as g
from workbench.robot.description import RobotConfig

# A stepper's speed is imposed. The servo below comes to 1.5 % of it within 100 ms; gain, rotor
# inertia and the limit were chosen together so that neither the servo nor its reaction on the body
# rings (our choice: none of them is published).
WHEEL_SERVO = 3.5e-3  # N m s/rad
ROTOR_INERTIA = 1.5e-5  # kg m², the motor's rotor as felt behind its 50:1 gear
TORQUE_LIMIT = 0.015  # N m per wheel
FRICTION = 0.8  # rubber tyre on paper or wood: our assumption, no measurement is published
# m from the axle's middle: slightly behind, so that the rear slider rests
CENTRE_OF_MASS = (-0.004, 0.0, -0.005)
FRONT_GAP = 0.0003  # m between the front slider and the floor


def add(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, robot: RobotConfig) -> None:
    """Add a free body on two driven wheels and two sliders."""
    body.add_freejoint(name=f"{name}/free")
    body.explicitinertial = True
    body.mass = robot.mass_kg - 2 * robot.wheel_mass_kg
    body.inertia = list(robot.inertia_kg_m2)
    body.ipos = [robot.size * x for x in CENTRE_OF_MASS]
    front = robot.size * FRONT_GAP
    for side, x, gap in (("rear", -robot.slider_x_m, 0.0), ("front", robot.slider_x_m, front)):
        add_sphere(
            body,
            f"{name}/{side}",
            robot.slider_radius_m,
            [x, 0, robot.slider_radius_m - robot.wheel_radius_m + gap],
            contype=FOOT,
            conaffinity=FLOOR,
            condim=1,
            priority=1,
        )
    for side, y in (("left", robot.track_m / 2), ("right", -robot.track_m / 2)):
        _add_wheel(spec, body.add_body(name=f"{name}/{side}", pos=[0, y, 0]), robot)


def _add_wheel(spec: mujoco.MjSpec, wheel: mujoco.MjsBody, robot: RobotConfig) -> None:
    """Make a body a wheel that touches the floor in one point, on a hinge with a velocity servo."""
    name = wheel.name
    heavy = robot.mass_kg / g.BODY_MASS
    size = robot.wheel_radius_m / g.WHEEL_RADIUS
    rolling = heavy * size**2  # inertia that a wheel feels, in units of an e-puck's
    spin = robot.wheel_mass_kg * robot.wheel_radius_m**2 / 2  # kg m², a disc about its axle
    wheel.explicitinertial = True
    wheel.mass = robot.wheel_mass_kg
    wheel.inertia = [0.51 * spin, spin, 0.51 * spin]
    wheel.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],
        armature=rolling * ROTOR_INERTIA,
    )
    add_sphere(
        wheel,
        f"{name}_tyre",
        robot.wheel_radius_m,
        [0, 0, 0],
        contype=FOOT,
        conaffinity=FLOOR,
        condim=3,
        priority=2,
        friction=[FRICTION, 0, 0],
    )
    motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_velocity(kv=rolling * WHEEL_SERVO)
    motor.forcelimited = True
    motor.forcerange = [-heavy * size * TORQUE_LIMIT, heavy * size * TORQUE_LIMIT]


def _at_rest(robot: RobotConfig, x: float, y: float, heading: float) -> tuple[float, ...]:
    turned = (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))  # a quaternion
    return (x, y, robot.wheel_radius_m, *turned, 0.0, 0.0)


@compiled
def read(qpos: Any, robot: int) -> tuple[float, float, float, float]:
    """Return x, y in m and the cosine and sine of the heading of a robot."""
    k = 9 * robot
    q0 = qpos[k + 3]
    q1 = qpos[k + 4]
    q2 = qpos[k + 5]
    q3 = qpos[k + 6]
    c = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
    s = 2.0 * (q0 * q3 + q1 * q2)
    norm = math.sqrt(c * c + s * s)
    return qpos[k], qpos[k + 1], c / norm, s / norm


WHEELS = Drive(
    "wheels",
    timestep_s=0.01,
    qpos=9,  # x y z, quaternion, left and right wheel
    actuators=("left", "right"),
    gravity=True,
    add=add,
    at_rest=_at_rest,
    axle_m=lambda robot: 0.0,
    per_step=lambda robot: 2 * math.pi / robot.steps_per_turn,  # rad
    read=read,
)
