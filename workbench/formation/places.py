"""Tracks and worlds of a configuration, for looking at: without learning, sensors or chance beyond
the track's.
"""

import numpy as np
from numpy.typing import NDArray

from workbench.arena.tracks import Track, make_track
from workbench.arena.world import World
from workbench.formation.config import ConvoyConfig
from workbench.formation.streams import children


def world_of(config: ConvoyConfig) -> World:
    """Return a world of one formation on its own track, lined up."""
    return World(
        config.followers,
        [track_of(config)],
        drive=config.drive,
        spacing_m=config.middle_m,
        line_width_m=config.track.line_width_m,
        robot=config.robot,
    )


def still_world(config: ConvoyConfig, poses: NDArray[np.void]) -> World:
    """Return ``world_of`` a configuration with the robots where one row of step records (PERIOD)
    has them.
    """
    world = world_of(config)
    for robot, pose in enumerate(poses):
        world.place(0, robot, float(pose["x"]), float(pose["y"]), float(pose["heading"]))
    return world


def track_of(config: ConvoyConfig, rng: np.random.Generator | None = None) -> Track:
    """Return the track that a formation of this configuration drives on, drawn from its seed unless
    a generator is given.
    """
    chance = rng if rng is not None else children(config.seed)["track"]
    return make_track(config.track, chance, convoy_length_m=config.followers * config.middle_m)
