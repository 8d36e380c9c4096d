"""Recordings: what a robot read and was told, period by period, as a CSV with a JSON file beside
it.

    t_s                                seconds since the first row, strictly rising
    ps0 … ps7, light0 … light7         proximity and ambient light in counts
    gs_left, gs_centre, gs_right       ground sensors in counts
    left_steps, right_steps            step counters
    left_command, right_command        steps/s, sent after the readings of the row
    state, action, probability         the learner's cell and action at that moment (-1: none) and
                                       the action's probability
    phase                              of the follower, see ``formation.reset`` (0: following)
    x_m, y_m, heading_rad, …_ahead     poses of the robot and of the one in front, where there is a
                                       camera

The sidecar (same name, .json) says schema, robot, link, whether the robot is real, units,
calibration, configuration, and, once closed, rows and sha256. Every row is one write and goes to
the disk within a second: a killed recorder leaves a file that can be read, but for a last line that
the loader drops and reports.

>>> _expected_columns({"proximity"}, poses=False)[:3], _expected_columns(set(), poses=False)
(['t_s', 'ps0', 'ps1'], ['t_s', 'left_command', 'right_command', 'state', 'action', 'probability',
'phase'])

Contract: a recording is only ever appended to by its recorder and never changed. Tables without
time are no recordings.
"""

import hashlib
import io
import math
import os
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pandas as pd

from workbench import fields
from workbench.formation.config import ConvoyConfig
from workbench.formation.reset import PHASES
from workbench.formation.solo import SoloFollower
from workbench.lab.storage import read_json, write_json
from workbench.robot.api import Robot
from workbench.robot.geometry import CONTROL_PERIOD, MAX_STEPS_EPUCK2

SCHEMA = 1
GROUPS = {  # sensor: columns, unit, lowest and highest value
    "proximity": ([f"ps{k}" for k in range(8)], "counts", 0, 4095),
    "light": ([f"light{k}" for k in range(8)], "counts", 0, 4095),
    "floor": (["gs_left", "gs_centre", "gs_right"], "counts", 0, 4095),
    "motor_position": (["left_steps", "right_steps"], "motor steps", -(2**53), 2**53),
    "gyroscope": (["gyro_x", "gyro_y", "gyro_z"], "counts", -(2**15), 2**15 - 1),
    "distance": (["distance_mm"], "mm", 0, 2**16 - 1),
    "age": (["age_s"], "s", 0, 10),
}
DONE = {  # what was done in a row: unit, lowest and highest value
    "left_command": ("steps/s", -1100, 1100),
    "right_command": ("steps/s", -1100, 1100),
    "state": ("cell, -1: none", -1, 2**31),
    "action": ("index, -1: none", -1, 2**31),
    "probability": ("", 0, 1),
    "phase": ("index", 0, len(PHASES) - 1),
}
POSES = [f"{name}{who}" for who in ("", "_ahead") for name in ("x_m", "y_m", "heading_rad")]
WHOLE = ("left_command", "right_command", "state", "action", "phase")
GAP_S = 1.0  # s between two rows that count as a gap


def _expected_columns(sensors: set[str], *, poses: bool) -> list[str]:
    columns = ["t_s"]
    for sensor, (names, *_) in GROUPS.items():
        columns += names if sensor in sensors else []
    return columns + list(DONE) + (POSES if poses else [])


