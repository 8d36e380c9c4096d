"""Pictures of the arena without OpenGL: camera rays and lamp rays through MuJoCo's own ray caster.

One ray per pixel finds what the camera sees; a second ray, from the lamp to that point, finds
whether it lies in shadow. The black line comes from the same floor raster that the leader's ground
sensors read. About 0.03 s for 320 × 240.

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> track = make_track(TrackConfig(), np.random.default_rng(0))
>>> world = World(1, [track], drive="planar", spacing_m=0.15)
>>> picture(world, width=32, height=24).shape
(24, 32, 3)

Contract: draws into a new array; the world is not changed.
"""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.floor import floor_darkness
from workbench.arena.world import World
from workbench.compiled import compiled, compiled_with_arrays
from workbench.robot.infrared import BEARINGS, RING

Floats = NDArray[np.float64]
LAMP = np.array([-0.9, -1.3, 2.4])  # m
SKY = np.array([0.97, 0.97, 0.98])
INK = np.array([0.13, 0.13, 0.15])
BEAM = np.array([0.80, 0.47, 0.65])
# how far and how wide a sensor's cone is drawn: about where it sees a cup well
BEAM_M = 0.06
BEAM_HALF = math.radians(15)
_GROUPS = np.array(
    [1, 1, 0, 0, 0, 0], dtype=np.uint8
)  # the floor and what is visible of the robots


class Scene(NamedTuple):
    """What is looked at: colours (geoms, 3), the floor's geom and raster, poses (robots, 3) of
    robots whose cones are drawn, and how large robots are.
    """

    colours: Any
    floor: int
    raster: Any
    column0: int
    row0: int
    poses: Any
    size: float


class Seen(NamedTuple):
    """What rays meet: distance (N,) in m, geom (N,) or -1, normal (N, 3), lit by the lamp (N,)."""

    distance: Any
    geom: Any
    normal: Any
    lit: Any


def picture(
    world: World,
    formation: int = 0,
    *,
    eye: tuple[float, float, float] = (0.0, -1.15, 0.95),
    target: tuple[float, float, float] = (0.0, -0.03, 0.0),
    field_of_view_deg: float = 42.0,
    width: int = 320,
    height: int = 240,
    smooth: int = 1,
    sensors: bool = False,
) -> NDArray[np.uint8]:
    """Return a picture of one formation, (height, width, 3) uint8.

    Args:
        world: the world to look at.
        formation: which of its formations.
        eye, target: camera position and the point that it looks at, m.
        field_of_view_deg: vertical angle of view.
        width, height: pixels.
        smooth: rays per pixel in each direction; 2 or 3 for smooth edges.
        sensors: show where the eight infrared sensors of every robot look, as cones on the floor
            (paper, Fig. 3).
    """
    if min(width, height, smooth) < 1 or not 1.0 <= field_of_view_deg <= 150.0:
        raise ValueError(
            f"width, height, smooth = {width}, {height}, {smooth}; field of view "
            f"{field_of_view_deg}; expected "
            "sizes of at least 1 and an angle from 1 to 150 degrees"
        )
    data = mujoco.MjData(world.model)
    data.qpos[:] = world.joints(formation)
    mujoco.mj_forward(world.model, data)
    origin = np.array(eye, dtype=np.float64)
    rays = _camera_rays(
        origin,
        np.array(target, dtype=np.float64),
        field_of_view_deg,
        width * smooth,
        height * smooth,
    )
    distance, geom, normal = _cast(world.model, data, origin, rays)
    beams, lengths = _from_lamp(origin, rays, distance)
    reach, _, _ = _cast(world.model, data, LAMP, beams)
    floor = world.floor
    poses = [world.pose(formation, robot) for robot in range(world.robots if sensors else 0)]
    scene = Scene(
        world.model.geom_rgba[:, :3].astype(np.float64),
        world.model.geom("floor").id,
        floor.raster[formation],
        floor.column0,
        floor.row0,
        np.array(poses, dtype=np.float64).reshape(-1, 3),
        world.robot.size,
    )
    seen = Seen(distance, geom, normal, reach > lengths - 2e-3)
    colour = _shade(scene, origin, rays, seen, beams)
    fine = colour.reshape(height, smooth, width, smooth, 3).mean(axis=(1, 3))
    pixels: NDArray[np.uint8] = np.round(255 * np.clip(fine, 0.0, 1.0)).astype(np.uint8)
    return pixels


