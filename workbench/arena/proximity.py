"""Infrared by rays: what the eight sensors get back from anything in the world: robots, walls,
boxes.

The compiled control step knows robots only, as upright cylinders. Here every ray of every sensor is
cast by MuJoCo against all visible geoms (group 1) and against whatever a world was furnished with
(group 2), at the height of the sensors, and the same law adds them up. Where there are only robots
both agree (a test holds them together).

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> from workbench.robot.infrared import InfraredConfig
>>> def wall(spec):
...     add_box(spec, "wall", (0.0, 0.1), (0.5, 0.005))
>>> line = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
>>> world = World(0, [line], drive="planar", spacing_m=0.1, furnish=wall)
>>> world.place(0, 0, 0.0, 0.04, math.pi / 2)  # the wall is 20 mm in front of its shell
>>> [round(light) for light in RayProximity(world, InfraredConfig()).light(0, 0)][:2]
[383, 95]

Contract: reads the world's state, changes nothing. About a quarter of a millisecond per robot.
"""

import copy
import math
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import World
from workbench.robot.infrared import (
    BEARINGS,
    RANGE,
    RING,
    SCALE,
    InfraredConfig,
    ray_share,
    strength_of,
    wall_rays,
)

HEIGHT = 0.030  # m above the floor: published heights of the sensors are 25 to 34 mm
FURNITURE = 2  # geom group
_GROUPS = np.array([0, 1, 1, 0, 0, 0], np.uint8)


def add_box(
    spec: mujoco.MjSpec,
    name: str,
    centre: tuple[float, float],
    half: tuple[float, float],
    *,
    height_m: float = 0.1,
) -> None:
    """Add an upright box to a world's specification, which robots collide with and rays meet;
    lengths in m.
    """
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[*half, height_m / 2],
        pos=[*centre, height_m / 2],
        contype=4,
        conaffinity=4,
        group=FURNITURE,
        rgba=[0.75, 0.75, 0.72, 1],
    )


class RayProximity:
    """The proximity sensors of a world's robots.

    Args:
        world: what is looked at.
        config: what robots are covered with.
        reflectance: of furniture by geom name, white paper = 1 (default).
    """

    def __init__(
        self, world: World, config: InfraredConfig, reflectance: Mapping[str, float] | None = None
    ) -> None:
        self.world = world
        radius, self._strength, beacon = strength_of(config)
        if beacon:
            raise ValueError("target = 'beacon' emits; rays of reflected light do not apply to it")
        model = self._model = _covered(world.model, world.robots, radius)
        self._data = mujoco.MjData(self._model)
        self._share = np.ones(model.ngeom)
        for name, value in (reflectance or {}).items():
            if not 0 < value <= 5:
                raise ValueError(
                    f"reflectance of {name!r} = {value!r}; expected a number above 0, up to 5"
                )
            self._share[model.geom(name).id] = value
        self._share[[model.geom(f"robot{robot}/shell").id for robot in range(world.robots)]] = (
            self._strength
        )
        angles, self._weights = wall_rays()
        self._angles = BEARINGS[:, None] + angles

    def light(self, formation: int, robot: int) -> NDArray[np.float64]:
        """Return (8,) light in counts at gain 1."""
        model = self._model
        data = self._data
        data.qpos[:] = self.world.joints(formation)
        mujoco.mj_kinematics(model, data)
        x, y, heading = self.world.pose(formation, robot)
        body = model.body(f"robot{robot}").id
        total = np.zeros(len(BEARINGS))
        for k, bearing in enumerate(BEARINGS):
            axis = heading + bearing
            origin = np.array([x + RING * math.cos(axis), y + RING * math.sin(axis), HEIGHT])
            angle = heading + self._angles[k]
            rays = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
            distance = np.zeros(len(rays))
            geom = np.full(len(rays), -1, np.int32)
            normal = np.zeros(3 * len(rays))
            mujoco.mj_multiRay(
                model,
                data,
                origin.reshape(3, 1),
                rays.reshape(-1, 1),
                _GROUPS.reshape(6, 1),
                True,
                body,
                geom.reshape(-1, 1),
                distance.reshape(-1, 1),
                normal.reshape(-1, 1),
                len(rays),
                RANGE,
            )
            for j in np.flatnonzero(geom >= 0):
                incidence = abs(float(rays[j] @ normal[3 * j : 3 * j + 3]))
                total[k] += (
                    self._weights[j]
                    * self._share[geom[j]]
                    * ray_share(float(distance[j]), incidence)
                )
        return SCALE * total


def _covered(model: mujoco.MjModel, robots: int, radius: float) -> mujoco.MjModel:
    """Return a copy of a model whose robots have the radius that infrared sees, without their
    noses.
    """
    own = copy.copy(model)
    for robot in range(robots):
        own.geom(f"robot{robot}/shell").size[0] = radius
    for part in range(own.ngeom):
        name = own.geom(part).name
        if name.startswith("robot") and not name.endswith("/shell"):
            own.geom_group[part] = 5
    own.geom_rbound[:] = np.maximum(own.geom_rbound, radius + 0.05)
    return own
