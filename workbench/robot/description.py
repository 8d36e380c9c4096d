"""What a robot with two driven wheels is, as one description: sizes, masses and motors. The
defaults are the e-puck's.

A description is a JSON file with any of the fields of ``RobotConfig``. What it leaves out is an
e-puck's, grown with the body: lengths with its radius r, the mass with r³, wheels' masses with the
mass m, moments of inertia with m r²; motor steps stay, so that speeds grow with the wheels.
``most_mps`` says the fastest speed of a wheel in m/s in the place of ``most_steps``, ``source``
what a reader should know of the numbers. Four numbers make a robot:

    {"body_radius_m": 0.09, "wheel_radius_m": 0.03, "track_m": 0.14, "most_mps": 0.4}

``RobotConfig(…)`` itself grows nothing: what it leaves out is as on the e-puck. Files
stand in ``data/robots/``; ``load_robot`` reads one of them by name, or any other
by path.

>>> round(RobotConfig().most_mps, 4), load_robot("epuck") == RobotConfig()
(0.1288, True)

Contract: SI units; x forward, y left, origin on the axle. A description is immutable. What depends
on an e-puck's own parts (infrared response, marker, serial protocols) does not scale: other robots
are sensed by their poses.
"""

import json
import math
from pathlib import Path
from typing import Any

from workbench import fields, paths
from workbench.fields import configuration, integer, real, reals
from workbench.robot import geometry as g
from workbench.robot.geometry import MAX_STEPS, TICKS

_RADII = (0.01, 1.0)


@configuration
class RobotConfig:
    """Sizes, masses and motors of a robot with two driven wheels. What is left out is as on the
    e-puck; in a file (``load_robot``) it grows with the body.
    """

    body_radius_m: float = real(
        *_RADII, "m", "radius of the body seen from above", default=g.BODY_RADIUS
    )
    body_height_m: float = real(0.01, 3.0, "m", "height of the body", default=g.BODY_HEIGHT)
    mass_kg: float = real(0.001, 5000.0, "kg", "mass, wheels included", default=g.BODY_MASS)
    inertia_kg_m2: tuple[float, float, float] = reals(
        1e-8, 10_000.0, "kg m²", "principal moments of inertia about x, y and z", default=g.INERTIA
    )
    wheel_radius_m: float = real(0.005, 1.0, "m", "radius of the wheels", default=g.WHEEL_RADIUS)
    wheel_mass_kg: float = real(0.00005, 500.0, "kg", "mass of each wheel", default=g.WHEEL_MASS)
    track_m: float = real(0.01, 2.0, "m", "distance between the wheels", default=g.TRACK)
    steps_per_turn: int = integer(
        1,
        10**6,
        "",
        "motor steps in one turn of a wheel; commands are steps/s",
        default=g.STEPS_PER_TURN,
    )
    most_steps: int = integer(
        10, 30_000, "steps/s", "fastest command of a wheel", default=MAX_STEPS
    )
    timer_hz: int = integer(
        0,
        10**7,
        "Hz",
        "a stepper driver's clock, whose whole ticks a step lasts; 0: every commanded speed "
        "is reached",
        default=TICKS,
    )
    slider_radius_m: float = real(
        0.001, 0.2, "m", "radius of the passive supports", default=g.SLIDER_RADIUS
    )
    slider_x_m: float = real(
        0.005, 1.0, "m", "distance of the passive supports from the axle", default=g.SLIDER_X
    )
    ground_x_m: float = real(
        0.0, 1.0, "m", "ground sensors in front of the axle", default=g.GROUND_SENSOR_X
    )
    ground_y_m: float = real(
        0.001, 0.5, "m", "outer ground sensors from the middle", default=g.GROUND_SENSOR_Y[0]
    )

    def _check(self) -> None:
        if self.track_m / 2 > self.body_radius_m:
            raise ValueError(
                f"RobotConfig.track_m = {self.track_m!r} with body_radius_m = "
                f"{self.body_radius_m!r}; expected wheels within "
                "the body: a smaller track or a larger body"
            )
        for name in ("wheel_radius_m", "slider_x_m", "ground_x_m", "ground_y_m"):
            if getattr(self, name) > self.body_radius_m:
                raise ValueError(
                    f"RobotConfig.{name} = {getattr(self, name)!r} with body_radius_m = "
                    f"{self.body_radius_m!r}; expected every part within the body"
                )
        if 0 < self.timer_hz < self.most_steps:
            raise ValueError(
                f"RobotConfig.most_steps = {self.most_steps!r} with timer_hz = "
                f"{self.timer_hz!r}; a step lasts at least one "
                "tick: expected a faster timer, or 0 for motors that reach every commanded speed"
            )
        if 2 * self.wheel_mass_kg >= self.mass_kg:
            raise ValueError(
                f"RobotConfig.wheel_mass_kg = {self.wheel_mass_kg!r} with mass_kg = "
                f"{self.mass_kg!r}; expected less than half "
                "of it: the mass has both wheels in it"
            )

        smallest, middle, largest = sorted(self.inertia_kg_m2)
        if smallest + middle < largest * (1 - 1e-9):
            raise ValueError(
                f"RobotConfig.inertia_kg_m2 = {self.inertia_kg_m2!r}; no body has a moment "
                "larger than the sum of the other two: "
                "expected each at most that"
            )

    @property
    def step_m(self) -> float:
        """Rim travel per motor step in m."""
        return 2 * math.pi * self.wheel_radius_m / self.steps_per_turn

    @property
    def most_mps(self) -> float:
        """Fastest speed of a wheel in m/s."""
        return self.most_steps * self.step_m

    @property
    def size(self) -> float:
        """Lengths against the e-puck's, by the body's radius."""
        return self.body_radius_m / g.BODY_RADIUS

    @property
    def ground_y(self) -> tuple[float, float, float]:
        """Places of the left, centre and right ground sensor across the robot, m."""
        return self.ground_y_m, 0.0, -self.ground_y_m

    def steps(self, speed_mps: float) -> int:
        """Convert a rim speed in m/s to the nearest whole command in steps/s.

        Raises:
            ValueError: the speed is not finite or beyond the motors.
        """
        if not math.isfinite(speed_mps) or abs(speed_mps) > self.most_mps * (1 + 1e-9):
            raise ValueError(
                f"speed {speed_mps!r} m/s; this robot's wheels do at most {self.most_mps:.4f} m/s"
            )
        return round(speed_mps / self.step_m)


