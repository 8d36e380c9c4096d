"""An overhead camera over the arena: what it is, how it is calibrated, and what it makes of pixels.

The camera looks down from ``height_m`` with a small tilt, a pinhole with radial lens distortion.
Every robot carries an ArUco marker on its top. What the user of such a camera has is a calibration,
and that is wrong by a little: focal length, distortion, and twelve floor points measured to a
millimetre, from which ``cv2.solvePnP`` finds where the camera hangs. A pixel is undistorted and its
ray cut with the plane of the markers.

    true projection → pixels (``frames``) → corners (``markers``) → Calibration.plane_points → pose

``bias_table`` gives the systematic part of the error over the arena, exactly, without pixels; the
random part of the fast error model (sensing "camera") was fitted to the pixel pipeline (``python -m
workbench validate camera``, data/validation/camera.json).

>>> camera = Camera(CameraConfig())
>>> pixel = camera.project(np.array([[0.3, -0.2, 0.0]]))
>>> np.allclose(camera.truth().plane_points(pixel, 0.0), [[0.3, -0.2]], atol=1e-6)
True

Contract: arrays of points are (n, 2) or (n, 3), world in m (x forward, y left of the arena, z up),
pixels x right, y down. cv2 is imported with this module only.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import TABLE, CameraConfig
from workbench.robot.geometry import BODY_HEIGHT

Floats = NDArray[np.float64]
MARKER_HEIGHT = BODY_HEIGHT + 0.002  # m above the floor
CALIBRATION_POINTS = 12


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is believed of a camera.

    Attributes:
        matrix: (3, 3) intrinsics, distortion: (5,), rotation: (3, 3) world to camera, position:
            (3,) of the camera in m.
    """

    matrix: Floats
    distortion: Floats
    rotation: Floats
    position: Floats

    def plane_points(self, pixels: Floats, height_m: float) -> Floats:
        """Return where on a plane at a height the rays of pixels (n, 2) end, (n, 2) in m."""
        flat = cv2.undistortPoints(
            np.asarray(pixels, np.float64).reshape(-1, 1, 2), self.matrix, self.distortion
        )
        rays = np.column_stack([flat.reshape(-1, 2), np.ones(len(flat))]) @ self.rotation
        along = (height_m - self.position[2]) / rays[:, 2]
        points: Floats = self.position[:2] + rays[:, :2] * along[:, None]
        return points


