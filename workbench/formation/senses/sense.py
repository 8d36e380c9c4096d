"""A sensing mode: what a follower is told, how it is compiled into the loop, and what it draws.

A mode is one file beside this one and a row of ``senses.table``; chance of a new kind also needs a
name at the end of ``formation.streams``. The loop calls its compiled functions,
with records of type TASK and ROBOT:

    locate(task, one, formation, i)             before anybody senses, for every robot i of the
                                                ``control.Arrays`` of one formation
    see(task, robots, i, chance)                writes ``robots[i].seen``: distance in m, bearing in
                                                rad; after ``seen.silent`` no reading arrives, the
                                                last one stays
    tiled(task, follower, e_d, o_err)           (inside, first, second): what its tiles are of
    errors(task, follower, e_d, o_err)          (u, v): what its rewards are of, in [-1, 1]
    trimmed(task, follower, e_d, first, second) what is tiled once the integral of the distance
                                                error has gone on, see ``formation.output``
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from workbench.compiled import compiled
from workbench.formation.output import trim_error
from workbench.learning.tiles import Tiling

LEADER = slice(0, 1)
FOLLOWERS = slice(1, None)
EVERYBODY = slice(None)

Values = Mapping[str, Mapping[str, Any]]


class Draw(NamedTuple):
    """Random numbers of every control period: field of CHANCE and its shape, stream, for whom, and
    whether uniform in [0, 1) or standard normal.
    """

    field: str
    shape: tuple[int, ...]
    stream: str
    robots: slice
    uniform: bool = False


@compiled
def nowhere(task: Any, one: Any, formation: Any, i: int) -> None:
    """Note nothing."""


@compiled
def tile_errors(task: Any, follower: Any, e_d: float, o_err: float) -> tuple[bool, float, float]:
    """Return the errors themselves, in m and rad."""
    return True, e_d, o_err


@compiled
def in_bounds(task: Any, follower: Any, e_d: float, o_err: float) -> tuple[float, float]:
    """Return the errors in units of their bounds."""
    return e_d / task.bounds.half_range, o_err / task.bounds.bearing


def _nothing(_: Any) -> None:
    return None


def _no_values(_: Any) -> Values:
    return {}


def _told_noise(config: Any) -> tuple[float, float]:
    return config.noise_distance_m, config.noise_bearing_rad


def _no_age(_: Any) -> float:
    return 0.0


@dataclass(frozen=True)
class Sense:
    """One sensing mode.

    Attributes:
        name: of the mode; tells: what it is, for a list of choices.
        gives: what a follower knows: distance and bearing of its predecessor, its own odometry, and
            more. A learner needs the first two, or readings; laws declare what they need.
        see, locate, tiled, errors, trimmed: compiled, see above.
        units: of both dimensions of the tiles; tilings: of a configuration, None for those of
            errors in m and rad.
        metric: whether what it tiles has metres, so that a place can be filtered and foreseen.
        noise: of a configuration, the spread of what is told, m and rad; age: how old it is, s.
        moving: whether it needs the robots' motion.
        epuck: whether it was measured on e-pucks and fits no other robot.
        see_place: ``see`` for followers that keep places by the leader; None: they cannot.
        needs: what a robot of the API must be capable of.
        draws: what is drawn for it.
        robot, task: fields that it adds to ROBOT and TASK.
        fill: values of its fields of TASK; check: raises ValueError for a configuration that makes
            no sense; equip: what a convoy needs before it starts.
    """

    name: str
    tells: str
    gives: tuple[str, ...]
    see: Any
    locate: Any = nowhere
    tiled: Any = tile_errors
    errors: Any = in_bounds
    trimmed: Any = trim_error
    units: tuple[str, str] = ("m", "rad")
    tilings: Callable[[Any], tuple[Tiling, Tiling]] | None = None
    metric: bool = True
    noise: Callable[[Any], tuple[float, float]] = _told_noise
    age: Callable[[Any], float] = _no_age
    moving: bool = False
    epuck: bool = False
    see_place: Any = None
    needs: str = "observe"
    draws: tuple[Draw, ...] = ()
    robot: tuple[tuple[str, np.dtype[Any]], ...] = ()
    task: tuple[tuple[str, np.dtype[Any]], ...] = ()
    fill: Callable[[Any], Values] = _no_values
    check: Callable[[Any], None] = _nothing
    equip: Callable[[Any], None] = _nothing
