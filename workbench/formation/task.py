"""The task in numbers: a ConvoyConfig as the one record that the compiled loop reads."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import NOISE, CameraConfig
from workbench.arena.world import motors_of
from workbench.formation.config import CAMERA, INFRARED, ConvoyConfig
from workbench.formation.functions import OwnLaw, OwnReward
from workbench.formation.laws import ControlLaw
from workbench.formation.readings import raw_scales
from workbench.formation.records import TASK
from workbench.formation.reset import search_numbers
from workbench.formation.reward import OWN, PRESETS, terminal_reward, worst_step_reward
from workbench.formation.senses.camera import MODEL, PIXELS
from workbench.learning.behaviour import SCHEDULES
from workbench.learning.rules import RULES
from workbench.robot.description import EPUCK
from workbench.robot.infrared import BEACON_RANGE, RANGE, WARPS, strength_of
from workbench.robot.inversion import FLOOR, inversion_table


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
    robot = config.robot
    _fill_grid(task["grid"], config)
    parts: dict[str, dict[str, Any]] = {
        "grid": {
            "tilings": config.tilings,
            "actions": config.actions,
            "right_levels": config.action_levels[1],
        },
        "bounds": {
            "middle": config.middle_m,
            "half_range": config.half_range_m,
            "bearing": config.bearing_limit_rad,
            "sight": config.sight_m,
        },
        "reward": _reward(config, reward),
        "learner": _learner(config, steps),
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
        "law": _law(config, law),
        "infrared": _sensors(config),
        "camera": _camera(config) if config.sensing in CAMERA else {},
        "body": {
            "any": not config.body.nominal,
            "slip": config.body.slip,
            "delay": config.body.delay,
            "silence": config.body.missed,
        },
        "run": {
            "restart": config.reset == "restart",
            "delayed": config.delay_steps > 0,
            "external": -1,
        },
    }
    if config.sensing in INFRARED:
        parts["infrared"] |= _perception(config)
    for part, values in parts.items():
        for name, value in values.items():
            task[part][name] = value
    return task


def _fill_grid(grid: NDArray[np.void], config: ConvoyConfig) -> None:
    """Write edges of tiles and levels of wheels into a (1,) GRID."""
    rows = 0
    for k, tiles in enumerate(config.grids()):
        for name, tiling in zip(("distance", "bearing"), tiles.tilings, strict=True):
            grid[f"{name}_edges"][0, k, : tiling.n + 1] = tiling.edges
            grid[f"{name}_tiles"][0, k] = tiling.n
        grid["first_row"][0, k] = rows
        rows += tiles.n
    for name, levels in zip(("left_steps", "right_steps"), config.levels(), strict=True):
        grid[name][0, : len(levels)] = levels


def _reward(config: ConvoyConfig, reward: OwnReward | None) -> dict[str, Any]:
    """Return the fields of the reward."""
    own = config.reward == OWN
    if own:
        worst = reward.worst if reward is not None else np.nan
    else:
        worst = worst_step_reward(config.reward)
    return {
        "preset": len(PRESETS) if own else PRESETS.index(config.reward),
        "function": reward.address if reward is not None else 0,
        "terminal": terminal_reward(worst, config.learner.gamma, config.terminal_factor),
    }


def _learner(config: ConvoyConfig, steps: int) -> dict[str, Any]:
    """Return the fields of the learner; step sizes are shared out among the tilings."""
    learner = config.learner
    rule = RULES[learner.rule]
    return {
        "target": rule.target,
        "ratio": rule.ratio,
        "true_online": rule.true_online,
        "kappa": rule.kappa,
        "alpha": learner.alpha / config.tilings,
        "beta": learner.beta / config.tilings,
        "gamma": learner.gamma,
        "lam": learner.lam,
        "cutoff": learner.trace_cutoff,
        "buffer": learner.buffer,
        "schedule": SCHEDULES.index(learner.epsilon_schedule),
        "epsilon": learner.epsilon,
        "epsilon_final": learner.epsilon_final,
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
        found |= {"number": law.number, "gain": [*gains, *[0.0] * (8 - len(gains))]}
    if isinstance(law, OwnLaw):
        found["speed_function"], found["turn_function"] = law.addresses()
    return found


def _camera(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of the overhead camera; what it sees (``window``) is for the camera to fill
    in.
    """
    camera = config.camera
    *noise, missed = NOISE[camera.conditions]
    coarse = (camera.span_m / camera.width_px) / (CameraConfig().span_m / CameraConfig().width_px)
    return {
        "mode": PIXELS if config.sensing == "pixels" else MODEL,
        "latency": camera.latency_s,
        "every": camera.every,
        "missed": 1 - (1 - missed) * (1 - camera.dropout),
        "noise": coarse * np.array(noise),
    }


def _sensors(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of infrared sensors and of what they look at."""
    infrared = config.infrared
    radius, strength, beacon = strength_of(infrared)
    return {
        "radius": radius,
        "strength": strength,
        "beacon": beacon,
        "reach": BEACON_RANGE if beacon else RANGE,
        "spread": infrared.noise / math.sqrt(infrared.samples),
        "age": infrared.age_s,
        "ambient": infrared.ambient_counts,
        "ambient_cos": math.cos(infrared.ambient_direction_rad),
        "ambient_sin": math.sin(infrared.ambient_direction_rad),
        "warp": WARPS.index(infrared.warp),
    }


def _perception(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of a follower that sees with nothing but its infrared."""
    middle, near, far, side = raw_scales(
        config.infrared, config.distance_m, config.bearing_limit_rad, FLOOR
    )
    return {
        "sees": 1,
        "raw": config.sensing == "ir-raw",
        "threshold": config.threshold_counts,
        "table": inversion_table(config.infrared),
        "raw_middle": middle,
        "raw_near": near,
        "raw_far": far,
        "raw_side": side,
    }
