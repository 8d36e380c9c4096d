"""What the command line does with robots: emulate one, drive one, record one.

Contract: each function runs until its time is over or it is interrupted, and leaves the robot
stopped and the recording closed. Robots on a wire have a guardian: they are stopped even if this
program is killed.
"""

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from workbench import fields
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.policy import Policy
from workbench.formation.senses.table import INFRARED, SENSES
from workbench.formation.solo import SoloFollower
from workbench.lab.progress import report
from workbench.lab.storage import read_json, refuse_existing
from workbench.lab.weights import Weights, describe, load_weights, write_weights
from workbench.logs.driving import drive
from workbench.logs.recordings import GROUPS, Recorder
from workbench.robot.api import Robot
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.open import open_robot

_REMEDIES = {  # what a robot must be capable of: what is said where it is not
    "proximity": "read its proximity sensors",
    "observe": "is watched by a camera: use sim:, or learn with infrared",
    "range_bearing": "has a range-and-bearing board: use sim:, or board:PORT",
}


def emulate(
    protocol: str,
    *,
    config: ConvoyConfig | None = None,
    port: int = 0,
    rate: float = 1.0,
    seconds: float = 0.0,
) -> str:
    """Serve an emulated robot, the first follower of a simulated convoy, until interrupted (or for
    some seconds); return its URL.

    Args:
        protocol: see ``workbench.robot.wire.emulator.PROTOCOLS``.
        config: the convoy around it; default: one follower with infrared.
        port: TCP port of an e-puck2, 0 for a free one.
        rate: simulated seconds per second, 0 for lockstep.
    """
    from workbench.formation.simulated import SimulatedRobot
    from workbench.robot.wire.emulator import Emulator

    body = SimulatedRobot(
        config if config is not None else replace(SETTINGS["infrared"], followers=1)
    )
    with Emulator(body, protocol, rate=rate, port=port) as emulator:
        print(
            f"an emulated {protocol} listens (stop it with Ctrl-C) at\n{emulator.url}", flush=True
        )
        until = time.monotonic() + seconds if seconds else float("inf")
        try:
            while time.monotonic() < until:
                time.sleep(0.1)
        except KeyboardInterrupt:
            pass  # that is how it is ended
        return emulator.url


def drive_robot(
    url: str,
    run: str | Path,
    *,
    seconds: float,
    learn: int = 0,
    record: str | Path | None = None,
    real: bool = False,
    out: str | Path | None = None,
    hello: str | Path | None = None,
    change: Callable[[ConvoyConfig], ConvoyConfig] | None = None,
) -> dict[str, Any]:
    """Let a learned follower drive the robot at a URL; return the report.

    Args:
        url: see ``open_robot``.
        run: folder of a run, or of weights that a drive kept; its first table drives.
        seconds: of control.
        learn: updates over which it learns on, 0 to follow greedily.
        record: CSV to write a recording to; real: whether to call it one of a real robot.
        out: folder for the weights as they are in the end, where it learns.
        hello: report of ``hello`` (.json): the follower foresees the delay that was measured.
        change: what to change in the run's configuration, its output for example.

    Raises:
        ValueError: the run's followers see with something that the robot does not have, or were
            driven by a law.
    """
    _check_seconds(seconds)
    if out is not None:
        if learn <= 0:
            raise ValueError(
                f"out = {str(out)!r} with learn = {learn!r}; there is nothing to keep unless "
                "it learns"
            )
        refuse_existing(Path(out))
    weights = load_weights(run)
    learned = weights.learned(run)
    policy = replace(learned, theta=learned.theta[:1])
    config = fields.from_dict(ConvoyConfig, weights.about["config"]).alone()
    config = change(config) if change is not None else config
    if hello is not None:
        config = _foreseeing(config, url, Path(hello))
    options = {"config": config} if url.startswith("sim:") else {}
    with ExitStack() as stack:
        robot = open_robot(url, guardian=True, **options)
        _check_senses(robot, config, url)
        stack.enter_context(robot)
        follower = SoloFollower(config, policy, steps=learn)
        calibration = _calibrate(robot) if config.sensing in INFRARED else "none"
        watch = None
        if record is not None:
            _enable_recorded(robot)
            recorder = Recorder(
                record, robot, link=url, real=real, config=config, calibration=calibration
            )
            watch = stack.enter_context(recorder).watch
        tell = stack.enter_context(_told("drive", seconds, robot))
        try:
            found = drive(robot, follower, seconds=seconds, watch=_telling(watch, tell))
        finally:  # what it has learned is kept, however the drive ended
            if out is not None:
                _keep(follower, Path(out))
        return asdict(found) | {"watchdog_stops": robot.watchdog_stops}


def _telling(watch: Any, tell: Callable[[int], None]) -> Callable[..., None]:
    """Return what is called after every decision: who watches, if somebody does, and the bar."""

    def each(*now: Any) -> None:
        tell(1)
        if watch is not None:
            watch(*now)

    return each


def _periods(seconds: float, robot: Robot) -> int:
    return max(1, round(seconds / (robot.period_s or CONTROL_PERIOD)))  # 0: no wall-clock time


def _told(
    label: str, seconds: float, robot: Robot
) -> AbstractContextManager[Callable[[int], None]]:
    """Return a progress bar over the periods of a drive."""
    return report(True, _periods(seconds, robot), label, unit=" periods")


