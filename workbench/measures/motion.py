"""How robots moved: one type for simulated runs, recordings and plain arrays, and the measures of
restless motion.

>>> t = np.arange(600) / 10.0
>>> circle = Motion.of_path(0.5 * np.stack([np.cos(0.12 * t), np.sin(0.12 * t)], axis=1), fs=10.0)
>>> measures = chatter(circle)
>>> round(float(measures["distance_m"][0]), 2), bool(measures["turn_rms_deg_s"][0] < 0.1)
(3.59, True)

``follow`` drives a formation with a policy or a classical law and returns its whole motion;
``as_motion`` takes a Motion, a Run (its last whole block of 250 s) or a recording: a table with the
columns time_s, robot (0 the leader, 1 behind it, …), x_m, y_m and, if there, heading_rad,
left_steps, right_steps.

Contract: a Motion is immutable; samples are evenly spaced; what is not known (commands of a bare
path) is None.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from workbench.arena.tracks import Track
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import EXPLORED
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.table import Controller, check_controller
from workbench.formation.places import track_of
from workbench.formation.reset import FOLLOW
from workbench.lab.records import sampled_blocks
from workbench.lab.runs import Run, controller_of, elsewhere, periods_of
from workbench.measures.smoothness import ldlj_vector
from workbench.robot.description import EPUCK, RobotConfig
from workbench.robot.geometry import CONTROL_PERIOD

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
WINDOW_S = 20.0  # of the windows in which jerk and turning are compared
JUMP_MPS = 0.4  # three times what an e-puck can do: it was put somewhere else (a restart)
TURNING_HZ = (
    1.0  # turning faster than this is chatter: the judder's shortest wavelength comes at 0.6 Hz
)
COLUMNS = ("time_s", "robot", "x_m", "y_m")


@dataclass(frozen=True, eq=False)
class Motion:
    """Evenly sampled motion of robots in line, the leader first.

    Attributes:
        fs: samples per second.
        position: (T, robots, 2) m.
        heading: (T, robots) rad, without jumps.
        command: (T, robots, 2) wheel commands in steps/s, left and right; None if not known.
        following: (T, robots) False while a robot drives back after a loss; True of the leader.
        explored: (T, robots) whether the command was a random action.
        track: the loop that the leader was to follow; None if not known.
        robot: what moved.
    """

    fs: float
    position: Floats
    heading: Floats
    command: Floats | None
    following: Flags
    explored: Flags
    track: Track | None = None
    robot: RobotConfig = EPUCK

    @classmethod
    def of_steps(
        cls, steps: NDArray[np.void], track: Track | None = None, robot: RobotConfig = EPUCK
    ) -> "Motion":
        """Return the motion in step records, (T, robots) of type ``formation.records.PERIOD``."""
        position = np.stack([steps["x"], steps["y"]], axis=-1).astype(np.float64)
        command = np.stack([steps["left"], steps["right"]], axis=-1).astype(np.float64)
        heading = np.unwrap(steps["heading"].astype(np.float64), axis=0)
        explored = steps["event"] & EXPLORED != 0
        return cls(
            1 / CONTROL_PERIOD,
            position,
            heading,
            command,
            steps["phase"] == FOLLOW,
            explored,
            track,
            robot,
        )

    @classmethod
    def of_path(cls, position: ArrayLike, fs: float, track: Track | None = None) -> "Motion":
        """Return the motion of paths (T, 2) or (T, robots, 2) in m; headings are the directions of
        travel.

        Raises:
            ValueError: another shape, fewer than three samples, or numbers that are not finite.
        """
        path = np.asarray(position, dtype=np.float64)
        path = path[:, None, :] if path.ndim == 2 else path
        if path.ndim != 3 or path.shape[2] != 2 or len(path) < 3:
            raise ValueError(
                f"position has shape {np.shape(position)}; expected (T, 2) or (T, robots, 2) "
                "with at least 3 samples"
            )
        if not np.all(np.isfinite(path)) or not fs > 0:
            raise ValueError(
                f"position has numbers that are not finite, or fs = {fs!r} is not above 0; "
                "cut gaps out"
            )
        velocity = np.gradient(path, axis=0, edge_order=2)
        heading = np.unwrap(np.arctan2(velocity[..., 1], velocity[..., 0]), axis=0)
        flags = np.ones(path.shape[:2], bool)
        return cls(float(fs), path, heading, None, flags, ~flags, track)

    @classmethod
    def of_table(cls, table: pd.DataFrame, track: Track | None = None) -> "Motion":
        """Return the motion in a recording, one line per time and robot.

        Raises:
            ValueError: a column is missing, or robots are not recorded at the same, evenly spaced
                times.
        """
        times, robots = _check_table(table)
        ordered = table.set_index(["time_s", "robot"]).reindex(
            pd.MultiIndex.from_product([times, robots])
        )

        def column(name: str) -> Floats:
            values: Floats = ordered[name].to_numpy(np.float64).reshape(times.size, len(robots))
            return values

        path = np.stack([column("x_m"), column("y_m")], axis=-1)
        motion = cls.of_path(path, (times.size - 1) / float(times[-1] - times[0]), track)
        known = {"left_steps", "right_steps"} <= set(table)
        command = (
            np.stack([column("left_steps"), column("right_steps")], axis=-1) if known else None
        )
        heading = (
            np.unwrap(column("heading_rad"), axis=0) if "heading_rad" in table else motion.heading
        )
        return cls(motion.fs, path, heading, command, motion.following, motion.explored, track)

    def gaps_m(self) -> Floats:
        """Return the free distance between every pair of robots' bodies, (T, pairs) in m; negative
        where they touch.
        """
        first, second = np.triu_indices(self.position.shape[1], k=1)
        apart = np.linalg.norm(self.position[:, first] - self.position[:, second], axis=-1)
        free: Floats = apart - 2 * self.robot.body_radius_m
        return free

    def errors(self) -> tuple[Floats, Floats]:
        """Return the true distance to the robot in front (m) and its bearing (rad), (T, robots - 1)
        each.
        """
        gap = self.position[:, :-1] - self.position[:, 1:]
        c, s = np.cos(self.heading[:, 1:]), np.sin(self.heading[:, 1:])
        bearing = np.arctan2(c * gap[..., 1] - s * gap[..., 0], c * gap[..., 0] + s * gap[..., 1])
        return np.linalg.norm(gap, axis=-1), bearing


Source: TypeAlias = Motion | Run | pd.DataFrame


def as_motion(source: Source) -> Motion:
    """Return the motion of a Motion, of a Run (its last whole block), or of a recording's table.

    Raises:
        TypeError: it is none of these; an array becomes a motion by ``Motion.of_path``.
    """
    if isinstance(source, Motion):
        return source
    if isinstance(source, Run):
        return Motion.of_steps(
            sampled_blocks(source.records)[-1][1], track_of(source.config), source.config.robot
        )
    if isinstance(source, pd.DataFrame):
        return Motion.of_table(source)
    raise TypeError(
        f"source is a {type(source).__name__}; expected a Motion, a Run or a table; for "
        "arrays: Motion.of_path(xy, fs)"
    )


def follow(
    policy: Controller | Run, config: ConvoyConfig | None = None, *, minutes: float = 20.0
) -> Motion:
    """Drive a formation greedily with a policy, or with a classical law, and return its whole
    motion. Arguments as ``evaluate``.

    Raises:
        TypeError: there is no configuration.
        ValueError: the policy or law does not fit the configuration, or minutes are not above 0.
    """
    config = elsewhere(policy, config)
    policy = controller_of(policy)
    check_controller(policy)
    policy.check(config)
    driver = policy if isinstance(policy, ControlLaw) else policy.theta
    periods = max(3, periods_of(minutes))
    convoy = Convoy(config, [config.seed], periods=periods, policy=driver, threads=1)
    return Motion.of_steps(convoy.whole(), convoy.world.tracks[0], config.robot)


def chatter(source: Source) -> pd.DataFrame:
    """Return how restlessly each robot moves, one line per robot.

    Jerk and turning are what an onlooker sees: driving back after a loss is part of them. Windows
    in which a robot was put somewhere else (a restart of the simulation) are left out. Compare
    motions of one sampling rate only.

    Columns:
        robot, distance_m: the robot's place in line and how far it drove.
        ldlj_vector: mean log dimensionless jerk of its velocity over windows of 20 s; larger is
            smoother. NaN below 20 s.
        turn_rms_deg_s: RMS turning rate above 1 Hz, over the same windows. NaN where sampling is
            too slow to tell (4 Hz or less).
        variation_mm_s_per_m: Σ|Δ command| of both wheels per metre, while following.
        switches_per_m: changes of the command per metre, while following.
        policy_switches_per_m: the same between commands of which neither was a random action: the
            policy's own.
    """
    motion = as_motion(source)
    lines = []
    for robot in range(motion.position.shape[1]):
        path = motion.position[:, robot]
        turn = np.diff(motion.heading[:, robot]) * motion.fs
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        jumps = steps > JUMP_MPS * motion.robot.most_mps / EPUCK.most_mps / motion.fs
        steps = np.where(jumps, 0.0, steps)
        line: dict[str, Any] = {"robot": robot, "distance_m": float(steps.sum())}
        line |= _windows(np.diff(path, axis=0) * motion.fs, turn, jumps, motion.fs)
        if motion.command is not None:
            together = motion.following[1:, robot] & motion.following[:-1, robot]
            line |= _switching(motion, robot, steps, together)
        lines.append(line)
    return pd.DataFrame(lines)


def _windows(velocity: Floats, turn: Floats, jumps: Flags, fs: float) -> dict[str, float]:
    whole = round(WINDOW_S * fs)
    length = min(whole, len(velocity))
    jerks = []
    powers = []
    for start in range(0, len(velocity) - length + 1, length):
        if np.any(jumps[start : start + length]):
            continue
        part = velocity[start : start + length]
        if length == whole and np.any(part):  # a robot that stands still has no smoothness
            jerks.append(ldlj_vector(part, fs))
        frequency, power = signal.periodogram(turn[start : start + length], fs, detrend=False)
        powers.append(float(power[frequency > TURNING_HZ].sum() * (frequency[1] - frequency[0])))
    return {
        "ldlj_vector": float(np.mean(jerks)) if jerks else np.nan,
        "turn_rms_deg_s": float(np.degrees(np.sqrt(np.mean(powers))))
        if powers and fs > 4 * TURNING_HZ
        else np.nan,
    }


def _switching(motion: Motion, robot: int, steps: Floats, together: Flags) -> dict[str, float]:
    assert motion.command is not None
    command = motion.command[:, robot]
    explored = motion.explored[:, robot]
    change = np.abs(np.diff(command, axis=0)).sum(axis=1)
    own = together & ~explored[1:] & ~explored[:-1]
    way = float(steps[together].sum())
    own_way = float(steps[own].sum())
    return {
        "variation_mm_s_per_m": 1000 * motion.robot.step_m * float(change[together].sum()) / way
        if way
        else np.nan,
        "switches_per_m": float(np.count_nonzero(change[together])) / way if way else np.nan,
        "policy_switches_per_m": float(np.count_nonzero(change[own])) / own_way
        if own_way
        else np.nan,
    }


def _check_table(table: pd.DataFrame) -> tuple[Floats, NDArray[np.int64]]:
    """Return the times in s and the robots of a recording; refuse one with gaps."""
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise ValueError(
            f"the recording lacks {', '.join(missing)}; it has {', '.join(map(str, table))}"
        )
    robots = np.arange(table["robot"].nunique())
    if set(table["robot"]) != set(robots.tolist()):
        found = ", ".join(map(str, pd.unique(table["robot"])))
        raise ValueError(
            f"robots are {found}; expected 0 for the leader, 1 for the robot behind it, and so on"
        )
    used = [
        *COLUMNS,
        *(name for name in ("heading_rad", "left_steps", "right_steps") if name in table),
    ]
    finite = np.isfinite(table[used].to_numpy(np.float64))
    if not finite.all():
        row, place = np.argwhere(~finite)[0]
        raise ValueError(
            f"the recording has no number in row {row}, column {used[place]}; cut gaps out"
        )
    times = np.sort(table["time_s"].unique())
    if len(table) != times.size * len(robots) or table.duplicated(["time_s", "robot"]).any():
        raise ValueError(
            f"{len(table)} lines for {times.size} times and {len(robots)} robots; "
            "expected one of each"
        )
    if times.size < 3:
        raise ValueError(f"{times.size} times; expected at least 3")
    uneven = np.flatnonzero(
        np.abs(np.diff(times) - np.median(np.diff(times))) > 0.1 * np.median(np.diff(times))
    )
    if uneven.size:
        at = times[uneven[0]]
        raise ValueError(
            f"times are not evenly spaced: a gap after {at:g} s; resample the recording first"
        )
    return times, robots
