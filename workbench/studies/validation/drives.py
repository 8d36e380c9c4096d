"""The simulated robot beside recordings of real ones. Recordings stay where they are; only
aggregates are written.

``validate_drive`` replays the set-points of real e-puck2 robots that drove in a straight line
(Texas Tech design project, April 2025, github MarkDannemiller/ttu_dp_elisa3_python, commit d9fc889)
on one simulated robot and compares how far both went. There

* files come at two rates. At 9.25 Hz the units below hold; in the earlier files, at 3.25 Hz, the
  counters advance at a third of what was commanded, which nobody explains: they are reported apart
      and decide nothing;

* a set-point of 1 means 100 motor steps/s, although the column says rad/s;
* only ``…_position_m`` is measured (from the motors' step counters, which says nothing about slip);
* the first motion comes seconds after the first command (network). This start-up delay is found
  from the first three seconds of motion and removed: all commands take effect that much later.
      Nothing else is fitted. The link's delay may change later in a
  run; how much that explains is told by a second number, the error at the constant delay that fits
  the whole run best.

The workbench's motors follow the firmware of the e-puck1, whose timer makes other speeds of the
same command than the e-puck2's; the replay is done with both rules.

Contract: nothing here feeds back into the simulator.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from workbench import paths
from workbench.arena.drives.table import DRIVES
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World
from workbench.lab.storage import write_json, write_table
from workbench.robot.description import EPUCK
from workbench.robot.motors import motor_speed, motor_speed_epuck2

Floats = NDArray[np.float64]
FOLDER = paths.DATA / "validation"
RECORDINGS = "ttu_epuck2_leader_follower"
STEPS_PER_UNIT = 100.0  # motor steps/s per unit of a set-point
ROBOTS = ("leader", "follower", "second_follower")
TOO_FAST_MPS = 0.3  # twice what the robot can do: a reading that implies it is a transmission error
MOVED_M = 0.002
# s of motion that fix the delay; delays tried; their spacing
START_S = 3.0
SEARCH_S = 6.0
SEARCH_STEP_S = 0.02
# s between rows: what tells the two kinds of log apart, and where rows are missing
SLOW_LOG_S = 0.2
GAP_S = 0.5
WINDOW_S = 1.0
RULES: dict[str, Callable[[int], float]] = {"e-puck1": motor_speed, "e-puck2": motor_speed_epuck2}


def validate_drive(*, out: Path | None = None) -> dict[str, Any]:
    """Replay all recordings that hold set-points, write drive.csv and drive.json, and return the
    aggregates.

    Args:
        out: folder of the aggregates, default data/validation/.

    Raises:
        FileNotFoundError: WORKBENCH_RECORDINGS or the recordings in it are missing.
    """
    source = paths.recordings() / RECORDINGS
    files = sorted(source.glob("epuck-exp-*.csv"))
    if not files:
        raise FileNotFoundError(
            f"{source} holds no epuck-exp-*.csv; expected the recordings of straight drives there"
        )
    lines = [line for file in files for line in _compare_file(file)]
    if not lines:
        raise FileNotFoundError(
            f"no file in {source} has set-points, positions and a robot that moves; expected "
            f"columns {ROBOTS[0]}_…"
        )
    table = pd.DataFrame(lines)
    folder = out or FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    summary = _aggregate(table)
    write_table(folder / "drive.csv", table, digits=6)
    write_json(
        folder / "drive.json",
        {
            "what": "real e-puck2 against the simulated robot at the same set-points, "
            "straight drives; start-up delay removed",
            "source": "github MarkDannemiller/ttu_dp_elisa3_python, commit "
            "d9fc88959c9105d374a713e42aa1b4d27e8dce4f, test-data",
            "files_with_set_points": int(table["file"].nunique()),
            "robot_runs": int(len(table) // (len(RULES) * len(DRIVES))),
            "steps_per_s_per_unit": STEPS_PER_UNIT,
            "window_s": WINDOW_S,
            "aggregates": summary,
        },
    )
    return {"aggregates": summary, "written": ["drive.csv", "drive.json"]}


def replay(drive: str, rule: str, times_s: Floats, commands: Floats) -> Floats:
    """Return how far (m) one simulated robot has driven straight, at every time step of the drive
    from time 0 on.

    Args:
        drive: one of ``drives.table.DRIVES``.
        rule: whose firmware makes a speed of a command, one of RULES.
        times_s, commands: (K,) when each command begins, rising from 0 or later, and the command of
            both wheels in steps/s; it holds until the next. The replay ends with the last time.
    """
    world = World(
        0,
        [make_track(TrackConfig(judder="none"), np.random.default_rng(0))],
        drive=drive,
        spacing_m=0.15,
    )
    world.place(0, 0, 0.0, 0.0, 0.0)
    begin = np.round(times_s / DRIVES[drive].timestep_s).astype(int)
    scale = DRIVES[drive].per_step(EPUCK)
    speeds = np.array([RULES[rule](round(command)) for command in commands]) * scale
    driven = np.zeros(begin[-1] + 1)
    active = np.searchsorted(begin, np.arange(driven.size), side="right") - 1
    for tick in range(driven.size):
        driven[tick] = world.pose(0, 0)[0]
        world.ctrl[0, :2] = speeds[active[tick]] if active[tick] >= 0 else 0.0
        world.batch.step(nstep=1)
    return driven


def _compare_drive(
    time: Floats, real: Floats, driven: Floats, timestep_s: float
) -> tuple[float, float, dict[str, float], dict[str, float]]:
    """Return the delay of the start and that of the whole drive in s, and the errors with each."""
    delay = best_delay(time, real, driven, timestep_s, seconds=START_S)
    whole = best_delay(time, real, driven, timestep_s)
    errors, fitted = (
        _errors(time, real, shifted(driven, timestep_s, time, late)) for late in (delay, whole)
    )
    return delay, whole, errors, fitted


def _compare_file(path: Path) -> list[dict[str, Any]]:
    frame = pd.read_csv(path)
    lines = []
    for robot in ROBOTS:
        kinds = ("left_setpoint_radps", "right_setpoint_radps", "position_m")
        names = [f"{robot}_{kind}" for kind in kinds]
        if "timestamp_s" not in frame or not set(names) <= set(frame.columns):
            continue
        time, left, right, position = (
            frame[name].to_numpy(float) for name in ("timestamp_s", *names)
        )
        if not np.allclose(left, right):
            raise ValueError(f"{path.name}: {robot} steers; this comparison is for straight drives")
        good = _plausible(time, position)
        gap = float(np.diff(time).max())
        slow = float(np.median(np.diff(time))) > SLOW_LOG_S
        log = "3 Hz" if slow else ("9 Hz, with gaps" if gap > GAP_S else "9 Hz")
        real = position[good] - position[good][0]
        if not np.any(left) or np.abs(real).max() <= MOVED_M:
            continue  # never commanded, or never moved
        label = {"file": path.stem, "robot": robot, "log": log, "longest_gap_s": gap}
        label |= {"set_points": "constant" if np.ptp(left) == 0 else "changing"}
        counts = {"rows": int(good.sum()), "rows_dropped": int((~good).sum())}
        for drive in DRIVES:
            for rule in RULES:
                driven = replay(drive, rule, time, left * STEPS_PER_UNIT)
                found = _compare_drive(time[good], real, driven, DRIVES[drive].timestep_s)
                delay, whole, errors, fitted = found
                lines.append(
                    label
                    | {"drive": drive, "firmware": rule}
                    | counts
                    | {
                        "start_up_delay_s": delay,
                        "mean_command_steps_s": float(np.abs(left).mean() * STEPS_PER_UNIT),
                    }
                    | errors
                    | {"best_delay_s": whole, "rms_error_at_best_delay_mm": fitted["rms_error_mm"]}
                )
    return lines


def shifted(driven_m: Floats, step_s: float, time_s: Floats, delay_s: float) -> Floats:
    """Return a replay at times ``time_s`` if all its commands had taken effect ``delay_s``
    later.
    """
    return np.interp(time_s - delay_s, np.arange(driven_m.size) * step_s, driven_m)


def best_delay(
    time_s: Floats, real_m: Floats, driven_m: Floats, step_s: float, *, seconds: float = math.inf
) -> float:
    """Return the delay (s) at which a replay is closest to a recording, in its first ``seconds`` of
    motion or as a whole.
    """
    moving = time_s[np.argmax(np.abs(real_m) > MOVED_M)]
    near = time_s <= moving + seconds
    delays = np.arange(0.0, moving + SEARCH_S, SEARCH_STEP_S)
    misfit = [
        np.mean((shifted(driven_m, step_s, time_s[near], delay) - real_m[near]) ** 2)
        for delay in delays
    ]
    return float(delays[int(np.argmin(misfit))])


def _plausible(time_s: Floats, position_m: Floats) -> NDArray[np.bool_]:
    """Return which rows hold a position that the robot can have reached from the last plausible
    one.
    """
    good = np.zeros(len(time_s), bool)
    good[0] = True
    last = 0
    for k in range(1, len(time_s)):
        good[k] = (
            abs(position_m[k] - position_m[last])
            <= TOO_FAST_MPS * (time_s[k] - time_s[last]) + MOVED_M
        )
        if good[k]:
            last = k
    return good


def _errors(time_s: Floats, real_m: Floats, simulated_m: Floats) -> dict[str, float]:
    error = 1000 * (simulated_m - real_m)
    ends = np.searchsorted(time_s, time_s + WINDOW_S)
    inside = ends < len(time_s)
    begin = np.flatnonzero(inside)
    end = ends[inside]
    per_window = error[end] - error[begin]
    travelled = float(np.abs(np.diff(real_m)).sum())
    return {
        "travelled_m": travelled,
        "distance_ratio": float(np.abs(np.diff(simulated_m)).sum() / travelled),
        "rms_error_mm": float(np.sqrt(np.mean(error**2))),
        "largest_error_mm": float(np.abs(error).max()),
        "rms_error_1s_mm": float(np.sqrt(np.mean(per_window**2))),
    }


def _aggregate(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return medians and ranges over robot-runs, per kind of log and of set-points, drive and
    firmware rule.
    """
    lines = []
    keys = ["log", "set_points", "drive", "firmware"]
    for names, part in table.groupby(keys):
        numbers: dict[str, Any] = dict(zip(keys, names, strict=True)) | {"robot_runs": len(part)}
        for name in (
            "start_up_delay_s",
            "distance_ratio",
            "rms_error_mm",
            "rms_error_1s_mm",
            "rms_error_at_best_delay_mm",
        ):
            values = part[name]
            numbers[name] = {
                "median": values.median(),
                "lowest": values.min(),
                "highest": values.max(),
            }
        lines.append(numbers)
    return lines
