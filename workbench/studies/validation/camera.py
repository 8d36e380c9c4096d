"""The camera's error budget, from pixels, and the fast model's numbers, fitted to them.

``validate_camera`` draws pictures of six markers at random places of the view and finds them again,
with ten calibrations (each wrong in its own way) and with none wrong. It writes medians and 95 %
quantiles per band of distance from the middle, and what it fits for ``arena.camera.config.NOISE``:
how the random error grows from the middle outwards, without calibration errors. Everything is
simulated: no picture of a real camera was taken. Times per picture are returned and printed, not
stored.

Contract: nothing here feeds back by itself: NOISE is copied by hand, and a test holds it against
pixels.
"""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench import paths
from workbench.arena.camera.config import CONDITIONS, NOISE, CameraConfig
from workbench.arena.camera.frames import Frames
from workbench.arena.camera.markers import Finder
from workbench.arena.camera.optics import Camera
from workbench.lab.storage import write_json, write_table

FOLDER = paths.DATA / "validation"
MARKERS = 6
PICTURES = 60
APART_M = 0.09  # between markers: robots do not overlap
BANDS = (0.0, 0.2, 0.4, 0.6, 1.2)  # m from the middle


def find_again(
    config: CameraConfig, seed: int, pictures: int, *, exact: bool = False
) -> tuple[pd.DataFrame, float]:
    """Draw pictures and find the markers in them, each anew in the whole picture.

    Args:
        config: the camera; seed: of its calibration, the places and the noise.
        pictures: how many, of six markers each.
        exact: whether the calibration is without error.

    Returns:
        One line per marker: x_m, y_m, found, dx_mm, dy_mm, turn_deg (NaN where it was not found);
            seconds per picture to find.
    """
    rng = np.random.default_rng([seed, *b"camera"])
    camera = Camera(config, None if exact else rng)
    frames = Frames(camera, None, MARKERS, rng)
    finder = Finder(camera, MARKERS)
    lines = []
    taken = 0.0
    for places in _places(camera, rng, pictures):
        image = frames.frame(places)
        begun = time.perf_counter()
        found = finder.find(image)
        taken += time.perf_counter() - begun
        for number, (x, y, heading) in enumerate(places):
            line = {
                "x_m": x,
                "y_m": y,
                "found": number in found,
                "dx_mm": math.nan,
                "dy_mm": math.nan,
                "turn_deg": math.nan,
            }
            if number in found:
                a, b, angle = found[number]
                turn = math.degrees(math.remainder(angle - heading, 2 * math.pi))
                line |= {"dx_mm": 1000 * (a - x), "dy_mm": 1000 * (b - y), "turn_deg": turn}
            lines.append(line)
    return pd.DataFrame(lines), taken / pictures


def _places(
    camera: Camera, rng: np.random.Generator, pictures: int
) -> Iterator[NDArray[np.float64]]:
    x0, x1, y0, y1 = camera.view()
    given = 0
    while given < pictures:
        x, y = rng.uniform(x0, x1, MARKERS), rng.uniform(y0, y1, MARKERS)
        gaps = np.hypot(x[:, None] - x, y[:, None] - y) + np.eye(MARKERS)
        if gaps.min() > APART_M:
            given += 1
            yield np.column_stack([x, y, rng.uniform(-math.pi, math.pi, MARKERS)])


def validate_camera(
    *, out: Path | None = None, seeds: int = 10, pictures: int = PICTURES
) -> dict[str, Any]:
    """Write camera.csv and camera.json into data/validation/ (or ``out``); return the aggregates
    and the times.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        lines, fits, speeds, totals = _all_conditions(seeds, pictures)
    finally:
        cv2.setNumThreads(threads)
    folder = out or FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "camera.csv", pd.DataFrame(lines), digits=4)
    write_json(
        folder / "camera.json",
        {
            "what": "markers drawn into simulated pictures and found again; ten calibrations, "
            "and one without error",
            "simulated": True,
            "pictures": 4 * seeds * pictures,
            "markers_per_picture": MARKERS,
            "with_calibration_errors": totals,
            "fitted_noise": fits,
            "used_noise": {name: list(NOISE[name]) for name in NOISE},
        },
    )
    return {
        "with_calibration_errors": totals,
        "fitted_noise": fits,
        **speeds,
        "written": ["camera.csv", "camera.json"],
    }


def _all_conditions(
    seeds: int, pictures: int
) -> tuple[list[dict[str, Any]], dict[str, Any], dict[str, float], dict[str, Any]]:
    """Return errors by distance from the middle, fitted noise, pictures per second and totals."""
    lines = []
    fits = {}
    speeds = {}
    totals = {}
    for conditions in CONDITIONS:
        config = CameraConfig(conditions=conditions)
        for calibration in ("exact", "with errors"):
            exact = calibration == "exact"
            parts = [
                find_again(config, seed, pictures, exact=exact) for seed in range(1, seeds + 1)
            ]
            data = pd.concat([frame for frame, _ in parts])
            lines += _bands(data, {"conditions": conditions, "calibration": calibration})
            if exact:
                fits[conditions] = _fit(data)
            else:
                speeds[f"{conditions}_frames_per_s"] = 1 / float(
                    np.median([seconds for _, seconds in parts])
                )
                totals[conditions] = _bands(data, {}, ((0.0, 9.0),))[0]
    return lines, fits, speeds, totals


def _bands(data: pd.DataFrame, labels: dict[str, str], bands: Any = None) -> list[dict[str, Any]]:
    lines = []
    radius = np.hypot(data["x_m"], data["y_m"])
    for low, high in bands or zip(BANDS[:-1], BANDS[1:], strict=True):
        part = data[(radius >= low) & (radius < high)]
        error = np.hypot(part["dx_mm"], part["dy_mm"])
        turn = part["turn_deg"].abs()
        lines.append(
            labels
            | {
                "from_m": low,
                "to_m": high,
                "markers": len(part),
                "share_found": float(part["found"].mean()),
                "position_median_mm": float(error.median()),
                "position_p95_mm": float(error.quantile(0.95)),
                "heading_median_deg": float(turn.median()),
                "heading_p95_deg": float(turn.quantile(0.95)),
            }
        )
    return lines


def _fit(data: pd.DataFrame) -> list[float]:
    """Return spread of x and y in m and its growth per m², the same of the heading in rad, and the
    share not found.
    """
    seen = data[data["found"]]
    r2 = (seen["x_m"] ** 2 + seen["y_m"] ** 2).to_numpy()
    design = np.column_stack([np.ones_like(r2), r2])
    result: list[float] = []
    for values in (
        np.hypot(seen["dx_mm"], seen["dy_mm"]) / 1000 / math.sqrt(2),
        np.radians(seen["turn_deg"].abs()),
    ):
        # for a normal error E|e| = sd √(2/π), for a length in the plane E|e| = sd √(π/2)
        scale = math.sqrt(math.pi / 2) if len(result) else math.sqrt(2) * math.sqrt(2 / math.pi)
        a, b = np.linalg.lstsq(design, scale * values.to_numpy(), rcond=None)[0]
        result += [float(a), float(b)]
    return [*result, float(1 - data["found"].mean())]
