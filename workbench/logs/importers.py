"""Public recordings of real robots as tidy tables: TUM's box sweep, Wii42's infrared and ground
rows, TTU's straight drives.

Only TTU's files have times; the others are tables, not recordings. Nothing of them is stored in
this project; ``validate`` reads them where WORKBENCH_RECORDINGS says and keeps aggregates. Sources:
github clamesc/ePuck-Box-Pushing commit 062f029 (GPL-3.0), Wii42/Robotics_Project commit 0dd269a and
MarkDannemiller/ttu_dp_elisa3_python commit d9fc889 (no licence stated).

Contract: a table that is not what it should be is refused with file, row and column.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

ROW_MM = 0.597  # Wii42: what the robot backs off between two rows
PS = [f"ps{k}" for k in range(8)]


def tum_box_sweep(folder: Path) -> pd.DataFrame:
    """Return 36 rows: bearing_deg of a box in contact, -180 to 170, positive left, and ps0 … ps7
    (means of 20 raw readings).
    """
    values = _numbers(folder / "tum_epuck1_box_bearing" / "proximity_values.txt", 36, 8)
    frame = pd.DataFrame(values, columns=PS)
    frame.insert(0, "bearing_deg", (np.arange(36) - 18) * 10.0)
    return frame


def _numbers(path: Path, rows: int, columns: int) -> NDArray[np.float64]:
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist; WORKBENCH_RECORDINGS has to name the folder of the recordings"
        )
    lines = path.read_text(errors="replace").split("\n")
    found = [line.split() for line in lines if line.strip()]
    if len(found) != rows:
        raise ValueError(f"{path} has {len(found)} rows; expected {rows}")
    for number, cells in enumerate(found, start=1):
        if len(cells) != columns:
            raise ValueError(f"{path}, row {number}: {len(cells)} columns; expected {columns}")
        for column, cell in enumerate(cells, start=1):
            try:
                good = np.isfinite(float(cell))
            except ValueError:
                good = False
            if not good:
                raise ValueError(
                    f"{path}, row {number}, column {column}: {cell!r}; expected a number"
                )
    return np.array(found, dtype=np.float64)


def wii42_backing_off(folder: Path) -> dict[str, pd.DataFrame]:
    """Return one table per run: row_mm driven back since the first row, and ps0 … ps7 (calibrated
    counts).
    """
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
    """Return one table per run in a straight line: t_s and per robot position_m, as measured by
    step counters.
    """
    runs = {}
    for path in sorted((folder / "ttu_epuck2_leader_follower").rglob("epuck-exp-*.csv")):
        frame = _table(path)
        time = next((column for column in ("timestamp_s", "timestamp") if column in frame), None)
        places = [column for column in frame if column.endswith(("_position_m", "_position"))]
        if time is None or not places:
            continue  # another kind of log
        kept = _as_numbers(path, frame[[time, *places]], missing=True)
        if path.stem in runs:
            raise ValueError(f"{path}: there is another file of this name; expected each once")
        runs[path.stem] = kept.set_axis(
            ["t_s", *(f"{name.split('_position')[0]}_position_m" for name in places)], axis=1
        )
    if not runs:
        raise FileNotFoundError(
            f"{folder} holds no ttu_epuck2_leader_follower/epuck-exp-*.csv with times and positions"
        )
    return runs


def _table(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path, encoding_errors="replace")
    except (ValueError, pd.errors.ParserError) as error:
        raise ValueError(f"{path}: {error}; expected a table of comma-separated values") from None


def _named(path: Path, columns: list[str]) -> pd.DataFrame:
    frame = _table(path)
    frame = frame[[column for column in frame if not str(column).startswith("Unnamed")]]
    if list(frame.columns) != columns:
        raise ValueError(f"{path}: columns {list(frame.columns)}; expected {columns}")
    if not len(frame):
        raise ValueError(f"{path} has no rows; expected at least one")
    return _as_numbers(path, frame)


def _as_numbers(path: Path, frame: pd.DataFrame, *, missing: bool = False) -> pd.DataFrame:
    """Return a table of finite numbers; name the first cell that is none (empty ones may be
    allowed).
    """
    kept = frame.copy()
    for column in frame:
        values = pd.to_numeric(frame[column], errors="coerce")
        wrong = ~np.isfinite(values.to_numpy(float)) & ~(missing & frame[column].isna().to_numpy())
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise ValueError(
                f"{path}, row {row + 1}, column {column}: {frame[column].iloc[row]!r}; "
                "expected a number"
            )
        kept[column] = values.astype(float)
    return kept
