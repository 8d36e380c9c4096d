"""How the simulated robot and its leader move: paths at constant commands beside exact rolling, and
the leader on its line.

>>> path = drive_path("planar", 466, 466, 1.0)
>>> exact = exact_rolling(466, 466, 1.0)
>>> [round(1000 * float(there["x_m"].iloc[-1]), 1) for there in (path, exact)]
[61.2, 61.3]
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from workbench.arena.drives.table import DRIVES
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.robot.motors import motor_speed, twist

_TICK = 0.02  # s, the time step that both drives can show
_FINDING = 20  # control periods in which the leader finds the line


def drive_path(drive: str, left: int, right: int, seconds: float) -> pd.DataFrame:
    """Return the path of one robot that starts at rest at the origin, heading along x, every 20 ms.

    Args:
        drive: "wheels" or "planar".
        left, right: commands in whole steps/s, given at time 0.
        seconds: how long.

    Returns:
        Columns t_s, x_m, y_m, heading_rad.
    """
    track = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
    world = World(0, [track], drive=drive, spacing_m=0.15)
    world.place(0, 0, 0.0, 0.0, 0.0)
    for _ in range(5):  # come to rest on the wheels
        world.step()
    x0, y0, heading0 = world.pose(0, 0)
    world.command(0, 0, left, right)
    rows = [(0.0, 0.0, 0.0, 0.0)]
    for tick in range(1, round(seconds / _TICK) + 1):
        world.batch.step(nstep=round(_TICK / DRIVES[drive].timestep_s))
        x, y, heading = world.pose(0, 0)
        turned = rows[-1][3] + math.remainder(heading - heading0 - rows[-1][3], 2 * math.pi)
        rows.append((tick * _TICK, x - x0, y - y0, turned))
    return pd.DataFrame(rows, columns=["t_s", "x_m", "y_m", "heading_rad"])


def exact_rolling(left: int, right: int, seconds: float) -> pd.DataFrame:
    """Return the path of wheels that turn at the motors' speeds at once and never slip; as
    ``drive_path``.
    """
    speed, turn = twist(motor_speed(left), motor_speed(right))
    t = np.arange(round(seconds / _TICK) + 1) * _TICK
    angle = turn * t
    if turn == 0.0:
        x, y = speed * t, np.zeros_like(t)
    else:
        x, y = speed / turn * np.sin(angle), speed / turn * (1 - np.cos(angle))
    return pd.DataFrame({"t_s": t, "x_m": x, "y_m": y, "heading_rad": angle})


def fidelity() -> pd.DataFrame:
    """Return how far both drives are from exact rolling, one line per manoeuvre.

    Lines are relative errors of distance or angle in percent, or the place (mm) and heading
    (degrees) at the end of an arc.
    """
    lines = []
    for drive in DRIVES:
        straight = drive_path(drive, 466, 466, 1.0)
        exact = exact_rolling(466, 466, 1.0)
        for seconds in (0.1, 1.0):
            k = round(seconds / _TICK)
            lines.append(
                (
                    drive,
                    f"straight, first {seconds:g} s, distance in %",
                    100 * (straight["x_m"][k] / exact["x_m"][k] - 1),
                )
            )
        spin = drive_path(drive, -300, 300, 1.0)
        exact = exact_rolling(-300, 300, 1.0)
        lines.append(
            (
                drive,
                "spin of 1 s, angle in %",
                100 * (spin["heading_rad"].iloc[-1] / exact["heading_rad"].iloc[-1] - 1),
            )
        )
        arc = drive_path(drive, 300, 500, 3.0)
        exact = exact_rolling(300, 500, 3.0)
        gap = arc.iloc[-1] - exact.iloc[-1]
        lines.append((drive, "arc of 3 s, end in mm", 1000 * math.hypot(gap["x_m"], gap["y_m"])))
        lines.append((drive, "arc of 3 s, heading in °", math.degrees(gap["heading_rad"])))
    table = pd.DataFrame(lines, columns=["drive", "manoeuvre", "error"])
    return table.pivot(index="manoeuvre", columns="drive", values="error").loc[
        list(dict.fromkeys(table["manoeuvre"]))
    ]


def leader_on_the_line(
    config: ConvoyConfig, seeds: Sequence[int], *, seconds: float
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Drive the leader alone with its ground sensors, one track per seed.

    Returns:
        (summary, path): per seed the RMS and 99th percentile of its axle's distance from the
        juddered line, the largest one, and the RMS distance of line and of leader from the nominal
        loop, all in mm and without the first 2 s, as the leader starts on the loop and not on the
        line; and the first seed's driven path with columns t_s, x_m, y_m, from_line_mm,
        from_loop_mm.
    """
    convoy = Convoy(replace(config, followers=1), seeds, periods=round(seconds / 0.1))
    blocks = [np.stack([robots[:, 0] for robots in steps]) for steps in convoy.steps()]
    driven = np.concatenate(blocks, axis=1)
    lines = []
    path = pd.DataFrame()
    for b, (seed, track) in enumerate(zip(seeds, convoy.world.tracks, strict=True)):
        points = np.column_stack([driven[b]["x"], driven[b]["y"]]).astype(float)
        off = 1000 * track.deviation(points)
        loop = 1000 * track.deviation(points, nominal=True)
        away = np.abs(off[_FINDING:])
        judder = 1000 * float(np.sqrt(np.mean(track.offset**2)))
        lines.append(
            (
                seed,
                float(np.sqrt(np.mean(away**2))),
                float(np.quantile(away, 0.99)),
                float(away.max()),
                judder,
                float(loop[_FINDING:].std()),
            )
        )
        if b == 0:
            t = 0.1 * np.arange(len(points))
            path = pd.DataFrame(
                {
                    "t_s": t,
                    "x_m": points[:, 0],
                    "y_m": points[:, 1],
                    "from_line_mm": off,
                    "from_loop_mm": loop,
                }
            )
    names = ["seed", "rms_mm", "p99_mm", "largest_mm", "line_rms_mm", "leader_rms_mm"]
    return pd.DataFrame(lines, columns=names), path
