"""Classical followers as drop-in policies: ``evaluate(CarrotPI(), config)`` drives the same robots
as a learned policy does.

A law runs inside the one follower (``formation.follower``): the same senses, noise, control period,
wheel range, firmware quantisation, terminals and reset manoeuvre as a learner. What differs is
declared: ``needs`` names the information it is given, and a sensing mode that lacks it is refused.
Noise is on distance and bearing, for learners and laws alike; what a law is told beyond that
(heading, speed, turning rate: over the last control period) is exact. Its commands are whole
steps/s, not the learner's few levels: ``quantised_carrot`` is a classical law within the learner's
own tiles and actions.

>>> CarrotPI(k_bearing=3.0).gains()
(2.0, 0.5, 3.0)
>>> check_law(LPsi(), ConvoyConfig(sensing="truth-relative"))
Traceback (most recent call last):
    ...
ValueError: law 'l-psi' needs the predecessor's heading, speed, turning rate, which sensing =
'truth-relative' does not give (it gives: distance, bearing, odometry); use sensing = 'truth' or
'range-and-bearing', or a law that needs less: carrot, pursuit, path

Default gains are our choice: plain values with time constants of a quarter of a second to a second,
not optimised on any study's tracks. A law of one's own is a file beside this one and a row here.
"""

import inspect
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.compiled import chosen, compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.laws.l_psi import LPsi
from workbench.formation.laws.law import SCHEMA, ControlLaw, wheels
from workbench.formation.laws.leader_frame import LeaderFrame
from workbench.formation.laws.outside import Outside
from workbench.formation.laws.own import OwnLaw
from workbench.formation.laws.path import PathReconstruction
from workbench.formation.laws.pursuit import PurePursuit
from workbench.formation.policy import Policy
from workbench.formation.senses.table import SENSING

# the laws that have a name in files and on the command line
LAWS = fields.Named[type[ControlLaw]](
    {law.name: law for law in (CarrotPI, LeaderFrame, LPsi, PurePursuit, PathReconstruction)}
)
Controller = Policy | ControlLaw

_STEERING: tuple[type[ControlLaw], ...] = (*LAWS.values(), OwnLaw)
OUTSIDE = len(_STEERING) + 1
LAW_NUMBERS = {law: number for number, law in enumerate((*_STEERING, Outside), 1)}  # 0: no law

_steer = chosen([law.steer for law in _STEERING])


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[int, int]:
    """Return a law's wheel commands in whole steps/s.

    Args:
        task: TASK record: ``law``, ``bounds.middle`` (d*, m), ``motors``.
        follower: ROBOT record; its ``choice.state`` is -1 where an episode begins.
        distance, bearing: of the predecessor, m and rad.
    """
    if task.law.number == OUTSIDE:
        return 0, 0
    if follower.choice.state < 0:
        follower.law.integral = 0.0
        follower.law.way.count = 0
        follower.law.way.x = follower.law.way.y = follower.law.way.heading = 0.0
    v, omega = _steer(task.law.number - 1, task, follower, distance, bearing)
    return wheels(task, follower, v, omega)


def check_law(law: ControlLaw, config: ConvoyConfig) -> None:
    """Refuse a configuration whose sensing does not give what a law needs, or that its own numbers
    do not suit.

    Raises:
        ValueError: what is missing, what there is, and which laws would do.
    """
    given = SENSING[config.sensing]
    missing = [need for need in law.needs if need not in given]
    if missing:
        modes = [mode for mode, gives in SENSING.items() if set(law.needs) <= set(gives)]
        enough = [other.name for other in LAWS.values() if set(other.needs) <= set(given)]
        less = f"or a law that needs less: {', '.join(enough)}"
        raise ValueError(
            f"law {law.name!r} needs the predecessor's {', '.join(missing)}, which "
            f"sensing = {config.sensing!r} does not give (it gives: {', '.join(given)}); use "
            f"sensing = {' or '.join(map(repr, modes))}, "
            f"{less if enough else 'no law does with less'}"
        )
    law.check(config)


def check_controller(policy: object) -> None:
    """Raise TypeError unless something can drive followers, with a hint for the likely mistakes."""
    if isinstance(policy, (Policy, ControlLaw)):
        return
    named = policy if isinstance(policy, str) else getattr(policy, "name", "carrot")
    remedy = f"a law with its gains, such as LAWS[{named!r}]()"
    if isinstance(policy, (str, Path)) and Path(policy).exists():
        remedy = f"load_run({str(policy)!r})"
    elif callable(getattr(policy, "act", None)):
        remedy = "evaluate_own(object, config) for an object with act"
    elif inspect.isfunction(policy):
        remedy = "OwnLaw(function=…) for a function of distance and bearing"
    raise TypeError(f"policy = {policy!r}; expected a run, its policy (run.policy), or {remedy}")


def controller_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Controller:
    """Read a policy or a law from what its ``arrays`` wrote.

    Raises:
        ValueError: it is neither, or of another schema.
    """
    if "law" not in arrays:
        return Policy.from_arrays(arrays)
    name = str(arrays["law"])
    if (
        name not in LAWS
        or int(arrays.get("law_schema", np.array(-1))) != SCHEMA
        or "gains" not in arrays
    ):
        raise ValueError(
            f"not a control law of schema {SCHEMA}: {name!r}; expected one of {', '.join(LAWS)}"
        )
    return fields.from_dict(LAWS[name], json.loads(str(arrays["gains"])))


def quantised_carrot(
    config: ConvoyConfig, *, k_distance: float = 2.0, k_bearing: float = 4.0
) -> Policy:
    """Return the carrot law as a table on a configuration's own tiles and actions.

    In the middle of every tile it takes the action whose wheel speeds are nearest to v = v_leader +
    k_d e_d, ω = k_φ φ. A table has no integral: the leader's constant speed is given instead. With
    several tilings: nearest to the mean of all active tiles.

    Args:
        config: tiles, levels and the leader's speed.
        k_distance, k_bearing: gains, 1/s.
    """
    left, right = (levels.astype(float) for levels in config.levels())
    rows = np.array(
        [grid.centre(cell) for grid in config.grids() for cell in range(grid.n)]
    )  # (rows, 2): e_d in m, φ in rad
    ahead = 0.0 if config.actions == "relative" else config.leader_speed_mps
    v, omega = ahead + k_distance * rows[:, 0], k_bearing * rows[:, 1]
    wanted = (
        np.stack(
            [v - omega * config.robot.track_m / 2, v + omega * config.robot.track_m / 2], axis=1
        )
        / config.robot.step_m
    )
    gap = (wanted[:, 0, None, None] - left[:, None]) ** 2 + (
        wanted[:, 1, None, None] - right[None, :]
    ) ** 2
    return Policy.of(config, -gap.reshape(1, config.rows, config.action_count))
