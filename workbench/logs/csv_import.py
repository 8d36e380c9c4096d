"""Anybody's own log, a CSV of any kind or a ROS 2 bag (``logs.bags``), as a recording.

    python -m workbench import mylog.csv --robot "e-puck2 4521" --map "Zeit [ms]=t_s"

What a file says by itself is taken from it and said: text encoding and byte-order mark, delimiter,
decimal comma, comments, units in a header ("left speed [mm/s]"), seconds or milliseconds or Unix
time by the size of the steps. What it does not say is asked for, all at once: which robot it was,
units of speeds and places, which column is which. Nothing is guessed in silence.

>>> _split("left speed [mm/s]"), _split("t_ms"), _split("ps0")
(('left speed', 'mm/s'), ('t', 'ms'), ('ps0', ''))

Contract: the file is only read. Errors name the option that answers them.
"""

import csv
import hashlib
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from workbench.fields import did_you_mean
from workbench.lab.storage import write_bytes, write_json
from workbench.logs.bags import is_bag, read_bag
from workbench.logs.recordings import DONE, GROUPS, POSES, SCHEMA, columns_text, unit_of
from workbench.robot.geometry import STEP, WHEEL_RADIUS

DELIMITERS = ",;\t|"
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
SPEEDS = {  # steps/s of one unit, for an e-puck's wheels
    "steps/s": 1.0,
    "mm/s": 1e-3 / STEP,
    "cm/s": 1e-2 / STEP,
    "m/s": 1.0 / STEP,
    "rad/s": WHEEL_RADIUS / STEP,
}
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ANGLES = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
KNOWN = [
    "t_s",
    *(name for names, *_ in GROUPS.values() for name in names),
    *DONE,
    *POSES,
]
OTHER_NAMES = {
    "t": "t_s",
    "time": "t_s",
    "timestamp": "t_s",
    "left command": "left_command",
    "right command": "right_command",
    "left speed": "left_command",
    "right speed": "right_command",
    "heading": "heading_rad",
    "x": "x_m",
    "y": "y_m",
}
for _word in ("prox", "prox ", "proximity ", "ir", "ir "):
    OTHER_NAMES |= {f"{_word}{k}": f"ps{k}" for k in range(8)}
FASTEST_MPS = 2.0  # of a small robot on a floor: beyond, a unit is wrong
_USUAL = {"state": -1.0, "action": -1.0, "probability": 1.0, "phase": 0.0}


