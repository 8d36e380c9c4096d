"""The overhead camera at work: draws and searches a picture of one formation every so often."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import World
from workbench.robot.geometry import CONTROL_PERIOD

if TYPE_CHECKING:
    from workbench.arena.camera.optics import Camera


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
        x = robots["camera"]["x"] + ahead * robots["camera"]["cos"]
        y = robots["camera"]["y"] + ahead * robots["camera"]["sin"]
        expected = {
            number: (float(x[number]), float(y[number]), 0.0)
            for number in np.flatnonzero(robots["camera"]["tracked"]).tolist()
        }
        for number, pose in self.finder.find(self.frame, expected).items():
            sights[number] = (*pose, 1.0)
