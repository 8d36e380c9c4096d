"""Pictures of the arena: without OpenGL always, with it where there is some; both show the same
scene.
"""

import numpy as np

import workbench as wb
from workbench.formation.places import world_of

CONFIG = wb.ConvoyConfig(drive="planar", seed=1)


def _robots(pixels):
    """Return where leader and followers are, by their colours: (2, height, width) flags."""
    red, blue = (pixels[..., k].astype(int) for k in (0, 2))
    return np.stack([red - blue > 60, blue - red > 60])


def test_sensor_cones_lie_on_the_floor_around_the_robots_and_nowhere_else():
    world = world_of(CONFIG)
    plain = wb.picture(world)
    cones = wb.picture(world, sensors=True)
    changed = np.any(plain != cones, axis=-1)
    assert 0.003 < changed.mean() < 0.1
    assert not np.any(changed & _robots(plain).any(axis=0))
    rows, columns = np.nonzero(_robots(plain).any(axis=0))
    there = np.argwhere(changed)
    gap = np.abs(there[:, None, 0] - rows) + np.abs(there[:, None, 1] - columns)
    assert gap.min(axis=1).max() < 40
