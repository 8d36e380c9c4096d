"""A recording behind the robot API: the same readings in the same order, nothing to drive.

Contract: ``step`` gives one row after the other, as fast as it is called; after the last row it
raises RecordingEnded. What a follower would do with the readings is up to the caller: commands are
refused, the recorded ones are in ``recorded_command``.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from workbench.logs.recordings import GROUPS, load_recording
from workbench.robot.api import Robot
from workbench.robot.faults import NotSupported, RobotError


class RecordingEnded(RobotError):
    """There are no more rows."""


class ReplayedRobot(Robot):
    """A recorded robot.

    Args:
        path: CSV of a recording.
        debug: print the time of every row.
        gap_s: longest interval between two rows, where longer ones are to be refused.
    """

    def __init__(self, path: str | Path, debug: bool = False, *, gap_s: float = math.inf) -> None:
        super().__init__(period_s=0.0, watchdog_s=None, debug=debug)
        self.recording = load_recording(path, gap_s=gap_s)
        self.capabilities = frozenset(self.recording.sensors) | {"motor_speed"}
        self._row = -1

    def _open(self) -> None:
        self._row = -1

    def _close(self) -> None:
        self._row = -1

    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        frame = self.recording.frame
        self._row = min(self._row + 1, len(frame))
        if self._row == len(frame):
            raise RecordingEnded(
                f"the recording has {len(frame)} rows; connect again to start over"
            )
        row = frame.iloc[self._row]
        if self.debug:
            print(f"{row['t_s']:.3f} s")
        found: dict[str, tuple[float, ...]] = {}
        for sensor in sensors:
            columns = (
                ["left_command", "right_command"] if sensor == "motor_speed" else GROUPS[sensor][0]
            )
            found[sensor] = tuple(float(value) for value in row[columns])
        return found

    def _drive(self, left: int, right: int) -> None:
        raise NotSupported("a recording cannot be driven")

    def _count_on(self, wire: tuple[float, ...]) -> tuple[float, ...]:
        return wire

    def _version(self) -> str:
        return f"recording of {self.recording.header['robot']}"

    @property
    def _now(self) -> pd.Series:
        if not 0 <= self._row < len(self.recording.frame):
            raise RecordingEnded(
                f"there is no row now: the recording has {len(self.recording.frame)} rows; "
                "call step() first"
            )
        return self.recording.frame.iloc[self._row]

    @property
    def time_s(self) -> float:
        """When this row was recorded."""
        return float(self._now["t_s"])

    @property
    def recorded_command(self) -> tuple[int, int]:
        """The command that was sent after the readings of this row, in steps/s."""
        row = self._now
        return int(row["left_command"]), int(row["right_command"])