class Recorder:
    """Append rows to a recording.

    Args:
        path: the CSV; must not exist yet.
        robot: whose enabled sensors are recorded.
        link: how the robot is connected, for example its URL.
        real: whether the robot is a real one; simulated and emulated ones are not.
        config: of the follower that drives.
        calibration: what is known about the sensors' zero.
        poses: whether rows come with poses.
        note: anything a reader should know.

    Raises:
        FileExistsError: there is something at path already.
    """

    def __init__(
        self,
        path: str | Path,
        robot: Robot,
        *,
        link: str,
        real: bool,
        config: ConvoyConfig | None = None,
        calibration: str = "none",
        poses: bool = False,
        note: str = "",
    ) -> None:
        self.path = Path(path).expanduser()
        if real and link.startswith(("sim:", "log:")):
            raise ValueError(
                f"real = {real!r} with link = {link!r}; that is no real robot: leave --real out"
            )
        if self.path.suffix != ".csv":
            raise ValueError(f"path = {str(path)!r}; expected a name that ends in .csv")
        side = self.path.with_suffix(".json")
        if self.path.exists() or side.exists():
            raise FileExistsError(
                f"{self.path} or its .json exists already; recordings are never overwritten: "
                "choose another name"
            )
        self.sensors = [sensor for sensor in GROUPS if sensor in robot.get_sensors_enabled()]
        self.columns = _expected_columns(set(self.sensors), poses=poses)
        self._poses = poses
        self._rows = 0
        self._times: list[float] = []
        self._synced = 0.0
        period = robot.period_s or CONTROL_PERIOD
        self.header: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": robot.get_sercom_version(),
            "link": link,
            "real": real,
            "rate_hz": 1 / period,
            "columns": self.columns,
            "units": {column: unit_of(column) for column in self.columns},
            "calibration": calibration,
            "config": fields.to_dict(config) if config is not None else None,
            "note": note,
            "complete": False,
            "rows": None,
            "sha256": None,
        }
        write_json(side, self.header)
        self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        self._write(",".join(self.columns))

    def add(
        self,
        t_s: float,
        robot: Robot,
        *,
        command: tuple[int, int],
        follower: SoloFollower | None = None,
        poses: Sequence[float] = (),
    ) -> None:
        """Append one row: the robot's readings, the command sent after them, and what the follower
        thought.

        Raises:
            ValueError: the number of poses is not what was announced.
        """
        if len(poses) != (len(POSES) if self._poses else 0):
            raise ValueError(
                f"{len(poses)} pose values; expected {len(POSES) if self._poses else 0}: "
                f"{', '.join(POSES)}"
            )
        row: list[float] = [t_s]
        for sensor in self.sensors:
            row += list(robot.reading(sensor))
        row += list(command)
        if follower is None:
            row += [-1, -1, 1.0, 0]
        else:
            record = follower.record
            following = record["choice"]["state"] >= 0
            row += [
                record["choice"]["state"],
                record["choice"]["action"] if following else -1,
                follower.probability,
                follower.step["phase"],
            ]
        self._write(
            ",".join(
                _text(column, value)
                for column, value in zip(self.columns, [*row, *poses], strict=True)
            )
        )
        self._rows += 1
        self._times.append(t_s)

    def watch(self, follower: SoloFollower, robot: Robot, t_s: float) -> None:
        """Record a period of ``driving.drive``; pass it as ``watch=``."""
        self.add(t_s, robot, command=robot.commanded, follower=follower)

    def close(self) -> None:
        """Complete the sidecar."""
        if self._file < 0:
            return
        os.fsync(self._file)
        os.close(self._file)
        self._file = -1
        self.header |= {"complete": True, "rows": self._rows, "sha256": _sha256(self.path)}
        if self._rows > 1:  # as it was, beside the wanted rate
            intervals = np.diff(self._times)
            self.header["measured_rate_hz"] = float(1 / np.median(intervals))
            self.header["longest_interval_s"] = float(intervals.max())
        write_json(self.path.with_suffix(".json"), self.header)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _write(self, line: str) -> None:
        data = (line + "\n").encode()
        while data:
            data = data[os.write(self._file, data) :]
        if time.monotonic() - self._synced > 1.0:
            os.fsync(self._file)
            self._synced = time.monotonic()


@dataclass(frozen=True, eq=False)
class Recording:
    """A checked recording.

    Attributes:
        frame: one row per control period, columns as in the module's docstring.
        header: the sidecar.
        truncated: whether a last, half-written line was dropped.
    """

    frame: pd.DataFrame
    header: dict[str, Any]
    truncated: bool

    @property
    def config(self) -> ConvoyConfig | None:
        """The configuration of the follower that drove, if there was one."""
        stored = self.header["config"]
        return fields.from_dict(ConvoyConfig, stored) if stored is not None else None

    @property
    def sensors(self) -> list[str]:
        """Names of the recorded sensors, as in the robot API."""
        return [sensor for sensor, (names, *_) in GROUPS.items() if names[0] in self.frame]

    def summary(self) -> dict[str, Any]:
        """Return rows, duration, rate and what it is, as plain values."""
        intervals = np.diff(self.frame["t_s"]) if len(self.frame) > 1 else np.array([np.nan])
        return {
            "rows": len(self.frame),
            "duration_s": float(self.frame["t_s"].iloc[-1]) if len(self.frame) else 0.0,
            "rate_hz": float(1 / np.median(intervals)),
            "longest_interval_s": float(np.max(intervals)),
            "gaps": int(np.count_nonzero(intervals > GAP_S)),
            "robot": self.header["robot"],
            "link": self.header["link"],
            "real": self.header["real"],
            "complete": self.header["complete"],
            "truncated": self.truncated,
            "sensors": self.sensors,
        }


