"""Plots of runs: visit map, learning curve, policy and value maps, trails. Statistics are computed
elsewhere.

Every function takes data and ``ax=None``, draws and returns the Axes; it never shows, saves or
computes statistics. In maps the follower looks up the page: right of the zero line is right of the
robot, so that bearing falls to the right.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.policy import Policy
from workbench.plots.style import CYCLE, MARKERS, NEVER, new_axes
from workbench.robot.motors import twist

Floats = NDArray[np.float64]
_SHARES = "share of visits (log scale; grey: never; <: below 0.005 %)"


def _edges(config: ConvoyConfig) -> tuple[Floats, Floats]:
    """Return the tile borders in mm of distance between centres and in degrees of bearing."""
    distance, bearing = config.grid().tilings
    return 1000 * (distance.edges + config.middle_m), np.degrees(bearing.edges)


def _tile_axes(ax: Axes, config: ConvoyConfig) -> None:
    distance, bearing = _edges(config)
    ax.set_xlim(bearing[-1], bearing[0])
    ax.set_ylim(distance[0], distance[-1])
    ax.set_xticks(
        np.round(np.linspace(-45, 45, 7))
        if abs(bearing[0] + 45) < 1e-9
        else np.linspace(bearing[0], bearing[-1], 5)
    )
    ax.set_xlabel("bearing of the predecessor in degrees (left + | right −)")
    ax.set_ylabel("distance between centres in mm")
    ax.spines[["top", "right"]].set_visible(True)


def visit_map(
    visits: ArrayLike,
    config: ConvoyConfig,
    *,
    label: str = "",
    ax: Axes | None = None,
    plain: bool = False,
) -> Axes:
    """Draw the shares of visits per state on a log colour scale, like Fig. 4 of the paper, in mm
    and degrees.

    Args:
        visits: (distance tiles, bearing tiles) counts.
        config: whose tiles they are.
        label: what was counted, written above the map.
        plain: without numbers and colour bar, for several maps side by side.
    """
    ax = ax or new_axes(6.4, 4.9)
    counts = np.asarray(visits, dtype=np.float64)
    share = counts / max(counts.sum(), 1)
    distance, bearing = _edges(config)
    ax.set_facecolor(NEVER)
    ax.patch.set(hatch="///", edgecolor="#bbbbbb")
    norm = LogNorm(1e-6, 1.0)
    ax.pcolormesh(
        bearing,
        distance,
        np.ma.masked_equal(share, 0),
        cmap="viridis",
        norm=norm,
        edgecolors="white",
        linewidth=0.6,
    )
    _tile_axes(ax, config)
    ax.set_title(label, loc="left", fontsize=8.5)
    if plain:
        return ax
    _write_shares(ax, share, distance, bearing, norm)
    share_bar(ax)
    return ax


def share_bar(ax: Axes, label: str = _SHARES) -> None:
    """Put the colour bar of its shares beside a visit map."""
    bar = ax.figure.colorbar(ax.collections[0], ax=ax, label=label)
    bar.set_ticks(
        [10.0**k for k in range(-6, 1)],
        labels=["0.0001 %", "0.001 %", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"],
    )
    bar.ax.minorticks_off()


def _write_shares(
    ax: Axes, share: Floats, distance: Floats, bearing: Floats, norm: LogNorm
) -> None:
    """Write every share that is not zero into its tile."""
    for i, row in enumerate(share):
        for j, value in enumerate(row):
            if value > 0:
                ax.text(
                    (bearing[j] + bearing[j + 1]) / 2,
                    (distance[i] + distance[i + 1]) / 2,
                    _percent(value),
                    ha="center",
                    va="center",
                    fontsize=8 if share.size > 30 else 11,
                    color="white" if norm(value) < 0.6 else "black",
                )


def often(visits: ArrayLike, least: float = 1e-3) -> Floats:
    """Return counts of visits without those of cells that hold less than a share of all: a map then
    leaves them grey.
    """
    counts = np.asarray(visits, dtype=np.float64)
    return np.where(counts >= least * counts.sum(), counts, 0.0)


def frame_block(
    ax: Axes,
    config: ConvoyConfig,
    place: Sequence[int],
    size: int,
    label: str,
    colour: str = "#D55E00",
) -> None:
    """Frame a size × size block of tiles that starts at (row, column), and name it in the
    legend.
    """
    distance, bearing = _edges(config)
    row, column = place
    rows, columns = min(row + size, len(distance) - 1), min(column + size, len(bearing) - 1)
    corner = (bearing[column], distance[row])
    ax.add_patch(
        Rectangle(
            corner,
            bearing[columns] - bearing[column],
            distance[rows] - distance[row],
            fill=False,
            edgecolor=colour,
            linewidth=2.2 if size > 1 else 1.4,
            linestyle="-" if size > 1 else "--",
            label=label,
            zorder=5,
            path_effects=[withStroke(linewidth=4.0, foreground="white")],
        )
    )


def learning_curves(
    blocks: pd.DataFrame,
    value: str,
    *,
    by: str,
    ylabel: str,
    ax: Axes | None = None,
    symlog: float = 0.0,
) -> Axes:
    """Draw one quantity against learning updates: each seed thin, the median of a condition thick.

    Args:
        blocks: tidy, with columns "updates" (before the block), "seed", "block" (its number),
            ``by`` and ``value``.
        value: the column to draw.
        by: the column that names the condition.
        ylabel: quantity and unit.
        symlog: if positive, a logarithmic value axis that is linear below this value.
    """
    ax = ax or new_axes(6.2, 3.5)
    for number, (name, group) in enumerate(blocks.groupby(by, sort=False)):
        for _, run in group.groupby("seed"):
            ax.plot(run["updates"] / 1e6, run[value], color=CYCLE[number], linewidth=0.7, alpha=0.5)
        middle = group.groupby("block")[["updates", value]].median()
        seeds = group["seed"].nunique()
        ax.plot(
            middle["updates"] / 1e6,
            middle[value],
            color=CYCLE[number],
            marker=MARKERS[number],
            markersize=4,
            linestyle=("-", "--")[number % 2],
            markevery=max(len(middle) // 8, 1),
            label=f"{name} (n = {seeds} seeds; thick: median, thin: each seed)",
        )
    if symlog:
        ax.set_yscale("symlog", linthresh=symlog)
        ax.set_ylim(bottom=0)
    ax.set_xlabel("learning updates of all followers together, millions")
    ax.set_ylabel(ylabel)
    ax.legend()
    return ax


def accumulated(
    table: pd.DataFrame, value: str, *, ylabel: str, ax: Axes | None = None, log: bool = False
) -> Axes:
    """Draw what has come together of a quantity so far, per follower: the median of all seeds, and
    from the lowest to the highest.

    Args:
        table: tidy, with columns "updates" (millions would be too coarse: single ones), "seed",
            "block" (its number), "follower" and ``value``.
        value: the column to draw.
        ylabel: quantity and unit.
        log: whether the updates are on a logarithmic axis.
    """
    ax = ax or new_axes(6.2, 3.5)
    for number, (follower, part) in enumerate(table.groupby("follower", sort=True)):
        blocks = part.groupby("block")
        updates = blocks["updates"].median() / 1e6
        low, middle, high = (blocks[value].quantile(q) for q in (0.0, 0.5, 1.0))
        ax.fill_between(updates, low, high, color=CYCLE[number], alpha=0.15, linewidth=0)
        ax.plot(
            updates,
            middle,
            color=CYCLE[number],
            marker=MARKERS[number],
            markersize=4,
            markevery=max(len(middle) // 8, 1),
            label=f"follower {follower}",
        )
    if log:
        ax.set_xscale("log")
    ax.set_ylim(bottom=0)
    ax.set_xlabel("learning updates of all followers together, millions")
    ax.set_ylabel(ylabel)
    ax.legend()
    return ax


def paper_pattern(ax: Axes, config: ConvoyConfig) -> Axes:
    """Draw what the paper tells of its Fig. 4, on the same tiles: 74 % right of the optimum, 98.7 %
    in the 3×3 block on the right side. Its single cells are known by colour only.
    """
    distance, bearing = _edges(config)
    row, column = config.state_tiles[0] // 2, config.state_tiles[1] // 2 - 1
    share = np.full(config.state_tiles, np.nan)
    share[row - 1 : row + 2, column - 1 : column + 2] = (0.987 - 0.74) / 8
    share[row, column] = 0.74
    ax.pcolormesh(
        bearing,
        distance,
        np.ma.masked_invalid(share),
        cmap="viridis",
        norm=LogNorm(1e-6, 1.0),
        edgecolors="white",
        linewidth=0.6,
    )
    x = (bearing[column] + bearing[column + 1]) / 2
    y = (distance[row] + distance[row + 1]) / 2
    ax.text(x, y, "74", ha="center", va="center", fontsize=8)
    corner = bearing[column - 1], distance[row - 1]
    ax.text(
        bearing[column + 2],
        distance[row + 2] + 2,
        "98.7 in the block,\n24.7 around the cell",
        fontsize=8,
        ha="left",
        va="bottom",
    )
    ax.add_patch(
        Rectangle(
            corner,
            bearing[column + 2] - corner[0],
            distance[row + 2] - corner[1],
            fill=False,
            edgecolor="#D55E00",
            linewidth=2.2,
        )
    )
    _tile_axes(ax, config)
    ax.set_title("the paper's words on its Fig. 4, in percent", loc="left", fontsize=8.5)
    return ax


def intervals_by_case(
    table: pd.DataFrame,
    value: str,
    *,
    rows: str,
    colours: str,
    lines: Mapping[str, float],
    ax: Axes | None = None,
) -> Axes:
    """Draw a mean and its interval for every pair of cases.

    Args:
        table: one line per pair, with columns ``value``, "low", "high", "seeds" and those named by
            rows and colours.
        rows: the column whose cases get a row each.
        colours: the column whose cases get a colour and a marker each.
        lines: name → value, vertical reference lines.
    """
    ax = ax or new_axes(6.4, 3.4)
    cases = list(table[rows].unique())
    kinds = list(table[colours].unique())
    for place, at in lines.items():
        ax.axvline(at, color="#777777", linestyle=":", linewidth=1)
        ax.text(at, -0.62, place, fontsize=7.5, ha="center", va="bottom", color="#555555")
    for number, kind in enumerate(kinds):
        part = table[table[colours] == kind]
        y = np.array([cases.index(case) for case in part[rows]]) + 0.2 * (
            number - (len(kinds) - 1) / 2
        )
        spread = np.abs(np.array([part["low"], part["high"]]) - part[value].to_numpy())
        ax.errorbar(
            part[value],
            y,
            xerr=spread,
            fmt=MARKERS[number],
            color=CYCLE[number],
            markersize=5,
            capsize=3,
            label=str(kind),
        )
    ax.set_yticks(range(len(cases)), cases)
    ax.set_ylim(len(cases) - 0.4, -0.65)
    seeds = sorted({str(n) for n in table["seeds"]})
    title = f"{colours}; mean, 95 % interval over {' or '.join(seeds)} seeds"
    ax.legend(title=title, loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=4, fontsize=8)
    return ax


def value_map(
    policy: Policy, config: ConvoyConfig, *, table: int = 0, ax: Axes | None = None
) -> Axes:
    """Draw the learned value of every state under the greedy policy, max over actions of θ.

    States whose best action was never updated (θ still θ₀) are left grey: their value is not
    learned.
    """
    best = policy.values()[table].max(axis=1)
    label = "value of the state, max over actions of θ"
    return _state_map(best, policy, config, table, label, ax)


def lead_map(
    policy: Policy, config: ConvoyConfig, *, table: int = 0, ax: Axes | None = None
) -> Axes:
    """Draw how far the value of every state's greedy action is ahead of the second best: where
    little, another action may do as well, or a few updates may change the choice.

    States whose best action was never updated are left grey, as in ``value_map``.
    """
    second, best = np.sort(policy.values()[table], axis=1)[:, -2:].T
    label = "θ of the greedy action above the second best"
    return _state_map(best - second, policy, config, table, label, ax)


def _state_map(
    values: Floats,
    policy: Policy,
    config: ConvoyConfig,
    table: int,
    label: str,
    ax: Axes | None,
    norm: Normalize | None = None,
) -> Axes:
    """Draw a number of every state whose greedy action was ever updated, with a colour bar."""
    ax = ax or new_axes(5.6, 4.4)
    distance, bearing = _edges(config)
    known = _known(policy, config, table)
    shown = np.ma.masked_where(~known, values.reshape(config.state_tiles))
    ax.set_facecolor(NEVER)
    ax.patch.set(hatch="///", edgecolor="#bbbbbb")
    mesh = ax.pcolormesh(
        bearing,
        distance,
        shown,
        cmap="viridis",
        norm=norm,
        edgecolors="white",
        linewidth=0.4,
    )
    ax.figure.colorbar(mesh, ax=ax, label=label)
    _tile_axes(ax, config)
    _look_at(ax, config, known)
    return ax


def _known(policy: Policy, config: ConvoyConfig, table: int) -> NDArray[np.bool_]:
    best = policy.values()[table].max(axis=1)
    return np.asarray((best != config.learner.theta0).reshape(config.state_tiles))


def _look_at(ax: Axes, config: ConvoyConfig, known: NDArray[np.bool_]) -> None:
    """Show the states that are known, and one more on every side: the rest has nothing to show."""
    if not known.any():
        return
    distance, bearing = _edges(config)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    low, high = max(rows[0] - 1, 0), min(rows[-1] + 2, len(distance) - 1)
    right, left = max(columns[0] - 1, 0), min(columns[-1] + 2, len(bearing) - 1)
    ax.set_ylim(distance[low], distance[high])
    ax.set_xlim(bearing[left], bearing[right])
    ax.set_xticks(bearing[right : left + 1])


def _lean(ax: Axes, turn: NDArray[np.float64], at: NDArray[np.bool_], config: ConvoyConfig) -> None:
    """Draw an arrow in every state that was seen, leaning to the side that it turns to (rad/s)."""
    distance, bearing = _edges(config)
    x, y = np.meshgrid((bearing[:-1] + bearing[1:]) / 2, (distance[:-1] + distance[1:]) / 2)
    lean = np.clip(turn / 1.2, -1, 1) * math.pi / 2
    ax.quiver(
        x[at],
        y[at],
        -np.sin(lean)[at],
        np.cos(lean)[at],
        pivot="mid",
        angles="uv",
        scale=14,
        width=0.008,
        color="white",
        edgecolor="black",
        linewidth=0.6,
    )


def policy_map(
    policy: Policy, config: ConvoyConfig, *, table: int = 0, ax: Axes | None = None
) -> Axes:
    """Draw the greedy action of every state: colour is forward speed, the arrow leans to the side
    it turns to.

    States whose greedy action was never updated (θ still θ₀) are left grey: what they would do next
    is not learned.
    """
    greedy = policy.greedy()[table]
    left, right = (
        levels[part]
        for levels, part in zip(
            (policy.left_steps, policy.right_steps),
            divmod(greedy, len(policy.right_steps)),
            strict=True,
        )
    )
    speed, turn = np.array([twist(float(a), float(b)) for a, b in zip(left, right, strict=True)]).T
    span = Normalize(*(1000 * np.array(config.wheel_speed_mps)))
    label = "greedy forward speed in mm/s"
    ax = _state_map(1000 * speed, policy, config, table, label, ax, span)
    _lean(ax, turn.reshape(config.state_tiles), _known(policy, config, table), config)
    return ax


def trails(
    samples: NDArray[np.void],
    *,
    line: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the driven paths of all robots.

    Args:
        samples: (periods, robots) of PERIOD, as sampled blocks are.
        line: (P, 2) the line on the floor, m.
        names: one name per robot.
    """
    ax = ax or new_axes(5.2, 5.0)
    if line is not None:
        points = np.asarray(line)
        ax.plot(
            *np.vstack([points, points[:1]]).T,
            color="#bbbbbb",
            linewidth=4,
            label="line on the floor",
            zorder=0,
        )
    for robot in range(samples.shape[1]):
        name = names[robot] if names else ("leader" if robot == 0 else f"follower {robot}")
        path = samples[:, robot]
        ax.plot(
            path["x"],
            path["y"],
            color=CYCLE[robot % len(CYCLE)],
            linewidth=1.1,
            label=name,
            markersize=6,
            marker=MARKERS[robot % len(MARKERS)],
            markevery=[len(path) - 1],
        )
    ax.set_aspect("equal")
    ax.set_xlabel("x in m")
    ax.set_ylabel("y in m")
    ax.legend(loc="center", fontsize=7.5)
    return ax


def arena_picture(pixels: NDArray[np.uint8], *, ax: Axes | None = None) -> Axes:
    """Show a picture from ``workbench.arena.picture``."""
    ax = ax or new_axes(6.4, 6.4 * pixels.shape[0] / pixels.shape[1])
    ax.imshow(pixels, interpolation="none")
    ax.set_axis_off()
    return ax


def _percent(share: float) -> str:
    percent = 100 * share
    if percent >= 0.1:
        return f"{percent:.1f}"
    return f"{percent:.2f}" if percent >= 0.005 else "<"
