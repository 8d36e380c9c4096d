"""The task in numbers: a ConvoyConfig as the one record that the compiled loop reads."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.arena.camera.config import NOISE, CameraConfig
from workbench.arena.world import motors_of
from workbench.formation.config import CAMERA, INFRARED, ConvoyConfig
from workbench.formation.follower import TASK
from workbench.formation.functions import OwnLaw, OwnReward
from workbench.formation.laws import ControlLaw
from workbench.formation.readings import raw_scales
from workbench.formation.reset import search_numbers
from workbench.formation.reward import OWN, PRESETS, terminal_reward, worst_step_reward
from workbench.formation.senses.camera import MODEL, PIXELS
from workbench.learning.behaviour import SCHEDULES
from workbench.learning.config import RULES
from workbench.robot.description import EPUCK
from workbench.robot.infrared import BEACON_RANGE, RANGE, WARPS, strength_of
from workbench.robot.inversion import FLOOR, inversion_table


def fill_task(
    config: ConvoyConfig, steps: int, law: ControlLaw | None = None, reward: OwnReward | None = None
) -> NDArray[np.void]:
    """Return the (1,) TASK record of a configuration, for runs of a number of updates or driven by
    a law.

    With reward = "own" and no function, rewards are NaN: for robots that do not learn.

    Where the floor's raster begins (``column0``, ``row0``) is for the world to fill in.
    """
    task = np.zeros(1, TASK)
    rows = 0
    for k, grid in enumerate(config.grids()):
        for name, tiling in zip(("distance", "bearing"), grid.tilings, strict=True):
            task[f"{name}_edges"][0, k, : tiling.n + 1] = tiling.edges
            task[f"{name}_tiles"][0, k] = tiling.n
        task["first_row"][0, k] = rows
        rows += grid.n
    left, right = config.levels()
    for name, values in (("left_steps", left), ("right_steps", right)):
        task[name][0, : len(values)] = values
    learner = config.learner
    robot = config.robot
    if config.reward == OWN:
        worst = reward.worst if reward is not None else np.nan
    else:
        worst = worst_step_reward(config.reward)
    plain: dict[str, Any] = {
        "tilings": config.tilings,
        "actions": config.actions,
        "right_levels": len(right),
        "middle": config.middle_m,
        "half_range": config.half_range_m,
        "limit": config.bearing_limit_rad,
        "sight": config.sight_m,
        "preset": len(PRESETS) if config.reward == OWN else PRESETS.index(config.reward),
        "own_reward": reward.address if reward is not None else 0,
        "terminal_reward": terminal_reward(worst, learner.gamma, config.terminal_factor),
        "rule": RULES.index(learner.rule),
        "kappa": learner.rule == "qrc",
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
        "leader_steps": config.leader_speed_mps / robot.step_m,
        "restart": config.reset == "restart",
        "delayed": config.delay_steps > 0,
        "distance_noise": config.noise_distance_m,
        "bearing_noise": config.noise_bearing_rad,
        "noisy": config.noisy,
        "noise_at": 3 + config.followers,
        "infrared_at": 3 + config.followers * (3 if config.noisy else 1),
        "external": -1,
        "slowest": robot.steps(config.wheel_speed_mps[0]),
        "fastest": robot.steps(config.wheel_speed_mps[1]),
    }
    plain |= (
        motors_of(robot, config.drive)
        | search_numbers(robot)
        | {
            "step_m": robot.step_m,
            "track_m": robot.track_m,
            "vigour": robot.most_steps / EPUCK.most_steps,
            "ground_x": robot.ground_x_m,
            "ground_y": robot.ground_y,
        }
    )
    plain |= _sensors(config) | {
        "body": not config.body.nominal,
        "slip": config.body.slip,
        "command_delay": config.body.delay,
        "silence": config.body.missed,
        "haste": 1.0 / (1 + 2 * config.body.delay),
    }
    if config.sensing in CAMERA:
        plain |= _camera(config)
    if config.sensing in INFRARED:
        plain |= _perception(config)
    for name, value in plain.items():
        task[name] = value
    if law is not None:
        gains = law.gains()
        task["law"] = law.number
        task["gain"][0, : len(gains)] = gains
        if isinstance(law, OwnLaw):
            task["own_speed"], task["own_turn"] = law.addresses()
    return task


def _camera(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of the overhead camera; what it sees (``cam_view``) is for the camera to
    fill in.
    """
    camera = config.camera
    *noise, missed = NOISE[camera.conditions]
    coarse = (camera.span_m / camera.width_px) / (CameraConfig().span_m / CameraConfig().width_px)
    return {
        "camera": PIXELS if config.sensing == "pixels" else MODEL,
        "cam_latency": camera.latency_s,
        "cam_every": camera.every,
        "cam_missed": 1 - (1 - missed) * (1 - camera.dropout),
        "cam_noise": coarse * np.array(noise),
        "camera_at": 3 + config.followers,
    }


def _sensors(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of infrared sensors and of what they look at."""
    infrared = config.infrared
    radius, strength, beacon = strength_of(infrared)
    return {
        "ir_radius": radius,
        "ir_strength": strength,
        "ir_beacon": beacon,
        "ir_reach": BEACON_RANGE if beacon else RANGE,
        "ir_spread": infrared.noise / math.sqrt(infrared.samples),
        "ir_age": infrared.age_s,
        "ambient": infrared.ambient_counts,
        "ambient_c": math.cos(infrared.ambient_direction_rad),
        "ambient_s": math.sin(infrared.ambient_direction_rad),
        "warp": WARPS.index(infrared.warp),
    }


def _perception(config: ConvoyConfig) -> dict[str, Any]:
    """Return the fields of a follower that sees with nothing but its infrared."""
    middle, near, far, side = raw_scales(
        config.infrared, config.distance_m, config.bearing_limit_rad, FLOOR
    )
    return {
        "infrared": 1,
        "raw": config.sensing == "ir-raw",
        "threshold": config.threshold_counts,
        "ir_table": inversion_table(config.infrared),
        "raw_middle": middle,
        "raw_near": near,
        "raw_far": far,
        "raw_side": side,
    }