def import_table(
    path: str | Path,
    *,
    robot: str | None = None,
    names: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    real: bool = False,
    commands: bool = True,
    cut: bool = False,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Write a log as a recording; return what was written and what was taken for what.

    Args:
        path: the log.
        robot: which robot it was, in words.
        names: column of the log → column of a recording (see ``logs.recordings``).
        units: column of a recording, or of the log → its unit in the log, where the header does
            not say.
        real: whether it is of a real robot.
        commands: whether the log has the commands; without, zeros are written.
        cut: whether rows that lack a number are cut out, and counted.
        out: the .csv to write; default: the log's name with "_recording".
        overwrite: whether it may exist.

    Raises:
        ValueError: what the log does not say, with the options that answer it.
    """
    place = Path(path).expanduser()
    said: list[str] = []
    if not place.exists():
        raise FileNotFoundError(f"{place} does not exist; expected a CSV file or a ROS 2 bag")
    target = Path(out).expanduser() if out else place.with_name(f"{place.stem}_recording.csv")
    if target.suffix != ".csv":
        raise ValueError(f"--out {target}: expected a name that ends in .csv")
    for one in (target, target.with_suffix(".json")):
        if one.exists() and not overwrite:
            raise FileExistsError(f"{one} exists already; add --out NAME.csv, or --overwrite")
    frame = read_bag(place, said) if is_bag(place) else _read(place, said)
    found = _columns(list(frame.columns), dict(names or {}), said)
    asked = _Asked(place)
    if robot is None:
        asked.add("does not say which robot it was", '--robot "e-puck2 4521"')
    table = _recorded(frame, found, dict(units or {}), said, asked, commands=commands)
    if cut:
        whole = np.isfinite(table.to_numpy(float)).all(axis=1)
        said.append(f"{int((~whole).sum())} rows without a number for every column cut out")
        table = table[whole].reset_index(drop=True)
    table["t_s"] -= table["t_s"].iloc[0]
    for name in ("left_command", "right_command"):
        table[name] = np.round(table[name])
    _plausible(table, place)
    return _write(target, table, place, str(robot), real, said)


def _recorded(
    frame: pd.DataFrame,
    found: dict[str, str],
    units: dict[str, str],
    said: list[str],
    asked: "_Asked",
    *,
    commands: bool,
) -> pd.DataFrame:
    """Return the columns of a recording in its units; refuse a log that leaves something open."""
    for name in ("t_s", *(("left_command", "right_command") if commands else ())):
        if name not in found:
            other = "" if name == "t_s" else ", or --no-commands if the robot was not driven"
            asked.add(f"has no column {name}", f"--map COLUMN={name}{other}")
    told = _units(units, found)
    table = pd.DataFrame()
    for name in KNOWN:
        if name in found:
            values = frame[found[name]]
            unit = told.get(name, _split(found[name])[1])
            table[name] = values.to_numpy(float) * _factor(name, unit, values, said, asked)
        elif name in DONE:
            table[name] = _USUAL.get(name, 0.0)
    asked.raise_if_any(list(frame.columns))
    return table


class _Asked:
    """What a log does not say, and the options that answer it."""

    def __init__(self, place: Path) -> None:
        self.place = place
        self.lines: list[str] = []

    def add(self, what: str, remedy: str) -> None:
        """Note something."""
        self.lines.append(f"{what}: add {remedy}")

    def raise_if_any(self, columns: list[str]) -> None:
        """Raise ValueError with all of it."""
        if self.lines:
            listed = "\n  ".join(self.lines)
            raise ValueError(f"{self.place} (columns {', '.join(columns)}) leaves open\n  {listed}")


def _units(units: dict[str, str], found: dict[str, str]) -> dict[str, str]:
    """Return units by the recording's columns, which may be named as in the log, too."""
    ours = {theirs: name for name, theirs in found.items()} | {name: name for name in found}
    for name, unit in units.items():
        if name not in ours:
            raise ValueError(
                f"--unit {name}={unit}: no column {name!r}; there are {', '.join(ours)}"
                + did_you_mean(name, ours)
            )
    return {ours[name]: unit for name, unit in units.items()}


def _plausible(table: pd.DataFrame, place: Path) -> None:
    """Refuse places and headings whose unit cannot be right."""
    seconds = np.diff(table["t_s"])
    for name in POSES:
        if name not in table or not len(seconds) or np.any(seconds <= 0):
            continue
        if name.startswith("heading") and table[name].abs().max() > 2 * math.pi + 0.1:
            raise ValueError(
                f"{place}: {name} reaches {table[name].abs().max():.4g}; radians go round once in "
                f"6.28: expected --unit {name}=deg"
            )
        moved = float(np.median(np.abs(np.diff(table[name])) / np.maximum(seconds, 1e-9)))
        if not name.startswith("heading") and moved > FASTEST_MPS:
            raise ValueError(
                f"{place}: {name} changes by {moved:.4g} m/s; no small robot is faster than "
                f"{FASTEST_MPS:g}: expected another --unit {name}=…, or another unit of time"
            )


def _read(place: Path, said: list[str]) -> pd.DataFrame:
    """Return the numbers of a log by the names in its header."""
    content = place.read_bytes()
    encoding = "utf-8-sig"
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        encoding = "latin-1"
        text = content.decode(encoding)
        said.append("text is not UTF-8: taken as Latin-1")
    lines = [line for line in text.splitlines() if line.strip()]
    comments = sum(line.lstrip().startswith("#") for line in lines)
    if comments:
        said.append(f"{comments} lines of comments left out")
        lines = [line for line in lines if not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise ValueError(f"{place} has {len(lines)} lines; expected a header and rows of numbers")
    counts = {mark: lines[0].count(mark) for mark in DELIMITERS}
    delimiter = max(counts, key=lambda mark: counts[mark])
    if not counts[delimiter]:
        raise ValueError(
            f"{place}: {lines[0][:60]!r} has none of the delimiters comma, semicolon, tab, bar"
        )
    header, *rows = csv.reader(lines, delimiter=delimiter)
    header = [name.strip() for name in header]
    if len(set(header)) < len(header):
        twice = sorted({name for name in header if header.count(name) > 1})
        raise ValueError(f"{place}: columns {twice} occur more than once; rename them first")
    comma = delimiter != "," and any(_COMMA.fullmatch(cell) for row in rows[:20] for cell in row)
    said.append(f"delimiter {delimiter!r}" + (", decimal comma" if comma else ""))
    frame = _numbers(place, header, rows, comma)
    words = [name for name in header if name not in frame]
    if words:
        said.append(f"left out, as they hold no numbers: {', '.join(words)}")
    return frame


_COMMA = re.compile(r"\s*[-+]?(\d{1,3}(\.\d{3})+|\d+),\d+\s*")  # 0,5 and 1.234,5


def _numbers(place: Path, header: list[str], rows: list[list[str]], comma: bool) -> pd.DataFrame:
    """Return a table of numbers; columns that hold words are left out."""
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise ValueError(f"{place}, row {number}: {len(row)} columns; expected {len(header)}")
    frame = pd.DataFrame(rows, columns=header)
    if comma:
        thousands = frame.apply(lambda column: column.str.fullmatch(_COMMA.pattern))
        plain = frame.apply(lambda column: column.str.replace(".", "", regex=False))
        frame = frame.where(~thousands, plain)
        frame = frame.apply(lambda column: column.str.replace(",", ".", regex=False))
    numeric = frame.apply(pd.to_numeric, errors="coerce")
    return numeric.loc[:, numeric.notna().any()]


def _columns(columns: list[str], names: dict[str, str], said: list[str]) -> dict[str, str]:
    """Return column of a recording → column of the log."""
    for theirs, ours in names.items():
        if theirs not in columns:
            raise ValueError(
                f"--map {theirs}={ours}: no column {theirs!r} of numbers; there are "
                f"{', '.join(columns)}"
            )
        if ours not in KNOWN:
            raise ValueError(
                f"--map {theirs}={ours}: a recording has no column {ours!r}; it has "
                f"{', '.join(KNOWN)}{did_you_mean(ours, KNOWN)}"
            )
    found = {ours: theirs for theirs, ours in names.items()}
    for column in columns:
        plain = _split(column)[0].lower().replace("_", " ")
        ours = column if column in KNOWN else OTHER_NAMES.get(plain, plain.replace(" ", "_"))
        if ours in KNOWN and ours not in found and column not in names:
            found[ours] = column
            if ours != column:
                said.append(f"{column!r} taken as {ours}")
    left = [column for column in columns if column not in found.values()]
    if left:
        said.append(f"left out: {', '.join(left)} (--map COLUMN=NAME takes one in)")
    return found


def _split(column: str) -> tuple[str, str]:
    """Return a header's name and its unit, "" where it has none."""
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]\s*(.*?)\s*[\])]", column)
    if bracketed:
        return bracketed[1], bracketed[2]
    behind = re.fullmatch(r"(.+)_(ms|us|ns|mm|cm|deg)", column)
    return (behind[1], behind[2]) if behind else (column, "")


