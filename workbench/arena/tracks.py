"""Closed tracks for the leader: a nominal loop, and the juddered line that is drawn on the floor.

Shapes: "circle"; "stadium", two half circles and two straights as long as the diameter; "eight", a
lemniscate of Bernoulli, which crosses itself at a right angle and turns as much to the left as to
the right. ``radius_m`` is the smallest radius of curvature of each.

The paper's line "is jittered and shall represent data which is comparable to the output of a SLAM
based path planner" (I-D), without numbers. Our choice: a lateral offset of 4 mm RMS with
wavelengths of 0.1 to 0.3 m.

* judder "spectrum": a sum of all harmonics of the loop in that band, equal amplitudes, random
  phases: a flat amplitude spectrum, zero outside the band.
* judder "replan": every 0.1 to 0.3 m (uniform) the planner replaces its path: the offset steps to a
  new normal random value, with a smooth ramp of 20 mm; scaled to the same RMS.

>>> line = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
>>> round(line.length_m, 3), line.clockwise
(3.142, True)

Contract: a Track is immutable; positions are in metres, arc length s runs along the nominal loop in
driving direction.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.fields import choice, configuration, real, reals

Floats = NDArray[np.float64]
SPACING = 0.001  # m between points of the stored line
# m that a unit of direction counts for when a place on the loop is looked up: tells an eight's
# branches apart
_HEADING_M = 0.1
RAMP = 0.020  # m, over which a re-planned path joins its new offset


@configuration
class TrackConfig:
    """The line on the floor."""

    shape: str = choice(
        ("circle", "stadium", "eight"), "form of the nominal loop", default="circle"
    )
    radius_m: float = real(
        0.15, 50.0, "m", "smallest radius of curvature; grows if the convoy needs room", default=0.5
    )
    direction: str = choice(
        ("clockwise", "anticlockwise"),
        "driving direction (of the eight's first lobe)",
        default="clockwise",
    )
    judder: str = choice(
        ("spectrum", "replan", "none"),
        "how the line deviates from the nominal loop",
        default="spectrum",
    )
    judder_rms_m: float = real(0.0, 0.2, "m", "RMS lateral offset of the line", default=0.004)
    wavelengths_m: tuple[float, float] = reals(
        0.01, 20.0, "m", "shortest and longest wavelength of the judder", default=(0.1, 0.3)
    )
    line_width_m: float = real(0.008, 0.5, "m", "width of the black line", default=0.015)

    def _check(self) -> None:
        short, long = self.wavelengths_m
        if short >= long:
            raise ValueError(
                f"TrackConfig.wavelengths_m = {self.wavelengths_m!r}; expected (shortest, "
                "longest) with shortest < longest"
            )

    def scaled(self, factor: float) -> "TrackConfig":
        """Return the same track with all lengths times a factor."""
        short, long = self.wavelengths_m
        return replace(
            self,
            radius_m=factor * self.radius_m,
            judder_rms_m=factor * self.judder_rms_m,
            wavelengths_m=(factor * short, factor * long),
            line_width_m=factor * self.line_width_m,
        )


@dataclass(frozen=True)
class Track:
    """A nominal loop and the line drawn around it, sampled every millimetre or a little less.

    Attributes:
        s: (P,) arc length of the points along the nominal loop, from 0.
        nominal: (P, 2) nominal loop.
        line: (P, 2) juddered line.
        offset: (P,) lateral offset of the line, positive to the left of the driving direction.
        length_m: length of the nominal loop.
        radius_m: smallest radius of curvature after making room for the convoy.
        clockwise: driving direction (of the first lobe).
    """

    s: Floats
    nominal: Floats
    line: Floats
    offset: Floats
    length_m: float
    radius_m: float
    clockwise: bool

    def pose(self, s: float) -> tuple[float, float, float]:
        """Return x, y in m and heading in rad on the nominal loop at arc length s (taken modulo the
        length).
        """
        x, y = self.point(s)
        step = self.length_m / self.s.size
        ahead = self.point(s + step)
        behind = self.point(s - step)
        return x, y, math.atan2(ahead[1] - behind[1], ahead[0] - behind[0])

    def point(self, s: float) -> tuple[float, float]:
        """Return x, y in m on the nominal loop at arc length s (taken modulo the length)."""
        at, x, y = self._closed
        wrapped = s % self.length_m
        return float(np.interp(wrapped, at, x)), float(np.interp(wrapped, at, y))

    @functools.cached_property
    def _closed(self) -> tuple[Floats, Floats, Floats]:
        """Arc length, x and y of the nominal loop, its first point once more at the end."""
        points = np.vstack([self.nominal, self.nominal[:1]])
        x, y = np.ascontiguousarray(points.T)
        return np.append(self.s, self.length_m), x, y

    def nearest(self, position: ArrayLike, heading: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the nearest point of the nominal loop that runs the same way.

        Args:
            position: (…, 2) m.
            heading: (…) rad.
        """
        angle = np.asarray(heading, dtype=np.float64)
        ahead = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        found = self._tree.query(
            np.concatenate([np.asarray(position, dtype=np.float64), _HEADING_M * ahead], axis=-1)
        )[1]
        return np.asarray(found, dtype=np.int64)

    @functools.cached_property
    def _tree(self) -> Any:
        """Places and directions of the nominal loop, to look up the nearest."""
        from scipy.spatial import cKDTree  # costs as much time to import as all else

        return cKDTree(np.hstack([self.nominal, _HEADING_M * _tangent(self.nominal)]))

    def lateral(self, position: ArrayLike, heading: ArrayLike) -> tuple[Floats, Floats]:
        """Return arc length along the nominal loop and deviation from it, left positive, in m;
        arguments as ``nearest``.
        """
        near = self.nearest(position, heading)
        tangent = _tangent(self.nominal)[near]
        gap = np.asarray(position, dtype=np.float64) - self.nominal[near]
        along: Floats = self.s[near] + np.sum(tangent * gap, axis=-1)
        return along, tangent[..., 0] * gap[..., 1] - tangent[..., 1] * gap[..., 0]

    def deviation(self, points: ArrayLike, *, nominal: bool = False) -> Floats:
        """Return the lateral distance in m of points (T, 2) from the line (or the nominal loop),
        left positive.

        A driven path is followed in order: each point is compared with the line near its
        predecessor's place, so that the crossing of the eight does not confuse the two branches.
        """
        reference = self.nominal if nominal else self.line
        path = np.asarray(points, dtype=np.float64)
        tangent = _tangent(reference)
        away = np.sum((reference - path[0]) ** 2, axis=1)
        motion = path[min(3, len(path) - 1)] - path[0]
        if (
            np.hypot(*motion) > 0
        ):  # where two branches cross, start on the one that runs along the path
            away += 0.02**2 * (1 - tangent @ (motion / np.hypot(*motion)))
        near = int(np.argmin(away))
        window = np.arange(-60, 200)
        result = np.empty(len(path))
        for t, point in enumerate(path):
            candidates = (near + window) % len(reference)
            gap = point - reference[candidates]
            best = int(np.argmin(np.sum(gap**2, axis=1)))
            near = int(candidates[best])
            result[t] = tangent[near, 0] * gap[best, 1] - tangent[near, 1] * gap[best, 0]
        return result


