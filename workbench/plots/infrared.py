"""Plots of infrared: readings beside real ones, where two readings determine a place, what tiles of
raw readings mean in metres.

Contract: plot functions draw on the axes that they are given and return them; ``cups`` and the
tables compute, without drawing.
"""

from collections.abc import Callable

import mujoco
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from workbench.formation.config import ConvoyConfig
from workbench.plots.style import CYCLE, MARKERS, note
from workbench.robot.infrared import (
    SENSORS,
    TARGETS,
    InfraredConfig,
    calibrate,
    draw_units,
    front_pair,
    headroom,
    mean_light,
    raw_reading,
)
from workbench.robot.inversion import inversion_table, invert, mean_pairs, uncertainty

CUT_MM = 85.0  # beyond, the compared readings are those that stood out of the noise
CUP_HEIGHT = 0.080  # m: a small coffee cup over the robot; our measure of the paper's Fig. 5
CUP_GREY = (0.97, 0.97, 0.96, 1.0)
# A collision class that no other geom answers to. Geoms without any class do not count in the
# bounds by which MuJoCo's rays pass over a body, so that the upper part of the cup would not be
# seen
_NOBODY = 16


def real_and_model(table: pd.DataFrame, kind: str, ax: Axes) -> Axes:
    """Draw median real readings and the fitted model's against their place.

    Args:
        table: data/validation/infrared_curves.csv.
        kind: "box in contact" (place in degrees) or "backing off" (mm, as far as medians lie above
            the cut of 30 counts).
    """
    part = table[table["kind"] == kind].sort_values("place")
    part = part[part["place"] <= (CUT_MM if kind == "backing off" else 90)]
    ax.plot(
        part["place"],
        part["real"],
        MARKERS[0],
        color=CYCLE[0],
        markersize=5,
        label="real e-puck (median)",
    )
    ax.plot(part["place"], part["model"], "-", color=CYCLE[1], label="model, gains fitted")
    ax.set_yscale("log")
    ax.set(ylabel="reading above free air (counts)")
    note(
        ax,
        "e-puck1, a box in contact"
        if kind == "box in contact"
        else "e-puck2 backs off, four runs, front sensors",
    )
    ax.set_xlabel(
        "sensor's axis off the box's normal (°)"
        if kind == "box in contact"
        else "gap to the object (mm)"
    )
    ax.legend()
    return ax


def targets_by_distance(infrared: InfraredConfig, threshold: float) -> pd.DataFrame:
    """Return the mean front reading straight ahead by distance between centres and target, with the
    assumption's range.
    """
    lines = []
    for target, (_, usual, (low, high)) in TARGETS.items():
        for distance in np.linspace(0.075, 0.60, 106):
            readings = [
                front_pair(
                    float(distance), 0.0, InfraredConfig(target=target, brightness=factor / usual)
                )[0]
                for factor in (low, usual, high)
            ]
            lines.append(
                {
                    "target": target,
                    "distance_m": distance,
                    "low": readings[0],
                    "counts": readings[1],
                    "high": readings[2],
                }
            )
    return pd.DataFrame(lines).assign(seen=lambda table: table["counts"] >= threshold)


def draw_targets(table: pd.DataFrame, threshold: float, ax: Axes) -> Axes:
    """Draw ``targets_by_distance``; a band is the range that an assumed reflectance may lie in."""
    for number, (target, part) in enumerate(table.groupby("target", sort=False)):
        mm = 1000 * part["distance_m"]
        ax.plot(
            mm,
            part["counts"],
            linestyle=("-", "--", ":", "-.")[number],
            color=CYCLE[number],
            label=target,
        )
        ax.fill_between(mm, part["low"], part["high"], color=CYCLE[number], alpha=0.15, linewidth=0)
    ax.axhline(threshold, color="#777777", linewidth=0.8)
    ax.text(215, 1.1 * threshold, "threshold of sight", fontsize=8, color="#555555")
    ax.set_yscale("log")
    ax.set(
        xlabel="distance between centres (mm)",
        ylabel="each front sensor (counts)",
        xlim=(70, 600),
        ylim=(2, 5000),
    )
    note(ax, "straight ahead; bands: range of the assumed reflectance or strength")
    ax.legend()
    return ax


def bounds_map(config: ConvoyConfig) -> pd.DataFrame:
    """Return the least standard deviations of an unbiased estimate, in mm and degrees, by distance
    (m) and bearing (degrees).
    """
    distances = np.linspace(0.075, 0.16, 86)
    bearings = np.linspace(-45, 45, 91)
    bound = uncertainty(distances, np.radians(bearings), config.infrared)
    grid_d, grid_b = np.meshgrid(distances, bearings, indexing="ij")
    return pd.DataFrame(
        {
            "distance_m": grid_d.ravel(),
            "bearing_deg": grid_b.ravel(),
            "distance_sd_mm": 1000 * bound[0].ravel(),
            "bearing_sd_deg": np.degrees(bound[1]).ravel(),
        }
    )


