"""Pictures of the arena with OpenGL, for who has it: faster than ``arena.picture`` where they are
large and smooth.

    # MUJOCO_GL=egl, osmesa or glfw is the user's to set before mujoco is imported
    with GLCamera(world) as camera:
        pixels = camera.picture()

The line on the floor is not in MuJoCo's model; here it is the top of a chain of capsules that are
sunk into the floor.

Contract: create one camera per world and use it for many pictures; it holds a context of the
graphics driver until it is closed.
"""

import math
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.picture import INK
from workbench.arena.world import World

SEGMENTS = 300  # capsules of the line


class GLCamera:
    """An OpenGL camera that looks at a world.

    Args:
        world: the world to look at.
        width, height: pixels.
        line_width_m: width of the black line.

    Raises:
        RuntimeError: there is no OpenGL; the message says what draws without it.
    """

    def __init__(
        self, world: World, *, width: int = 320, height: int = 240, line_width_m: float = 0.015
    ) -> None:
        self.world = world
        self._line_width_m = line_width_m
        world.model.vis.global_.offwidth, world.model.vis.global_.offheight = width, height
        world.model.vis.headlight.ambient[:] = 0.6
        world.model.vis.headlight.diffuse[:] = 0.45
        try:
            self._renderer = mujoco.Renderer(
                world.model, height, width, max_geom=SEGMENTS + 20 * world.robots + 100
            )
        except Exception as error:  # whatever a driver raises
            raise RuntimeError(
                f"no OpenGL here ({type(error).__name__}: {error}); set MUJOCO_GL to egl, "
                "osmesa or glfw before Python starts, "
                "or draw without it: workbench.picture"
            ) from error

    def picture(
        self,
        formation: int = 0,
        *,
        eye: tuple[float, float, float] = (0.0, -1.15, 0.95),
        target: tuple[float, float, float] = (0.0, -0.03, 0.0),
        field_of_view_deg: float = 42.0,
    ) -> NDArray[np.uint8]:
        """Return a picture of one formation, (height, width, 3) uint8; arguments as
        ``arena.picture.picture``.
        """
        world = self.world
        data = world.batch.get_data(formation)
        mujoco.mj_forward(world.model, data)
        camera = mujoco.MjvCamera()
        away = np.array(target) - np.array(eye)
        camera.lookat = target
        camera.distance = float(np.linalg.norm(away))
        camera.azimuth = math.degrees(math.atan2(away[1], away[0]))
        camera.elevation = math.degrees(math.asin(away[2] / camera.distance))
        world.model.vis.global_.fovy = field_of_view_deg
        self._renderer.update_scene(data, camera)
        self._draw_line(formation)
        pixels: NDArray[np.uint8] = self._renderer.render()
        return pixels.copy()

    def _draw_line(self, formation: int) -> None:
        scene = self._renderer.scene
        track = self.world.tracks[formation]
        # of what shows above the floor, m
        half = self._line_width_m / 2
        height = 0.0006
        radius = (half**2 + height**2) / (2 * height)
        points = track.line[:: max(1, len(track.line) // SEGMENTS)][:SEGMENTS]
        ends = np.column_stack([points, np.full(len(points), height - radius)])
        for start, end in zip(ends, np.roll(ends, -1, axis=0), strict=True):
            geom = scene.geoms[scene.ngeom]
            rgba = np.array([*INK, 1.0], np.float32)
            mujoco.mjv_initGeom(
                geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9), rgba
            )
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, start, end)
            scene.ngeom += 1

    def close(self) -> None:
        """Give the graphics context back."""
        self._renderer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
