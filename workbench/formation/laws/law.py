"""What all classical laws have in common: declarations, memory, and the way to the wheels.

A law is a configuration (its gains) and one compiled function,

    steer(task, follower, distance, bearing) -> (v, ω)       m, rad → m/s, rad/s

with records of type TASK and ROBOT. Unicycle: v = (v_L + v_R) / 2, ω = (v_R - v_L) / b. The law's
(v, ω) becomes two wheel speeds within the learner's own range, in whole steps/s; where a wheel
would leave the range both are shifted, so that the turn is kept as long as possible.

Contract: laws are immutable; a law writes only its memory in the follower's record; every episode
begins with an empty memory.
"""

import hashlib
import json
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.compiled import compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.breadcrumbs import BREADCRUMBS
from workbench.robot.geometry import CONTROL_PERIOD

SCHEMA = 1

SEEN_LEADER = np.dtype(  # m, rad, m/s, rad/s
    [
        ("distance", "f8"),
        ("bearing", "f8"),
        ("heading", "f8"),
        ("speed", "f8"),
        ("turn", "f8"),
    ]
)
LAW = np.dtype(
    [
        (
            "ahead_heading",
            "f8",
        ),  # what is known of the predecessor: rad relative to own, m/s, rad/s
        ("ahead_speed", "f8"),
        ("ahead_turn", "f8"),
        ("leader", SEEN_LEADER),  # where the leader itself is, with a shape
        ("left", "i8"),  # the last command, steps/s
        ("right", "i8"),
        ("integral", "f8"),  # of the distance error, m s
        ("way", BREADCRUMBS),
    ]
)
LAW_TASK = np.dtype(
    [
        ("number", "i8"),  # of ``laws.table``, 0 where a table of weights decides
        ("gain", "f8", (8,)),
        ("slowest", "f8"),  # steps/s of a wheel
        ("fastest", "f8"),
        ("speed_function", "i8"),  # addresses of the user's functions
        ("turn_function", "i8"),
    ]
)


class ControlLaw:
    """What all laws have in common.

    Attributes:
        name: the law's name on the command line and in files.
        needs: the information that it is given, words of ``senses.table.SENSING``.
        steer: the compiled function.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]]
    steer: ClassVar[Any]

    def gains(self) -> tuple[float, ...]:
        """Return the law's numbers in the order of its fields."""
        return tuple(float(value) for value in fields.to_dict(self).values())

    def check(self, config: ConvoyConfig) -> None:
        """Refuse a configuration for which the law's own numbers make no sense; what it needs to be
        told is compared by ``laws.table.check_law``.
        """

    def sha256(self) -> str:
        """Return a hash of the law and its gains."""
        return hashlib.sha256(json.dumps([self.name, fields.to_dict(self)]).encode()).hexdigest()

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the law as plain arrays, for a file."""
        return {
            "law_schema": np.array(SCHEMA),
            "law": np.array(self.name),
            "gains": np.array(json.dumps(fields.to_dict(self))),
        }


@compiled
def pace(task: Any, follower: Any, error: float) -> float:
    """Return the forward speed of a PI control of the distance, whose integral stops where the
    wheels' range ends.
    """
    v: float = task.law.gain[0] * error + task.law.gain[1] * follower.law.integral
    if (v < task.law.fastest * task.motors.step_m or error < 0.0) and (
        v > task.law.slowest * task.motors.step_m or error > 0.0
    ):
        follower.law.integral += error * CONTROL_PERIOD
    return v


@compiled
def wheels(task: Any, follower: Any, v: float, omega: float) -> tuple[int, int]:
    """Return wheel commands for (v, ω) within the range of the learner's levels, the turn kept as
    long as possible.
    """
    law = follower.law
    slowest = task.law.slowest
    fastest = task.law.fastest
    left = (v - omega * task.motors.track_m / 2) / task.motors.step_m
    right = (v + omega * task.motors.track_m / 2) / task.motors.step_m
    shift = min(0.0, fastest - max(left, right)) + max(0.0, slowest - min(left, right))
    law.left = int(round(min(max(left + shift, slowest), fastest)))
    law.right = int(round(min(max(right + shift, slowest), fastest)))
    return law.left, law.right