def load_recording(path: str | Path, *, gap_s: float = math.inf) -> Recording:
    """Load and check a recording.

    Rate and gaps are as they are: ``Recording.summary`` tells them.

    Args:
        path: its CSV.
        gap_s: longest interval between two rows, where longer ones are to be refused.

    Raises:
        FileNotFoundError: the CSV or its sidecar is missing.
        ValueError: the first thing that is wrong, by row (1 is the first after the header) and
            column.
    """
    place = Path(path).expanduser()
    if place.suffix != ".csv" or place.is_dir():
        raise ValueError(f"{place} is no recording; expected a file that ends in .csv")
    if not place.is_file() and not place.with_suffix(".json").is_file():
        raise FileNotFoundError(f"{place} does not exist; expected the .csv of a recording")
    if not place.with_suffix(".json").is_file():
        raise FileNotFoundError(
            f"{place} has no sidecar ({place.stem}.json), so that nobody knows its units and its "
            f"robot; a log of your own becomes a recording by: python -m workbench import {place}"
        )
    header = _read_sidecar(place)
    most = _most_steps(place, header)
    content = place.read_bytes() if place.is_file() else b""  # killed before the first byte
    if header["complete"] and header.get("sha256") != hashlib.sha256(content).hexdigest():
        raise ValueError(
            f"{place} is not what its sidecar's sha256 says: it was changed (line ends, "
            "perhaps) or cut after it was recorded"
        )
    end = content.rfind(b"\n") + 1
    rest = content[end:]  # of a killed recorder
    whole = content[:end] if rest else content
    if not whole and not header["complete"]:
        return Recording(pd.DataFrame(columns=header["columns"], dtype=float), header, bool(rest))
    first = whole[: max(0, whole.find(b"\n"))].decode("utf-8", "replace")
    if first.split(",") != header["columns"]:
        raise ValueError(
            f"{place}, row 0: columns {[first]}; expected {','.join(header['columns'])}"
        )
    frame = _table(place, whole, header["columns"])
    _check(place, frame, gap_s, most)
    for column in WHOLE:
        if column in frame:
            frame[column] = frame[column].astype(np.int64)
    return Recording(frame, header, bool(rest))


def _read_sidecar(place: Path) -> dict[str, Any]:
    """Return the sidecar of a recording."""
    header = read_json(place.with_suffix(".json"))
    if not isinstance(header, dict) or header.get("schema") != SCHEMA:
        raise ValueError(f"{place.with_suffix('.json')} is no sidecar of schema {SCHEMA}")
    lacking = [
        key
        for key in ("columns", "rate_hz", "complete", "config", "robot", "link", "real")
        if key not in header
    ]
    if lacking:
        raise ValueError(f"{place.with_suffix('.json')} lacks {', '.join(lacking)}")
    rate = header["rate_hz"]
    if isinstance(rate, bool) or not isinstance(rate, (int, float)) or not 0 < rate < 1e6:
        raise ValueError(
            f"{place.with_suffix('.json')}: rate_hz = {rate!r}; expected rows per second"
        )
    if header["complete"] and not place.is_file():
        raise FileNotFoundError(
            f"{place} does not exist, though its sidecar says that it is complete; restore it"
        )
    return header


def _most_steps(place: Path, header: dict[str, Any]) -> int:
    """Return the fastest speed that a wheel of the recorded robot can have, steps/s."""
    most = MAX_STEPS_EPUCK2
    if header["config"] is not None:
        try:
            most = max(most, fields.from_dict(ConvoyConfig, header["config"]).robot.most_steps)
        except (TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{place.with_suffix('.json')}: config: {error}") from None
    return most


def _table(place: Path, whole: bytes, columns: list[str]) -> pd.DataFrame:
    """Return the rows as numbers: at once, or one by one where that fails, to name the first cell
    that is wrong.
    """
    if len(set(columns)) < len(columns):
        twice = sorted({name for name in columns if columns.count(name) > 1})
        raise ValueError(f"{place}: columns {twice} occur more than once; expected each once")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                io.BytesIO(whole),
                names=columns,
                header=None,
                skiprows=1,
                index_col=False,
                skip_blank_lines=False,
            ).astype(np.float64)
        if not frame.isna().to_numpy().any():
            return frame
    except (ValueError, pd.errors.ParserWarning):
        pass
    lines = whole.decode("utf-8", "replace").split("\n")[1:-1]
    rows = [_parse(place, number, line, columns) for number, line in enumerate(lines, start=1)]
    return pd.DataFrame(np.array(rows, dtype=float).reshape(-1, len(columns)), columns=columns)


