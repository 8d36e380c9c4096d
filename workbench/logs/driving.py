"""The loop in which one follower drives one robot through the robot API.

    follower = SoloFollower(config, policy)                 # greedy, or steps=… to learn
    report = drive(robot, follower, seconds=60)

With the update buffer (paper II-D) the loop sends the command first and learns while it runs.

Contract: the loop ends with the robot stopped.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import LEARNED, LOSS, RECOVERED
from workbench.formation.senses.table import SENSES
from workbench.formation.solo import SoloFollower
from workbench.logs.listener import Listener
from workbench.robot.api import Robot
from workbench.robot.geometry import CONTROL_PERIOD

Observer = Callable[[], tuple[float, float]]
Watcher = Callable[[SoloFollower, Robot, float], None]


@dataclass
class DriveReport:
    """What a drive was like.

    Attributes:
        periods: control periods; missed: those that began late; worst_latency_s: by how much at
            most.
        losses, recoveries: of the robot in front; updates: learning updates since the follower
            began.
        command_latency_s: mean time from when the readings were there to the command;
            late_commands: those that took longer than a control period.
    """

    periods: int
    missed: int
    worst_latency_s: float
    losses: int
    recoveries: int
    updates: int
    command_latency_s: float
    late_commands: int


def drive(
    robot: Robot,
    follower: SoloFollower,
    *,
    seconds: float,
    observer: Observer | None = None,
    watch: Watcher | None = None,
    update_s: float = 0.0,
) -> DriveReport:
    """Let a follower drive a connected robot; the robot is stopped at the end, whatever happens.

    Args:
        robot: connected.
        follower: who decides.
        seconds: of control periods.
        observer: where distance and bearing come from unless the follower sees by infrared; default
            that of its sensing mode, or ``robot.observe``.
        watch: called at the end of every period, learning included, with follower, robot and the
            period's time in s, for example a recorder.
        update_s: wall-clock time that an update takes in addition, to be like a slower computer.

    Raises:
        ValueError: no time to drive, or a robot that follows nobody.
        RobotError: see ``robot.faults``; stop has been sent where a channel was alive.
    """
    sees = _eyes(robot, follower, observer)
    slow = _SlowComputer(follower, update_s)
    losses = recoveries = late = 0
    latency = 0.0
    if not 0 < seconds < math.inf:
        raise ValueError(f"seconds = {seconds!r}; expected more than 0")
    missed = robot.missed_deadlines
    periods = max(1, round(seconds / _period(robot)))
    robot.worst_latency_s = 0.0
    try:
        for _ in range(periods):
            robot.step()
            begun = time.monotonic()
            slow.before()
            left, right = follower.decide(**sees())
            robot.set_motors_speed(left, right)
            took = time.monotonic() - begun
            latency = latency + took
            late = late + (took > _period(robot))
            event = int(follower.step["event"])
            losses = losses + (event & LOSS != 0)
            recoveries = recoveries + (event & RECOVERED != 0)
            slow.after(event)
            follower.learn()
            if watch is not None:
                watch(follower, robot, robot.time_s)
        robot.step()
    finally:
        if robot.is_connected():
            robot.stop()
    return DriveReport(
        periods,
        robot.missed_deadlines - missed,
        robot.worst_latency_s,
        losses,
        recoveries,
        follower.updates,
        latency / periods,
        late,
    )


def _eyes(
    robot: Robot, follower: SoloFollower, observer: Observer | None
) -> Callable[[], dict[str, Any]]:
    """Return what tells a follower what it sees, as arguments of ``decide``."""
    needs = SENSES[follower.config.sensing].needs
    if needs == "proximity":
        return _infrared(robot)
    see = observer or _OBSERVERS[needs](robot, follower.config)

    def told() -> dict[str, Any]:
        distance, bearing = see()
        return {"distance": distance, "bearing": bearing}

    return told


# what a robot is capable of: who tells distance and bearing of the robot in front by it
_OBSERVERS: dict[str, Callable[[Robot, ConvoyConfig], Observer]] = {
    "observe": lambda robot, _: robot.observe,
    "range_bearing": Listener,
}


def _infrared(robot: Robot) -> Callable[[], dict[str, Any]]:
    """Return what reads the proximity sensors."""
    robot.enable("proximity")
    if "light" in robot.capabilities:
        robot.enable("light")

    def read() -> dict[str, Any]:
        light = robot.get_light_sensor() if "light" in robot.get_sensors_enabled() else None
        return {"readings": robot.get_proximity(), "light": light}

    return read


class _SlowComputer:
    """Waits as long as an update takes on a slower computer: before the command, or after it with
    the update buffer.
    """

    def __init__(self, follower: SoloFollower, update_s: float) -> None:
        self._follower = follower
        self._seconds = update_s
        self._buffer = follower.config.learner.buffer

    def before(self) -> None:
        """Wait where the transition that ends now is learned at once."""
        follower = self._follower
        if self._buffer or not self._seconds or not follower.steps:
            return
        if follower.record["choice"]["state"] >= 0:
            time.sleep(self._seconds)

    def after(self, event: int) -> None:
        """Wait where it is learned while the command runs."""
        if self._buffer and self._seconds and event & LEARNED:
            time.sleep(self._seconds)


def _period(robot: Robot) -> float:
    return robot.period_s or CONTROL_PERIOD
