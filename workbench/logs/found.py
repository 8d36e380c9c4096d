"""Robots found in pictures that somebody took: a folder or a video, through the same finder and
tracker as the simulated camera's, into a table of poses.

The table has the columns of ``measures.motion.Motion.of_table`` (time_s, robot, x_m, y_m,
heading_rad) and ``found``: 1 where the marker was seen, 0 where the pose is the tracker's
prediction (half a second at most). While a robot has no pose its numbers are empty. A JSON file
beside it says where it comes from. The world is that of the calibration, see
``arena.camera.calibrate``.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench.arena.camera.calibrate import load_camera
from workbench.arena.camera.markers import Finder, check_name, is_picture, pictures
from workbench.arena.camera.tracker import TRACK, follow_marker
from workbench.lab.storage import write_json, write_table

VIDEOS = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm")


def find_robots(
    source: str | Path,
    camera: str | Path,
    out: str | Path,
    *,
    robots: int,
    rate: float | None = None,
    marker: float = 0.048,
) -> dict[str, Any]:
    """Write where robots are in every picture of a folder or video.

    Args:
        source: folder of pictures in the order of their names, or a video.
        camera: JSON file of ``calibrate``.
        out: .csv to write; a .json is written beside it.
        robots: how many; robot i carries marker i.
        rate: pictures per second; None for what a video says.
        marker: edge of a marker in m.

    Returns:
        pictures, rate_hz, found (share of pictures, per robot), written.

    Raises:
        FileExistsError: the file exists. FileNotFoundError: no pictures.
        ValueError: no rate; no video; another size than the camera's; nobody is ever found.
    """
    target = Path(out).expanduser()
    side = target.with_suffix(".json")
    if target.suffix != ".csv":
        raise ValueError(f"out = {str(out)!r}; expected a name that ends in .csv")
    if target.exists() or side.exists():
        raise FileExistsError(f"{target} or its .json exists already; add --out NAME.csv")
    if robots < 1:
        raise ValueError(f"robots = {robots!r}; expected how many robots there are, 1 or more")
    place = Path(source).expanduser()
    images, rate_hz = _pictures(place, rate)
    finder = Finder(load_camera(camera, marker_m=marker), robots)
    table = _follow(images, finder, rate_hz)
    share = table.groupby("robot")["found"].mean()
    if not share.any():
        raise ValueError(
            f"no marker 0 to {robots - 1} of {1000 * marker:g} mm in {place}; is --marker the edge "
            "of the black square, and the calibration this camera's?"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    write_table(target, table, digits=9)
    write_json(
        side,
        {
            "kind": "workbench poses",
            "source": str(place),
            "camera_sha256": hashlib.sha256(Path(camera).expanduser().read_bytes()).hexdigest(),
            "rate_hz": rate_hz,
            "robots": robots,
            "marker_m": marker,
        },
    )
    shares = [round(float(part), 4) for part in share]
    count = len(table) // robots
    return {"pictures": count, "rate_hz": rate_hz, "found": shares, "written": str(target)}


def _follow(images: Iterator[NDArray[np.uint8]], finder: Finder, rate_hz: float) -> pd.DataFrame:
    """Return a row per picture and robot."""
    tracks = np.zeros(finder.robots, TRACK)
    rows: list[tuple[Any, ...]] = []
    for number, image in enumerate(images):
        known = np.flatnonzero(tracks["tracked"])
        expected = {int(k): _pose(tracks[k]) for k in known}
        found = finder.find(image, expected)
        for robot in range(finder.robots):
            x, y, heading = found.get(robot, (0.0, 0.0, 0.0))
            follow_marker(tracks[robot], robot in found, x, y, heading, 1 / rate_hz)
            pose = _pose(tracks[robot]) if tracks[robot]["tracked"] else (np.nan,) * 3
            rows.append((number / rate_hz, robot, *pose, int(robot in found)))
    columns = ["time_s", "robot", "x_m", "y_m", "heading_rad", "found"]
    return pd.DataFrame(rows, columns=columns)


def _pose(track: Any) -> tuple[float, float, float]:
    heading = float(np.arctan2(track["sin"], track["cos"]))
    return float(track["x"]), float(track["y"]), heading


def _pictures(place: Path, rate: float | None) -> tuple[Iterator[NDArray[np.uint8]], float]:
    """Return the grey pictures of a folder or video, and how many there are per second."""
    if rate is not None and not 0 < rate <= 1e4:
        raise ValueError(f"rate = {rate!r}; expected pictures per second, above 0")
    if place.is_dir():
        if rate is None:
            raise ValueError(f"{place} is a folder; add --rate, the pictures per second")
        return (image for _, image in pictures(place)), rate
    if not place.is_file():
        raise FileNotFoundError(f"{place} is no folder and no video")
    if is_picture(place):
        raise ValueError(f"{place} is one picture; give the folder of all")
    check_name(place)
    video = cv2.VideoCapture(str(place))
    if not video.isOpened():
        kinds = ", ".join(VIDEOS)
        raise ValueError(f"{place} is no video that OpenCV can read; expected one of {kinds}")
    own = rate or float(video.get(cv2.CAP_PROP_FPS))
    if not own > 0:
        raise ValueError(f"{place} does not say its rate; add --rate, the pictures per second")
    return _frames(video, place), own


def _frames(video: "cv2.VideoCapture", place: Path) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures of a video; refuse one that has lost some, whose times would be wrong."""
    promised = round(video.get(cv2.CAP_PROP_FRAME_COUNT))
    count = 0
    while True:
        going, image = video.read()
        if not going:
            video.release()
            if not count or count < promised - 1:
                raise ValueError(
                    f"{place}: {count} of {promised} pictures could be read; repair it, or make "
                    "pictures of it and give their folder"
                )
            return
        count += 1
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        yield np.asarray(grey, np.uint8)
