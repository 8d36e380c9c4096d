"""Public recordings of real robots as tidy tables: TUM's box sweep, Wii42's infrared and ground rows, TTU's straight drives.

Only TTU's files have times; the others are tables, not recordings. Nothing of them is stored in this project; ``validate``
reads them where WORKBENCH_RECORDINGS says and keeps aggregates. Sources: github clamesc/ePuck-Box-Pushing commit 062f029
(GPL-3.0), Wii42/Robotics_Project commit 0dd269a and MarkDannemiller/ttu_dp_elisa3_python commit d9fc889 (no licence stated).

Contract: a table that is not what it should be is refused with file, row and column.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

ROW_MM = 0.597  # Wii42: what the robot backs off between two rows
PS = [f"ps{k}" for k in range(8)]


def tum_box_sweep(folder: Path) -> pd.DataFrame:
    """Return 36 rows: bearing_deg of a box in contact, -180 to 170, positive left, and ps0 … ps7 (means of 20 raw readings)."""
    values = _numbers(folder / "tum_epuck1_box_bearing" / "proximity_values.txt", 36, 8)
    frame = pd.DataFrame(values, columns=PS)
    frame.insert(0, "bearing_deg", (np.arange(36) - 18) * 10.0)
    return frame


def _numbers(path: Path, rows: int, columns: int) -> NDArray[np.float64]:
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; WORKBENCH_RECORDINGS has to name the folder of the recordings")
    lines = path.read_text().split("\n")
    found = [line.split() for line in lines if line.strip()]
    if len(found) != rows:
        raise ValueError(f"{path} has {len(found)} rows; expected {rows}")
    for number, cells in enumerate(found, start=1):
        if len(cells) != columns:
            raise ValueError(f"{path}, row {number}: {len(cells)} columns; expected {columns}")
    try:
        return np.array(found, dtype=np.float64)
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected numbers") from None


def wii42_backing_off(folder: Path) -> dict[str, pd.DataFrame]:
    """Return one table per run: row_mm driven back since the first row, and ps0 … ps7 (calibrated counts)."""
    runs = {}
    for path in sorted((folder / "wii42_epuck2_ir_ground").glob("IRsensors*.csv")):
        frame = _named(path, ["step", *PS])
        frame.insert(0, "row_mm", frame["step"] * ROW_MM)
        runs[path.stem] = frame.drop(columns="step")
    if not runs:
        raise FileNotFoundError(f"{folder} holds no wii42_epuck2_ir_ground/IRsensors*.csv")
    return runs


def wii42_ground(folder: Path) -> dict[str, pd.DataFrame]:
    """Return one table per run over bars: gs_left, gs_centre, gs_right in counts."""
    runs = {}
    for path in sorted((folder / "wii42_epuck2_ir_ground").glob("Gsensors_*.csv")):
        frame = _named(path, ["step", "gs0", "gs1", "gs2"]).drop(columns="step")
        runs[path.stem] = frame.set_axis(["gs_left", "gs_centre", "gs_right"], axis=1)
    if not runs:
        raise FileNotFoundError(f"{folder} holds no wii42_epuck2_ir_ground/Gsensors_*.csv")
    return runs


def ttu_drives(folder: Path) -> dict[str, pd.DataFrame]:
    """Return one table per run in a straight line: t_s and per robot position_m, as measured by step counters."""
    runs = {}
    for path in sorted((folder / "ttu_epuck2_leader_follower").rglob("epuck-exp-*.csv")):
        frame = pd.read_csv(path)
        time = next((column for column in ("timestamp_s", "timestamp") if column in frame), None)
        places = [column for column in frame if column.endswith(("_position_m", "_position"))]
        if time is None or not places:
            continue  # another kind of log
        kept = frame[[time, *places]].astype(float)
        runs[path.stem] = kept.set_axis(["t_s", *(f"{name.split('_position')[0]}_position_m" for name in places)], axis=1)
    if not runs:
        raise FileNotFoundError(f"{folder} holds no ttu_epuck2_leader_follower/epuck-exp-*.csv with times and positions")
    return runs


def _named(path: Path, columns: list[str]) -> pd.DataFrame:
    frame = pd.read_csv(path)
    frame = frame[[column for column in frame if not str(column).startswith("Unnamed")]]
    if list(frame.columns) != columns:
        raise ValueError(f"{path}: columns {list(frame.columns)}; expected {columns}")
    for column in columns:
        values = pd.to_numeric(frame[column], errors="coerce")
        if values.isna().any():
            row = int(np.flatnonzero(values.isna())[0])
            raise ValueError(f"{path}, row {row + 1}, column {column}: {frame[column].iloc[row]!r}; expected a number")
        frame[column] = values
    return frame
