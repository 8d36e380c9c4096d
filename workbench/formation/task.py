"""The task in numbers: a ConvoyConfig as the one record that the compiled loop reads."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import motors_of
from workbench.formation.config import ConvoyConfig
from workbench.formation.estimate import gains
from workbench.formation.graph import MAX_EDGES, worst_step
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.own import OwnLaw
from workbench.formation.laws.table import LAW_NUMBERS
from workbench.formation.output import lattice_fields
from workbench.formation.own_reward import OwnReward
from workbench.formation.records import TASK
from workbench.formation.reset import search_numbers
from workbench.formation.reward import GRAPH, OWN, PRESETS, terminal_reward, worst_step_reward
from workbench.formation.senses.infrared import sensor_fields
from workbench.formation.senses.table import SENSES, numbers
from workbench.formation.shapes import random_reach
from workbench.learning.behaviour import SCHEDULES
from workbench.learning.rules import RULES, UPDATES
from workbench.robot.description import EPUCK
from workbench.robot.geometry import CONTROL_PERIOD


def fill_task(
    config: ConvoyConfig, steps: int, law: ControlLaw | None = None, reward: OwnReward | None = None
) -> NDArray[np.void]:
    """Return the (1,) TASK record of a configuration, for runs of a number of updates or driven by
    a law.

    With reward = "own" and no function, rewards are NaN: for robots that do not learn.

    Where the floor's raster begins (``leader.column0``, ``leader.row0``) is for the world to fill
    in.
    """
    task = np.zeros(1, TASK)
    _fill_grid(task["grid"], task["output"]["lattice"], config)
    parts = _parts(config) | {
        "reward": _reward(config, reward),
        "learner": _learner(config, steps),
        "estimate": _estimate(config),
        "output": {
            "interpolated": config.output == "interpolated",
            "relative": config.actions == "relative",
            "learning": config.learn_by == "output",
            "trim": config.trim,
            "trim_limit": config.trim_limit_m,
        },
        "law": _law(config, law),
        "infrared": sensor_fields(config),
        "sense": numbers(config.sensing, shaped=config.formation.shaped),
        "shape": _shape(config),
        "graph": graph_of(config),
        "run": {
            "restart": config.reset == "restart",
            "delayed": config.delay_steps > 0,
            "external": -1,
            "moving": _moving(config, law),
        },
    }
    # numbers that a record and the configuration call the same
    for part in TASK.names or ():
        source = getattr(config, part, config)
        for name in TASK[part].names or ():
            if isinstance(getattr(source, name, None), (bool, int, float)):
                task[part][name] = getattr(source, name)
    for part, values in (*parts.items(), *SENSES[config.sensing].fill(config).items()):
        for name, value in values.items():
            task[part][name] = value
    return task


def _moving(config: ConvoyConfig, law: ControlLaw | None) -> int:
    """Return of how many robots the motion is needed: with places the leader's, for senses and laws
    everybody's.
    """
    if SENSES[config.sensing].moving or law is not None:
        return config.followers + 1
    return int(config.formation.shaped)


def _parts(config: ConvoyConfig) -> dict[str, dict[str, Any]]:
    """Return the fields of the parts that are plain numbers of the configuration."""
    robot = config.robot
    return {
        "grid": {
            "tilings": config.tilings,
            "actions": config.action_count,
            "right_levels": config.action_levels[1],
        },
        "bounds": {
            "middle": config.middle_m,
            "half_range": config.half_range_m,
            "bearing": config.bearing_limit_rad,
            "sight": config.sight_m,
        },
        "motors": motors_of(robot, config.drive),
        "leader": {
            "speed": config.leader_speed_mps / robot.step_m,
            "vigour": robot.most_steps / EPUCK.most_steps,
            "ground_x": robot.ground_x_m,
            "ground_y": robot.ground_y,
        },
        "search": search_numbers(robot) | {"haste": 1.0 / (1 + 2 * config.body.delay)},
        "noise": {
            "any": config.noisy,
            "distance": config.noise_distance_m,
            "bearing": config.noise_bearing_rad,
        },
        "body": {
            "any": not config.body.nominal,
            "silence": config.body.missed,
        },
    }


def _fill_grid(grid: NDArray[np.void], lattice: NDArray[np.void], config: ConvoyConfig) -> None:
    """Write edges of tiles and levels of wheels into a (1,) GRID and a (1,) LATTICE."""
    for name, value in lattice_fields(config.grids()).items():
        lattice[name][0] = value
    rows = 0
    for k, tiles in enumerate(config.grids()):
        for name, tiling in zip(("distance", "bearing"), tiles.tilings, strict=True):
            grid[f"{name}_edges"][0, k, : tiling.n + 1] = tiling.edges
            grid[f"{name}_tiles"][0, k] = tiling.n
        grid["first_row"][0, k] = rows
        rows += tiles.n
    for name, levels in zip(("left_steps", "right_steps"), config.levels(), strict=True):
        grid[name][0, : len(levels)] = levels


_QUIET_M = 1e-4  # what is expected to be noise where there is none: wheels that turn unevenly
_VELOCITY = 0.3  # gain of the velocity where places are taken as they are read


def _estimate(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of filter and prediction."""
    if not config.estimates:
        return {"any": 0}
    told = config.estimate
    noise_m, noise_rad = SENSES[config.sensing].noise(config)
    along = max(told.noise_distance_m or noise_m, _QUIET_M)
    across = max(config.middle_m * (told.noise_bearing_rad or noise_rad), _QUIET_M)
    alpha, beta = (1.0, 1.0), (_VELOCITY, _VELOCITY)
    if config.filter != "none":
        pairs = (gains(noise, told.acceleration_mps2) for noise in (along, across))
        alpha, beta = zip(*pairs, strict=True)
    return {
        "any": 1,
        "own": config.prediction != "none",
        "both": config.prediction == "both",
        "delay": config.late_s / CONTROL_PERIOD,
        "alpha": alpha,
        "beta": beta,
    }


