"""Calibrating one's own overhead camera from pictures of a board, and reading that calibration.

Print a ChArUco board or a chessboard, take ten pictures or more of it in all parts of the view and
at several tilts, and one of it lying flat on the floor where the robots drive. ``calibrate`` finds
focal length and lens (``cv2.calibrateCamera``) and, from the picture on the floor, where the camera
hangs; ``load_camera`` makes of that a ``Camera`` that a ``markers.Finder`` takes.

The board on the floor is the world: its origin is the board's first corner (top left as printed),
x along the top edge, y up the page, z up from the floor. The board's own thickness is neglected.

>>> Board(7, 5, square_m=0.04, marker_m=0.03).corners
24
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import CameraConfig
from workbench.arena.camera.markers import pictures
from workbench.arena.camera.optics import Calibration, Camera

Floats = NDArray[np.float64]
KIND = "workbench camera"
FEWEST = 5  # pictures in which a board must be found
TILT_DEG = 15.0  # by which the board must be tilted from one picture to another
# of what a calibration may be off by: our choice
WORST_PX = 2.0
WORST_FOCAL = 0.02
_CORNERS = 6  # corners of the board that a picture must show
_FLIP = np.diag([1.0, -1.0, -1.0])  # OpenCV's boards: y down the page, z away from the camera


@dataclass(frozen=True)
class Board:
    """A printed board: ``columns`` × ``rows`` squares of ``square_m``, with markers of ``marker_m``
    in the white ones, or None for a plain chessboard.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float | None = None
    markers: str = "4X4_50"

    def __post_init__(self) -> None:
        fewest = 4 if self.marker_m is None else 3  # OpenCV's, of a plain chessboard and of others
        if min(self.columns, self.rows) < fewest:
            raise ValueError(
                f"a board of {self.columns}×{self.rows} squares; expected {fewest} or more each way"
            )
        if not self.square_m > 0 or not math.isfinite(self.square_m):
            raise ValueError(f"square_m = {self.square_m!r}; expected the edge of a square in m")
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise ValueError(
                f"marker_m = {self.marker_m!r}; expected less than a square's {self.square_m!r} m"
            )
        if not hasattr(cv2.aruco, f"DICT_{self.markers}"):
            raise ValueError(
                f"markers = {self.markers!r}; expected a dictionary such as 4X4_50 or 6X6_250"
            )

    @property
    def corners(self) -> int:
        """Corners between the squares."""
        return (self.columns - 1) * (self.rows - 1)

    def charuco(self) -> "cv2.aruco.CharucoBoard":
        """Return OpenCV's board."""
        assert self.marker_m is not None
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.markers}"))
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, markers)

    def find(self, image: NDArray[np.uint8]) -> tuple[Floats, Floats] | None:
        """Return the board's points (n, 3) in m and where they are in a picture (n, 2), None where
        too little of it is seen.
        """
        if self.marker_m is None:
            return self._find_chessboard(image)
        board = self.charuco()
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        if numbers is None or len(numbers) < _CORNERS:
            return None
        # OpenCV's own types do not know that it takes its own answers
        points, pixels = board.matchImagePoints(corners, numbers)  # type: ignore[call-overload]
        if np.linalg.matrix_rank(_plain(points, 3) - _plain(points, 3)[0]) < 2:
            return None  # a single row of corners tells no pose
        return _plain(points, 3), _plain(pixels, 2)

    def _find_chessboard(self, image: NDArray[np.uint8]) -> tuple[Floats, Floats] | None:
        inner = (self.columns - 1, self.rows - 1)
        found, corners = cv2.findChessboardCornersSB(image, inner)
        if not found:
            return None
        y, x = np.mgrid[1 : self.rows, 1 : self.columns] * self.square_m
        points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        return points, _plain(corners, 2)


def calibrate(folder: str | Path, board: Board, *, floor: str | None = None) -> dict[str, Any]:
    """Return what pictures of a board say of the camera that took them.

    Args:
        folder: of .png and .jpg pictures, all of one size.
        board: that they show.
        floor: name of the picture in which the board lies flat on the floor, None for a calibration
            of the lens alone.

    Returns:
        kind, width_px, height_px, matrix (3×3), distortion (k1, k2, p1, p2, k3), focal_px and its
        standard deviation focal_sd_px, tilt_deg (how far the boards are tilted against each other),
        reprojection_px (RMS), worst_picture, pictures, left_out (names); rotation (3×3, world to
        camera) and position (m), None without a picture on the floor.

    Raises:
        FileNotFoundError: no pictures.
        ValueError: pictures of several sizes; the board is found in too few, or not on the floor;
            all show it at about the same tilt, or do not agree on any camera.
    """
    seen, left_out, (height, width) = _seen(folder, board, floor)
    names = list(seen)
    points, pixels = ([seen[name][k].astype(np.float32) for name in names] for k in (0, 1))
    rms, matrix, distortion, turns, moves, deviations, _, each = cv2.calibrateCameraExtended(
        points, pixels, (width, height), np.eye(3), np.zeros(5)
    )
    tilt = _tilt_deg(turns)
    focal_sd = float(np.asarray(deviations).ravel()[0])
    _check_quality(tilt, float(rms), focal_sd / matrix[0, 0], names[int(np.argmax(each))])
    place: dict[str, Any] = {"rotation": None, "position": None}
    if floor is not None:
        at = names.index(floor)
        rotation = np.asarray(cv2.Rodrigues(turns[at])[0], np.float64)
        position = -(rotation @ _FLIP).T @ np.asarray(moves[at], np.float64).ravel()
        place = {"rotation": (rotation @ _FLIP).tolist(), "position": position.tolist()}
    return {
        "kind": KIND,
        "width_px": width,
        "height_px": height,
        "matrix": np.asarray(matrix, np.float64).tolist(),
        "distortion": np.asarray(distortion, np.float64).ravel()[:5].tolist(),
        "focal_px": float(matrix[0, 0]),
        "focal_sd_px": focal_sd,
        "tilt_deg": tilt,
        "reprojection_px": float(rms),
        "worst_picture": names[int(np.argmax(each))],
        "pictures": len(names),
        "left_out": left_out,
        "board": {
            "columns": board.columns,
            "rows": board.rows,
            "square_m": board.square_m,
            "marker_m": board.marker_m,
        },
    } | place


