"""Pictures as the overhead camera takes them: floor with its line, robots with their markers,
light, blur and noise.

The floor is drawn once per track, pixel by pixel through the true lens. A marker is warped into its
place (perspective, and the lens at its corners; within a marker of 27 pixels the lens is a straight
one). Then exposure, blur and noise are put on everything.

Contract: ``frame`` returns a new (height, width) uint8 array. Noise comes from the generator that
was given: a large tile of it is drawn once and shifted at random.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import CONDITIONS
from workbench.arena.camera.optics import MARKER_HEIGHT, Camera, dictionary
from workbench.arena.floor import Floor
from workbench.robot.geometry import BODY_RADIUS

Picture = NDArray[np.uint8]
# grey levels
FLOOR = 205
LINE = 30
SHELL = 120
PAPER = 245
_CELL = 12  # texture pixels per cell of a marker
_FINE = 3  # sub-pixels per pixel where robots are drawn
_SHIFT = 256  # pixels by which the noise is shifted


class Frames:
    """The pictures of one formation.

    Args:
        camera: through which they are seen.
        floor: rasters of the lines, or None for a blank floor; formation: which of them.
        robots: how many markers there are.
        rng: noise.
    """

    def __init__(
        self,
        camera: Camera,
        floor: Floor | None,
        robots: int,
        rng: np.random.Generator,
        *,
        formation: int = 0,
    ) -> None:
        self.camera = camera
        self._rng = rng
        config = camera.config
        self.exposure, self.blur_px, self.noise = CONDITIONS[config.conditions]
        self._shape = (config.height_px, config.width_px)
        self._background = self._draw_floor(floor, formation)
        markers = dictionary(robots)
        side = 6 * _CELL  # four cells and a black border
        self._textures = [
            cv2.copyMakeBorder(
                cv2.aruco.generateImageMarker(markers, number, side),
                _CELL,
                _CELL,
                _CELL,
                _CELL,
                cv2.BORDER_CONSTANT,
                value=PAPER,
            )
            for number in range(robots)
        ]
        tile = self.noise * rng.standard_normal(
            (self._shape[0] + _SHIFT, self._shape[1] + _SHIFT), dtype=np.float32
        )
        self._noise = np.round(tile).astype(np.int16)

    def frame(self, poses: NDArray[np.float64], hidden: NDArray[np.bool_] | None = None) -> Picture:
        """Return the picture of robots at poses (robots, 3): x, y in m and heading in rad; hidden
        ones lack their marker.
        """
        image = self._background.copy()
        for number, (x, y, heading) in enumerate(poses):
            self._draw_robot(
                image, number, x, y, heading, marker=hidden is None or not hidden[number]
            )
        if self.exposure != 1.0:
            image = np.asarray(cv2.convertScaleAbs(image, alpha=self.exposure), np.uint8)
        if self.blur_px:
            size = 2 * math.ceil(2 * self.blur_px) + 1
            image = np.asarray(cv2.GaussianBlur(image, (size, size), self.blur_px), np.uint8)
        if self.noise:
            down, right = (int(shift) for shift in self._rng.integers(0, _SHIFT, 2))
            noise = self._noise[down : down + self._shape[0], right : right + self._shape[1]]
            image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
        return image

    def _draw_floor(self, floor: Floor | None, formation: int) -> Picture:
        height, width = self._shape
        if floor is None:
            return np.full(self._shape, FLOOR, np.uint8)
        columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        points = self.camera.truth().plane_points(
            np.column_stack([columns.ravel(), rows.ravel()]), 0.0
        )
        dark = floor.darkness(formation, points[:, :2]).reshape(height, width)
        background: Picture = np.round(FLOOR + (LINE - FLOOR) * dark).astype(np.uint8)
        return background

    def _draw_robot(
        self, image: Picture, number: int, x: float, y: float, heading: float, *, marker: bool
    ) -> None:
        camera = self.camera
        rim = np.linspace(0, 2 * math.pi, 24, endpoint=False)
        shell = np.column_stack(
            [
                x + BODY_RADIUS * np.cos(rim),
                y + BODY_RADIUS * np.sin(rim),
                np.full(24, MARKER_HEIGHT),
            ]
        )
        paper = camera.marker_corners(x, y, heading, grow=8 / 6)
        pixels = camera.project(np.concatenate([shell, paper]))
        low = np.floor(pixels.min(axis=0)).astype(int) - 1
        high = np.ceil(pixels.max(axis=0)).astype(int) + 2
        x0 = max(low[0], 0)
        y0 = max(low[1], 0)
        x1 = min(high[0], image.shape[1])
        y1 = min(high[1], image.shape[0])
        if x1 <= x0 or y1 <= y0:
            return
        fine = ((pixels - [x0, y0] + 0.5) * _FINE - 0.5).astype(np.float32)
        patch = cv2.resize(
            image[y0:y1, x0:x1], None, fx=_FINE, fy=_FINE, interpolation=cv2.INTER_NEAREST
        )
        cv2.fillPoly(patch, [np.round(fine[:24] * 8).astype(np.int32)], SHELL, shift=3)
        if marker:
            side = self._textures[number].shape[0]
            texture = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - 0.5
            warp = cv2.getPerspectiveTransform(texture, fine[24:])
            cv2.warpPerspective(
                self._textures[number],
                warp,
                (patch.shape[1], patch.shape[0]),
                dst=patch,
                flags=cv2.INTER_AREA,
                borderMode=cv2.BORDER_TRANSPARENT,
            )
        image[y0:y1, x0:x1] = cv2.resize(patch, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
