"""Pictures of the arena without OpenGL: camera rays and lamp rays through MuJoCo's own ray caster.

One ray per pixel finds what the camera sees; a second ray, from the lamp to that point, finds
whether it lies in shadow. The black line comes from the same floor raster that the leader's ground
sensors read. About 0.1 s for 320 × 240.

>>> from workbench.arena.tracks import TrackConfig, make_track
>>> track = make_track(TrackConfig(), np.random.default_rng(0))
>>> world = World(1, [track], drive="planar", spacing_m=0.15)
>>> picture(world, width=32, height=24).shape
(24, 32, 3)

Contract: draws into a new array; the world is not changed.
"""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import World
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
    hit = geom >= 0
    points = origin + rays * distance[:, None]
    colour = np.tile(SKY, (len(rays), 1))
    colour[hit] = world.model.geom_rgba[geom[hit], :3]
    floor = hit & (geom == world.model.geom("floor").id)
    dark = world.floor.darkness(formation, points[floor, :2])
    colour[floor] = colour[floor] * (1 - dark[:, None]) + INK * dark[:, None]
    if sensors:
        cone = _cones(world, formation, points[floor])[:, None]
        colour[floor] = colour[floor] * (1 - cone) + BEAM * cone
    colour[hit] *= _light(world.model, data, points[hit], normal[hit])[:, None]
    far = np.clip((distance - 2.0) / 3.0, 0.0, 1.0)[:, None]
    colour = np.where(hit[:, None], colour * (1 - far) + SKY * far, colour)
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


def _light(model: mujoco.MjModel, data: mujoco.MjData, points: Floats, normal: Floats) -> Floats:
    """Return brightness: ambient light, and the lamp's where no geom stands between."""
    beam = points - LAMP
    length = np.linalg.norm(beam, axis=1)
    beam /= length[:, None]
    reach, _, _ = _cast(model, data, LAMP, beam)
    lit = reach > length - 2e-3
    facing = np.clip(-np.sum(beam * normal, axis=1), 0.0, 1.0)
    brightness: Floats = 0.55 + 0.50 * facing * lit
    return brightness


def _cones(world: World, formation: int, points: Floats) -> Floats:
    """Return how much floor points are within the sensors' cones, fading out towards their ends,
    (N,) in [0, 1].
    """
    share = np.zeros(len(points))
    ring = RING * world.robot.size
    length = BEAM_M * world.robot.size
    for robot in range(world.robots):
        x, y, heading = world.pose(formation, robot)
        near = np.flatnonzero(np.hypot(points[:, 0] - x, points[:, 1] - y) < ring + length)
        for angle in BEARINGS + heading:
            gap = points[near, :2] - [x + ring * math.cos(angle), y + ring * math.sin(angle)]
            far = np.hypot(gap[:, 0], gap[:, 1])
            off = np.arctan2(gap[:, 1], gap[:, 0]) - angle
            inside = (far < length) & (np.abs(np.arctan2(np.sin(off), np.cos(off))) < BEAM_HALF)
            share[near[inside]] = np.maximum(
                share[near[inside]], 0.75 - 0.45 * far[inside] / length
            )
    return share
