"""The MuJoCo model of a line of e-pucks, with one of several drives.

Robots collide with each other as upright cylinders: their collision geoms are spheres of the body's
radius, whose centres all lie at the same height. The visible geoms (group 1) take no part in the
physics.

Contract: actuators and qpos come per robot as the drive says.

>>> model = build_model(2, "wheels")
>>> model.nq, model.nu, round(1000 * model.body_subtreemass[0])
(18, 4, 300)
"""

import math
from collections.abc import Callable

import mujoco

from workbench.arena.drives.drive import BODY, FLOOR, FOOT, add_sphere
from workbench.arena.drives.table import DRIVES
from workbench.robot.description import EPUCK, RobotConfig

COLOURS = ((0.80, 0.25, 0.20, 1.0), (0.20, 0.45, 0.75, 1.0))  # leader, followers


def build_model(
    robots: int,
    drive: str,
    furnish: Callable[[mujoco.MjSpec], None] | None = None,
    robot: RobotConfig = EPUCK,
    *,
    looks: bool = True,
) -> mujoco.MjModel:
    """Compile the model of a number of robots on an infinite floor; their bodies are robot0,
    robot1, ….

    ``looks``: whether there is anything to see of them, which physics does not need. ``furnish``
    may add walls, boxes and the like to the specification before it is compiled. Gaps and offsets
    of robots other than the e-puck are scaled with the body's radius.

    Raises:
        ValueError: fewer than one robot or an unknown drive.
    """
    if robots < 1:
        raise ValueError(f"robots = {robots!r}; expected at least 1")
    if drive not in DRIVES:
        raise ValueError(f"drive = {drive!r}; expected one of {', '.join(map(repr, DRIVES))}")
    spec = mujoco.MjSpec()
    fidelity = DRIVES[drive]
    spec.option.timestep = fidelity.timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if not fidelity.gravity:
        spec.option.gravity = [0, 0, 0]
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        contype=FLOOR,
        conaffinity=FOOT,
        rgba=[0.93, 0.92, 0.90, 1],
    )
    for number in range(robots):
        body = spec.worldbody.add_body(name=f"robot{number}")
        fidelity.add(spec, body, body.name, robot)
        _add_bumper(body, fidelity.axle_m(robot), robot)
        if looks:
            _add_looks(body, number, fidelity.axle_m(robot), robot)
    if furnish is not None:
        furnish(spec)
    return spec.compile()


def _add_bumper(body: mujoco.MjsBody, axle: float, robot: RobotConfig) -> None:
    """Add the collision sphere, with the axle at a height of the body frame."""
    add_sphere(
        body,
        f"{body.name}/bumper",
        robot.body_radius_m,
        [0, 0, axle],
        contype=BODY,
        conaffinity=BODY,
        condim=1,
    )


def _add_looks(body: mujoco.MjsBody, number: int, axle: float, robot: RobotConfig) -> None:
    """Add what is seen of a robot and touches nothing."""
    name = f"robot{number}"
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
