"""What a follower is told by the overhead camera: poses by pixels, or by a fast model of their
errors.

    pixels   every picture is drawn (``arena.camera.frames``) and searched
             (``arena.camera.markers``), the tracker fills gaps;
    camera   the true pose of a moment ago, plus the calibration's bias at that place, plus noise;
             now and then nothing. The noise was fitted to the pixels
             (``arena.camera.config.NOISE``), the bias is exact.

Both end in the same tracker. Distance and bearing come from the poses of follower and predecessor;
if one of them is nowhere, the predecessor is out of sight.

Contract: what the loop calls is compiled.
"""

import math
from typing import Any

import numpy as np

from workbench.arena.camera.config import NOISE, CameraConfig
from workbench.arena.camera.eyes import Eyes
from workbench.arena.camera.tracker import TRACK, bias_at, follow_marker
from workbench.compiled import compiled
from workbench.formation.senses.infrared import UNSEEN
from workbench.formation.senses.sense import EVERYBODY, Draw, Sense, Values
from workbench.formation.senses.truth import observe
from workbench.robot.geometry import CONTROL_PERIOD

# spread of distances in m and bearings in rad by tracked poses, in the default arena: what a filter
# expects
NOISE_TOLD = (1e-4, math.radians(0.25))
# of TASK.camera
MODEL = 1
PIXELS = 2

CAMERA = np.dtype(  # seconds, control periods, share, spreads, rectangle seen
    [
        ("mode", "i8"),
        ("latency", "f8"),
        ("every", "i8"),
        ("missed", "f8"),
        ("noise", "f8", (4,)),
        ("window", "f8", (4,)),
    ]
)


@compiled
def camera_pose(
    task: Any, robot: Any, sight: Any, lens: Any, normal: Any, u: float, shown: bool
) -> None:
    """Track one robot for one control period.

    Args:
        task, robot: records of type TASK and ROBOT.
        sight: (4,) with pixels: x, y in m, heading in rad, found.
        lens: (3, n, n) with the model: systematic errors.
        normal: (3,) standard normal numbers; u: a uniform number in [0, 1).
        shown: whether there is a picture in this period.
    """
    if task.camera.mode == PIXELS:
        follow_marker(robot.camera, sight[3] > 0.5, sight[0], sight[1], sight[2], CONTROL_PERIOD)
        return
    age = task.camera.latency
    x = robot.pose.x - age * robot.motion.speed * robot.pose.cos
    y = robot.pose.y - age * robot.motion.speed * robot.pose.sin
    heading = math.atan2(robot.pose.sin, robot.pose.cos) - age * robot.motion.turn
    view = task.camera.window
    found = shown and u >= task.camera.missed and view[0] < x < view[1] and view[2] < y < view[3]
    if found:
        dx, dy, turn = bias_at(lens, view, x, y)
        r2 = x * x + y * y
        spread = task.camera.noise[0] + task.camera.noise[1] * r2
        sway = task.camera.noise[2] + task.camera.noise[3] * r2
        x = x + dx + spread * normal[0]
        y = y + dy + spread * normal[1]
        heading = heading + turn + sway * normal[2]
    follow_marker(robot.camera, found, x, y, heading, CONTROL_PERIOD)


@compiled
def observe_tracked(robot: Any, ahead: Any) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the robot ahead by the tracked poses, UNSEEN if
    one is nowhere.
    """
    if not (robot.camera.tracked and ahead.camera.tracked):
        return UNSEEN, 0.0
    return observe(
        robot.camera.x,
        robot.camera.y,
        robot.camera.cos,
        robot.camera.sin,
        ahead.camera.x,
        ahead.camera.y,
    )


@compiled
def locate(task: Any, one: Any, formation: Any, i: int) -> None:
    """Track robot i."""
    shown = formation.periods % task.camera.every == 0
    chance = one.chance[i]
    camera_pose(task, one.robots[i], one.sights[i], one.lens, chance.camera, chance.hidden, shown)


@compiled
def see(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write where the predecessor of follower i is by the tracked poses."""
    robot = robots[i]
    if not robot.seen.silent:
        robot.seen.distance, robot.seen.bearing = observe_tracked(robot, robots[robot.ahead])


def check(config: Any) -> None:
    """Refuse noise beside the camera's own."""
    if config.noisy:
        raise ValueError(
            f"ConvoyConfig.noise_distance_m = {config.noise_distance_m!r}, "
            f"noise_bearing_rad = {config.noise_bearing_rad!r} with "
            f"sensing = {config.sensing!r}; a camera has noise of its own: see camera.conditions"
        )


def fill(config: Any) -> Values:
    """Return the fields of the overhead camera; what it sees (``window``) is for ``equip``."""
    camera = config.camera
    *noise, missed = NOISE[camera.conditions]
    coarse = (camera.span_m / camera.width_px) / (CameraConfig().span_m / CameraConfig().width_px)
    camera_fields = {
        "mode": PIXELS if config.sensing == "pixels" else MODEL,
        "latency": camera.latency_s,
        "every": camera.every,
        "missed": 1 - (1 - missed) * (1 - camera.dropout),
        "noise": coarse * np.array(noise),
    }
    return {"camera": camera_fields}


def equip(convoy: Any) -> None:
    """Hang and calibrate a camera over every formation of a convoy."""
    from workbench.arena.camera.optics import Camera

    config = convoy.config.camera
    for b, (rng, track) in enumerate(zip(convoy.rngs, convoy.world.tracks, strict=True)):
        camera = Camera(config, rng["lens"])
        if not camera.sees(track.line):
            raise ValueError(
                f"CameraConfig.span_m = {config.span_m!r}; the track of seed "
                f"{convoy.seeds[b]} leaves the picture: expected a "
                "wider view (and more pixels), or a smaller track.radius_m"
            )
        if convoy.config.sensing == "pixels":
            convoy.eyes.append(Eyes(camera, convoy.world, b, rng["pictures"], rng["covered"]))
        else:
            table, view = camera.bias_table()
            if b == 0:
                convoy.lens = np.zeros((len(convoy.seeds), *table.shape))
                convoy.task["camera"]["window"] = view
            convoy.lens[b] = table


_KNOWN = ("distance", "bearing", "odometry")
MODES = tuple(
    Sense(
        name,
        tells,
        _KNOWN,
        see,
        locate,
        moving=True,
        epuck=True,
        noise=lambda _: NOISE_TOLD,
        age=lambda config: config.camera.latency_s,
        draws=(
            Draw("camera", (3,), "camera", EVERYBODY),
            Draw("hidden", (), "hidden", EVERYBODY, uniform=True),
        ),
        robot=(("camera", TRACK),),
        task=(("camera", CAMERA),),
        fill=fill,
        check=check,
        equip=equip,
    )
    for name, tells in (
        ("camera", "a fast model of an overhead camera's errors"),
        ("pixels", "draws and searches pictures of an overhead camera"),
    )
)