def make_track(
    config: TrackConfig, rng: np.random.Generator, *, convoy_length_m: float = 0.0
) -> Track:
    """Build a track; the loop is scaled up where a convoy of the given length would fill over 3/5
    of it (or of a lobe).

    Args:
        config: the shape and its judder.
        rng: source of the judder's phases or offsets.
        convoy_length_m: distance between the first and the last robot.
    """
    length, _ = _loop(config.shape, 1.0)
    usable = 0.6 * length / (2 if config.shape == "eight" else 1)
    radius = max(config.radius_m, convoy_length_m / usable)
    length, nominal = _loop(config.shape, radius)
    clockwise = config.direction == "clockwise"
    if clockwise:
        nominal = nominal * np.array([1.0, -1.0])
    s: Floats = np.arange(len(nominal), dtype=np.float64) * (length / len(nominal))
    offset = _judder(config, s, length, rng)
    tangent = _tangent(nominal)
    left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    line = nominal + offset[:, None] * left
    for array in (s, nominal, line, offset):
        array.flags.writeable = False
    return Track(s, nominal, line, offset, length, radius, clockwise)


def _tangent(points: Floats) -> Floats:
    """Return the unit tangent (P, 2) at every point of a closed line (P, 2)."""
    tangent: Floats = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    return tangent / np.hypot(tangent[:, 0], tangent[:, 1])[:, None]


