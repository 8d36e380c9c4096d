"""A steering law of the user's own, given as one plain Python function:

    def chase(distance, bearing):            # m, rad (left positive) of the robot in front
        # forward speed in m/s, turning rate in rad/s (left positive)
        return 0.06 + 2.0 * (distance - 0.15), 4.0 * bearing
    evaluate(OwnLaw(function=chase), config)

``functions`` says what such a function may do.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench import functions
from workbench.compiled import call_at, compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.law import ControlLaw

_KIND = functions.Kind(
    "law",
    "two numbers: speed in m/s, turning rate in rad/s",
    2,
    (np.linspace(0.05, 0.5, 51), np.linspace(-1.5, 1.5, 51)),
    "distance = {:g} m, bearing = {:g} rad",
    "places within the bounds",
)


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω) of the user's function, 0 and a note of the place where it fails."""
    v = call_at(task.law.speed_function, distance, bearing)
    omega = call_at(task.law.turn_function, distance, bearing)
    if math.isfinite(v) and math.isfinite(omega):
        return v, omega
    follower.failure.any = 1
    follower.failure.at[0] = distance
    follower.failure.at[1] = bearing
    return 0.0, 0.0


@dataclass(frozen=True)
class OwnLaw(ControlLaw):
    """A steering law given as a function of distance (m) and bearing (rad, positive where the robot
    in front is to the left): returns speed (m/s) and turning rate (rad/s, positive to the left).

    Commands stay within the learner's range of wheel speeds. Objects can be sent to other processes
    if the function can.

    Raises:
        TypeError: it is no plain function.
    """

    name: ClassVar[str] = "own"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing")
    steer: ClassVar[Any] = staticmethod(steer)

    function: Callable[[float, float], tuple[float, float]]

    def __post_init__(self) -> None:
        functions.plain(self.function, _KIND)

    def gains(self) -> tuple[float, ...]:
        """Return nothing: what the law is stands in its function."""
        return ()

    def check(self, config: ConvoyConfig) -> None:
        """Compile the function; it must give two finite numbers within the bounds.

        Raises:
            TypeError, ValueError: it cannot be compiled; it is not finite somewhere.
        """
        bearings = config.bearing_limit_rad * np.linspace(-1, 1, 51)
        kind = _KIND._replace(axes=(np.linspace(*config.distance_m, 51), bearings))
        functions.compile_anew(self.function, kind)
        functions.look(self.function, kind)

    def addresses(self) -> tuple[int, int]:
        """Return the addresses of the compiled speed and turning rate."""
        speed, turn = functions.last_compiled(self.function, _KIND)
        return speed.address, turn.address

    def failed_at(self, distance: float, bearing: float) -> str:
        """Return what to say where the function failed in the loop."""
        return (
            f"law {functions.name_of(self.function)!r} is not finite at distance = {distance:g} m, "
            f"bearing = {bearing:g} rad; expected two finite numbers there"
        )

    def sha256(self) -> str:
        """Return a hash of the function's values where robots may meet it."""
        calls = functions.compile_anew(self.function, _KIND)
        found = [
            [call.ctypes(x, y) for x in _KIND.axes[0] for y in _KIND.axes[1]] for call in calls
        ]
        return functions.values_sha256(np.array(found))

    def arrays(self) -> Mapping[str, NDArray[np.generic]]:  # type: ignore[override]
        """Refuse: a function is code, and files hold none."""
        raise ValueError(
            "a law of your own is code and is not stored; leave out= out, and keep "
            "run.summary or run.records"
        )
