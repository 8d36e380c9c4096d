"""The paper's explanatory figures, drawn from the live objects: error measures (Fig. 1), tiles
(Fig. 2), and the geometry of following on a circle (E3).

Each function takes data and ``ax=None``, draws and returns the Axes.
"""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Wedge
from numpy.typing import ArrayLike, NDArray

from workbench.arena.world import World
from workbench.formation.config import ConvoyConfig
from workbench.formation.senses.truth import observe
from workbench.learning.tiles import TileGrid
from workbench.plots.style import CYCLE, MARKERS, NEVER, new_axes
from workbench.robot import geometry


def error_measures(
    world: World,
    config: ConvoyConfig,
    *,
    formation: int = 0,
    follower: int = 1,
    ax: Axes | None = None,
) -> Axes:
    """Draw distance and angular error of one follower, from the poses that the world has now
    (paper, Fig. 1).
    """
    ax = ax or new_axes(5.2, 4.6)
    x, y, heading = world.pose(formation, follower)
    ahead_x, ahead_y, ahead_heading = world.pose(formation, follower - 1)
    distance, bearing = observe(x, y, math.cos(heading), math.sin(heading), ahead_x, ahead_y)
    draw_body(ax, (x, y, heading), CYCLE[0], "follower")
    draw_body(ax, (ahead_x, ahead_y, ahead_heading), CYCLE[1], "robot in front")
    wanted = {"edgecolor": CYCLE[2], "label": f"d* = {1000 * config.middle_m:.0f} mm"}
    ax.add_patch(Circle((x, y), config.middle_m, fill=False, linestyle="--", **wanted))
    ax.plot([x, ahead_x], [y, ahead_y], color="black", linewidth=1)
    straight = (
        x + 1.15 * config.middle_m * math.cos(heading),
        y + 1.15 * config.middle_m * math.sin(heading),
    )
    ax.plot([x, straight[0]], [y, straight[1]], color="#888888", linewidth=1, linestyle=":")
    start, end = sorted((math.degrees(heading), math.degrees(heading + bearing)))
    ax.add_patch(Arc((x, y), 0.17, 0.17, theta1=start, theta2=end, color="black"))
    middle = heading + bearing / 2
    thin: dict[str, Any] = {"arrowstyle": "-", "linewidth": 0.7}
    ax.annotate(
        rf"$o_{{err}}$ = {math.degrees(bearing):+.1f}°",
        (x + 0.085 * math.cos(middle), y + 0.085 * math.sin(middle)),
        xytext=(-24, -40),
        textcoords="offset points",
        arrowprops=thin,
    )
    error_mm = 1000 * (distance - config.middle_m)
    ax.annotate(
        f"d = {1000 * distance:.0f} mm\n" + rf"$e_d$ = {error_mm:+.0f} mm",
        ((x + ahead_x) / 2, (y + ahead_y) / 2),
        xytext=(-100, 18),
        textcoords="offset points",
        arrowprops=thin,
    )
    reach = config.middle_m + 0.07
    ax.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach))
    ax.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    ax.legend(loc="lower left", fontsize=7.5)
    return ax


def draw_body(
    ax: Axes, pose: tuple[float, float, float], colour: str, name: str = "", alpha: float = 0.35
) -> None:
    """Draw a robot from above."""
    x, y, heading = pose
    ax.add_patch(
        Circle(
            (x, y),
            geometry.BODY_RADIUS,
            facecolor=colour,
            alpha=alpha,
            edgecolor=colour,
            label=name,
        )
    )
    nose = (x + 0.06 * math.cos(heading), y + 0.06 * math.sin(heading))
    ax.add_patch(FancyArrowPatch((x, y), nose, arrowstyle="-|>", mutation_scale=12, color=colour))


def tile_fan(config: ConvoyConfig, *, ax: Axes | None = None) -> Axes:
    """Draw the state tiles around the follower, which looks up the page (paper, Fig.

    2); offset tilings in colours above them.
    """
    ax = ax or new_axes(5.6, 4.2)
    top = _fan(ax, config)
    for number, shifted in enumerate(config.grids()[1:]):
        _fan_lines(
            ax,
            shifted,
            1000 * config.middle_m,
            CYCLE[number % len(CYCLE)],
            ("-", "--", ":")[number % 3],
        )
    _fan_robots(ax, 1000 * config.middle_m)
    ax.set(
        xlim=(-top * 0.8, top * 0.8),
        ylim=(-45, top),
        xlabel="to the side in mm (left of the robot is left)",
        ylabel="ahead in mm",
        aspect="equal",
    )
    return ax


