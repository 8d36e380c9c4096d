"""Shapes of a formation: where the places of its followers are, in the leader's frame.

    column     one behind the other                  wedge    in pairs, back and to the sides
    line       in pairs beside the leader            diamond  the lattice with the leader at its tip
    circle     around a centre behind the leader     points   as given

What a place is relative to (``frame``):

    predecessor  the robot in front: the paper's worm; the column is its only shape
    heading      the leader, by its heading of this moment; a leader that judders swings far places
    path         the leader's trail: a place back along it, and to the side of it
    follower     the follower's own heading: the leader at a distance and a bearing, as somebody who
                 knows no heading of its would do it; for comparison, it fails beside the leader
    auto         a column: predecessor; shapes with places less than a window behind the leader
                 (line, circle): heading; others: path

``random`` is for learning: places are drawn anew again and again, so that one table serves every
shape. Names as in Balch & Arkin (IEEE T-RA 14(6), 926, 1998).

>>> places("wedge", 4, 0.15).tolist()
[[-0.15, 0.15], [-0.15, -0.15], [-0.3, 0.3], [-0.3, -0.3]]

Contract: x points forward, y to the left; metres; the leader stands at (0, 0).
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.fields import choice, configuration, pairs, real
from workbench.formation.assignment import ASSIGNMENTS
from workbench.robot.geometry import CONTROL_PERIOD

Floats = NDArray[np.float64]
TRAIL_M = 9.5  # of its path that a leader's trail holds
SHAPES = ("column", "line", "wedge", "diamond", "circle", "points", "random")
FRAMES = ("auto", "predecessor", "heading", "path", "follower")


@configuration
class FormationConfig:
    """Who drives where: the shape, what it is relative to, and how it changes."""

    shape: str = choice(SHAPES, "where followers drive", default="column")
    frame: str = choice(
        FRAMES,
        "what places are relative to: the robot in front (the paper), the leader's heading, or its "
        "path; follower: its own heading, without the leader's; auto: what suits the shape",
        default="auto",
    )
    spacing_m: float = real(
        0.0, 10.0, "m", "between neighbouring places; 0 takes the wanted distance", default=0.0
    )
    points: tuple[tuple[float, float], ...] = pairs(
        -50.0, 50.0, "m", "places of shape 'points': forward and left of the leader", default=()
    )
    window_m: float = real(
        0.01, 10.0, "m", "half the piece of path whose direction a place has", default=0.15
    )
    smooth_s: float = real(
        0.0,
        100.0,
        "s",
        "time constant of the averages of the leader's speed and turning rate, which its steering "
        "makes noisy",
        default=1.0,
    )
    assignment: str = choice(
        tuple(ASSIGNMENTS), "who takes which place when a shape is asked for", default="squared"
    )
    place_speed_mps: float = real(
        0.001, 10.0, "m/s", "fastest speed of a place that moves", default=0.02
    )
    place_acceleration_mps2: float = real(
        0.001, 10.0, "m/s²", "largest acceleration of a place that moves", default=0.03
    )
    clearance_m: float = real(
        0.0, 10.0, "m", "how near places may be; those that are nearer part", default=0.12
    )
    edges: tuple[tuple[int, int], ...] = pairs(
        0,
        256,
        "",
        "between places, 0 the leader's, whose distances reward 'graph' is of; none: the shortest "
        "that hold the shape",
        default=(),
        whole=True,
    )
    hold_s: float = real(
        1.0, 1000.0, "s", "how long a random place is held before another is drawn", default=20.0
    )

    def _check(self) -> None:
        if self.frame == "predecessor" and self.shape != "column":
            raise ValueError(
                f"FormationConfig.shape = {self.shape!r} with frame = 'predecessor'; behind the "
                "robot in front there is a column only: expected frame = 'heading' or 'path'"
            )
        if (self.shape == "points") != bool(self.points):
            raise ValueError(
                f"FormationConfig.points = {self.points!r} with shape = {self.shape!r}; expected "
                "points with shape = 'points', and only there"
            )

    @property
    def relative_to(self) -> str:
        """What places are relative to: one of FRAMES, but for "auto"."""
        if self.frame != "auto":
            return self.frame
        if self.shape == "column":
            return "predecessor"
        beside = any(x > -self.window_m for x, _ in self.points)
        near = 0.0 < self.spacing_m < self.window_m  # of the first row, to the leader
        wide = self.shape in ("line", "random", "circle")
        return "heading" if beside or near or wide else "path"

    def scaled(self, size: float, pace: float) -> "FormationConfig":
        """Return the same formation with lengths and speeds times these factors."""
        return replace(
            self,
            spacing_m=size * self.spacing_m,
            points=tuple((size * x, size * y) for x, y in self.points),
            window_m=size * self.window_m,
            clearance_m=size * self.clearance_m,
            place_speed_mps=pace * self.place_speed_mps,
            place_acceleration_mps2=pace * self.place_acceleration_mps2,
        )

    @property
    def hold_periods(self) -> int:
        """Control periods between random places."""
        return round(self.hold_s / CONTROL_PERIOD)

    @property
    def shaped(self) -> bool:
        """Whether places are relative to the leader."""
        return self.relative_to != "predecessor"


def places(shape: str, followers: int, spacing_m: float, points: ArrayLike = ()) -> Floats:
    """Return the places of a shape, (followers, 2) in m.

    Raises:
        ValueError: an unknown shape, or not one point for every follower.
    """
    k = np.arange(1, followers + 1)
    side = np.where(k % 2 == 1, 1.0, -1.0)
    pair = (k + 1) // 2
    rows = {
        "column": (-k, 0 * k),
        "random": (-k, 0 * k),  # to begin with
        "line": (0 * k, side * pair),
        "wedge": (-pair, side * pair),
        "diamond": tuple(_lattice(followers).T),
        "circle": _ring(side * pair, followers + 1),
    }
    if shape in rows:
        return spacing_m * np.stack(rows[shape], axis=1).astype(np.float64)
    if shape != "points":
        raise ValueError(f"shape = {shape!r}; expected one of {', '.join(SHAPES)}")
    found: Floats = np.asarray(points, dtype=np.float64)
    if found.shape != (followers, 2) or not np.all(np.isfinite(found)):
        raise ValueError(
            f"points have shape {found.shape}; expected ({followers}, 2) finite numbers: forward "
            "and left of the leader for every follower"
        )
    return found


def random_reach(followers: int, spacing_m: float) -> tuple[float, float]:
    """Return how far back and how far aside random places are drawn, m: as a column and a line
    reach.
    """
    return followers * spacing_m, (followers + 1) // 2 * spacing_m


def _ring(k: Floats, robots: int) -> tuple[Floats, Floats]:
    """Return x and y of the k-th of robots on a circle with unit sides, from the leader on."""
    radius = 0.5 / math.sin(math.pi / robots)
    angle = 2 * math.pi * k / robots
    return radius * (np.cos(angle) - 1.0), radius * np.sin(angle)


def _lattice(followers: int) -> Floats:
    """Return the lattice points of the smallest diamond that holds all robots, those at its tips
    and edges first, without its front tip, where the leader is.
    """
    size = 1
    while 2 * size * (size + 1) < followers:
        size += 1
    near = range(-size, size + 1)
    points = [(x, y) for x in near for y in near if abs(x) + abs(y) <= size and (x, y) != (size, 0)]
    points.sort(key=lambda p: (-(abs(p[0]) + abs(p[1])), -p[0], abs(p[1]), -p[1]))
    return np.array(points[:followers], dtype=np.float64) - [size, 0]


def _check_room(config: FormationConfig, found: Floats, touch: float) -> None:
    """Refuse places that are too near each other, or the leader; ``touch`` in m."""
    everybody = np.vstack([[0.0, 0.0], found])
    apart = np.linalg.norm(everybody[:, None] - everybody[None], axis=-1)
    apart[np.diag_indices_from(apart)] = math.inf
    if apart.min() <= touch:
        i, j = np.unravel_index(int(apart.argmin()), apart.shape)
        raise ValueError(
            f"formation: robots {i} and {j} are {apart.min():.3g} m apart, and touch at "
            f"{touch:.3g} m: expected a larger spacing_m, or other points"
        )
    if apart.min() < config.clearance_m - 1e-9 and config.shape != "random":
        raise ValueError(
            f"FormationConfig.clearance_m = {config.clearance_m!r} with places {apart.min():.3g} m "
            "apart; they would part for ever: expected a smaller clearance_m, or a larger spacing_m"
        )
    if config.shape == "random" and config.clearance_m <= touch:
        raise ValueError(
            f"FormationConfig.clearance_m = {config.clearance_m!r} with random places; robots "
            f"touch at {touch:.3g} m: expected more than that"
        )


def _check_path(config: FormationConfig, found: Floats, depth: float) -> None:
    """Refuse places where the leader has no path; depth of the last in m."""
    if config.relative_to == "path" and depth > TRAIL_M:
        raise ValueError(
            f"formation: a place {depth:.3g} m back along a path that is remembered for "
            f"{TRAIL_M:.3g} m: expected smaller shapes, or frame = 'heading'"
        )
    if config.relative_to == "path" and found[:, 0].max() > 1e-9:
        raise ValueError(
            f"formation: a place {found[:, 0].max():.3g} m ahead of the leader with frame = "
            "'path'; there is no path yet: expected places at its side or behind, or frame = "
            "'heading'"
        )


def check_shape(
    config: "FormationConfig",
    found: Floats,
    *,
    leader_mps: float,
    fastest_mps: float,
    radius_m: float,
    track_m: float,
    body_radius_m: float,
) -> None:
    """Refuse places that no robot can keep.

    Args:
        found: (followers, 2) in m.
        leader_mps: speed of the leader; fastest_mps: of a follower's wheel.
        radius_m: smallest radius of the track.
        track_m: distance between a robot's wheels.
        body_radius_m: of a robot.

    Raises:
        ValueError: what is too near, too fast or ahead of the leader, and what would do.
    """
    _check_room(config, found, 2 * body_radius_m)
    depth = max(float(-found[:, 0].min()), 0.0)
    _check_path(config, found, depth)
    aside = float(np.abs(found[:, 1]).max())
    if aside >= radius_m:
        raise ValueError(
            f"formation: a place {aside:.3g} m aside on a track with curves of {radius_m:.3g} m "
            "would stand still or go back on their inside: expected track.radius_m above that, or "
            "a smaller spacing_m"
        )
    # on the outside of the tightest curve, with the outer wheel
    reach = aside + track_m / 2
    needed = leader_mps * (1 + reach / radius_m)
    if config.relative_to != "path":  # deep places swing out
        needed = leader_mps * math.hypot(1 + reach / radius_m, depth / radius_m)
    if needed > fastest_mps:
        room = reach * leader_mps / max(fastest_mps - leader_mps, 1e-9)
        raise ValueError(
            f"formation: the outer wheel of a place {reach:.3g} m aside, {depth:.3g} m back "
            f"drives {needed:.3g} m/s in curves of {radius_m:.3g} m, and does {fastest_mps:.3g}: "
            f"expected wheel_speed_mps up to {needed:.2g}, a slower leader_speed_mps, or "
            f"track.radius_m from {room:.3g} m on"
        )
