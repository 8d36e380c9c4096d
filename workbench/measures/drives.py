"""How the simulated robot and its leader move: drives beside each other and beside exact rolling,
and the leader on its line.

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
from workbench.robot.geometry import BODY_RADIUS, CONTROL_PERIOD
from workbench.robot.motors import motor_speed, twist

_TICK = 0.02  # s, the time step that all drives can show
_FINDING = 20  # control periods in which the leader finds the line


def drive_path(drive: str, left: int, right: int, seconds: float) -> pd.DataFrame:
    """Return the path of one robot that starts at rest at the origin, heading along x, every 20 ms.

    Args:
        drive: one of ``drives.table.DRIVES``.
        left, right: commands in whole steps/s, given at time 0.
        seconds: how long.

    Returns:
        Columns t_s, x_m, y_m, heading_rad.
    """
    world = _alone(drive)
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


# what a drive may differ by from wheels, set before rolling was first run: unit, margin
MARGINS = {
    "straight, way in 0.1 s": ("mm", 0.1),
    "straight, way in 1 s": ("mm", 0.3),
    "spin, angle in 1 s": ("°", 0.5),
    "arc of 3 s, place": ("mm", 1.5),
    "arc of 3 s, heading": ("°", 0.5),
    "bump head-on, pushed in 3 s": ("mm", 5.0),
    "bump head-on, overlap": ("mm", 1.0),
    "bump 20 mm aside, pushed in 3 s": ("mm", 5.0),
}
EXACT = "exact rolling"


def fidelity() -> pd.DataFrame:
    """Return how far every drive, and exact rolling, is from wheels: a line a manoeuvre of MARGINS.

    Returns:
        Columns unit, margin, wheels (what wheels did), and differences by drive, NaN for what
        exact rolling does not know.
    """
    did = {drive: _manoeuvres(drive) for drive in (*DRIVES, EXACT)}
    wheels = did["wheels"]
    lines = []
    for name, (unit, margin) in MARGINS.items():
        line = {"manoeuvre": name, "unit": unit, "margin": margin, "wheels": abs(wheels[name])}
        for drive, values in did.items():
            if drive != "wheels":
                apart = values[name] - wheels[name]
                # two places differ by a distance, and a way by more or less
                line[drive] = abs(apart) if isinstance(apart, complex) else apart
        lines.append(line)
    return pd.DataFrame(lines).set_index("manoeuvre")


def _manoeuvres(drive: str) -> dict[str, float | complex]:
    """Return what a drive does in every manoeuvre of MARGINS; places are complex numbers."""

    def path(left: int, right: int, seconds: float) -> pd.DataFrame:
        if drive == EXACT:
            return exact_rolling(left, right, seconds)
        return drive_path(drive, left, right, seconds)

    straight = 1000 * path(466, 466, 1.0)["x_m"]
    arc = path(300, 500, 3.0).iloc[-1]
    values = (
        float(straight[round(0.1 / _TICK)]),
        float(straight.iloc[-1]),
        math.degrees(path(-300, 300, 1.0)["heading_rad"].iloc[-1]),
        1000 * complex(arc["x_m"], arc["y_m"]),
        math.degrees(arc["heading_rad"]),
    )
    bumps = (math.nan,) * 3 if drive == EXACT else (*_bump(drive, 0.0), _bump(drive, 0.02)[0])
    return dict(zip(MARGINS, (*values, *bumps), strict=True))


def _bump(drive: str, aside_m: float) -> tuple[float, float]:
    """Return by how many mm a robot pushes one that stands in its way, 0.17 m ahead, in 3 s, and by
    how many mm they overlap at most.
    """
    world = _alone(drive, robots=2)
    world.place(0, 0, 0.17, aside_m, 0.0)
    world.place(0, 1, 0.0, 0.0, 0.0)
    for _ in range(5):
        world.step()
    begun = np.array(world.pose(0, 0)[:2])
    world.command(0, 1, 466, 466)
    nearest = math.inf
    for _ in range(round(3.0 / _TICK)):
        world.batch.step(nstep=round(_TICK / DRIVES[drive].timestep_s))
        nearest = min(nearest, math.dist(world.pose(0, 0)[:2], world.pose(0, 1)[:2]))
    pushed = math.dist(begun, world.pose(0, 0)[:2])
    return 1000 * pushed, 1000 * max(2 * BODY_RADIUS - nearest, 0.0)


def _alone(drive: str, robots: int = 1) -> World:
    """Return a world of one formation on a track that matters to nobody."""
    track = make_track(TrackConfig(judder="none"), np.random.default_rng(0))
    return World(robots - 1, [track], drive=drive, spacing_m=0.15)


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


def fit_rolling(periods: int = 4000, seed: int = 0) -> dict[str, float]:
    """Return the constants of the drive "rolling" as two least squares over one robot on wheels
    find them, at random commands of 7×7 levels from 233 to 699 steps/s.

    Returns:
        speed_gain, turn_gain; speed_lag, turn_lag in s; and the RMS of what is left per control
        period, rest_mm and rest_deg.
    """
    world = _alone("wheels")
    levels = np.linspace(233, 699, 7).round().astype(int)
    commands = np.random.default_rng(seed).choice(levels, (periods, 2))
    poses = np.zeros((periods + 1, 3))
    for k, (left, right) in enumerate(commands):
        poses[k] = world.pose(0, 0)
        world.command(0, 0, int(left), int(right))
        world.step()
    poses[-1] = world.pose(0, 0)
    turned = np.angle(np.exp(1j * np.diff(poses[:, 2])))
    step = np.diff(poses[:, :2], axis=0)
    heading = poses[:-1, 2] + turned / 2
    chord = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
    driven = chord / (1 - (turned / 2) ** 2 / 6)
    meant = np.array([twist(motor_speed(int(a)), motor_speed(int(b))) for a, b in commands])
    found = {}
    for name, column, went, unit in (("speed", 0, driven, 1000), ("turn", 1, turned, 180 / np.pi)):
        now = meant[1:, column]
        inputs = np.column_stack([CONTROL_PERIOD * now, -np.diff(meant[:, column])])
        (gain, lag), *_ = np.linalg.lstsq(inputs, went[1:], rcond=None)
        rest = went[1:] - inputs @ [gain, lag]
        found[f"{name}_gain"], found[f"{name}_lag"] = float(gain), float(lag)
        kind = "mm" if column == 0 else "deg"
        found[f"rest_{kind}"] = float(unit * np.sqrt(np.mean(rest**2)))
    return found
