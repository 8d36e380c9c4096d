"""Plots of the robot: motor speeds, drive models beside exact rolling, the leader on its line, the
drive beside recordings.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from workbench.plots.style import CYCLE, MARKERS, new_axes, note


def motor_speeds(
    speeds: pd.DataFrame, levels: ArrayLike, *, leader: float, ax: Axes | None = None
) -> Axes:
    """Draw by how many percent wheels turn faster than commanded.

    Args:
        speeds: columns "command" (steps/s) and one of real steps/s per robot.
        levels: commands to mark, the followers' action levels.
        leader: the leader's command.
    """
    ax = ax or new_axes(6.6, 3.4)
    for number, name in enumerate([column for column in speeds if column != "command"]):
        excess = 100 * (speeds[name] / speeds["command"] - 1)
        ax.plot(
            speeds["command"],
            excess,
            color=CYCLE[number],
            linestyle=("-", "--")[number % 2],
            linewidth=1.2,
            label=name,
        )
    for k, level in enumerate(np.asarray(levels)):
        ax.axvline(
            level,
            color="#999999",
            linewidth=0.8,
            zorder=0,
            label="levels of the followers" if k == 0 else None,
        )
    ax.axvline(
        leader, color=CYCLE[2], linewidth=1.2, linestyle=(0, (4, 3)), zorder=0, label="leader"
    )
    ax.set_xlabel("commanded speed in steps/s")
    ax.set_ylabel("real speed above command in %")
    ax.legend(loc="upper left")
    return ax


def speed_after_a_step(paths: Mapping[str, pd.DataFrame], *, ax: Axes | None = None) -> Axes:
    """Draw forward speed (mm/s) against time for paths with columns t_s and x_m, by name."""
    ax = ax or new_axes(4.6, 3.6)
    for number, (name, path) in enumerate(paths.items()):
        speed = 1000 * np.diff(path["x_m"]) / np.diff(path["t_s"])
        middle = 1000 * (path["t_s"].to_numpy()[1:] + path["t_s"].to_numpy()[:-1]) / 2
        ax.plot(
            middle,
            speed,
            color=CYCLE[number],
            marker=MARKERS[number],
            markersize=3.5,
            label=name,
            linestyle=("-", "--", ":")[number % 3],
        )
    ax.axvline(100, color="#999999", linewidth=0.8, linestyle=":")
    ax.text(102, 5, "next command", fontsize=8, color="#555555")
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time after the command in ms")
    ax.set_ylabel("forward speed in mm/s")
    ax.legend(loc="center right")
    return ax


def paths_in_the_plane(paths: Mapping[str, pd.DataFrame], *, ax: Axes | None = None) -> Axes:
    """Draw paths with columns x_m and y_m, by name; marks stand at their ends, which an inset
    enlarges (mm from their middle).
    """
    ax = ax or new_axes(4.6, 3.6)
    ends = {name: path[["x_m", "y_m"]].iloc[-1].to_numpy() for name, path in paths.items()}
    middle = np.mean(list(ends.values()), axis=0)
    inset = ax.inset_axes((0.36, 0.3, 0.3, 0.34))
    for number, (name, path) in enumerate(paths.items()):
        look: dict[str, Any] = {
            "color": CYCLE[number],
            "marker": MARKERS[number],
            "markerfacecolor": "none",
        }
        ax.plot(
            path["x_m"],
            path["y_m"],
            linestyle=("-", "--", ":")[number % 3],
            label=name,
            markevery=[len(path) - 1],
            **look,
        )
        inset.plot(*(1000 * (ends[name] - middle)), markersize=8, linestyle="none", **look)
    inset.set(xlim=(-5, 5), ylim=(-5, 5), aspect="equal", xticks=(-4, 0, 4), yticks=(-4, 0, 4))
    inset.set_title("ends, mm", fontsize=8.5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x in m")
    ax.set_ylabel("y in m")
    ax.legend(loc="best")
    return ax


def leader_and_line(path: pd.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draw the sideways distance (mm) of the leader and of the line under it from the nominal loop,
    against time.
    """
    ax = ax or new_axes(7.2, 3.0)
    ax.plot(
        path["t_s"],
        path["from_loop_mm"] - path["from_line_mm"],
        color="#777777",
        linestyle="--",
        linewidth=1,
        label="the line",
    )
    ax.plot(path["t_s"], path["from_loop_mm"], color=CYCLE[0], label="the leader's axle")
    ax.axhline(0, color="#bbbbbb", linewidth=0.8, zorder=0)
    ax.set_xlabel("time in s")
    ax.set_ylabel("left of the nominal loop in mm")
    ax.set_ylim(top=1.35 * float((path["from_loop_mm"] - path["from_line_mm"]).max()))
    ax.legend(loc="upper right", ncols=2)
    return ax


def drive_validation(runs: pd.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draw simulated over real distance, one mark per robot-run, by kind of log and of set-points,
    for both motor rules.

    Args:
        runs: lines of data/validation/drive.csv of one drive.
    """
    ax = ax or new_axes(7.0, 3.2)
    kinds = [
        (log, points) for log in sorted(runs["log"].unique()) for points in ("constant", "changing")
    ]
    ax.axvline(1.0, color="#999999", linewidth=0.8)
    for number, rule in enumerate(sorted(runs["firmware"].unique())):
        for place, (log, points) in enumerate(kinds):
            part = runs[
                (runs["log"] == log) & (runs["set_points"] == points) & (runs["firmware"] == rule)
            ]
            spread = (
                np.linspace(-0.09, 0.09, max(len(part), 1))
                if len(part) > 1
                else np.zeros(len(part))
            )
            ax.plot(
                part["distance_ratio"],
                place + 0.22 * (number - 0.5) + spread,
                MARKERS[number],
                color=CYCLE[number],
                markersize=4,
                alpha=0.75,
                label=f"motor rule of the {rule}" if place == 0 else None,
            )
    counts = [
        len(runs[(runs["log"] == log) & (runs["set_points"] == points)]) // 2
        for log, points in kinds
    ]
    ax.set_yticks(
        range(len(kinds)),
        [f"{log}\n{points} (n = {n})" for (log, points), n in zip(kinds, counts, strict=True)],
    )
    ax.set_ylim(len(kinds) - 0.5, -0.5)
    ax.set_xlabel("simulated over real distance travelled")
    ax.legend(loc="upper right")
    note(ax, "one mark per real robot and run; n robot-runs")
    return ax