def _fan(ax: Axes, config: ConvoyConfig) -> float:
    """Draw the tiles of the first grid; return how far the picture reaches, in mm."""
    grid = config.grid()
    distance, bearing = grid.tilings
    inner = 1000 * (distance.edges[:-1] + config.middle_m)
    outer = 1000 * (distance.edges[1:] + config.middle_m)
    wedges = []
    colours = []
    best = grid.index(0.0, 0.0)
    for state in range(grid.n):
        i, j = grid.cells(state)
        low, high = np.degrees(bearing.edges[j : j + 2]) + 90
        wedges.append(Wedge((0, 0), outer[i], low, high, width=outer[i] - inner[i]))
        colours.append("#F0C14B" if state == best else ("#f7f7f7" if (i + j) % 2 else NEVER))
    ax.add_collection(
        PatchCollection(wedges, facecolor=colours, edgecolor="#777777", linewidth=0.6)
    )
    return float(outer[-1]) + 30


def _fan_robots(ax: Axes, middle: float) -> None:
    """Draw the follower, and the robot in front where it should be (mm)."""
    ax.add_patch(
        Circle(
            (0, 0), 1000 * geometry.BODY_RADIUS, facecolor=CYCLE[0], alpha=0.4, edgecolor=CYCLE[0]
        )
    )
    ax.add_patch(
        FancyArrowPatch((0, 0), (0, 55), arrowstyle="-|>", mutation_scale=12, color=CYCLE[0])
    )
    ax.add_patch(
        Circle(
            (0, middle),
            1000 * geometry.BODY_RADIUS,
            fill=False,
            linestyle="--",
            edgecolor=CYCLE[1],
        )
    )
    ax.annotate(
        "robot in front\nat the optimum",
        (0, middle + 35),
        xytext=(48, 40),
        textcoords="offset points",
        fontsize=8,
        color=CYCLE[1],
        arrowprops={"arrowstyle": "-", "color": CYCLE[1]},
    )


def _fan_lines(ax: Axes, grid: TileGrid, middle_mm: float, colour: str, line: str) -> None:
    """Draw the inner edges of a grid of distance errors and bearings as arcs and rays."""
    distance, bearing = grid.tilings
    radii = 1000 * distance.edges + middle_mm
    angles = np.degrees(bearing.edges) + 90
    for radius in radii[1:-1]:
        ax.add_patch(
            Arc(
                (0, 0),
                2 * radius,
                2 * radius,
                theta1=angles[0],
                theta2=angles[-1],
                color=colour,
                linewidth=0.8,
                linestyle=line,
            )
        )
    for angle in np.radians(angles[1:-1]):
        ends = np.outer([radii[0], radii[-1]], [math.cos(angle), math.sin(angle)])
        ax.plot(ends[:, 0], ends[:, 1], color=colour, linewidth=0.8, linestyle=line)


def circle_geometry(
    radius_m: float, distance_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the one-parameter family of steady following on a circle: |bearing| in degrees,
    follower's radius in m.

    A follower at radius r behind a predecessor at R, at distance d and heading along its own
    circle, sees it at the inward bearing asin((r² + d² - R²) / 2rd): from 0 at r = √(R² - d²) to
    asin(d / 2R) at r = R.
    """
    radius = np.linspace(0.88 * radius_m, 1.1 * radius_m, 200)
    inward = np.arcsin((radius**2 + distance_m**2 - radius_m**2) / (2 * radius * distance_m))
    return np.degrees(inward), radius


def circle_following(
    bearing_deg: dict[str, ArrayLike],
    radius_m: dict[str, ArrayLike],
    *,
    leader_radius_m: float,
    distance_m: float,
    ax: Axes | None = None,
) -> Axes:
    """Draw where followers settle between keeping their predecessor's circle and cutting in.

    Args:
        bearing_deg, radius_m: condition → one value per seed: mean inward bearing, mean radius of
            the first follower.
        leader_radius_m, distance_m: of the leader's path and of the followers, for the geometric
            line.
    """
    ax = ax or new_axes(5.6, 4.0)
    line_bearing, line_radius = circle_geometry(leader_radius_m, distance_m)
    ax.plot(
        line_bearing,
        1000 * line_radius,
        color="#999999",
        label=f"geometry for d = {1000 * distance_m:.0f} mm",
    )
    keep = math.degrees(math.asin(distance_m / (2 * leader_radius_m)))
    cut = math.sqrt(leader_radius_m**2 - distance_m**2)
    for place, text, shift in (
        ((keep, leader_radius_m), "keep the circle", (-82, -3)),
        ((0.0, cut), "cut in", (12, -16)),
    ):
        ax.plot(
            place[0], 1000 * place[1], "x", color="black", markersize=8, markeredgewidth=2, zorder=5
        )
        ax.annotate(
            text,
            (place[0], 1000 * place[1]),
            xytext=shift,
            textcoords="offset points",
            fontsize=8.5,
        )
    for number, name in enumerate(bearing_deg):
        ax.plot(
            np.asarray(bearing_deg[name]),
            1000 * np.asarray(radius_m[name]),
            MARKERS[number],
            color=CYCLE[number],
            markersize=5,
            alpha=0.8,
            label=f"{name} (n = {np.size(bearing_deg[name])} runs)",
        )
    ax.set_xlabel("mean bearing towards the inside of the circle in degrees")
    ax.set_ylabel("mean radius of follower 1 in mm")
    ax.legend()
    return ax
