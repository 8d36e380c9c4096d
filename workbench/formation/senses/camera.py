"""What a follower is told by the overhead camera: poses by pixels, or by a fast model of their
errors.

    pixels   every picture is drawn (``arena.camera.frames``) and searched
             (``arena.camera.markers``), the tracker fills gaps;
    camera   the true pose of a moment ago, plus the calibration's bias at that place, plus noise;
             now and then nothing. The noise was fitted to the pixels
             (``arena.camera.config.NOISE``), the bias is exact.

Both end in the same tracker. Distance and bearing come from the poses of follower and predecessor;
if one of them is nowhere, the predecessor is out of sight.

Contract: ``camera_pose`` and ``observe_tracked`` are compiled; ``Eyes`` is Python and holds the
pictures of one formation.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.tracker import bias_at, follow_marker
from workbench.arena.world import World
from workbench.compiled import compiled
from workbench.formation.senses.infrared import UNSEEN
from workbench.formation.senses.truth import observe
from workbench.robot.geometry import CONTROL_PERIOD

if TYPE_CHECKING:
    from workbench.arena.camera.optics import Camera

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
    x, y = (
        robot.pose.x - age * robot.motion.speed * robot.pose.cos,
        robot.pose.y - age * robot.motion.speed * robot.pose.sin,
    )
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


class Eyes:
    """The camera of one formation, in pixels.

    Args:
        camera: calibrated.
        world, formation: what is looked at.
        noise, hidden: generators of picture noise and of hidden markers.
    """

    def __init__(
        self,
        camera: "Camera",
        world: World,
        formation: int,
        noise: np.random.Generator,
        hidden: np.random.Generator,
    ) -> None:
        from workbench.arena.camera.frames import Frames
        from workbench.arena.camera.markers import Finder

        self.camera = camera
        self.frames = Frames(camera, world.floor, world.robots, noise, formation=formation)
        self.finder = Finder(camera, world.robots)
        self._hidden = hidden
        self._config = camera.config
        self.frame: NDArray[np.uint8] | None = None

    def look(
        self,
        t: int,
        robots: NDArray[np.void],
        poses: NDArray[np.float64],
        sights: NDArray[np.float64],
    ) -> None:
        """Draw and search one picture; write (robots, 4) sights: x, y, heading, found.

        Args:
            t: control periods since the start.
            robots: their records: motion in the last period, and where the tracker expects them.
            poses: (robots, 3) true poses of this moment.
        """
        sights[:, 3] = 0.0
        if t % self._config.every:
            return
        age = self._config.latency_s
        past = poses.copy()
        past[:, 0] -= age * robots["motion"]["speed"] * np.cos(poses[:, 2])
        past[:, 1] -= age * robots["motion"]["speed"] * np.sin(poses[:, 2])
        past[:, 2] -= age * robots["motion"]["turn"]
        hidden = self._hidden.random(len(poses)) < self._config.dropout
        self.frame = self.frames.frame(past, hidden)
        ahead = robots["camera"]["speed"] * CONTROL_PERIOD
        x, y = (
            robots["camera"]["x"] + ahead * robots["camera"]["cos"],
            robots["camera"]["y"] + ahead * robots["camera"]["sin"],
        )
        expected = {
            number: (float(x[number]), float(y[number]), 0.0)
            for number in np.flatnonzero(robots["camera"]["tracked"]).tolist()
        }
        for number, pose in self.finder.find(self.frame, expected).items():
            sights[number] = (*pose, 1.0)
