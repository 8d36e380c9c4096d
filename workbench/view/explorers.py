"""What the panels draw: pure functions from a few numbers to a figure, 7 inches wide.

    tile_explorer       what a choice of tiles means in mm, degrees and counts
    infrared_explorer   what two front sensors read of the robot in front, and which tile that is
    learning_explorer   visits, values, greedy actions and how sure of them, at a moment of a run

Contract: equal arguments give equal figures; nothing is remembered.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge
from numpy.typing import NDArray

from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.policy import Policy
from workbench.lab.records import SUMS, Recorder
from workbench.plots.diagrams import tile_fan
from workbench.plots.runs import lead_map, policy_map, share_bar, value_map, visit_map
from workbench.plots.style import CYCLE, INK, style
from workbench.robot.geometry import BODY_RADIUS
from workbench.robot.infrared import (
    BEARINGS,
    BLINDED,
    DARK,
    DIFFUSE,
    RING,
    InfraredConfig,
    mean_light,
    noise_sd,
    saturate,
)
from workbench.robot.inversion import inversion_table, invert


def tile_explorer(
    spacing: str = "uniform",
    distance_tiles: int = 9,
    bearing_tiles: int = 9,
    inner_mm: float = 3.0,
    tilings: int = 1,
) -> Figure:
    """Draw the tiles around a follower, the depth of every distance tile, and what a front sensor
    reads of a cup in it.

    Args:
        spacing: "uniform" or "logarithmic", of both dimensions.
        distance_tiles, bearing_tiles: odd numbers.
        inner_mm: half depth of the middle distance tile where spacing is logarithmic; the middle
            bearing tile is ±2°.
        tilings: offset tilings, 1, 2, 4 or 8.
    """
    config = ConvoyConfig(
        state_tiles=(distance_tiles, bearing_tiles),
        distance_tiling=spacing,
        bearing_tiling=spacing,
        inner_distance_m=inner_mm / 1000,
        tilings=tilings,
    )
    distance, bearing = (tiling.edges for tiling in config.grid().tilings)
    edges = 1000 * (distance + config.middle_m)
    middle = (np.diff(edges)[distance_tiles // 2], np.degrees(np.diff(bearing)[bearing_tiles // 2]))
    with style():
        fig = Figure(figsize=(7.0, 6.4), layout="constrained")
        grid = fig.add_gridspec(2, 2, height_ratios=(1.5, 1))
        tile_fan(config, ax=fig.add_subplot(grid[0, :]))
        _depths(fig.add_subplot(grid[1, 0]), edges)
        _counts(fig.add_subplot(grid[1, 1]), edges, config.threshold_counts)
        fig.suptitle(
            f"{distance_tiles}×{bearing_tiles} = {config.grid().n} states, {config.rows} rows "
            "of the table; "
            f"middle tile {middle[0]:.1f} mm × {middle[1]:.1f}°"
        )
    return fig


def _depths(ax: Axes, edges: NDArray[np.float64]) -> None:
    """Draw the depth of every distance tile; edges in mm."""
    ax.bar(
        edges[:-1],
        np.diff(edges),
        width=np.diff(edges),
        align="edge",
        color=CYCLE[5],
        edgecolor=INK,
        linewidth=0.7,
    )
    ax.set(
        xlabel="distance between centres in mm",
        ylabel="depth of the tile in mm",
        ylim=(0, None),
    )


def _counts(ax: Axes, edges: NDArray[np.float64], threshold: float) -> None:
    """Draw what a front sensor reads of a cup over the distance; edges in mm."""
    places = np.linspace(edges[0], edges[-1], 60)
    curve, at_edges = (
        [_front(mm / 1000, 0.0, InfraredConfig())[0][0] for mm in where]
        for where in (places, edges)
    )
    ax.plot(places, curve, color=CYCLE[1])
    ax.vlines(edges, 0.5, at_edges, color=INK, linewidth=0.6)
    ax.axhline(threshold, color=CYCLE[0], linestyle="--", linewidth=1)
    ax.annotate(
        "seen above",
        (edges[-1], threshold),
        ha="right",
        va="bottom",
        fontsize=8.5,
        color=CYCLE[0],
    )
    ax.set(
        xlabel="distance between centres in mm",
        ylabel="counts of a front sensor",
        yscale="log",
        ylim=(0.5, 4000),
    )


def _front(
    distance_m: float, bearing_rad: float, infrared: InfraredConfig
) -> tuple[NDArray[np.float64], float]:
    """Return the mean readings (2,) of the left and the right front sensor, and the counts that
    light from ahead leaves them.
    """
    light = mean_light(distance_m, bearing_rad, infrared)
    room = max(DARK - infrared.ambient_counts * max(math.cos(float(BEARINGS[0])), DIFFUSE), 0.0)
    return np.array([saturate(float(light[k]), room) for k in (7, 0)]), room


def infrared_explorer(
    distance_mm: float = 105.0,
    bearing_deg: float = 0.0,
    reflectance: float = 1.0,
    ambient: float = 0.0,
    route: str = "ir-metric",
) -> Figure:
    """Draw the robot in front as it stands, what the two front sensors read of it, and the tile
    that they make of it.

    Args:
        distance_mm, bearing_deg: of the robot in front; bearing to the left is positive.
        reflectance: of the paper cup over it, 1 for white.
        ambient: counts that light from straight ahead takes from a sensor that faces it.
        route: "ir-metric" or "ir-raw".
    """
    infrared = InfraredConfig(brightness=reflectance, ambient_counts=ambient)
    config = replace(SETTINGS["infrared"], sensing=route)
    distance = distance_mm / 1000
    bearing = math.radians(bearing_deg)
    readings, room = _front(distance, bearing, infrared)
    table = inversion_table(InfraredConfig())  # the robot takes what it sees for a white cup
    blind = room < BLINDED
    seen = not blind and float(readings.max()) >= config.threshold_counts
    believed, towards = (
        (float(value) for value in invert(table, *readings)) if seen else (math.nan, math.nan)
    )
    first, second = readings if route == "ir-raw" else (believed - config.middle_m, towards)
    tile = config.grid().index(float(first), float(second)) if seen else -1
    with style():
        fig = Figure(figsize=(7.0, 6.0), layout="constrained")
        grid = fig.add_gridspec(2, 2, height_ratios=(1, 1.1))
        _stand(fig.add_subplot(grid[0, 0]), distance, bearing, readings)
        _bars(fig.add_subplot(grid[0, 1]), readings, config.threshold_counts, infrared)
        _cells(fig.add_subplot(grid[1, :]), config, tile)
        words = "blinded by the light, and it notices" if blind else "nothing is seen"
        if seen:
            words = (
                f"it takes that for {1000 * believed:.0f} mm and {round(math.degrees(towards)):+d}°"
            )
        where = f"state {tile}" if tile >= 0 else "no tile"
        fig.suptitle(
            f"robot in front at {distance_mm:.0f} mm and {round(bearing_deg):+d}°; {words}: {where}"
        )
    return fig


def _stand(ax: Axes, distance: float, bearing: float, readings: NDArray[np.float64]) -> None:
    ax.add_patch(Circle((0, 0), 1000 * BODY_RADIUS, facecolor=CYCLE[0], alpha=0.9))
    ax.add_patch(
        Circle(
            (-1000 * distance * math.sin(bearing), 1000 * distance * math.cos(bearing)),
            37,
            facecolor=CYCLE[1],
            alpha=0.8,
        )
    )
    for k, reading in zip((7, 0), readings, strict=True):
        place = 1000 * RING * np.array([-math.sin(BEARINGS[k]), math.cos(BEARINGS[k])])
        ahead = 90 + math.degrees(BEARINGS[k])
        share = math.log1p(float(reading)) / math.log(4096)
        ax.add_patch(
            Wedge(tuple(place), 75, ahead - 30, ahead + 30, color=CYCLE[3], alpha=0.1 + 0.6 * share)
        )
    ax.set(
        xlim=(-110, 110),
        ylim=(-45, 200),
        aspect="equal",
        xlabel="to the side in mm",
        ylabel="ahead in mm",
    )


def _bars(
    ax: Axes, readings: NDArray[np.float64], threshold: float, infrared: InfraredConfig
) -> None:
    spread = [
        infrared.noise * noise_sd(float(reading)) / math.sqrt(infrared.samples)
        for reading in readings
    ]
    ax.bar(
        ("left (ps7)", "right (ps0)"),
        np.maximum(readings, 0.5),
        width=0.45,
        color=(CYCLE[3], CYCLE[3]),
        yerr=spread,
        capsize=4,
    )
    ax.axhline(threshold, color=CYCLE[0], linestyle="--", linewidth=1)
    ax.annotate(
        "seen above", (0.5, threshold), ha="center", va="bottom", fontsize=8.5, color=CYCLE[0]
    )
    ax.set_xlim(-0.5, 1.5)
    for number, reading in enumerate(readings):
        ax.annotate(
            f"{reading:.0f}",
            (number + 0.03, max(float(reading), 0.5)),
            xytext=(2, 3),
            textcoords="offset points",
            va="bottom",
        )
    ax.set(yscale="log", ylim=(0.5, 6000), ylabel="counts ± one standard deviation")


def _cells(ax: Axes, config: ConvoyConfig, tile: int) -> None:
    """Draw all tiles as rectangles over their own two dimensions, the active one filled."""
    raw = config.sensing == "ir-raw"
    rows, columns = (tiling.edges.copy() for tiling in config.grid().tilings)
    if raw:
        rows[0], columns[0] = (
            1.0,
            1.0,
        )  # the lowest tile begins at 0, which a log scale does not have
    else:
        rows, columns = 1000 * (rows + config.middle_m), np.degrees(columns)
    shown = np.zeros((len(rows) - 1, len(columns) - 1))
    if tile >= 0:
        shown[divmod(tile, len(columns) - 1)] = 1.0
    ax.pcolormesh(
        columns, rows, shown, cmap="Oranges", vmin=0, vmax=1.6, edgecolors="#777777", linewidth=0.7
    )
    if raw:
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="right reading in counts",
            ylabel="left reading in counts",
        )
    else:
        ax.set(xlabel="bearing in degrees (left + | right −)", ylabel="distance in mm")
        ax.invert_xaxis()


@dataclass(frozen=True)
class History:
    """A run block by block.

    Attributes:
        config: of the run.
        updates: (K,) updates done at the end of each block.
        visits: (K, distance tiles, bearing tiles) of all followers in each block.
        losses: (K,) of all followers in each block.
        policies: what was known at the end of each block.
    """

    config: ConvoyConfig
    updates: tuple[int, ...]
    visits: NDArray[np.int64]
    losses: tuple[int, ...]
    policies: tuple[Policy, ...]


def learn_history(config: ConvoyConfig, *, steps: int) -> History:
    """Learn as ``learn`` does and keep what was known after every block of 2 500 control
    periods.
    """
    convoy = Convoy(config, [config.seed], steps=steps, threads=1)
    recorder = Recorder(config, steps)
    updates: list[int] = []
    policies = []
    for [block] in convoy.steps():
        recorder.add(block, updates[-1] if updates else 0)
        updates.append(int(convoy.updates[0]))
        policies.append(Policy.of(config, convoy.tables(0)[0]))
    records = recorder.records()
    visits = records["visits"].sum(axis=1, dtype=np.int64).reshape(-1, *config.state_tiles)
    losses = records["sums"][:, :, SUMS.index("losses")].sum(axis=1).astype(np.int64)
    return History(config, tuple(updates), visits, tuple(losses.tolist()), tuple(policies))


_UNSEEN, _UNTRIED = "never visited", "the best action was never tried"

# what a learner's maps are called where all are shown, and who draws those of a table
_MAPS: dict[str, tuple[str, Callable[..., Axes] | None]] = {
    "visits": ("share of visits in this block", None),
    "values": ("value of the state: max of θ", value_map),
    "actions": ("greedy action: mm/s, arrow: turn", policy_map),
    "confidence": ("confidence: its θ above the next best", lead_map),
}


def learning_explorer(
    history: History, *, block: int = -1, follower: int = 1, show: str = "all"
) -> Figure:
    """Draw the visits of one block, and the values and greedy actions that one follower has learned
    by its end.

    Args:
        history: of ``learn_history``.
        block: number of the block, negative from the end.
        follower: whose table, 1 for the first.
        show: "visits", "values", "actions", "confidence" (how far the greedy action's value is
            ahead of the second best) or "all".

    Raises:
        ValueError: show is nothing of these, or there is no such block or follower.
    """
    blocks = len(history.updates)
    followers = history.config.followers
    if not -blocks <= block < blocks or not 1 <= follower <= followers:
        raise ValueError(
            f"block = {block!r}, follower = {follower!r}; the run has blocks 0 to "
            f"{blocks - 1} and followers 1 to {followers}"
        )
    if show not in (*_MAPS, "all"):
        raise ValueError(
            f"show = {show!r}; expected one of {', '.join(map(repr, (*_MAPS, 'all')))}"
        )
    chosen = tuple(_MAPS) if show == "all" else (show,)
    policy = history.policies[block]
    table = min(follower - 1, policy.theta.shape[0] - 1)
    with style():
        fig = Figure(figsize=(7.0, 6.6 if show == "all" else 5.4), layout="constrained")
        grid = fig.subplots(2, 2) if show == "all" else fig.subplots(squeeze=False)
        for kind, ax in zip(chosen, grid.ravel(), strict=True):
            title, drawn = _MAPS[kind]
            if drawn is None:
                visit_map(history.visits[block], history.config, ax=ax, plain=show == "all")
            else:
                drawn(policy, history.config, table=table, ax=ax)
            if show == "all":
                _shorten(ax, title)
        done = f"{history.updates[block]:,}".replace(",", " ")
        hatched = {"all": f"{_UNSEEN}; in the other maps: {_UNTRIED}", "visits": _UNSEEN}
        fig.suptitle(
            f"after {done} updates: {history.losses[block]} losses in this block; table of "
            f"follower {table + 1}\nhatched: {hatched.get(show, _UNTRIED)}"
        )
    return fig


def _shorten(ax: Axes, title: str) -> None:
    """Say above a small map what its colour bar says beside a large one."""
    mesh = next(part for part in ax.collections if isinstance(part, QuadMesh))
    if mesh.colorbar is None:
        share_bar(ax, "")
    else:
        mesh.colorbar.set_label("")
    ax.set_title(title, fontsize=9.5, loc="left")
    # the same tiles in the same place of every map
    corners = np.asarray(mesh.get_coordinates())
    ax.set(xlim=corners[0, [-1, 0], 0], ylim=corners[[0, -1], 0, 1])
    ax.set_xticks(np.round(np.linspace(*ax.get_xlim(), 4)))
    ax.set(xlabel="bearing in degrees", ylabel="distance in mm")
