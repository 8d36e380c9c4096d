"""The MuJoCo model of a line of e-pucks, in two fidelities.

"wheels" (default, 10 ms steps): a free body on two driven wheels and two passive sliders. A wheel
touches the floor in one point (a sphere of the wheel's radius): point contact, Coulomb friction,
slip. It rolls on a hinge with a velocity servo, as stepper motors impose a speed. The rear slider
carries a little of the weight and slides without friction; the front one hangs 0.3 mm above the
floor and catches the body when it brakes hard.

"planar" (20 ms steps, for sweeps): x, y and yaw only. Speed servos act at the two wheel points
along the body and hold the axle's sideways speed at zero. No wheel contact and no slip; robots
still push each other, with servos that know no slip: while one pushes another that holds still, the
two overlap by up to 9 mm (2 mm on wheels).

Robots collide with each other as upright cylinders: their collision geoms are spheres of the body's
radius, whose centres all lie at the same height. The visible geoms (group 1) take no part in the
physics.

Contract: actuators come in the order of ``ACTUATORS[drive]`` per robot, qpos per robot as in
``QPOS[drive]``.

>>> model = build_model(2, "wheels")
>>> model.nq, model.nu, round(1000 * model.body_subtreemass[0])
(18, 4, 300)
"""

import math
from collections.abc import Callable

import mujoco

from workbench.robot import geometry as g
from workbench.robot.description import EPUCK, RobotConfig

DRIVES = ("wheels", "planar")
TIMESTEP = {"wheels": 0.01, "planar": 0.02}  # s
QPOS = {"wheels": 9, "planar": 3}  # numbers per robot: x y z quaternion left right | x y yaw
ACTUATORS = {"wheels": ("left", "right"), "planar": ("left", "right", "sideways")}

# A stepper's speed is imposed. The servo below comes to 1.5 % of it within 100 ms; gain, rotor
# inertia and the limit were chosen together so that neither the servo nor its reaction on the body
# rings (our choice: none of them is published).
WHEEL_SERVO = 3.5e-3  # N m s/rad
ROTOR_INERTIA = 1.5e-5  # kg m², the motor's rotor as felt behind its 50:1 gear
TORQUE_LIMIT = 0.015  # N m per wheel
PLANAR_SERVO = 50.0  # N s/m: a time constant of 1.5 ms; our choice
FRICTION = 0.8  # rubber tyre on paper or wood: our assumption, no measurement is published
CENTRE_OF_MASS = (
    -0.004,
    0.0,
    -0.005,
)  # m from the axle's middle: slightly behind, so that the rear slider rests
FRONT_GAP = 0.0003  # m between the front slider and the floor
# collision classes
_FLOOR = 1
_FOOT = 2
_BODY = 4

COLOURS = ((0.80, 0.25, 0.20, 1.0), (0.20, 0.45, 0.75, 1.0))  # leader, followers


def build_model(
    robots: int,
    drive: str,
    furnish: Callable[[mujoco.MjSpec], None] | None = None,
    robot: RobotConfig = EPUCK,
) -> mujoco.MjModel:
    """Compile the model of a number of robots on an infinite floor; their bodies are robot0,
    robot1, ….

    ``furnish`` may add walls, boxes and the like to the specification before it is compiled. Servos
    of robots other than the e-puck are scaled with mass and wheels, so that they settle as fast
    where inertia is in proportion; gaps and offsets with the body's radius.

    Raises:
        ValueError: fewer than one robot or an unknown drive.
    """
    if robots < 1:
        raise ValueError(f"robots = {robots!r}; expected at least 1")
    if drive not in DRIVES:
        raise ValueError(f"drive = {drive!r}; expected one of {', '.join(map(repr, DRIVES))}")
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP[drive]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if drive == "planar":
        spec.option.gravity = [0, 0, 0]
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        contype=_FLOOR,
        conaffinity=_FOOT,
        rgba=[0.93, 0.92, 0.90, 1],
    )
    for number in range(robots):
        body = spec.worldbody.add_body(name=f"robot{number}")
        if drive == "wheels":
            _add_wheels(spec, body, number, robot)
        else:
            _add_planar(spec, body, number, robot)
        height = 0.0 if drive == "wheels" else robot.wheel_radius_m
        _add_shell(body, number, height, robot)
    if furnish is not None:
        furnish(spec)
    return spec.compile()


def _sphere(
    body: mujoco.MjsBody, name: str, radius: float, pos: list[float], **kinds: object
) -> None:
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0, 0],
        pos=pos,
        mass=0,
        group=3,
        **kinds,
    )


