"""Getting to know a robot: what it is, how fast it answers, whether its lights and wheels do what
they are told. The report is the acceptance test of the day.

    python -m workbench robots
    python -m workbench hello serial:/dev/rfcomm0 --move

The measured delay, from a command to the first reading after it, is what a predictor of late
commands needs.

Contract: nothing moves unless ``move`` says so; the robot stands afterwards.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from workbench.lab.storage import write_json
from workbench.robot.api import Robot
from workbench.robot.faults import RobotError
from workbench.robot.geometry import STEP, TRACK
from workbench.robot.open import open_robot
from workbench.robot.wire.epuck1 import SerComRobot
from workbench.robot.wire.sercom import variant_of

EXCHANGES = 50  # readings that delay and rate are measured on
SPEED = 300  # steps/s
DISTANCE_M = 0.05
TURN_RAD = math.pi / 2
TOLERANCE = 0.1  # relative, of step counters against what was asked for


def list_robots() -> list[dict[str, str]]:
    """Return the serial ports of this computer, and what answers at each."""
    from serial.tools import list_ports

    found = []
    for port in list_ports.comports():
        answer = "nothing that speaks SerCom"
        for scheme in ("serial", "overo"):
            try:
                with open_robot(f"{scheme}:{port.device}", watchdog_s=None) as robot:
                    answer = robot.version.replace("\n", "; ")
                break
            except RobotError:
                continue
        found.append({"url": f"serial:{port.device}", "port": port.description, "answers": answer})
    return found


def hello(url: str, *, move: bool = False, out: str | Path | None = None) -> dict[str, Any]:
    """Meet a robot; return the report, and write it to ``out`` (a .json).

    Args:
        url: see ``open_robot``.
        move: drive 5 cm straight on, then turn by 90° to the left.
    """
    with open_robot(url, guardian=True) as robot:
        report: dict[str, Any] = {"url": url, "version": robot.version}
        kinds = _variant(robot)
        if not kinds:
            report |= _meet(robot, move)
    if kinds:  # it was taken for another
        report |= {name: f"{kind}: open_robot(…, {name}={kind!r})" for name, kind in kinds.items()}
        with open_robot(url, guardian=True, **kinds) as robot:
            report |= _meet(robot, move)
    if out is not None:
        write_json(Path(out), report)
        report["written"] = str(out)
    return report


def _meet(robot: Robot, move: bool) -> dict[str, Any]:
    """Return battery, times and lights of a robot, and what its wheels did if they may move."""
    found = _battery(robot) | _timing(robot) | {"lights": _blink(robot)}
    return found | (_drive(robot) if move else {})


def _variant(robot: Robot) -> dict[str, str]:
    """Return which SerCom a robot speaks by its own word, where it was taken for another."""
    if not isinstance(robot, SerComRobot):
        return {}
    right = variant_of(robot.version, variant=robot.variant.name)
    return {} if right == robot.variant.name else {"variant": right}


def _battery(robot: Robot) -> dict[str, Any]:
    if "battery" not in robot.capabilities:
        return {"battery": None}
    robot.enable("battery")
    robot.step()
    level = robot.get_battery()[0]
    robot.disable("battery")
    return {"battery": level}


def _timing(robot: Robot) -> dict[str, float]:
    """Return how long an exchange takes: a command and a reading of the ring."""
    robot.enable("proximity")
    before = robot.period_s
    robot.period_s = 0.0
    taken = []
    for _ in range(EXCHANGES):
        begun = robot.clock.now()
        robot.set_motors_speed(0, 0)
        robot.step()
        taken.append(robot.clock.now() - begun)
    robot.period_s = before
    return {
        "delay_s": float(np.median(taken)),
        "delay_p95_s": float(np.quantile(taken, 0.95)),
        "rate_hz": float(1 / max(np.median(taken), 1e-9)),
    }


def _blink(robot: Robot) -> list[str]:
    """Let every light blink once; return which there are."""
    lights = []
    if "led" in robot.capabilities:
        for led in range(8):
            robot.set_led(led, 1)
            robot.sleep(0.1)
            robot.set_led(led, 0)
        lights.append("ring")
    for name in ("body_led", "front_led"):
        if name in robot.capabilities:
            turn = getattr(robot, f"set_{name}")
            turn(1)
            robot.sleep(0.2)
            turn(0)
            lights.append(name.removesuffix("_led"))
    return lights


def _drive(robot: Robot) -> dict[str, Any]:
    """Drive straight on, then turn to the left; return what the step counters say."""
    straight = _counted(robot, SPEED, SPEED, DISTANCE_M / STEP / SPEED)
    turned = _counted(robot, -SPEED, SPEED, TURN_RAD * TRACK / 2 / STEP / SPEED)
    driven = float(np.mean(straight)) * STEP
    angle = float(turned[1] - turned[0]) * STEP / TRACK
    good = abs(driven / DISTANCE_M - 1) < TOLERANCE and abs(angle / TURN_RAD - 1) < TOLERANCE
    return {
        "driven_m": driven,
        "turned_deg": math.degrees(angle),
        "wheels_as_told": bool(good),
    }


def _counted(robot: Robot, left: int, right: int, seconds: float) -> tuple[float, float]:
    """Drive for some time; return how many steps each wheel made."""
    robot.enable("motor_position")
    robot.step()
    left_begin, right_begin = robot.get_motor_position()
    robot.set_motors_speed(left, right)
    robot.sleep(seconds)
    robot.stop()
    robot.step()
    left_end, right_end = robot.get_motor_position()
    return left_end - left_begin, right_end - right_begin