def _camera_rays(eye: Floats, target: Floats, angle_deg: float, width: int, height: int) -> Floats:
    forward = (target - eye) / np.linalg.norm(target - eye)
    side = np.cross(forward, [0.0, 0.0, 1.0])
    right = (
        side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-9 else np.array([1.0, 0.0, 0.0])
    )
    up = np.cross(right, forward)
    half = math.tan(math.radians(angle_deg) / 2)
    v = half * (1 - (np.arange(height) + 0.5) / height * 2)
    u = half * width / height * ((np.arange(width) + 0.5) / width * 2 - 1)
    rays = forward + v[:, None, None] * up + u[None, :, None] * right
    flat: Floats = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    return flat


def _cast(
    model: mujoco.MjModel, data: mujoco.MjData, origin: Floats, rays: Floats
) -> tuple[Floats, NDArray[np.int32], Floats]:
    """Return distance, geom (-1: none) and surface normal for rays from one point."""
    count = len(rays)
    distance = np.zeros(count)
    geom = np.full(count, -1, np.int32)
    normal = np.zeros(3 * count)
    mujoco.mj_multiRay(
        model,
        data,
        origin.reshape(3, 1),
        np.ascontiguousarray(rays).reshape(-1, 1),
        _GROUPS.reshape(6, 1),
        True,
        -1,
        geom.reshape(-1, 1),
        distance.reshape(-1, 1),
        normal.reshape(-1, 1),
        count,
        20.0,
    )
    return distance, geom, normal.reshape(-1, 3)


@compiled_with_arrays
def _from_lamp(origin: Any, rays: Any, distance: Any) -> tuple[Any, Any]:
    """Return the directions from the lamp to where rays from a point end, (N, 3), and how far that
    is, (N,) in m; straight up, away from all, where a ray meets nothing.
    """
    beams = np.zeros(rays.shape)
    lengths = np.ones(rays.shape[0])
    for n in range(rays.shape[0]):
        if distance[n] < 0.0:
            beams[n, 2] = 1.0
            continue
        square = 0.0
        for k in range(3):
            beams[n, k] = origin[k] + rays[n, k] * distance[n] - LAMP[k]
            square += beams[n, k] * beams[n, k]
        lengths[n] = math.sqrt(square)
        for k in range(3):
            beams[n, k] /= lengths[n]
    return beams, lengths


@compiled_with_arrays
def _shade(scene: Any, origin: Any, rays: Any, seen: Any, beams: Any) -> Any:
    """Return the colour of what every ray meets, (N, 3) in [0, 1]: in the lamp's light or shadow,
    in haze where it is far.

    Args:
        scene: of type Scene; seen: of type Seen.
        origin, rays: (3,), (N, 3) from the camera; beams: (N, 3) from the lamp.
    """
    colour = np.empty(rays.shape)
    for n in range(rays.shape[0]):
        geom = seen.geom[n]
        if geom < 0:
            colour[n] = SKY
            continue
        away = seen.distance[n]
        dark = cone = 0.0
        if geom == scene.floor:
            x, y = origin[0] + rays[n, 0] * away, origin[1] + rays[n, 1] * away
            dark = floor_darkness(scene.raster, scene.column0, scene.row0, x, y)
            cone = _cone(scene, x, y)
        facing = 0.0
        for k in range(3):
            facing -= beams[n, k] * seen.normal[n, k]
        light = 0.55 + 0.50 * min(max(facing, 0.0), 1.0) * seen.lit[n]
        far = min(max((away - 2.0) / 3.0, 0.0), 1.0)
        for k in range(3):
            own = scene.colours[geom, k] * (1.0 - dark) + INK[k] * dark
            own = (own * (1.0 - cone) + BEAM[k] * cone) * light
            colour[n, k] = own * (1.0 - far) + SKY[k] * far
    return colour


@compiled
def _cone(scene: Any, x: float, y: float) -> float:
    """Return how much a place on the floor is within the sensors' cones, in [0, 1], fading out
    towards their ends.
    """
    ring = RING * scene.size
    length = BEAM_M * scene.size
    share = 0.0
    for robot in range(scene.poses.shape[0]):
        dx, dy = x - scene.poses[robot, 0], y - scene.poses[robot, 1]
        if math.hypot(dx, dy) >= ring + length:
            continue
        for k in range(BEARINGS.size):
            axis = BEARINGS[k] + scene.poses[robot, 2]
            gx, gy = dx - ring * math.cos(axis), dy - ring * math.sin(axis)
            far = math.hypot(gx, gy)
            off = math.atan2(gy, gx) - axis
            if far < length and abs(math.atan2(math.sin(off), math.cos(off))) < BEAM_HALF:
                share = max(share, 0.75 - 0.45 * far / length)
    return share
