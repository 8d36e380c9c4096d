"""Pictures of scenes with matplotlib: what the live arena shows, for pages without a kernel.

Contract: functions take data and ``ax=None``, draw and return the Axes.
"""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Wedge

from workbench.plots.style import CYCLE, INK, new_axes
from workbench.view.scenes import FIELDS, Frames, LiveScene, StoredScene

TRAIL = 300  # control periods
_LEADER = CYCLE[1]
_FOLLOWER = CYCLE[0]
_TILE = CYCLE[4]
_BEAM = CYCLE[3]
_TRAILS = ("-", "--", "-.", ":", (0, (6, 2, 1, 2, 1, 2)))


def draw_scene(scene: LiveScene | StoredScene, t: int = -1, *, ax: Axes | None = None) -> Axes:
    """Draw one frame of a scene from above: line, trails, bounds and tile of every follower,
    proximity readings.

    Args:
        scene: a live scene that has run, or a stored one.
        t: number of the frame, negative from the end.

    Raises:
        IndexError: the scene has no such frame.
    """
    frames = scene.frames
    about = scene.about
    if not -len(frames) <= t < len(frames):
        raise IndexError(
            f"t = {t!r}; the scene has {len(frames)} frames: let it run first (advance)"
        )
    ax = ax or new_axes(6.4, 5.6)
    k = t % len(frames)
    line = np.array(about["line"])
    ax.plot(
        *np.vstack([line, line[:1]]).T,
        color="#9a9a9a",
        linewidth=4,
        zorder=0,
        label="line on the floor",
    )
    for i in range(about["robots"]):
        path = frames[max(0, k - TRAIL) : k + 1, i]
        name = "leader" if i == 0 else f"follower {i}"
        colour = _LEADER if i == 0 else _FOLLOWER
        ax.plot(
            path[:, 0],
            path[:, 1],
            color=colour,
            linewidth=1.9 if i == 0 else 1.1,
            linestyle=_TRAILS[i % len(_TRAILS)],
            label=f"way of {name}",
        )
        _robot(ax, frames[k, i], about, i)
    _frame(ax, frames[max(0, k - TRAIL) : k + 1, :, :2].reshape(-1, 2), line, about)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    ax.set_title(f"{scene.title} · {k * about['period']:.1f} s", loc="left", fontsize=9)
    return ax


def _frame(ax: Axes, ways: Frames, line: Frames, about: dict[str, Any]) -> None:
    """Show the robots' ways and the line, not too flat and not too slim; who drives by hand may be
    far from the line.
    """
    reach = 2.2 * about["bounds"]["middle"]
    shown = ways if about["free"] else np.vstack([ways, line])
    low, high = shown.min(axis=0) - reach / 2, shown.max(axis=0) + reach / 2
    grow = np.maximum(0.75 * (high - low)[::-1] - (high - low), 0.0) / 2
    low, high = low - grow, high + grow
    ax.set(
        xlim=(low[0], high[0]),
        ylim=(low[1], high[1]),
        xlabel="x in m",
        ylabel="y in m",
        aspect="equal",
    )


def _robot(ax: Axes, now: Frames, about: dict[str, Any], i: int) -> None:
    x, y, heading = (float(value) for value in now[:3])
    radius = about["radius"]
    if i > 0:
        _tile(ax, now, about, x, y, heading)
    _beams(ax, now, about)
    driving_back = i > 0 and now[FIELDS.index("phase")] != 0
    colour = _LEADER if i == 0 else _FOLLOWER
    ax.add_patch(
        Circle(
            (x, y),
            radius,
            facecolor=colour,
            edgecolor="black",
            linestyle="--" if driving_back else "-",
            alpha=0.4 if driving_back else 0.95,
            zorder=3,
        )
    )
    c, s = radius * math.cos(heading), radius * math.sin(heading)
    ax.plot([x + 0.35 * c, x + c], [y + 0.35 * s, y + s], color="white", linewidth=2, zorder=5)
    ax.annotate(
        "L" if i == 0 else str(i),
        (x - 0.3 * c, y - 0.3 * s),
        color="white",
        ha="center",
        va="center",
        fontsize=8.5,
        fontweight="bold",
        zorder=5,
    )


def _beams(ax: Axes, now: Frames, about: dict[str, Any]) -> None:
    """Draw what each proximity sensor reads."""
    x, y, heading = (float(value) for value in now[:3])
    radius = about["radius"]
    ring = about["ring"]
    for k, angle in enumerate(about["sensors"]):
        reading = float(now[FIELDS.index("ps0") + k])
        share = min(1.0, math.log1p(max(0.0, reading)) / math.log(4096))
        at = (x + ring * math.cos(heading + angle), y + ring * math.sin(heading + angle))
        middle = math.degrees(heading + angle)
        beam = Wedge(
            at,
            radius * (0.35 + 1.9 * share),
            middle - 12.6,
            middle + 12.6,
            color=_BEAM,
            alpha=0.12 + 0.6 * share,
            zorder=2,
        )
        ax.add_patch(beam)


def _tile(ax: Axes, now: Frames, about: dict[str, Any], x: float, y: float, heading: float) -> None:
    near, far = about["bounds"]["distance"]
    limit = math.degrees(about["bounds"]["bearing"])
    ahead = math.degrees(heading)
    for looks in (
        {"facecolor": _FOLLOWER, "alpha": 0.08},
        {"fill": False, "edgecolor": INK, "linewidth": 0.4},
    ):
        field = Wedge(
            (x, y), far, ahead - limit, ahead + limit, width=far - near, zorder=1, **looks
        )
        ax.add_patch(field)
    tile = int(now[FIELDS.index("state")])
    tiles = about["tiles"]
    if tile < 0 or tiles is None:
        return
    distance = tiles["distance"]
    bearing = np.degrees(tiles["bearing"])
    row, column = divmod(tile, len(bearing) - 1)
    ax.add_patch(
        Wedge(
            (x, y),
            distance[row + 1],
            ahead + bearing[column],
            ahead + bearing[column + 1],
            width=distance[row + 1] - distance[row],
            facecolor=_TILE,
            edgecolor="black",
            linewidth=0.8,
            alpha=0.55,
            zorder=3.5,
        )
    )