def _keep(follower: SoloFollower, out: Path) -> None:
    """Write what a follower has learned."""
    out.mkdir(parents=True, exist_ok=True)
    config = follower.config
    secondary = follower.weights[1].reshape(1, config.rows, config.action_count)
    about = describe(follower.policy, config, follower.updates)
    write_weights(out, Weights(follower.policy, secondary, follower.updates, about))


def _foreseeing(config: ConvoyConfig, url: str, report: Path) -> ConvoyConfig:
    """Return a configuration that foresees the delay in a report of ``hello``."""
    if url.startswith("sim:"):
        raise ValueError(
            f"hello = {str(report)!r} with {url!r}; a simulated robot's link has the delay that "
            "its configuration says (body.delay): expected a robot on a wire"
        )
    found = read_json(report)
    if not isinstance(found, dict) or not isinstance(found.get("delay_s"), float):
        raise ValueError(
            f"{report} holds no delay_s; expected a report of `python -m workbench hello URL "
            "--out FILE`"
        )
    told = replace(config.estimate, delay_s=found["delay_s"])
    ahead = "both" if config.prediction == "none" else config.prediction
    return replace(config, prediction=ahead, estimate=told)


def record_emulated(folder: str | Path, *, seconds: float = 30.0) -> list[str]:
    """Record three emulated robots over their real protocols, in real time, as data/recordings/ was
    made; return their names.

    An e-puck1 learns on raw readings over its serial line, one behind an Overo follows greedily, an
    e-puck2 follows on metric ones.
    """
    from workbench.formation.simulated import SimulatedRobot
    from workbench.lab.runs import learn
    from workbench.robot.wire.emulator import Emulator

    names = []
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    base = replace(SETTINGS["infrared"], followers=1, state_tiles=(5, 5), action_levels=(3, 3))
    for name, protocol, sensing, learning in (
        ("emulated_epuck1_learning", "epuck1", "ir-raw", True),
        ("emulated_overo_following", "overo", "ir-raw", False),
        ("emulated_epuck2_following", "epuck2", "ir-metric", False),
    ):
        config = replace(base, sensing=sensing)
        run = learn(replace(config, drive="planar"), steps=60_000, progress=False)
        assert isinstance(run.policy, Policy)
        follower = SoloFollower(config, run.policy, steps=10_000 if learning else 0)
        with (
            Emulator(SimulatedRobot(config.with_seed(7)), protocol) as emulator,
            open_robot(emulator.url) as robot,
        ):
            _enable_recorded(robot)
            calibration = _calibrate(robot)
            recorder = Recorder(
                place / f"{name}.csv",
                robot,
                link=protocol,
                real=False,
                config=config,
                calibration=calibration,
                note=f"emulated: simulated physics behind the {protocol} protocol on a real "
                "wire, in real time; no real robot",
            )
            with recorder:
                drive(robot, follower, seconds=seconds, watch=recorder.watch)
        names.append(f"{name}.csv")
    return names


def record_robot(
    url: str,
    out: str | Path,
    *,
    seconds: float,
    speeds: tuple[int, int] = (0, 0),
    real: bool = False,
) -> dict[str, Any]:
    """Record a robot that stands, or drives at constant speeds in steps/s; return rows and missed
    deadlines.

    Raises:
        ValueError: a recording instead of a robot, speeds beyond the motors' limit, no time.
    """
    _check_seconds(seconds)
    with open_robot(url, guardian=True) as robot:
        if "drive" not in robot.capabilities:
            raise ValueError(
                f"{url} cannot be driven and is a recording already; copy its .csv and .json "
                "instead"
            )
        for speed in speeds:
            if abs(speed) > robot.most_steps:
                raise ValueError(
                    f"speeds = {speeds!r}; expected -{robot.most_steps} to {robot.most_steps} "
                    "steps/s"
                )
        _enable_recorded(robot)
        with Recorder(
            out, robot, link=url, real=real, note="robot driven at constant speeds"
        ) as recorder:
            rows = _periods(seconds, robot)
            with _told("record", seconds, robot) as tell:
                for _ in range(rows):
                    robot.step()
                    robot.set_motors_speed(*speeds)
                    recorder.add(robot.time_s, robot, command=robot.commanded)
                    tell(1)
        late = {
            "missed_deadlines": robot.missed_deadlines,
            "worst_latency_s": robot.worst_latency_s,
        }
        return {"rows": rows, **late, "watchdog_stops": robot.watchdog_stops}


def _check_seconds(seconds: float) -> None:
    if not 0 < seconds < math.inf:
        raise ValueError(f"seconds = {seconds!r}; expected more than 0")


def _enable_recorded(robot: Robot) -> None:
    """Enable everything that a recording has columns for, as far as the robot has it."""
    robot.enable(*(sensor for sensor in GROUPS if sensor in robot.capabilities))


def _calibrate(robot: Robot) -> str:
    if "calibrate" not in robot.capabilities:
        return "none"
    if robot.calibration_s:
        print(
            f"calibrating, for up to {robot.calibration_s:g} s; nothing may stand near", flush=True
        )
    robot.calibrate_proximity_sensors()
    return "mean of 100 readings before the drive"


def _check_senses(robot: Robot, config: ConvoyConfig, url: str) -> None:
    needed = SENSES[config.sensing].needs
    if needed not in robot.capabilities or "drive" not in robot.capabilities:
        lacking = "drive" if needed in robot.capabilities else needed
        raise ValueError(
            f"{url} cannot {lacking!r}; a run with sensing = {config.sensing!r} needs a robot "
            f"that can be driven and {_REMEDIES[needed]}"
        )
