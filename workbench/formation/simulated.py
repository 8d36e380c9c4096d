"""A simulated e-puck behind the robot API: one robot of a convoy, while the others do what they
always do.

    with SimulatedRobot(ConvoyConfig(followers=1)) as robot: ...

The robot stands in its place of the convoy, driven by nobody but the program. ``step`` lets 0.1 s
of physics pass, as fast as it goes. Robots in front follow the line or their predecessor; the
leader itself (``robot=0``) can be driven too.

>>> with SimulatedRobot(ConvoyConfig(followers=1, drive="planar", leader_speed_mps=0.05)) as robot:
...     robot.enable("proximity", "motor_position")
...     for _ in range(11):
...         _ = robot.step()
...         robot.set_motors_speed(300, 300)
>>> robot.get_motor_position()
(303.0, 303.0)

Contract: equal configuration and seed give equal readings for equal commands. ``convoy`` is open to
every use; the robot's readings are those that a follower of a compiled convoy would have, bit for
bit.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from workbench.arena.proximity import RayProximity
from workbench.compiled import compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.control import read_ground
from workbench.formation.convoy import Convoy
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.table import Controller
from workbench.formation.policy import Policy
from workbench.formation.senses import range_bearing
from workbench.formation.senses.infrared import ALL, sense_proximity
from workbench.formation.senses.table import INFRARED
from workbench.formation.senses.truth import observe
from workbench.formation.streams import own_chance
from workbench.robot.api import SENSORS, Robot
from workbench.robot.description import EPUCK
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.infrared import SENSORS as RING_SENSORS, calibrate, raw_reading
from workbench.robot.motors import wheel_speed
from workbench.robot.range_bearing import ROBOTS, Report, pack

GYROSCOPE = 131.0  # counts per °/s


@compiled
def sense(task: Any, robots: Any, i: int, noise: Any) -> None:
    """Read the proximity sensors of robot i, see ``formation.senses.infrared.sense_proximity``;
    ``task`` is (1,).
    """
    sense_proximity(task[0], robots, i, noise, ALL)


@compiled
def _ground(task: Any, floor: Any, robots: Any, i: int, k: int, noise: float) -> float:
    return read_ground(task[0], floor, robots[i], k, noise)


@compiled
def _measure(
    task: Any, robots: Any, i: int, sender: int, normal: Any
) -> tuple[float, float, float]:
    return range_bearing.measure(task[0], robots[i], robots[sender], normal)


def _check_whole_periods(config: ConvoyConfig) -> None:
    """Refuse commands that wait for an update within a control period."""
    if config.delay_steps:
        raise ValueError(
            f"ConvoyConfig.compute_time_s = {config.compute_time_s!r} without the buffer; a robot "
            "that is driven from outside runs whole control periods: expected "
            "learner.buffer = True"
        )


def _gyroscope(turn: float) -> float:
    """Return the raw reading of a turning rate (rad/s), to the left positive: 131 counts per °/s,
    16 bits, as the e-puck2's motion sensor has it at its finest range; which range its firmware
    takes is our assumption.
    """
    counts = GYROSCOPE * math.degrees(turn)
    return float(round(max(-(2.0**15), min(2.0**15 - 1, counts))))


class SimulatedRobot(Robot):
    """An e-puck in a simulated convoy.

    Args:
        config: the convoy; its seed too.
        debug: print every command.
        robot: which robot is driven; 0 is the leader.
        others: what the other followers follow, a policy or a classical law; default a carrot, or
            θ₀ where they learn.
        learn: updates over which the others' exploration schedule runs while they learn on; 0: they
            do not learn.
        realtime: whether a step takes as long as it simulates.
        furnish, reflectance: walls and boxes, see ``arena.proximity``; with them this robot's
            infrared is cast by rays.

    Attributes:
        sent: what it has sent by its range-and-bearing board. The others run no program that takes
            it; they report on this robot (``robot.range_bearing.Report``), robots 0 to 15.
    """

    capabilities = frozenset(SENSORS[: SENSORS.index("microphone")]) | {
        "gyroscope",
        "range_bearing",
        "send",
        "drive",
        "calibrate",
        "led",
        "body_led",
        "front_led",
        "observe",
    }

    def __init__(
        self,
        config: ConvoyConfig | None = None,
        debug: bool = False,
        *,
        robot: int = 1,
        others: Controller | None = None,
        learn: int = 0,
        realtime: bool = False,
        furnish: Callable[[mujoco.MjSpec], None] | None = None,
        reflectance: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(period_s=CONTROL_PERIOD if realtime else 0.0, watchdog_s=None, debug=debug)
        self.config = config if config is not None else ConvoyConfig(followers=1)
        if self.config.reset == "restart":
            raise ValueError(
                "ConvoyConfig.reset = 'restart'; a robot that is driven from outside cannot "
                "be put back: expected 'manoeuvre'"
            )
        if others is not None:
            others.check(self.config)
        if not 0 <= robot <= self.config.followers:
            raise ValueError(
                f"robot = {robot!r}; this convoy has robots 0 (the leader) to "
                f"{self.config.followers}"
            )
        if learn < 0 or (learn and isinstance(others, ControlLaw)):
            raise ValueError(
                f"learn = {learn!r} with others = {others!r}; expected 0 or more updates, and "
                "no law where they learn"
            )
        self.robot = self.number = robot
        self._others = others
        self._learn = learn
        self.most_steps = self.config.robot.most_steps
        if self.config.robot != EPUCK:  # what its sensors would read nobody has measured
            self.capabilities = self.capabilities - {"proximity", "light", "calibrate"}
        if robot >= ROBOTS:  # a report has no number for it
            self.capabilities = self.capabilities - {"range_bearing", "send"}
        self._furnish = furnish
        self._reflectance = reflectance
        self.lights: dict[str, tuple[int, ...]] = {}

    def _open(self) -> None:
        config = self.config
        alone = config.followers == 1 and self.robot == 1
        others = self._others if self._others is not None or alone or self._learn else CarrotPI()
        driver = others.theta if isinstance(others, Policy) else others
        _check_whole_periods(config)
        self.convoy = Convoy(
            config,
            [config.seed],
            steps=10**12 if self._learn else 0,
            periods=10**12,
            horizon=self._learn or None,
            policy=driver,
            external=self.robot,
            threads=1,
            furnish=self._furnish,
        )
        self._rays = (
            RayProximity(self.convoy.world, config.infrared, self._reflectance)
            if self._furnish
            else None
        )
        self._time = 0
        self._started = False
        self._steps = np.zeros(2)
        self._own = own_chance(config.seed, self.robot)
        self._fit_board()
        self.convoy.robots["infrared"]["bias"][0, self.robot] = (
            0.0  # this robot calibrates when it is told to
        )
        sense(
            self.convoy.task, self.convoy.robots[0], self.robot, np.zeros(RING_SENSORS)
        )  # compiled now, not while
        _ground(
            self.convoy.task,
            self.convoy.world.floor.raster[0],
            self.convoy.robots[0],
            self.robot,
            0,
            0.0,
        )  # a client waits

    def _fit_board(self) -> None:
        """Give all robots a range-and-bearing board, also where nobody senses by it."""
        range_bearing.equip(self.convoy)
        for name, value in range_bearing.fill(self.config)["board"].items():
            self.convoy.task["board"][name] = value
        self._messages = own_chance(self.config.seed, self.robot, "messages")
        self.sent: list[bytes] = []
        _measure(self.convoy.task, self.convoy.robots[0], self.robot, self.robot, np.zeros(3))

    def _close(self) -> None:
        self._started = False

    def _drive(self, left: int, right: int) -> None:
        if self.debug:
            print("→ D", left, right)
        record = self.convoy.robots[0, self.robot]
        record["command"]["left"] = left
        record["command"]["right"] = right

    def _pass_time(self) -> None:
        if self._started:
            self.convoy.command(self.robot, *self._speed, self._time)
            self.convoy.world.step()
            most = self.config.robot.most_steps
            ticks = self.config.robot.timer_hz
            self._steps += [
                wheel_speed(speed, most, ticks) * CONTROL_PERIOD for speed in self._speed
            ]
            self._time += 1

    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        convoy = self.convoy
        me = self.robot
        self.record: NDArray[np.void] = convoy.period(self._time)[0]
        self._started = True
        robots = convoy.robots[0]
        record = robots[me]
        if (
            self.config.sensing not in INFRARED or me == 0 or self._rays is not None
        ) and not record["seen"]["silent"]:
            sense(convoy.task, robots, me, self._own.standard_normal(RING_SENSORS))
        if self._rays is not None and not record["seen"]["silent"]:
            self._cast(record)
        found: dict[str, tuple[float, ...]] = {
            "observe": (float(record["seen"]["distance"]), float(record["seen"]["bearing"]))
        }
        if "proximity" in sensors:
            found["proximity"] = tuple(record["infrared"]["readings"].tolist())
        if "light" in sensors:
            found["light"] = tuple(record["infrared"]["headroom"].tolist())
        if "floor" in sensors:
            found["floor"] = self._floor()
        speeds = {
            "motor_speed": (float(self._speed[0]), float(self._speed[1])),
            "motor_position": tuple(float(int(count)) for count in self._steps),
            "accelerometer": (0.0, 0.0, 800.0),
            "gyroscope": (0.0, 0.0, _gyroscope(record["motion"]["turn"])),
            "selector": (10.0,),
            "battery": (1.0,),
        }
        if "range_bearing" in sensors:
            found["range_bearing"] = self._listen()
        return found | {sensor: speeds[sensor] for sensor in sensors if sensor in speeds}

    def _listen(self) -> tuple[float, ...]:
        """Return what the others' reports on this robot are: range, bearing and data of each."""
        told = self.config.range_bearing
        robots = self.convoy.robots[0]
        found: list[float] = []
        for other in range(min(len(robots), ROBOTS)):
            if other == self.robot or self._time % told.period:
                continue
            lost = self._messages.random() < told.message_loss
            normal = self._messages.standard_normal(3)
            distance, mine, its = _measure(self.convoy.task, robots, self.robot, other, normal)
            if lost or distance > told.range_m:
                continue
            motion = robots[other]["motion"]
            speed, turn = float(motion["speed"]), float(motion["turn"])
            data = pack(Report(other, self.robot, its, speed, turn))
            bearing = math.remainder(mine, 2 * math.pi)
            found += [distance, bearing, float(int.from_bytes(data))]
        return tuple(found)

    def _cast(self, record: Any) -> None:
        """Read the proximity sensors by rays against everything in the world."""
        assert self._rays is not None
        task = self.convoy.task[0]
        noise = self._own.standard_normal(RING_SENSORS)
        for k, light in enumerate(self._rays.light(0, self.robot)):
            raw = raw_reading(
                light,
                record["infrared"]["gain"][k],
                record["infrared"]["offset"][k],
                record["infrared"]["headroom"][k],
                noise[k],
                task["infrared"]["spread"],
            )
            record["infrared"]["readings"][k] = max(raw - record["infrared"]["bias"][k], 0.0)

    def _floor(self) -> tuple[float, ...]:
        convoy = self.convoy
        noise = self._own.standard_normal(3)
        return tuple(
            float(
                _ground(
                    convoy.task,
                    convoy.world.floor.raster[0],
                    convoy.robots[0],
                    self.robot,
                    k,
                    noise[k],
                )
            )
            for k in range(3)
        )

    def _set_device(self, device: str, values: tuple[int, ...]) -> None:
        if device == "motor_position":
            self._steps[:] = values
        elif device == "send":
            self.sent.append(bytes(values))
        elif device == "calibrate":
            record = self.convoy.robots[0, self.robot]
            chance = own_chance(self.config.fleet or self.config.seed, self.robot, "bias")
            record["infrared"]["bias"] = calibrate(
                chance, self.config.infrared, record["infrared"]["offset"]
            )
        else:
            self.lights[device] = values

    def _count_on(self, wire: tuple[float, ...]) -> tuple[float, ...]:
        return wire  # nothing wraps here

    def _reset(self) -> None:
        self._open()

    def _version(self) -> str:
        return (
            f"simulated e-puck {self.robot} of {self.config.followers + 1}, sensing "
            f"{self.config.sensing}"
        )

    @property
    def time_s(self) -> float:
        """Simulated s since the start."""
        return self._time * CONTROL_PERIOD

    def pose(self) -> tuple[float, float, float]:
        """Return the robot's true x, y in m and heading in rad."""
        return self.convoy.world.pose(0, self.robot)

    def true_errors(self) -> tuple[float, float]:
        """Return the true distance in m and bearing in rad of the robot in front, for judging
        only.
        """
        x, y, heading = self.pose()
        ahead_x, ahead_y, _ = self.convoy.world.pose(
            0, int(self.convoy.robots["ahead"][0, self.robot])
        )
        distance, bearing = observe(x, y, math.cos(heading), math.sin(heading), ahead_x, ahead_y)
        return float(distance), float(bearing)