def _add_wheels(spec: mujoco.MjSpec, body: mujoco.MjsBody, number: int, robot: RobotConfig) -> None:
    name = f"robot{number}"
    rolling = (
        robot.mass_kg / g.BODY_MASS * (robot.wheel_radius_m / g.WHEEL_RADIUS) ** 2
    )  # inertia that a wheel feels
    pulling = robot.mass_kg / g.BODY_MASS * (robot.wheel_radius_m / g.WHEEL_RADIUS)
    body.add_freejoint(name=f"{name}/free")
    body.explicitinertial = True
    body.mass = robot.mass_kg - 2 * robot.wheel_mass_kg
    body.inertia = list(robot.inertia_kg_m2)
    body.ipos = [robot.size * x for x in CENTRE_OF_MASS]
    for side, x, gap in (
        ("rear", -robot.slider_x_m, 0.0),
        ("front", robot.slider_x_m, robot.size * FRONT_GAP),
    ):
        place = [x, 0, robot.slider_radius_m - robot.wheel_radius_m + gap]
        _sphere(
            body,
            f"{name}/{side}",
            robot.slider_radius_m,
            place,
            contype=_FOOT,
            conaffinity=_FLOOR,
            condim=1,
            priority=1,
        )
    spin = robot.wheel_mass_kg * robot.wheel_radius_m**2 / 2  # kg m², a disc about its axle
    for side, y in (("left", robot.track_m / 2), ("right", -robot.track_m / 2)):
        wheel = body.add_body(name=f"{name}/{side}", pos=[0, y, 0])
        wheel.explicitinertial = True
        wheel.mass = robot.wheel_mass_kg
        wheel.inertia = [0.51 * spin, spin, 0.51 * spin]
        wheel.add_joint(
            name=f"{name}/{side}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 1, 0],
            armature=rolling * ROTOR_INERTIA,
        )
        _sphere(
            wheel,
            f"{name}/{side}_tyre",
            robot.wheel_radius_m,
            [0, 0, 0],
            contype=_FOOT,
            conaffinity=_FLOOR,
            condim=3,
            priority=2,
            friction=[FRICTION, 0, 0],
        )
        motor = spec.add_actuator(
            name=f"{name}/{side}", target=f"{name}/{side}", trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.set_to_velocity(kv=rolling * WHEEL_SERVO)
        motor.forcelimited = True
        motor.forcerange = [-pulling * TORQUE_LIMIT, pulling * TORQUE_LIMIT]


def _add_planar(spec: mujoco.MjSpec, body: mujoco.MjsBody, number: int, robot: RobotConfig) -> None:
    name = f"robot{number}"
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


def _add_shell(body: mujoco.MjsBody, number: int, axle: float, robot: RobotConfig) -> None:
    """Add the collision sphere and the visible parts, with the axle at the given height of the body
    frame.
    """
    name = f"robot{number}"
    _sphere(
        body,
        f"{name}/bumper",
        robot.body_radius_m,
        [0, 0, axle],
        contype=_BODY,
        conaffinity=_BODY,
        condim=1,
    )
    colour = list(COLOURS[0] if number == 0 else COLOURS[1])
    half = (robot.body_height_m - 0.004) / 2
    seen = {"contype": 0, "conaffinity": 0, "mass": 0, "group": 1}
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(
        name=f"{name}/shell",
        type=cylinder,
        size=[robot.body_radius_m, half, 0],
        pos=[0, 0, axle - robot.wheel_radius_m + 0.004 + half],
        rgba=colour,
        **seen,
    )
    top = axle - robot.wheel_radius_m + robot.body_height_m
    size = robot.size
    body.add_geom(
        name=f"{name}/nose",
        type=box,
        size=[size * 0.012, size * 0.003, size * 0.002],
        pos=[size * 0.020, 0, top + size * 0.002],
        rgba=[0.98, 0.95, 0.85, 1],
        **seen,
    )
    for side, y in (("left", robot.track_m / 2), ("right", -robot.track_m / 2)):
        body.add_geom(
            name=f"{name}/{side}_disc",
            type=cylinder,
            size=[robot.wheel_radius_m, size * 0.0015, 0],
            pos=[0, y * 1.32, axle],
            quat=[math.cos(math.pi / 4), math.sin(math.pi / 4), 0, 0],
            rgba=[0.2, 0.2, 0.2, 1],
            **seen,
        )
