"""How well a formation keeps its shape: from where robots were, and where their places were.

    place_rms_mm       RMS distance of followers from their places
    share_in_place     of the time, within one body radius of its place, all followers
    out_of_formation   share of the time in which anybody is farther out (Balch & Arkin 1998)
    shape_rms_mm       RMS after the best shift and rotation (Procrustes): the rigid shape, wherever
                       it is; along a path shapes bend in curves, by their frame
    contacts           times that two bodies came to touch
    reform_s           until all are within 20 mm of their final places for good, NaN if never

Places are computed here from the leader's motion alone, independently of the loop's own
(``formation.virtual``): they are where followers should be, not where the loop told them to be.

Contract: input is a ``Motion``, or arrays; distances in m in, mm out.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.measures.motion import Motion

Floats = NDArray[np.float64]
ARRIVED_M = 0.020
BEGIN_S = 60.0  # left out: from a column into the shape


def places_in_world(
    motion: Motion, offsets: ArrayLike, *, frame: str = "heading", window_m: float = 0.15
) -> Floats:
    """Return where the places of followers were, (T, followers, 2) in m.

    Args:
        offsets: (followers, 2) m forward and left of the leader, or along and beside its path.
        frame: "heading" or "path".
        window_m: half the chord that gives the path's direction.
    """
    r = np.asarray(offsets, dtype=np.float64)
    leader = motion.position[:, 0]
    if frame == "heading":
        c, s = np.cos(motion.heading[:, :1]), np.sin(motion.heading[:, :1])
        x = leader[:, :1] + c * r[:, 0] - s * r[:, 1]
        y = leader[:, 1:] + s * r[:, 0] + c * r[:, 1]
        return np.stack([x, y], axis=-1)
    # the path begins with the line in which the followers stood
    behind = motion.position[0, :0:-1]
    path = np.vstack([behind, leader])
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    now = along[len(behind) :, None] + r[:, 0]

    def at(s: Floats) -> Floats:
        return np.stack([np.interp(s, along, path[:, k]) for k in range(2)], axis=-1)

    middle = np.minimum(now, along[len(behind) :, None] - window_m)
    chord = at(middle + window_m) - at(middle - window_m)
    chord /= np.maximum(np.linalg.norm(chord, axis=-1, keepdims=True), 1e-9)
    normal = np.stack([-chord[..., 1], chord[..., 0]], axis=-1)
    found: Floats = at(now) + r[:, 1:] * normal
    return found


def procrustes(points: Floats, shape: Floats) -> Floats:
    """Return the RMS distance of points (T, N, 2) from a shape (N, 2) or (T, N, 2) after the best
    shift and rotation, (T,) in m.
    """
    a = points - points.mean(axis=1, keepdims=True)
    b = shape - shape.mean(axis=-2, keepdims=True)
    b = np.broadcast_to(b, a.shape)
    dot = np.sum(a * b, axis=(1, 2))
    cross = np.sum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], axis=1)
    squares = np.sum(a * a, axis=(1, 2)) + np.sum(b * b, axis=(1, 2))
    left = np.maximum(squares - 2 * np.hypot(dot, cross), 0.0)
    found: Floats = np.sqrt(left / points.shape[1])
    return found


def contacts(motion: Motion) -> int:
    """Return how often two bodies that were apart came to touch."""
    touching = motion.gaps_m() <= 0.0
    return int(np.sum(touching[1:] & ~touching[:-1]) + np.sum(touching[0]))


def reform_s(motion: Motion, places: Floats, near_m: float = ARRIVED_M) -> float:
    """Return from when on all followers stay near their places, s; NaN if they do not."""
    apart = np.linalg.norm(motion.position[:, 1:] - places, axis=-1).max(axis=1)
    away = np.flatnonzero(apart > near_m)
    if away.size == 0:
        return 0.0
    return math.nan if away[-1] == len(apart) - 1 else float((away[-1] + 1) / motion.fs)


def shape_errors(
    motion: Motion,
    offsets: ArrayLike,
    *,
    frame: str = "heading",
    window_m: float = 0.15,
    begin_s: float = BEGIN_S,
) -> dict[str, Any]:
    """Return the measures above; all but contacts and reform_s leave out the beginning.

    Args:
        offsets: (followers, 2) the place that each follower has taken, m; see ``places_in_world``.
        begin_s: what is left out.

    Raises:
        ValueError: the motion is no longer than that.
    """
    r = np.asarray(offsets, dtype=np.float64)
    places = places_in_world(motion, r, frame=frame, window_m=window_m)
    first = round(begin_s * motion.fs)
    if first >= len(places):
        raise ValueError(
            f"a motion of {len(places) / motion.fs:g} s, of which begin_s = {begin_s:g} s are left "
            "out; expected a longer one"
        )
    apart = np.linalg.norm(motion.position[:, 1:] - places, axis=-1)
    late = apart[first:]
    radius = motion.robot.body_radius_m
    everybody = np.vstack([[0.0, 0.0], r])
    turned = procrustes(motion.position[first:], everybody)
    return {
        "place_rms_mm": 1000 * float(np.sqrt(np.mean(late**2))),
        "share_in_place": float(np.mean(late <= radius)),
        "out_of_formation": float(np.mean(late.max(axis=1) > radius)),
        "shape_rms_mm": 1000 * float(np.sqrt(np.mean(turned**2))),
        "contacts": contacts(motion),
        "reform_s": reform_s(motion, places),
    }
