"""From pixels to poses: ``cv2.aruco.ArucoDetector`` finds the markers, the calibration makes poses
of their corners.

In a sequence most markers are where they were expected: small windows around the expected places
are searched first, and the whole picture only while a robot is missing. A light blur before
detection costs little and saves most of the time that noise would.

Contract: a Finder keeps no picture. Expected places are the caller's; without them the whole
picture is searched.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.optics import MARKER_HEIGHT, Camera, dictionary

Picture = NDArray[np.uint8]
Pose = tuple[float, float, float]
SQUARE = 1.5  # longest over shortest side of what can be a marker
SIZE = 1.6  # how much larger or smaller it can be than a marker in the middle of the picture
WINDOW = 2.2  # marker widths around the expected middle


class Finder:
    """Finds the robots of a formation in pictures.

    Args:
        camera: its calibration is used.
        robots: markers 0 to robots - 1 are looked for; others are ignored.
    """

    def __init__(self, camera: Camera, robots: int) -> None:
        self.camera = camera
        self.robots = robots
        settings = cv2.aruco.DetectorParameters()
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        settings.perspectiveRemovePixelPerCell = 8
        settings.perspectiveRemoveIgnoredMarginPerCell = 0.25
        settings.errorCorrectionRate = 1.0
        settings.adaptiveThreshWinSizeMin = 13
        settings.adaptiveThreshWinSizeMax = 23
        settings.minMarkerPerimeterRate = 0.02
        self._detector = cv2.aruco.ArucoDetector(dictionary(robots), settings)
        near = cv2.aruco.DetectorParameters()
        for name in (
            "cornerRefinementMethod",
            "perspectiveRemovePixelPerCell",
            "perspectiveRemoveIgnoredMarginPerCell",
            "errorCorrectionRate",
            "adaptiveThreshWinSizeMin",
            "adaptiveThreshWinSizeMax",
        ):
            setattr(near, name, getattr(settings, name))
        near.minMarkerPerimeterRate = 0.5
        self._near = cv2.aruco.ArucoDetector(dictionary(robots), near)
        config = camera.config
        self._half = WINDOW / 2 * config.marker_m * config.width_px / config.span_m

    def find(self, image: Picture, expected: Mapping[int, Pose] | None = None) -> dict[int, Pose]:
        """Return the pose of every robot that is found: x, y in m, heading in rad.

        What is not square, or of another size than a marker on a robot, is none (text, for
        example); a marker that is there twice tells no pose and is left out, where the whole
        picture is searched.

        Args:
            image: (height, width) uint8, of the camera's size.
            expected: poses near which to look first.

        Raises:
            ValueError: a picture of another size or kind than the camera's.
        """
        self._check(image)
        found: dict[int, Pose] = {}
        for number, place in (expected or {}).items():
            corners = self._find_near(image, number, place)
            if corners is not None:
                found[number] = self.camera.pose_of(corners)
        if len(found) < self.robots:
            seen = list(self._detect(self._detector, image))
            numbers = [number for number, _ in seen]
            for number, corners in seen:
                if number not in found and numbers.count(number) == 1:
                    found[number] = self.camera.pose_of(corners)
        return found

    def _check(self, image: Picture) -> None:
        config = self.camera.config
        wanted = (config.height_px, config.width_px)
        shape = np.shape(image)
        kind = getattr(image, "dtype", type(image).__name__)
        if kind != np.uint8 or shape != wanted:
            raise ValueError(
                f"a picture of {shape} {kind}; expected {wanted} uint8, grey, as the camera was "
                "calibrated: convert it, or describe the camera that took it (CameraConfig)"
            )

    def _find_near(self, image: Picture, number: int, place: Pose) -> NDArray[np.float64] | None:
        middle = self.camera.project(np.array([[place[0], place[1], MARKER_HEIGHT]]))[0]
        x0, y0 = (max(0, int(at - self._half)) for at in middle)
        x1, y1 = (max(0, int(at + self._half)) for at in middle)
        window = image[y0:y1, x0:x1]
        if min(window.shape) < 16:
            return None
        for seen, corners in self._detect(self._near, window):
            if seen == number:
                return corners + [x0, y0]
        return None

    def _detect(
        self, detector: "cv2.aruco.ArucoDetector", image: Picture
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        corners, numbers, _ = detector.detectMarkers(cv2.GaussianBlur(image, (3, 3), 0))
        for found, number in zip(corners, [] if numbers is None else numbers.ravel(), strict=True):
            square = found.reshape(4, 2).astype(np.float64)
            if number < self.robots and self._is_marker(square):
                yield int(number), square

    def _is_marker(self, corners: NDArray[np.float64]) -> bool:
        """Return whether four corners are about square, and about as large as a marker."""
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        large = sides / (2 * self._half / WINDOW)
        return bool(sides.max() < SQUARE * sides.min() and 1 / SIZE < large.mean() < SIZE)


def is_picture(path: Path) -> bool:
    """Return whether a file has the name of a picture, and is not hidden."""
    return path.suffix.lower() in (".png", ".jpg", ".jpeg") and not path.name.startswith(".")


def check_name(path: Path) -> None:
    """Refuse a name that OpenCV cannot take.

    Raises:
        ValueError: it is no UTF-8.
    """
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        raise ValueError(f"{str(path)!r} is no UTF-8 name; rename it") from None


def _by_number(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def pictures(folder: str | Path) -> Iterator[tuple[str, Picture]]:
    """Yield name and grey picture of every PNG or JPEG in a folder, in the order of their names,
    numbers in them by size.

    Raises:
        FileNotFoundError: no folder, or no pictures in it.
        ValueError: a file is no picture.
    """
    place = Path(folder).expanduser()
    files = [path for path in place.glob("*") if is_picture(path)]
    if not files:
        raise FileNotFoundError(f"{place} holds no .png or .jpg pictures")
    for path in sorted(files, key=_by_number):
        check_name(path)
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f"{path} is no picture that OpenCV can read; take it away")
        yield path.name, np.asarray(image, np.uint8)