class Camera:
    """A camera and the calibration that its user has.

    Args:
        config: see CameraConfig.
        rng: draws the errors of the calibration; None for a calibration without error.
        calibration: of a camera that exists, see ``calibrate``; of the configuration only sizes
            count then.
    """

    def __init__(
        self,
        config: CameraConfig,
        rng: np.random.Generator | None = None,
        *,
        calibration: Calibration | None = None,
    ) -> None:
        self.config = config
        truth = _ideal(config) if calibration is None else calibration
        self.matrix, self.distortion = truth.matrix, truth.distortion
        self.rotation, self.position = truth.rotation, truth.position
        self.calibration = truth if rng is None else self._calibrate(rng)

    def truth(self) -> Calibration:
        """Return the calibration that has no error."""
        return Calibration(self.matrix, self.distortion, self.rotation, self.position)

    def project(self, points: Floats) -> Floats:
        """Return the true pixels (n, 2) of world points (n, 3)."""
        vector, _ = cv2.Rodrigues(self.rotation)
        pixels, _ = cv2.projectPoints(
            np.asarray(points, np.float64).reshape(-1, 1, 3),
            vector,
            -self.rotation @ self.position,
            self.matrix,
            self.distortion,
        )
        found: Floats = np.asarray(pixels, np.float64).reshape(-1, 2)
        return found

    def view(self, height_m: float = MARKER_HEIGHT) -> tuple[float, float, float, float]:
        """Return the rectangle x0, x1, y0, y1 in m around what is seen at a height, a marker's half
        width inside.
        """
        w = self.config.width_px
        h = self.config.height_px
        edge = [(0, h / 2), (w, h / 2), (w / 2, 0), (w / 2, h)]
        points = self.truth().plane_points(np.array(edge, float), height_m)
        half = self.config.marker_m / 2 * math.sqrt(2)
        return points[0, 0] + half, points[1, 0] - half, points[3, 1] + half, points[2, 1] - half

    def sees(self, points: Floats) -> bool:
        """Return whether markers at all points (n, 2) would be in the picture."""
        x0, x1, y0, y1 = self.view()
        return bool(
            np.all(
                (points[:, 0] > x0)
                & (points[:, 0] < x1)
                & (points[:, 1] > y0)
                & (points[:, 1] < y1)
            )
        )

    def _calibrate(self, rng: np.random.Generator) -> Calibration:
        config = self.config
        matrix = self.matrix.copy()
        distortion = self.distortion.copy()
        matrix[0, 0] *= 1 + config.focal_error * rng.standard_normal()
        matrix[1, 1] = matrix[0, 0]
        distortion *= 1 + config.distortion_error * rng.standard_normal()
        x0, x1, y0, y1 = self.view(0.0)
        across = np.array([(x, y) for y in np.linspace(y0, y1, 3) for x in np.linspace(x0, x1, 4)])[
            :CALIBRATION_POINTS
        ]
        pixels = self.project(np.column_stack([across, np.zeros(len(across))]))
        measured = across + config.floor_error_m * rng.standard_normal(across.shape)
        points = np.column_stack([measured, np.zeros(len(measured))])
        found, vector, translation = cv2.solvePnP(points, pixels, matrix, distortion)
        if not found:
            raise RuntimeError(
                "cv2.solvePnP found no pose for the calibration points; check CameraConfig"
            )
        rotation = np.asarray(cv2.Rodrigues(vector)[0], np.float64)
        return Calibration(
            matrix, distortion, rotation, np.asarray(-rotation.T @ translation, np.float64).ravel()
        )

    def marker_corners(self, x: float, y: float, heading: float, *, grow: float = 1.0) -> Floats:
        """Return (4, 3) world corners of a robot's marker: top left, top right, bottom right,
        bottom left, its top in front.
        """
        half = self.config.marker_m / 2 * grow
        local = np.array(
            [[half, half], [half, -half], [-half, -half], [-half, half]]
        )  # x forward, y left
        c, s = math.cos(heading), math.sin(heading)
        around = local @ np.array([[c, s], [-s, c]])
        return np.column_stack([x + around[:, 0], y + around[:, 1], np.full(4, MARKER_HEIGHT)])

    def pose_of(self, corners_px: Floats) -> tuple[float, float, float]:
        """Return x, y in m and heading in rad of a robot from its marker's corners (4, 2) in
        pixels, by the calibration.
        """
        points = self.calibration.plane_points(corners_px, MARKER_HEIGHT)
        front = (points[0] + points[1]) / 2
        back = (points[2] + points[3]) / 2
        left, right = (points[0] + points[3]) / 2, (points[1] + points[2]) / 2
        along = front - back
        across = left - right
        heading = math.atan2(along[1] - across[0], along[0] + across[1])  # mean of both directions
        x, y = points.mean(axis=0)
        return float(x), float(y), heading

    def bias_table(self) -> tuple[Floats, Floats]:
        """Return (3, TABLE, TABLE) systematic errors x, y in m and heading in rad over the view,
        and its x0, x1, y0, y1.

        The last axis is x. What a noiseless picture of a marker there would be taken for, minus
        where it is.
        """
        x0, x1, y0, y1 = self.view()
        xs, ys = np.linspace(x0, x1, TABLE), np.linspace(y0, y1, TABLE)
        table = np.zeros((3, TABLE, TABLE))
        corners = np.concatenate([self.marker_corners(x, y, 0.0) for y in ys for x in xs])
        pixels = self.project(corners).reshape(TABLE, TABLE, 4, 2)
        for i in range(TABLE):
            for j in range(TABLE):
                x, y, heading = self.pose_of(pixels[i, j])
                table[:, i, j] = x - xs[j], y - ys[i], heading
        return table, np.array([x0, x1, y0, y1])


def _ideal(config: CameraConfig) -> Calibration:
    """Return the camera that a configuration describes; it looks at the middle of the arena."""
    focal = config.width_px * config.height_m / config.span_m
    matrix = np.array(
        [[focal, 0, config.width_px / 2], [0, focal, config.height_px / 2], [0, 0, 1.0]]
    )
    distortion = np.array([config.k1, -config.k1 / 5, 0.0, 0.0, 0.0])
    tilt = math.radians(config.tilt_deg)
    lean = np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    position = np.array([0.0, config.height_m * math.tan(tilt), config.height_m])
    return Calibration(matrix, distortion, np.array([1.0, -1.0, -1.0]) * lean, position)


@lru_cache(maxsize=4)
def dictionary(robots: int) -> "cv2.aruco.Dictionary":
    """Return the smallest dictionary of 4×4 markers that has enough for a number of robots; robot i
    carries marker i.
    """
    if robots > 1000:
        raise ValueError(f"{robots} robots; the largest dictionary of 4×4 markers has 1000")
    kinds = {50: cv2.aruco.DICT_4X4_50, 250: cv2.aruco.DICT_4X4_250, 1000: cv2.aruco.DICT_4X4_1000}
    return cv2.aruco.getPredefinedDictionary(kinds[min(size for size in kinds if robots <= size)])
