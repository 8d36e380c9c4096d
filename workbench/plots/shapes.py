"""Formations from above: robots, where their places are, and the virtual leaders of these."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from workbench.formation.convoy import Convoy
from workbench.measures.motion import Motion
from workbench.plots.diagrams import draw_body
from workbench.plots.style import CYCLE, INK, new_axes
from workbench.robot.geometry import BODY_RADIUS

TRAIL = 120  # control periods
_LEADER, _FOLLOWER = CYCLE[1], CYCLE[0]


def draw_formation(
    convoy: Convoy,
    motion: Motion,
    *,
    virtual: bool = False,
    reach_m: float = 0.0,
    ax: Axes | None = None,
) -> Axes:
    """Draw the first formation of a convoy as it stands now, with the ways that led there.

    Args:
        convoy: whose followers keep places.
        motion: what it has just driven.
        virtual: whether the virtual leader of every place is drawn, too, as a dashed body, with
            the line from its place to it.
        reach_m: half the width of what is shown; 0: what the robots need.
    """
    config = convoy.config
    if not config.formation.shaped:
        raise ValueError("convoy keeps no places; expected ConvoyConfig.formation with a shape")
    ax = ax or new_axes(4.4, 4.4)
    radius = config.robot.body_radius_m
    ways = motion.position[-TRAIL:]
    for i in range(ways.shape[1]):
        colour = _LEADER if i == 0 else _FOLLOWER
        ax.plot(*ways[:, i].T, color=colour, linewidth=1.1, alpha=0.8, zorder=0)
        ax.add_patch(Circle(tuple(ways[-1, i].tolist()), radius, facecolor=colour, alpha=0.9))
        x, y = ways[-1, i].tolist()
        word = "L" if i == 0 else str(i)
        ax.text(x, y, word, color="white", ha="center", va="center", fontsize=9)
    for place, here in zip(convoy.robots["place"][0, 1:], convoy.places[0], strict=True):
        there = np.array([place["ahead_x"], place["ahead_y"]])
        look: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 1.0}
        ax.add_patch(Circle(tuple(here.tolist()), 1.25 * radius, **look))
        if virtual:
            ax.plot(*np.stack([here, there]).T, color=INK, linewidth=0.8, linestyle="--")
            ax.add_patch(Circle(tuple(there.tolist()), radius, linestyle="--", **look))
    low, high = ways[-1].min(axis=0), ways[-1].max(axis=0)
    middle = (low + high) / 2
    reach = reach_m or max(float(np.ptp(ways[-1], axis=0).max()) / 2 + 0.2, 0.3)
    ax.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
    )
    return ax


def seen_alike(distance_m: float, bearing_deg: float, *, ax: Axes | None = None) -> Axes:
    """Draw e-pucks that all see a leader at the same distance and bearing, each with another
    heading; the one with the leader's own is the dark one.
    """
    ax = ax or new_axes(4.0, 4.0)
    draw_body(ax, (0.0, 0.0, 0.0), _LEADER, alpha=0.8)
    for turned in np.radians(np.arange(0, 360, 45)):
        towards = turned + np.radians(bearing_deg)
        at = -distance_m * np.cos(towards), -distance_m * np.sin(towards)
        draw_body(ax, (*at, float(turned)), _FOLLOWER, alpha=0.8 if turned == 0.0 else 0.2)
    reach = distance_m + 2.4 * BODY_RADIUS
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.set_axis_off()
    return ax
