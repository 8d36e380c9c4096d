"""A reward of the user's own, given as one plain Python function:

    def calm(u, v):                          # errors in units of their bounds, both in [-1, 1]
        return -(u * u + 2.0 * v * v)
    learn(config, steps=200_000, reward=calm)

``workbench.functions`` says what such a function may do.

>>> own_reward(lambda u, v: -abs(u)).worst
-1.0
>>> own_reward(lambda u, v: 1.0 / u)
Traceback (most recent call last):
    ...
ValueError: reward '<lambda>' is not finite at u = 0, v = -1; expected a finite number for all u, v
in [-1, 1]
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench import functions
from workbench.formation.config import ConvoyConfig, expect_config
from workbench.formation.reward import OWN

Reward = Callable[[float, float], float]
_GRID = np.linspace(-1.0, 1.0, 101)
_KIND = functions.Kind(
    "reward", "a number", 1, (_GRID, _GRID), "u = {:g}, v = {:g}", "u, v in [-1, 1]"
)


@dataclass(frozen=True)
class OwnReward:
    """A compiled reward.

    Attributes:
        name: of the function.
        sha256: of its values on a grid.
        address: of the compiled function.
        worst: its smallest value on a grid of all u, v in [-1, 1].
    """

    name: str
    sha256: str
    address: int
    worst: float

    def failed_at(self, u: float, v: float) -> str:
        """Return what to say where the reward failed in the loop."""
        return (
            f"reward {self.name!r} is not finite at u = {u:g}, v = {v:g}; expected a finite number "
            "for all u, v in [-1, 1]"
        )


def own_reward(function: Reward) -> OwnReward:
    """Compile a reward r(u, v) of errors in units of their bounds, and look at its values.

    Raises:
        TypeError: it is no function of two numbers that numba can compile.
        ValueError: a value is not finite, or not the same twice.
    """
    [call] = functions.compile_anew(function, _KIND)
    values = functions.look(function, _KIND)
    return OwnReward(
        functions.name_of(function),
        functions.values_sha256(values),
        call.address,
        float(values.min()),
    )


def with_reward(
    config: ConvoyConfig, function: Reward | None
) -> tuple[ConvoyConfig, OwnReward | None]:
    """Return the configuration that says "own" and the compiled reward, or what was given if there
    is no function.
    """
    expect_config(config)
    if isinstance(function, str):
        raise TypeError(
            f"reward = {function!r}; expected a function of u and v: a preset is named by "
            f"ConvoyConfig(reward={function!r})"
        )
    return (
        (config, None) if function is None else (replace(config, reward=OWN), own_reward(function))
    )


def check_reward(config: ConvoyConfig, reward: OwnReward | None, *, learning: bool) -> None:
    """Refuse a function where the configuration says a preset, and learning without one where it
    says "own".

    Raises:
        ValueError: what was given, and what goes together.
    """
    if (reward is not None) != (config.reward == OWN) and (learning or reward is not None):
        given = reward.name if reward is not None else None
        raise ValueError(
            f"ConvoyConfig.reward = {config.reward!r} with the function {given!r}; give one "
            f"with {OWN!r}, only there"
        )


def trouble(robots: NDArray[np.void], owner: Any) -> str:
    """Return what to say where a function of the user's own failed in the loop, "" if none did.

    Args:
        owner: the OwnReward or OwnLaw that is in use.
    """
    at = robots["failure"][robots["failure"]["any"] != 0]["at"]
    return owner.failed_at(*at[0].tolist()) if len(at) else ""