def draw_bounds(
    table: pd.DataFrame,
    column: str,
    config: ConvoyConfig,
    ax: Axes,
    *,
    levels: tuple[float, ...],
    label: str,
) -> Axes:
    """Draw a column of ``bounds_map`` in steps, with the working range as a frame; hatched where it
    exceeds the last level.
    """
    grid = table.pivot(index="distance_m", columns="bearing_deg", values=column)
    values = np.where(np.isfinite(grid), grid, 1e6)
    place = (grid.columns.to_numpy(), 1000 * grid.index.to_numpy())
    shades = ax.contourf(*place, values, levels=levels, cmap="viridis", extend="min")
    ax.contourf(*place, values, levels=(levels[-1], 2e6), colors=["#e8e8e8"], hatches=["///"])
    limit = np.degrees(config.bearing_limit_rad)
    (low, high) = config.distance_m
    ax.plot(
        [-limit, limit, limit, -limit, -limit],
        [1000 * low, 1000 * low, 1000 * high, 1000 * high, 1000 * low],
        color="white",
        linewidth=2,
        path_effects=[withStroke(linewidth=4, foreground="black")],
    )
    ax.set(xlabel="bearing (°)", ylabel="distance between centres (mm)")
    assert ax.figure is not None
    ax.figure.colorbar(shades, ax=ax, label=label, ticks=levels)
    return ax


def states_by_place(config: ConvoyConfig, *, cells: int = 240) -> pd.DataFrame:
    """Return the state that a matched, noiseless robot is in, over distance (m) and bearing
    (degrees) of the working range.
    """
    grid = config.grid()
    # middles of a grid of cells
    (low, high) = config.distance_m
    limit = config.bearing_limit_rad
    distances = low + (high - low) * (np.arange(cells) + 0.5) / cells
    bearings = limit * (2 * np.arange(cells) + 1 - cells) / cells
    grid_d, grid_b = np.meshgrid(distances, bearings, indexing="ij")
    if config.sensing == "ir-raw":
        first, second = mean_pairs(distances, bearings, config.infrared)
    else:
        first = grid_d - config.middle_m
        second = grid_b
    states = [
        grid.index(float(a), float(b)) for a, b in zip(first.ravel(), second.ravel(), strict=True)
    ]
    return pd.DataFrame(
        {"distance_m": grid_d.ravel(), "bearing_deg": np.degrees(grid_b).ravel(), "state": states}
    )


def draw_states(table: pd.DataFrame, config: ConvoyConfig, ax: Axes) -> Axes:
    """Draw the tiles of ``states_by_place``, shades repeated so that neighbours differ."""
    grid = table.pivot(index="distance_m", columns="bearing_deg", values="state")
    columns = config.state_tiles[1]
    shade = np.where(grid < 0, np.nan, (grid // columns % 3) * 3 + grid % columns % 3)
    ax.pcolormesh(
        grid.columns,
        1000 * grid.index,
        shade,
        cmap="viridis",
        vmin=-1,
        vmax=9,
        shading="nearest",
        rasterized=True,
    )
    ax.set(xlabel="bearing (°)", ylabel="distance between centres (mm)")
    reached = np.unique(grid.to_numpy()[grid.to_numpy() >= 0]).size
    note(ax, f"{config.sensing}: {reached} of {np.prod(config.state_tiles)} tiles are reached")
    return ax


def cups(*robots: int) -> Callable[[mujoco.MjSpec], None]:
    """Return what furnishes a world on the planar drive with a paper cup over some robots, for
    pictures (the paper's Fig. 5).
    """

    def furnish(spec: mujoco.MjSpec) -> None:
        for number in robots:
            body = spec.body(f"robot{number}")
            for side in ("left", "right"):
                spec.geom(f"robot{number}/{side}_disc").group = 3  # wheels are under the cup
            body.add_geom(
                name=f"robot{number}/cup",
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=[TARGETS["cup"][0], CUP_HEIGHT / 2, 0],
                pos=[0, 0, CUP_HEIGHT / 2 + 0.002],
                rgba=list(CUP_GREY),
                contype=_NOBODY,
                conaffinity=0,
                mass=0,
                group=1,
            )

    return furnish


def one_robot(config: ConvoyConfig) -> pd.DataFrame:
    """Return what one robot's eight sensors read on average (100 readings) in three situations, raw
    and calibrated, in counts.

    A line each, columns ps0 … ps7; the last line is the sensors' gains.
    """
    rng = np.random.default_rng(config.seed)
    infrared = config.infrared
    gains, offsets = draw_units(rng, infrared)
    bias = calibrate(rng, infrared, offsets)
    spread = infrared.noise / np.sqrt(infrared.samples)
    lines = {}
    cup = mean_light(0.085, 0.0, infrared)
    for name, light, ambient in (
        ("free air", 0 * cup, 0.0),
        ("cup at 85 mm", cup, 0.0),
        ("cup, light from ahead", cup, 4000.0),
    ):
        left = [headroom(k, 1.0, 0.0, ambient, 1.0, 0.0) for k in range(SENSORS)]
        noise = rng.standard_normal((100, SENSORS))
        raw = np.array(
            [
                [
                    raw_reading(light[k], gains[k], offsets[k], left[k], z[k], spread)
                    for k in range(SENSORS)
                ]
                for z in noise
            ]
        )
        lines[name] = raw.mean(axis=0)
        lines[f"{name}, calibrated"] = np.maximum(raw - bias, 0.0).mean(axis=0)
    lines["gain"] = gains
    return pd.DataFrame(lines, index=[f"ps{k}" for k in range(SENSORS)]).T


def shift_by_gains(config: ConvoyConfig, robots: int) -> dict[str, float]:
    """Return by how much unmatched gains shift a target seen straight ahead at d*, standard
    deviations in mm and degrees.
    """
    gains = np.exp(
        config.infrared.gain_spread * np.random.default_rng(0).standard_normal((robots, 2))
    )
    left, right = front_pair(config.middle_m, 0.0, config.infrared)
    table = inversion_table(config.infrared)
    seen = np.array([invert(table, a * left, b * right) for a, b in gains])
    return {
        "distance_mm": 1000 * float(seen[:, 0].std()),
        "bearing_deg": float(np.degrees(seen[:, 1].std())),
    }