def _factor(name: str, unit: str, values: pd.Series, said: list[str], asked: "_Asked") -> float:
    """Return what a column's numbers are multiplied by."""
    if name == "t_s":
        return _time_factor(unit, values, said)
    if name in ("left_command", "right_command"):
        table = SPEEDS
    elif name.startswith("heading"):
        table = ANGLES
    elif name in POSES:
        table = LENGTHS
    else:
        return 1.0
    if not unit and values.name == name:
        return 1.0  # a recording's own name says its unit
    if unit not in table:
        asked.add(
            f"column {values.name!r} has the unit {unit!r}",
            f"--unit {name}=UNIT, one of {', '.join(table)}",
        )
        return 1.0
    said.append(f"{values.name!r} in {unit}")
    return table[unit]


def _time_factor(unit: str, values: pd.Series, said: list[str]) -> float:
    """Return seconds per unit of time: by the header, or by the size of the steps."""
    if unit in TIMES:
        return TIMES[unit]
    if unit:
        raise ValueError(
            f"column {values.name!r} has the unit {unit!r}; add --unit t_s=UNIT, one of "
            f"{', '.join(TIMES)}"
        )
    step = float(np.median(np.diff(values.to_numpy(float)))) if len(values) > 1 else 0.1
    longest = {"s": 5.0, "ms": 5e3, "us": 5e6, "ns": math.inf}
    name = next(name for name, most in longest.items() if step <= most)
    epoch = ", since 1970" if values.iloc[0] * TIMES[name] > 1e9 else ""
    said.append(f"times taken as {name}{epoch}: their steps are {step:g}")
    return TIMES[name]


def _write(
    target: Path, table: pd.DataFrame, source: Path, robot: str, real: bool, said: list[str]
) -> dict[str, Any]:
    """Write a recording and its sidecar."""
    side = target.with_suffix(".json")
    bad = np.argwhere(~np.isfinite(table.to_numpy(float)))
    if len(bad):
        row, column = bad[0]
        raise ValueError(
            f"{source}, row {row + 1}: no number for {table.columns[column]}; add --cut, which "
            "cuts such rows out"
        )
    content = columns_text(table).encode()
    intervals = np.diff(table["t_s"])
    if np.any(intervals <= 0):
        row = int(np.argmax(intervals <= 0)) + 2
        raise ValueError(f"{source}, row {row}: time does not advance; cut the row out by hand")
    write_bytes(target, content)
    write_json(
        side,
        {
            "schema": SCHEMA,
            "robot": robot,
            "link": f"import of {source.name}",
            "real": real,
            "rate_hz": round(float(1 / np.median(intervals)), 6) if len(intervals) else 10.0,
            "columns": list(table.columns),
            "units": {column: unit_of(column) for column in table.columns},
            "calibration": "unknown",
            "config": None,
            "note": "; ".join(said),
            "complete": True,
            "rows": len(table),
            "sha256": hashlib.sha256(content).hexdigest(),
        },
    )
    return {"written": str(target), "rows": len(table), "said": said}
