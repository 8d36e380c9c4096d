"""The task in numbers: a ConvoyConfig as the one record that the compiled loop reads."""

import numpy as np
from numpy.typing import NDArray

from workbench.arena.world import World
from workbench.formation.classical import ControlLaw
from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import TASK
from workbench.formation.reward import PRESETS, terminal_reward
from workbench.learning.behaviour import SCHEDULES
from workbench.learning.config import RULES
from workbench.robot.geometry import STEP as STEP_LENGTH
from workbench.robot.motors import steps_from_speed


def fill_task(config: ConvoyConfig, steps: int, world: World, law: ControlLaw | None = None) -> NDArray[np.void]:
    """Return the (1,) TASK record of a configuration, for runs of a number of updates in a world, or driven by a law."""
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
    plain = {
        "tilings": config.tilings, "actions": config.actions, "right_levels": len(right),
        "middle": config.middle_m, "half_range": config.half_range_m, "limit": config.bearing_limit_rad,
        "sight": config.sight_m, "preset": PRESETS.index(config.reward),
        "terminal_reward": terminal_reward(config.reward, learner.gamma, config.terminal_factor),
        "rule": RULES.index(learner.rule), "kappa": learner.rule == "qrc",
        "alpha": learner.alpha / config.tilings, "beta": learner.beta / config.tilings,
        "gamma": learner.gamma, "lam": learner.lam,
        "cutoff": learner.trace_cutoff, "buffer": learner.buffer, "schedule": SCHEDULES.index(learner.epsilon_schedule),
        "epsilon": learner.epsilon, "epsilon_final": learner.epsilon_final,
        "epsilon_horizon": max(1.0, learner.epsilon_fraction * steps),
        "leader_steps": config.leader_speed_mps / STEP_LENGTH, "column0": world.floor.column0, "row0": world.floor.row0,
        "wheels": world.wheels, "restart": config.reset == "restart",
        "delayed": config.delay_steps > 0,
        "distance_noise": config.noise_distance_m, "bearing_noise": config.noise_bearing_rad,
        "noisy": config.noise_distance_m > 0 or config.noise_bearing_rad > 0,
        "slowest": steps_from_speed(config.wheel_speed_mps[0]), "fastest": steps_from_speed(config.wheel_speed_mps[1]),
    }  # fmt: skip
    for name, value in plain.items():
        task[name] = value
    if law is not None:
        gains = law.gains()
        task["law"], task["gain"][0, : len(gains)] = law.number, gains
    return task
