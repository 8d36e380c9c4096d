"""A formation from above."""

import numpy as np
from matplotlib.patches import Circle

import workbench as wb
from workbench.formation.convoy import Convoy
from workbench.formation.shapes import FormationConfig
from workbench.measures.motion import Motion
from workbench.plots.shapes import draw_formation


def test_robots_places_and_virtual_leaders_are_where_they_are():
    track = wb.TrackConfig(shape="eight", radius_m=1.0, judder="none")
    config = wb.ConvoyConfig(
        drive="rolling",
        track=track,
        wheel_speed_mps=(0.0, 0.12),
        formation=FormationConfig(shape="wedge", frame="heading"),
    )
    convoy = Convoy(config, [1], periods=600, policy=wb.LAWS["carrot"](), threads=1)
    motion = Motion.of_steps(convoy.whole(), None, config.robot)
    ax = draw_formation(convoy, motion, virtual=True)
    circles = [patch for patch in ax.patches if isinstance(patch, Circle)]
    assert len(circles) == 5 + 4 + 4
    for robot, circle in enumerate(circles[:5]):
        assert np.allclose(circle.center, motion.position[-1, robot])
    rings, leaders = circles[5::2], circles[6::2]
    for k, (ring, leader) in enumerate(zip(rings, leaders, strict=True), 1):
        apart = np.subtract(leader.center, ring.center)
        assert np.isclose(np.hypot(*apart), config.middle_m)
        assert np.linalg.norm(np.subtract(ring.center, motion.position[-1, k])) < 0.02
    assert [text.get_text() for text in ax.texts] == ["L", "1", "2", "3", "4"]
