"""Is the follower's path a smoothed variant of the leader's? The protocol, in space and not in time
(requirement E6).

1. e_i(s): lateral deviation of robot i from the nominal loop at arc length s, mean removed (and
   reported apart).
2. Spectra by Welch's method over whole loops (scipy.signal, no taper: a loop repeats); transfer H1
   = S_{i-1,i} / S_{i-1,i-1} and coherence γ² between a robot and its predecessor.
3. Judder J_i: RMS of e_i in the band of the injected judder, wavelengths of 0.1 to 0.3 m. Gain G_i
   = J_i / J_{i-1}; the product down the line is J_i / J_0 (string stability: below 1).
4. The null model is the tractrix: a follower that only keeps its distance d and points at its
   predecessor is a low pass by geometry, |H(Λ)| = 1/√(1 + (2πd/Λ)²). Excess X_i = G_i over the
   tractrix's gain for the measured d and the predecessor's
   spectrum: X < 1 means smoother than geometry, X ≈ 1 geometry alone, X > 1 that the follower
       passes on more than geometry
   would, or adds judder of its own.
5. Fidelity, as "smooth" must not mean "not following": RMS of e_i at wavelengths above 0.6 m, and
   the mean offset, on a circle within [0, R - √(R² - d²)] of the predecessor's, towards the inside.

Where γ² < 0.8, part of the output is the robot's own, and G is an upper bound of what is
transmitted; ``transmitted``, the RMS of |H1| over the input, is the part that is coherent with the
predecessor. Coherence is estimated from repetitions of the loop: what a robot repeats at the same
place every time counts as coherent, and K loops of unrelated motion have γ² = 1/K. Below 4 loops it
is not told at all.

The null model holds on loops whose curvature changes slowly. On a circle and an eight ideal rods
have X = 1.00 for the first robot and 0.92 to 0.98 further down (inner loops are shorter); on a
stadium the steps of curvature between straights and bends are themselves in the band: rods have X =
1.1, 1.6, 3.9 there, and X says nothing.

>>> round(float(tractrix_gain(0.1, 0.2)), 3)
0.303

Contract: pure functions; a robot's first passage of a place counts, so that driving back after a
loss is not counted twice.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import signal
from scipy.interpolate import PchipInterpolator

from workbench.arena.tracks import Track
from workbench.compiled import compiled
from workbench.measures.motion import Motion, Source, as_motion

Floats = NDArray[np.float64]
BAND_M = (0.1, 0.3)  # wavelengths of the injected judder
FIDELITY_M = 0.6  # wavelengths above this are the way, not judder
GRID_M = 0.005  # m between samples of e(s)
SETTLE_M = 1.0  # m at the start that do not count
REACH_M = (
    0.2  # m that a robot's place may change between samples, and per second while it is not known
)
LOOPS = 4  # of which coherence is told


@dataclass(frozen=True, eq=False)
class Deviations:
    """Lateral deviations of all robots on one grid of arc length.

    Attributes:
        lateral: (robots, loops * samples) m, left of the driving direction positive, mean removed.
        offset: (robots,) the means in m.
        samples: per loop.
        step_m: between samples.
    """

    lateral: Floats
    offset: Floats
    samples: int
    step_m: float

    @property
    def loops(self) -> int:
        """Whole loops."""
        return int(self.lateral.shape[1] // self.samples)


def deviations(motion: Motion, track: Track) -> Deviations:
    """Return the lateral deviations over as many whole loops as all robots drove, after the first
    metre.

    Raises:
        ValueError: they did not drive a whole loop together.
    """
    along, lateral = track.lateral(motion.position, motion.heading)  # (T, robots) each
    for robot in range(
        along.shape[1]
    ):  # neighbours are less than half a loop apart: count laps from robot to robot
        if robot:
            along[0, robot] -= track.length_m * np.round(
                (along[0, robot] - along[0, robot - 1]) / track.length_m
            )
        _count_laps(along[:, robot], track.length_m, REACH_M, REACH_M / motion.fs)
    start = float(along[0].max()) + SETTLE_M
    end = float(np.nanmax(along, axis=0).min())
    loops = int((end - start) // track.length_m)
    if loops < 1:
        raise ValueError(
            f"the robots drove {max(end - start, 0.0):.2f} m together after the first "
            f"{SETTLE_M:g} m; expected at least one loop "
            f"of {track.length_m:.2f} m: drive longer"
        )
    samples = round(track.length_m / GRID_M)
    grid = start + np.arange(loops * samples, dtype=np.float64) * (track.length_m / samples)
    rows = np.stack(
        [_first_passage(along[:, k], lateral[:, k], grid) for k in range(along.shape[1])]
    )
    offset = rows.mean(axis=1)
    return Deviations(rows - offset[:, None], offset, samples, track.length_m / samples)


def _first_passage(along: Floats, lateral: Floats, grid: Floats) -> Floats:
    """Return the lateral deviation on the grid, from samples at which the robot was farther along
    than ever before.
    """
    along, lateral = along[~np.isnan(along)], lateral[~np.isnan(along)]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(along)[:-1]])
    new = along > before + 1e-9
    values: Floats = PchipInterpolator(along[new], lateral[new])(grid)
    return values


@compiled
def _count_laps(along: Any, length: float, reach: float, growth: float) -> None:
    """Make arc lengths (T,) count on over laps, in place; NaN where a place is out of reach of the
    last one.

    A robot that turns on the spot where an eight crosses itself seems to be on the other branch,
    half a loop away. Its place is not told there, until it is back within ``reach`` (m), which
    grows by ``growth`` per sample.
    """
    last = along[0]
    away = 0
    for t in range(1, along.size):
        place = along[t] + length * np.round((last - along[t]) / length)
        away += 1
        if abs(place - last) <= reach + growth * away:
            along[t] = place
            last = place
            away = 0
        else:
            along[t] = np.nan


@dataclass(frozen=True, eq=False)
class Transfer:
    """From a robot's deviation to its follower's, per spatial frequency.

    Attributes:
        frequency: (F,) cycles per m, without the mean.
        before, after: (F,) power spectral densities of the two, m² per cycle/m.
        gain: (F,) |H1|.
        coherence: (F,) γ².
    """

    frequency: Floats
    before: Floats
    after: Floats
    gain: Floats
    coherence: Floats


def transfer(before: ArrayLike, after: ArrayLike, samples: int, step_m: float) -> Transfer:
    """Return transfer H1 and coherence of two deviations over whole loops of a number of samples,
    step_m apart.

    Raises:
        ValueError: the two have different lengths or less than one loop.
    """
    x, y = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    if x.shape != y.shape or x.ndim != 1 or x.size < samples:
        raise ValueError(
            f"deviations have shapes {x.shape} and {y.shape}; expected two of (loops * {samples},)"
        )
    how: dict[str, Any] = {
        "fs": 1 / step_m,
        "window": "boxcar",
        "nperseg": samples,
        "noverlap": 0,
        "detrend": False,
    }
    frequency, s_xx = signal.welch(x, **how)
    s_yy = signal.welch(y, **how)[1]
    s_xy = signal.csd(x, y, **how)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.abs(s_xy) / s_xx
        coherence = np.abs(s_xy) ** 2 / (s_xx * s_yy)
    return Transfer(frequency[1:], s_xx[1:], s_yy[1:], gain[1:], coherence[1:])


def tractrix_gain(distance_m: float, wavelength_m: ArrayLike) -> Floats:
    """Return |H(Λ)| = 1/√(1 + (2πd/Λ)²), what keeping a distance and pointing at the predecessor
    does to a wave.
    """
    gain: Floats = 1.0 / np.sqrt(
        1.0 + (2 * np.pi * distance_m / np.asarray(wavelength_m, dtype=np.float64)) ** 2
    )
    return gain


def judder(
    source: Source, track: Track | None = None, *, band_m: tuple[float, float] = BAND_M
) -> pd.DataFrame:
    """Return the protocol's numbers, one line per robot; gains compare a robot with the one in
    front of it.

    Columns:
        robot: its place in line, 0 the leader.
        judder_mm: J_i. low_band_mm: RMS at wavelengths above 0.6 m. offset_mm: mean lateral offset,
            left positive.
        distance_mm: mean distance to the robot in front while following.
        gain: G_i. product: J_i / J_0. tractrix: the null model's gain. excess: X_i. transmitted:
            RMS gain of the coherent part.
        coherence: mean γ² in the band, weighted with the input. loops: whole loops that the spectra
            average.

    Args:
        source: a Motion, a Run or a recording's table.
        track: the nominal loop, where the source does not know it.
        band_m: shortest and longest wavelength of the judder.

    Raises:
        ValueError: no track, less than a whole loop, a band that is none, or samples too sparse for
            it.
    """
    motion = as_motion(source)
    if not 2 * GRID_M <= band_m[0] < band_m[1] < np.inf:
        raise ValueError(
            f"band_m = {band_m!r}; expected (shortest, longest) wavelength in m, the shortest "
            f"at least {2 * GRID_M:g}"
        )
    apart = np.nanmedian(np.linalg.norm(np.diff(motion.position, axis=0), axis=-1))
    if apart > band_m[0] / 4:
        raise ValueError(
            f"samples are {apart:.3f} m apart; expected a quarter of the shortest wavelength, "
            f"{band_m[0]:g} m, or less"
        )
    loop = track or motion.track
    if loop is None:
        raise ValueError(
            "the motion does not know its track; give track=, the nominal loop, for example "
            "make_track(config, rng)"
        )
    return _lines(motion, deviations(motion, loop), band_m)


def _lines(motion: Motion, found: Deviations, band_m: tuple[float, float]) -> pd.DataFrame:
    """Return the lines of ``judder``."""
    lines: list[dict[str, Any]] = []
    for robot in range(motion.position.shape[1]):
        pair = transfer(
            found.lateral[max(robot - 1, 0)], found.lateral[robot], found.samples, found.step_m
        )
        width = pair.frequency[0]
        inside = (pair.frequency >= 1 / band_m[1] - 1e-9) & (pair.frequency <= 1 / band_m[0] + 1e-9)
        low = pair.frequency < 1 / FIDELITY_M
        line: dict[str, Any] = {
            "robot": robot,
            "judder_mm": 1000 * float(np.sqrt(pair.after[inside].sum() * width)),
            "low_band_mm": 1000 * float(np.sqrt(pair.after[low].sum() * width)),
            "offset_mm": 1000 * float(found.offset[robot]),
            "loops": found.loops,
        }
        if robot:
            line |= _compare(motion, pair, inside, robot, lines[-1]["judder_mm"], line["judder_mm"])
            if found.loops < LOOPS:
                line["coherence"] = line["transmitted"] = np.nan
            line["product"] = (
                line["judder_mm"] / lines[0]["judder_mm"] if lines[0]["judder_mm"] else np.nan
            )
        lines.append(line)
    return pd.DataFrame(lines)


def _compare(
    motion: Motion,
    pair: Transfer,
    inside: NDArray[np.bool_],
    robot: int,
    before: float,
    after: float,
) -> dict[str, float]:
    apart = motion.errors()[0][:, robot - 1]
    following = motion.following[:, robot]
    distance = float(apart[following].mean()) if following.any() else np.nan
    power = pair.before[inside]
    total = power.sum()
    if total == 0:
        return {"distance_mm": 1000 * distance} | dict.fromkeys(
            ("gain", "tractrix", "excess", "transmitted", "coherence"), np.nan
        )
    null = float(
        np.sqrt((tractrix_gain(distance, 1 / pair.frequency[inside]) ** 2 * power).sum() / total)
    )
    return {
        "distance_mm": 1000 * distance,
        "gain": after / before,
        "tractrix": null,
        "excess": after / before / null,
        "transmitted": float(np.sqrt((pair.gain[inside] ** 2 * power).sum() / total)),
        "coherence": float((pair.coherence[inside] * power).sum() / total),
    }


def tractrix_line(
    leader: ArrayLike, distance_m: float, followers: int, *, start: ArrayLike | None = None
) -> Floats:
    """Return the paths (T, followers + 1, 2) of ideal followers behind a leader's path (T, 2): rods
    of length d, pulled.

    Args:
        leader: densely sampled path in m; steps should be small beside the distance.
        distance_m: length of the rods.
        start: (followers, 2) first places; default: in line behind the leader's first direction.
    """
    path = np.asarray(leader, dtype=np.float64)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2 or not distance_m > 0:
        raise ValueError(
            f"leader has shape {path.shape}, distance_m = {distance_m!r}; expected (T, 2) and "
            "a distance above 0"
        )
    if not np.all(np.isfinite(path)):
        raise ValueError("leader has numbers that are not finite; cut gaps out")
    line = np.empty((len(path), followers + 1, 2))
    line[:, 0] = path
    moved = path[np.flatnonzero(np.any(path != path[0], axis=1))[:1]] - path[0]
    back = -moved[0] / np.linalg.norm(moved[0]) if moved.size else np.array([-1.0, 0.0])
    first = (
        np.asarray(start, np.float64)
        if start is not None
        else path[0] + distance_m * np.arange(1, followers + 1)[:, None] * back
    )
    if first.shape != (followers, 2):
        raise ValueError(
            f"start has shape {first.shape}; expected ({followers}, 2), a place for each follower"
        )
    for robot in range(1, followers + 1):
        _pull(line[:, robot - 1], line[:, robot], first[robot - 1], distance_m)
    return line


@compiled
def _pull(ahead: Any, path: Any, first: Any, distance: float) -> None:
    """Fill the path (T, 2) of a rod's rear end; each step is cut into 8, so that the rod's turn
    within it is followed.
    """
    x, y = first[0], first[1]
    for t in range(ahead.shape[0]):
        for part in range(1, 9):
            k = max(t - 1, 0)
            ax = ahead[k, 0] + (ahead[t, 0] - ahead[k, 0]) * part / 8
            ay = ahead[k, 1] + (ahead[t, 1] - ahead[k, 1]) * part / 8
            gap = max(np.hypot(ax - x, ay - y), 1e-12)
            x, y = ax - (ax - x) / gap * distance, ay - (ay - y) / gap * distance
        path[t, 0] = x
        path[t, 1] = y
