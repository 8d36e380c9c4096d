"""One robot API for simulated, real and recorded e-pucks, in the words of pyePuck and ePuckVRep.

A control program reads, decides and drives, whatever is at the other end:

    # "serial:/dev/ttyS0", "tcp:192.168.1.20:1000", "log:recording.csv"
    with open_robot("sim:") as robot:
        robot.enable("proximity")
        for _ in range(100):
            robot.step()  # lets one control period pass, then reads what is enabled
            robot.set_motors_speed(*decide(robot.get_proximity()))  # takes effect at once
        robot.stop()

``step`` keeps the pace: the first call reads at once, every later one waits until a period after
the last. A call that comes late is counted (``missed_deadlines``, ``worst_latency_s``) and starts a
new period. A program that learns does so between ``set_motors_speed`` and ``step``, while the
command runs.

A robot never runs away. It is stopped when a connection opens, when a ``with`` block or the program
ends, for whatever reason (``robot.ends``), on a faulty reply, and by a watchdog when a moving robot
has heard nothing for ``watchdog_s``. A stop counts when the robot's own speeds are zero
(``robot.guard``). Where the link is lost nothing can stop it: the error says so, and stop is the
first thing sent when it is connected again. A program that is killed (SIGKILL) stops nothing; the
``guardian`` does (``robot.guardian``).

Units: speeds in motor steps/s, positions in motor steps (counted on beyond the wire's 16 bits),
readings in counts. Sensor order: see ``robot.infrared``; ground sensors left, centre, right.

Contract: one program thread per robot; the watchdog takes the same lock. ``capabilities`` says what
a back-end can do, everything else raises NotSupported. Errors of the link are RobotErrors, no
others.
"""

import math
import numbers
import threading
import warnings
from abc import abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

from workbench import fields
from workbench.robot import ends, guard
from workbench.robot.clock import CLOCK, Clock
from workbench.robot.faults import (
    BadReply,
    LinkLost,
    LinkTimeout,
    NotConnected,
    NotSupported,
    RobotError,
)
from workbench.robot.geometry import CONTROL_PERIOD, MAX_STEPS
from workbench.robot.guard import MAY_MOVE, Watchdog
from workbench.robot.vocabulary import Words

SENSORS = (
    "proximity",
    "light",
    "floor",
    "motor_speed",
    "motor_position",
    "accelerometer",
    "selector",
    "battery",
    "microphone",
    "gyroscope",
    "magnetometer",
    "distance",
    "temperature",
    "button",
    "remote",
    "age",
    "range_bearing",
)
WRAP = 1 << 16
# s by which a period may begin late before that counts: what a busy computer's timer is off
OVERSLEPT_S = 0.005
PATIENCE_S = 0.5  # s that a call waits for replies, asked for twice; then the guard has STOP_S
WATCHDOG_S = 0.5  # s without a word from the program after which a moving robot is stopped