def _parse(place: Path, number: int, line: str, columns: list[str]) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(columns):
        raise ValueError(f"{place}, row {number}: {len(cells)} columns; expected {len(columns)}")
    row = []
    for column, cell in zip(columns, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            raise ValueError(
                f"{place}, row {number}, column {column}: {cell!r}; expected a number"
            ) from None
        row.append(value)
    return row


def _check(place: Path, frame: pd.DataFrame, gap_s: float, most: int) -> None:
    """Name the first violation, row by row; ``most`` is the fastest command that there can be,
    steps/s.
    """
    if "t_s" not in frame:
        raise ValueError(f"{place} has no column t_s; a table without time is no recording")
    values = frame.to_numpy()
    low, high = np.array([_range(column, most) for column in frame.columns]).T
    whole = [frame.columns.get_loc(column) for column in WHOLE if column in frame]
    if _all_good(values, low, high, whole, frame.columns.get_loc("t_s"), gap_s):
        return
    wrong = ~((values >= low) & (values <= high))
    wrong[:, whole] |= values[:, whole] != np.round(values[:, whole])
    t = values[:, frame.columns.get_loc("t_s")]
    step = np.diff(t, prepend=-np.inf)
    order = step <= 0
    gap = np.zeros(len(t), bool)
    gap[1:] = step[1:] > gap_s
    for row in np.flatnonzero(wrong.any(axis=1) | order | gap)[:1]:
        if wrong[row].any():
            column = frame.columns[int(np.argmax(wrong[row]))]
            a, b = _range(column, most)
            kind = "a whole number" if column in WHOLE else "a number"
            raise ValueError(
                f"{place}, row {row + 1}, column {column}: {values[row][wrong[row]][0]:g}; "
                f"expected {kind} from {a:g} to {b:g}"
            )
        if order[row]:
            raise ValueError(
                f"{place}, row {row + 1}, column t_s: {t[row]:g} after {t[row - 1]:g}; "
                "expected rising times"
            )
        raise ValueError(
            f"{place}, row {row + 1}, column t_s: {step[row]:.3g} s without a row; expected "
            f"at most {gap_s:g} s"
        )


def _all_good(values: Any, low: Any, high: Any, whole: list[int], time: int, gap_s: float) -> bool:
    """Return whether nothing is wrong anywhere: quick, but tells no place."""
    if not len(values):
        return True
    columns = values.T
    within = all(
        column.min() >= a and column.max() <= b
        for column, a, b in zip(columns, low, high, strict=True)
    )
    step = np.diff(columns[time])
    rising = bool(np.all(step > 0) and np.all(step <= gap_s))
    return within and rising and all(np.array_equal(columns[k], np.rint(columns[k])) for k in whole)


def _range(column: str, most: int) -> tuple[float, float]:
    if column in ("left_command", "right_command"):
        return -most, most
    for names, _, low, high in GROUPS.values():
        if column in names:
            return low, high
    if column in DONE:
        return DONE[column][1:]
    return (0.0, 1e9) if column == "t_s" else (-1e3, 1e3)


def unit_of(column: str) -> str:
    """Return the unit of a column."""
    for names, unit, _, _ in GROUPS.values():
        if column in names:
            return unit
    if column in DONE:
        return DONE[column][0]
    return "s" if column == "t_s" else ("rad" if column.startswith("heading") else "m")


def columns_text(table: pd.DataFrame) -> str:
    """Return a table of a recording's columns as its CSV."""
    lines = [",".join(table.columns)]
    for row in table.itertuples(index=False):
        lines.append(",".join(map(_text, table.columns, row)))
    return "\n".join(lines) + "\n"


def _text(column: str, value: float) -> str:
    return str(int(value)) if column in WHOLE else f"{float(value):.9g}"


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