def _tilt_deg(turns: Any) -> float:
    """Return the largest angle between the normals of two boards."""
    normals = np.array([np.asarray(cv2.Rodrigues(turn)[0])[:, 2] for turn in turns])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1))).max())


def _check_quality(tilt: float, rms: float, focal_sd: float, worst: str) -> None:
    """Refuse what cannot tell focal length from distance, or no camera at all."""
    if tilt < TILT_DEG:
        raise ValueError(
            f"the board is tilted by {tilt:.0f}° at most from one picture to another; expected "
            f"{TILT_DEG:g}° or more, or focal length and distance cannot be told apart"
        )
    if rms > WORST_PX or focal_sd > WORST_FOCAL:
        raise ValueError(
            f"the pictures agree on no camera: corners are off by {rms:.1f} px RMS (expected at "
            f"most {WORST_PX:g}), the focal length is known to {100 * focal_sd:.1f} % (expected "
            f"{100 * WORST_FOCAL:g} %); is it the right board, flat and in focus? The worst "
            f"picture is {worst}"
        )


def load_camera(path: str | Path, *, marker_m: float) -> Camera:
    """Return the camera that ``calibrate`` has described in a JSON file.

    Args:
        path: of the file.
        marker_m: edge of the robots' markers.

    Raises:
        ValueError: another kind of file, or one that does not say where the camera hangs.
    """
    place = Path(path).expanduser()
    try:
        said = json.loads(place.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{place} is no JSON: {error}") from None
    if not isinstance(said, dict) or said.get("kind") != KIND:
        raise ValueError(f"{place} is no camera; write one: workbench calibrate-camera FOLDER")
    if said.get("rotation", "") is None:
        raise ValueError(
            f"{place} does not say where the camera hangs; calibrate again with --floor PICTURE, "
            "the board lying on the floor"
        )
    shapes = {"matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "position": (3,)}
    found = {name: _numbers(place, said, name, shape) for name, shape in shapes.items()}
    matrix, distortion, rotation, position = found.values()
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise ValueError(f"{place}: rotation is no rotation matrix; calibrate again")
    width, height = (
        int(_numbers(place, said, name, ()).item()) for name in ("width_px", "height_px")
    )
    above = float(position[2])
    config = CameraConfig(
        width_px=width,
        height_px=height,
        height_m=above,
        span_m=width * above / matrix[0, 0],
        marker_m=marker_m,
    )
    return Camera(config, calibration=Calibration(matrix, distortion, rotation, position))


def _numbers(place: Path, said: dict[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
    """Return the numbers that a file has under a name."""
    try:
        found = np.array(said[name], np.float64)
        if found.shape != shape or not np.all(np.isfinite(found)):
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise ValueError(
            f"{place}: {name} = {said.get(name)!r}; expected {shape or 'a number'} finite numbers; "
            "calibrate again"
        ) from None
    return found


def _plain(points: Any, columns: int) -> Floats:
    return np.asarray(points, np.float64).reshape(-1, columns)


def _seen(
    folder: str | Path, board: Board, floor: str | None
) -> tuple[dict[str, tuple[Floats, Floats]], list[str], tuple[int, ...]]:
    """Return where the board is in which picture, pictures without it, and their size."""
    if floor is not None and board.marker_m is None:
        raise ValueError(
            f"floor = {floor!r}: a plain chessboard does not say which corner is its first; "
            "expected a ChArUco board (--marker)"
        )
    seen: dict[str, tuple[Floats, Floats]] = {}
    left_out = []
    sizes: dict[tuple[int, ...], str] = {}
    for name, image in pictures(folder):
        sizes.setdefault(image.shape, name)
        found = board.find(image)
        if found is None:
            left_out.append(name)
        else:
            seen[name] = found
    if len(sizes) > 1:
        told = ", ".join(f"{name} {shape[1]}×{shape[0]}" for shape, name in sizes.items())
        raise ValueError(f"pictures of several sizes: {told}; expected those of one camera")
    what = f"{board.columns}×{board.rows} squares"
    if len(seen) < FEWEST:
        raise ValueError(
            f"a board of {what} found in {len(seen)} of {len(seen) + len(left_out)} pictures of "
            f"{folder}; expected {FEWEST} or more: is it the right board, whole and in focus?"
        )
    if floor is not None and floor not in seen:
        known = "not one of the pictures" if floor not in left_out else "no board found in it"
        raise ValueError(f"floor = {floor!r}: {known}; expected one of {', '.join(seen)}")
    return seen, left_out, next(iter(sizes))