EPUCK = RobotConfig()


def load_robot(name: str | Path) -> RobotConfig:
    """Read a robot's description: the name of a file in data/robots/ without its ending, or a path.

    Raises:
        FileNotFoundError: no such description; the message lists those there are.
        ValueError: not JSON, or a value out of range.
        TypeError: an unknown field or a value of the wrong type.
    """
    folder = paths.DATA / "robots"
    path = Path(name).expanduser() if str(name).endswith(".json") else folder / f"{name}.json"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in folder.glob("*.json")))
        raise FileNotFoundError(
            f"{path} does not exist; expected a path that ends in .json, or one of: {known}"
        )
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}") from None
    if not isinstance(given, dict):
        raise ValueError(
            f"{path} holds a {type(given).__name__}; expected an object with fields of RobotConfig"
        )
    given.pop("source", None)
    try:
        return fields.from_dict(RobotConfig, _grown(given))
    except (TypeError, ValueError) as error:
        raise type(error)(f"{path}: {error}") from None


_LENGTHS = (
    "body_height_m",
    "wheel_radius_m",
    "track_m",
    "slider_radius_m",
    "slider_x_m",
    "ground_x_m",
    "ground_y_m",
)


def _grown(given: dict[str, Any]) -> dict[str, Any]:
    """Return a description with what it leaves out, grown with the body."""
    size = _against_epuck(given, "body_radius_m")
    if not _RADII[0] / g.BODY_RADIUS <= size <= _RADII[1] / g.BODY_RADIUS:
        known = dict(given)
        known.pop("most_mps", None)
        return known  # the radius itself is refused
    whole = {name: getattr(EPUCK, name) * size for name in _LENGTHS}
    whole["mass_kg"] = EPUCK.mass_kg * size**3
    mass = _against_epuck(whole | given, "mass_kg")
    whole["wheel_mass_kg"] = EPUCK.wheel_mass_kg * mass
    whole["inertia_kg_m2"] = [each * mass * size**2 for each in EPUCK.inertia_kg_m2]
    return _in_steps(whole | given)


def _in_steps(given: dict[str, Any]) -> dict[str, Any]:
    """Return a description with its wheels' fastest speed as motor steps/s.

    Raises:
        ValueError: it is no positive number, or is given twice.
    """
    known = dict(given)
    most = known.pop("most_mps", None)
    if most is None:
        return known
    if "most_steps" in known or not isinstance(most, (int, float)) or not 0 < most < math.inf:
        raise ValueError(
            f"most_mps = {most!r} with most_steps = {known.get('most_steps')!r}; expected one of "
            "them: a wheel's fastest speed in m/s above 0, or in steps/s"
        )
    turns = most / (2 * math.pi * known["wheel_radius_m"])
    known["most_steps"] = round(turns * known.get("steps_per_turn", EPUCK.steps_per_turn))
    return known


def _against_epuck(given: dict[str, Any], name: str) -> float:
    """Return a number against the e-puck's; what is no number is refused by the field itself."""
    value = given.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return 1.0
    return value / getattr(EPUCK, name) if 0 < value < 1e6 else 1.0