def _shape(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of the formation's shape; random places are drawn where those of a line and
    of a column may be.
    """
    told = config.formation
    random = told.shape == "random"
    depth, width = random_reach(config.followers, config.spacing_m) if random else (0.0, 0.0)
    return {
        "any": told.shaped,
        "path": told.relative_to == "path",
        "own": told.relative_to == "follower",
        "window": told.window_m,
        "gain": 1.0 - math.exp(-CONTROL_PERIOD / told.smooth_s) if told.smooth_s else 1.0,
        "speed": told.place_speed_mps,
        "acceleration": told.place_acceleration_mps2,
        "clearance": told.clearance_m,
        "hold": told.hold_periods if random else 0,
        "depth": depth,
        "width": width,
    }


def graph_of(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of the reward on distances."""
    edges = config.edges
    ends = np.zeros((MAX_EDGES, 2), np.int64)
    ends[: len(edges)] = np.array(edges, np.int64).reshape(-1, 2)
    return {"count": len(edges), "ends": ends}


def _reward(config: ConvoyConfig, reward: OwnReward | None) -> dict[str, Any]:
    """Return the fields of the reward."""
    preset = config.reward in PRESETS
    return {
        "preset": PRESETS.index(config.reward) if preset else len(PRESETS),
        "function": reward.address if reward is not None else 0,
        "terminal": terminal_of(config, reward),
    }


def terminal_of(config: ConvoyConfig, reward: OwnReward | None = None) -> float:
    """Return the reward of losing the leader."""
    if config.reward == OWN:
        worst = reward.worst if reward is not None else np.nan
    elif config.reward == GRAPH:
        worst = worst_step(config.edges, config.followers + 1)
    else:
        worst = worst_step_reward(config.reward)
    return terminal_reward(worst, config.learner.gamma, config.terminal_factor)


def _learner(config: ConvoyConfig, steps: int) -> dict[str, Any]:
    """Return the fields of the learner; step sizes are shared out among the tilings."""
    learner = config.learner
    rule = RULES[learner.rule]
    return {
        "target": rule.target,
        "ratio": rule.ratio,
        "update": UPDATES.index(rule.update),
        "kappa": rule.kappa,
        "alpha": learner.alpha / config.tilings,
        "beta": learner.beta / config.tilings,
        "cutoff": learner.trace_cutoff,
        "schedule": SCHEDULES.index(learner.epsilon_schedule),
        "epsilon_horizon": max(1.0, learner.epsilon_fraction * steps),
    }


def _law(config: ConvoyConfig, law: ControlLaw | None) -> dict[str, Any]:
    """Return the fields of a classical law, and the range of wheels, which all laws keep to."""
    found: dict[str, Any] = {
        "slowest": config.robot.steps(config.wheel_speed_mps[0]),
        "fastest": config.robot.steps(config.wheel_speed_mps[1]),
    }
    if law is not None:
        gains = law.gains()
        found |= {"number": LAW_NUMBERS[type(law)], "gain": [*gains, *[0.0] * (8 - len(gains))]}
    if isinstance(law, OwnLaw):
        found["speed_function"], found["turn_function"] = law.addresses()
    return found
