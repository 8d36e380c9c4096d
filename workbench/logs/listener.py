"""Where the robot in front is, heard by a robot's range-and-bearing board: the same estimate as in
the sensing mode ``range-and-bearing``, from what comes over the wire. Places of shapes are not kept
this way yet.

    with wb.open_robot("board:/dev/rfcomm0") as robot:
        listener = Listener(robot, config)
        robot.step()
        distance, bearing = listener()

Contract: as of ``formation.senses.range_bearing``; it is asked once a control period.
"""

import math
from typing import Any

import numpy as np

from workbench.formation.senses.range_bearing import BOARD, correct, move_on
from workbench.robot.api import Robot
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.range_bearing import ROBOTS, Reporter, unpack


class Listener:
    """Where the robot in front is, by the board of a robot of the API and its step counters: what
    ``driving.drive`` asks. Its odometry is the robot's own, the sender reports
    (``robot.range_bearing.Report``), and it reports itself, so that robots that listen can follow
    each other. A leader's program does that with a ``Reporter``.

    Args:
        robot: connected; its ``number`` says which it is, the one before it is followed.
        config: the follower's.

    Raises:
        ValueError: the leader, who follows nobody.
    """

    def __init__(self, robot: Robot, config: Any) -> None:
        if robot.number < 1:
            raise ValueError(
                f"robot.number = {robot.number!r}; the leader follows nobody: expected a robot "
                f"from 1 to {ROBOTS - 1}"
            )
        robot.enable("range_bearing", "motor_position")
        self._robot = robot
        self._config = config
        self._reporter = Reporter(robot)
        self._at = robot.time_s
        self._board = np.zeros(1, BOARD)[0]
        self._counts: tuple[float, ...] | None = None

    def __call__(self) -> tuple[float, float]:
        """Return distance (m) and bearing (rad) of the robot in front; before it has been heard,
        twice as far away as anybody can be seen.
        """
        board = self._board
        went, turned, seconds = self._moved()
        move_on(board, went, turned)
        messages = self._robot.get_range_bearing()
        self._reporter.report(messages, went / seconds, turned / seconds)
        mine = self._robot.number
        for heard in messages:
            report = unpack(heard.data)
            if (report.sender, report.about) == (mine - 1, mine):
                board["speed"], board["turn"] = report.speed_mps, report.turn_radps
                gain = self._config.range_bearing.gain
                correct(board, gain, heard.range_m, heard.bearing_rad, report.bearing_rad)
        if not board["any"]:
            return 2.0 * self._config.sight_m, 0.0
        x, y = float(board["x"]), float(board["y"])
        return math.hypot(x, y), math.atan2(y, x)

    def _moved(self) -> tuple[float, float, float]:
        """Return how far (m) and by how much (rad) its wheels have turned it since the last call,
        and how many seconds that took; nothing where counters have been set since.
        """
        counts, now = self._robot.get_motor_position(), self._robot.time_s
        before = self._counts or counts
        seconds = max(now - self._at, CONTROL_PERIOD)
        most = 2 * self._robot.most_steps * seconds
        self._counts, self._at = counts, now
        body = self._config.robot
        steps = [count - then for count, then in zip(counts, before, strict=True)]
        if max(map(abs, steps)) > most:
            return 0.0, 0.0, seconds
        left, right = (body.step_m * count for count in steps)
        return (left + right) / 2, (right - left) / body.track_m, seconds