def _loop(shape: str, radius: float) -> tuple[float, Floats]:
    """Return the length and evenly spaced points (P, 2) of an anticlockwise loop."""
    if shape == "circle":
        turn = np.linspace(0.0, 2 * math.pi, 4097)
        dense = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    elif shape == "stadium":
        bend = np.linspace(-math.pi / 2, math.pi / 2, 2049)
        cap = radius * np.column_stack([np.cos(bend), np.sin(bend)])
        right = cap + [radius, 0.0]
        left = -cap - [radius, 0.0]
        dense = np.vstack([right, left, right[:1]])
    else:  # lemniscate of Bernoulli with half width a; its curvature is 3 r / a², at most 3 / a
        a = 3 * radius
        turn = np.linspace(3 * math.pi / 2, 7 * math.pi / 2, 8193)
        stretch = a / (1 + np.sin(turn) ** 2)
        dense = np.column_stack([stretch * np.cos(turn), stretch * np.sin(turn) * np.cos(turn)])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    length = {"circle": 2 * math.pi * radius, "stadium": (2 * math.pi + 4) * radius}.get(
        shape, float(along[-1])
    )
    count = math.ceil(length / SPACING)
    at = np.arange(count) * (along[-1] / count)
    return length, np.column_stack([np.interp(at, along, dense[:, k]) for k in (0, 1)])


def _judder(config: TrackConfig, s: Floats, length: float, rng: np.random.Generator) -> Floats:
    if config.judder == "none" or config.judder_rms_m == 0.0:
        return np.zeros_like(s)
    short, long = config.wavelengths_m
    if config.judder == "spectrum":
        harmonics = np.arange(math.ceil(length / long), math.floor(length / short) + 1)
        if not harmonics.size:
            raise ValueError(
                f"TrackConfig.wavelengths_m = {config.wavelengths_m!r}: no harmonic of a loop "
                f"of {length:.2f} m lies in this "
                "band; widen it, or enlarge radius_m"
            )
        phases = rng.uniform(0.0, 2 * math.pi, harmonics.size)
        offset = np.zeros_like(s)
        for harmonic, phase in zip(harmonics, phases, strict=True):
            offset += np.cos(2 * math.pi * harmonic * s / length + phase)
    else:
        at = [0.0]
        while at[-1] < length:
            at.append(at[-1] + rng.uniform(short, long))
        at[-1] = length
        levels = rng.normal(size=len(at))
        levels[-1] = levels[0]
        offset = np.full_like(s, levels[0])
        for start, before, after in zip(at[1:], levels[:-1], levels[1:], strict=True):
            ramp = np.clip((s - (start - RAMP)) / RAMP, 0.0, 1.0)
            offset += (after - before) * (1 - np.cos(math.pi * ramp)) / 2
        offset -= offset.mean()
    scaled: Floats = offset * (config.judder_rms_m / math.sqrt(float(np.mean(offset**2))))
    return scaled