class Robot(Words):
    """What all back-ends have in common. A back-end fills in the methods with an underscore.

    Args:
        period_s: wall-clock seconds between two steps, 0 for as fast as it goes.
        watchdog_s: seconds after which the watchdog stops a moving robot, None for no watchdog.
        debug: print every exchange.
        strict: refuse speeds that are no whole numbers within the motors' limit; otherwise they are
            cut to such, as pyePuck and the firmware do, with a warning once.
        clock: the time that it goes by.

    Attributes:
        capabilities: words of SENSORS, and what else it can: drive, calibrate, led, observe, …
        missed_deadlines, worst_latency_s: steps that began late, and the longest delay.
        watchdog_stops: how often the watchdog had to stop the robot.
    """

    capabilities: frozenset[str] = frozenset()
    most_steps = MAX_STEPS
    wired = False  # whether a robot that drives on stands behind it, however the program ends
    calibration_s = 0.0  # how long calibration may take
    number = 1  # of a formation, 0 the leader

    def __init__(
        self,
        *,
        period_s: float = CONTROL_PERIOD,
        watchdog_s: float | None = WATCHDOG_S,
        debug: bool = False,
        strict: bool = False,
        clock: Clock = CLOCK,
    ) -> None:
        if not 0 <= period_s <= 10:
            raise ValueError(f"period_s = {period_s!r}; expected 0 to 10 s")
        if watchdog_s is not None and not (period_s < watchdog_s < math.inf and watchdog_s > 0):
            raise ValueError(
                f"watchdog_s = {watchdog_s!r} with period_s = {period_s!r}; expected more "
                "than a control period, or the watchdog "
                "stops the robot in every one; None switches it off"
            )
        self.period_s = period_s
        self.watchdog_s = watchdog_s
        self.debug = debug
        self.strict = strict
        self.clock = clock
        self._warned = False
        self.missed_deadlines = 0
        self.worst_latency_s = 0.0
        self.watchdog_stops = 0
        self._enabled: list[str] = []
        self._read: dict[str, tuple[float, ...]] = {}
        self._speed = (0, 0)
        self._connected = False
        self._last_step: float | None = None
        self._first: float | None = None
        self._stamp = 0.0
        self._heard = 0.0
        self._lock = threading.RLock()
        every_s = None if watchdog_s is None else watchdog_s / 5
        self._watchdog = Watchdog(self._stop_silent, every_s, clock)
        self._counted: tuple[int, int] | None = None  # motor positions without wrapping

    # what a back-end provides

    @abstractmethod
    def _open(self) -> None:
        """Open the link; the guard stops the robot before anything else is sent."""

    @abstractmethod
    def _close(self) -> None:
        """Close the link; never raises."""

    @abstractmethod
    def _exchange(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        """Read sensors, each as plain numbers."""

    @abstractmethod
    def _drive(self, left: int, right: int) -> None:
        """Send wheel speeds."""

    def _end_request(self) -> None:  # noqa: B027  (optional)
        """End what the robot's parser may be in the middle of; wait for nothing."""

    def _send_stop(self) -> None:
        """End what the parser may be in the middle of and send stop; wait for nothing."""
        self._drive(0, 0)

    def _stands(self) -> bool:
        """Return whether the robot's own speeds are zero."""
        return True

    def _limit(self, until: float) -> None:  # noqa: B027  (optional)
        """Let no reply be waited for beyond a moment of the clock."""

    def _announce(self, seconds: float) -> None:  # noqa: B027  (optional)
        """Tell a guardian that nothing will be said for so long."""

    def _pass_time(self) -> None:  # noqa: B027  (optional)
        """Let a control period pass that is not wall-clock time."""

    # connecting

    def connect(self) -> bool:
        """Open the link; the robot is stopped first. Returns True, as pyePuck does."""
        with self._lock:
            if not self._connected:
                self._open()
                self._halt_or_lose()
                self._connected = True
                if self.wired:
                    ends.add(self)
                self._speed = (0, 0)
                self._last_step = None
                self._counted = None
                self._first = None
                self._read = {}
                self._heard = self.clock.now()
        return True

    def disconnect(self) -> None:
        """Stop the robot and close the link. Does nothing if there is none."""
        with ends.undisturbed():
            with self._lock:
                if self._connected:
                    try:
                        self._halt()
                    except RobotError as error:
                        warnings.warn(
                            f"stop was not confirmed on closing: {error}; the robot may still be "
                            "moving",
                            stacklevel=2,
                        )
                    finally:
                        self._lost()
            self._watchdog.end()
            ends.settle()

    def close(self) -> None:
        """Same as ``disconnect``."""
        self.disconnect()

    def is_connected(self) -> bool:
        """Return whether the link is open."""
        return self._connected

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.disconnect()

    # sensors

    def enable(self, *sensors: str) -> None:
        """Read these sensors at every step; words of SENSORS."""
        for sensor in sensors:
            self._check_sensor(sensor)
            if sensor not in self._enabled:
                self._enabled.append(sensor)

    def disable(self, *sensors: str) -> None:
        """Read these sensors no more."""
        for sensor in sensors:
            if sensor in self._enabled:
                self._enabled.remove(sensor)
            self._read.pop(sensor, None)

    def get_sensors_enabled(self) -> list[str]:
        """Return the names of the enabled sensors."""
        return list(self._enabled)

    def step(self) -> bool:
        """Let one control period pass and read all enabled sensors; the first call reads at once.
        Returns True.

        Raises:
            LinkTimeout, BadReply: twice in a row no usable reply; stop has been sent.
            LinkLost: the link is gone; the robot may still be moving.
        """
        self._require()
        now = self.clock.now()
        if self._last_step is None:
            self._last_step = now
        else:
            due = self._last_step + self.period_s
            overrun = now > due + 1e-4
            if now < due:
                self.clock.sleep(due - now)
                now = self.clock.now()
            if self.period_s and (overrun or now > due + OVERSLEPT_S):
                self.missed_deadlines += 1
                self.worst_latency_s = max(self.worst_latency_s, now - due)
                due = now
            self._pass_time()
            self._last_step = due if self.period_s else self.clock.now()
        self._heard = self.clock.now()
        with self._lock:
            self._first = self._heard if self._first is None else self._first
            self._stamp = self._heard
            self._read |= self._guarded(self._enabled)
        self._heard = self.clock.now()
        return True

    @property
    def time_s(self) -> float:
        """When the sensors were last read, in s since the first time after connecting; the robot's
        own time if simulated.
        """
        return self._stamp - (self._first or 0.0)

    # acting

    def set_motors_speed(self, left: int, right: int) -> None:
        """Set the wheel speeds in steps/s, at once: whole numbers within the motors' limit; others
        are cut to such with a warning, unless the robot is ``strict``.

        Raises:
            ValueError: no finite numbers, or what ``strict`` refuses.
        """
        pair = [self._whole_speed(name, v) for name, v in (("left", left), ("right", right))]
        self._require("drive")
        if any(pair):
            ends.look()
        self._heard = self.clock.now()
        with self._lock:
            self._speed = (pair[0], pair[1])
            self._guarded_twice(lambda: self._drive(*self._speed))
        if any(self._speed):
            self._watchdog.start()

    def _whole_speed(self, name: str, value: Any) -> int:
        """Return a speed that the motors can do."""
        most = self.most_steps
        try:
            return fields.whole(name, value, -most, most, "steps/s")
        except ValueError:
            number = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if self.strict or not number or not math.isfinite(value):
                raise
        cut = max(-most, min(most, int(float(value))))
        if not self._warned:
            self._warned = True
            warnings.warn(
                f"{name} = {value!r} was cut to {cut} steps/s: motors take whole numbers up to "
                f"±{most}; strict=True refuses others (said once)",
                stacklevel=3,
            )
        return cut

    def sleep(self, seconds: float) -> None:
        """Let time pass while the robot does what it was told last: simulated time where it is
        simulated. ``time.sleep`` passes none there, and on a wire the watchdog stops the robot.
        """
        self._require()
        if self.period_s == 0 and not self.wired:
            for _ in range(round(seconds / CONTROL_PERIOD)):
                self.step()
            return
        self._announce(seconds)
        until = self.clock.now() + seconds
        while (left := until - self.clock.now()) > 0:
            self.clock.sleep(min(left, 0.1))
            self._heard = self.clock.now()

    def stop(self) -> None:
        """Stop both wheels, and make sure that they stand.

        Raises:
            LinkTimeout, BadReply, LinkLost: it could not be confirmed; the robot may be moving.
        """
        self._require("drive")
        self._heard = self.clock.now()
        with self._lock:
            self._speed = (0, 0)
            self._halt_or_lose()

    @property
    def commanded(self) -> tuple[int, int]:
        """The wheel speeds that were set last, in steps/s; zeros once the robot has been
        stopped.
        """
        return self._speed

    def get_sercom_version(self) -> str:
        """Return what the robot says it is."""
        self._require()
        return self._version()

    def reset(self) -> None:
        """Restart the robot's program; speeds are zero afterwards."""
        self._require()
        with self._lock:
            self._protected(self._reset)
            self._speed = (0, 0)
            self._last_step = None
            self._counted = None
            self._read = {}

    def send_and_receive(self, message: str) -> str:
        """Send a raw command and return the reply, where the protocol has such.

        Raises:
            ValueError: a command that drives: the watchdog would not know of it.
        """
        self._require("raw")
        if message.lstrip()[:1].upper() == "D":
            raise ValueError(
                f"message = {message!r}; use set_motors_speed, which the watchdog knows of"
            )
        with self._lock:
            answer: str = self._protected(lambda: self._raw(message))
            return answer

    def set_debug(self, debug: bool) -> None:
        """Print every exchange, or no longer."""
        self.debug = debug

    # the rest is common machinery

    def _version(self) -> str:
        return type(self).__name__

    def _reset(self) -> None:
        self._drive(0, 0)

    def _raw(self, message: str) -> str:
        raise NotSupported(message)

    def _set_device(self, device: str, values: tuple[int, ...]) -> None:
        raise NotSupported(device)

    def _device(self, device: str, *values: int) -> None:
        self._require(device)
        with self._lock:
            self._protected(lambda: self._set_device(device, values))
            if device == "motor_position":
                self._counted = None
                if device in self._read:
                    self._read[device] = tuple(float(value) for value in values)
        self._heard = self.clock.now()

    def _check_sensor(self, sensor: str) -> None:
        able = [name for name in SENSORS if name in self.capabilities]
        if sensor not in SENSORS:
            raise ValueError(
                f"unknown sensor {sensor!r}; {type(self).__name__} has {', '.join(able)}"
            )
        if sensor not in able:
            raise NotSupported(f"{type(self).__name__} has no {sensor!r}; it has {', '.join(able)}")

    def _require(self, capability: str | None = None) -> None:
        if capability is not None and capability not in self.capabilities:
            raise NotSupported(
                f"{type(self).__name__} cannot {capability!r}; it can "
                f"{', '.join(sorted(self.capabilities))}"
            )
        if not self._connected:
            raise NotConnected(
                f"{type(self).__name__} is not connected; call connect(), or use it in a with block"
            )

    def reading(self, sensor: str) -> tuple[float, ...]:
        """Return what a sensor read at the last step, by its name."""
        if sensor == "observe":
            self._require("observe")
        if sensor in self._read:
            return self._read[sensor]
        if sensor in SENSORS:
            self._check_sensor(sensor)
            if sensor not in self._enabled:
                raise ValueError(
                    f"{sensor!r} is not enabled; call enable({sensor!r}) and step() first"
                )
        raise ValueError(f"{sensor!r} has not been read yet; call step() first")

    def _guarded(self, sensors: Sequence[str]) -> dict[str, tuple[float, ...]]:
        """Read, once more if the first reply was no good; stop the robot if the second was not
        either.
        """
        found: dict[str, tuple[float, ...]] = self._guarded_twice(lambda: self._exchange(sensors))
        if "motor_position" in found:
            found["motor_position"] = self._count_on(found["motor_position"])
        return found

    def _guarded_twice(self, operation: Any) -> Any:
        """Run an exchange, once more if the first reply was no good; stop the robot if the second
        was not either.
        """
        self._limit(self.clock.now() + PATIENCE_S)
        try:
            return operation()
        except (LinkTimeout, BadReply):
            return self._protected(lambda: self._once_more(operation), again=True)
        except LinkLost as error:
            self._lost()
            error.add_note(MAY_MOVE)
            raise

    def _once_more(self, operation: Any) -> Any:
        self._end_request()
        return operation()

    def _protected(self, operation: Any, *, again: bool = False) -> Any:
        """Run an exchange; on a fault stop the robot where the channel is alive."""
        if not again:
            self._limit(self.clock.now() + PATIENCE_S)
        try:
            return operation()
        except (LinkTimeout, BadReply) as error:
            self._speed = (0, 0)
            try:
                self._halt()
                error.add_note("stop has been sent, and the robot stands")
            except RobotError as second:
                sent = (
                    "was not confirmed"
                    if isinstance(second, (LinkTimeout, BadReply))
                    else "could not be sent"
                )
                error.add_note(f"stop {sent}: {MAY_MOVE}")
                self._lost()
            raise
        except LinkLost as error:
            self._lost()
            error.add_note(MAY_MOVE)
            raise

    def _halt(self) -> None:
        """Stop the robot and make sure of it."""
        if "drive" in self.capabilities:
            guard.stop(self, self.clock)

    def _halt_or_lose(self) -> None:
        """Stop the robot; where that cannot be confirmed the link is given up."""
        try:
            self._halt()
        except RobotError as error:
            self._lost()
            error.add_note(MAY_MOVE)
            raise

    def _lost(self) -> None:
        self._connected = False
        self._speed = (0, 0)
        self._close()
        ends.remove(self)

    def _count_on(self, wire: tuple[float, ...]) -> tuple[float, ...]:
        left, right = (int(value) for value in wire)
        if self._counted is None:
            self._counted = (left, right)
        else:
            a, b = self._counted
            half = WRAP // 2
            self._counted = (
                a + (left - a + half) % WRAP - half,
                b + (right - b + half) % WRAP - half,
            )
        return (float(self._counted[0]), float(self._counted[1]))

    def _stop_silent(self) -> None:
        """Stop a moving robot whose program has said nothing for too long (the watchdog's
        thread).
        """
        if not self._silent():
            return
        with self._lock:
            if not self._silent() or not self._connected:
                return
            self.watchdog_stops += 1
            self._speed = (0, 0)
            quiet = f"the program said nothing for {self.watchdog_s:g} s"
            said = f"{quiet}: the watchdog stopped the robot (robot.sleep lets it drive on)"
            try:
                self._halt()
            except RobotError as error:
                said = f"the watchdog could not stop the robot: {error}; {MAY_MOVE}"
                self._lost()
            guard.tell(said)

    def _silent(self) -> bool:
        assert self.watchdog_s is not None
        return any(self._speed) and self.clock.now() - self._heard > self.watchdog_s
