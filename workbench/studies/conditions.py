"""Conditions that several studies start from, and how they are varied.

Studies run on the drive that rolls (``studies.drives`` compares it with wheels), 200 000 updates
and a greedy evaluation of 20 simulated minutes each, ten seeds, unless they say otherwise.
"""

from collections.abc import Sequence
from dataclasses import replace

from workbench import fields
from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Labels
from workbench.learning.config import LearnerConfig
from workbench.robot.infrared import InfraredConfig

BASE = ConvoyConfig(drive="rolling")
ROBOT = replace(SETTINGS["paper-robot"], drive="rolling")
LOGARITHMIC = replace(SETTINGS["logarithmic"], drive="rolling")
OTHER = BodyConfig(wheel_spread=0.02, axle_spread=0.02)  # robots that are not alike
HORIZON = 1_000_000  # updates of the study of smoothness, over which ε falls
# how a trial's main numbers are called on axes
GREEDY = {
    "greedy_rms_distance_error_mm": "greedy RMS distance error in mm",
    "greedy_bearing_std_deg": "greedy bearing spread in degrees",
}
LOSSES_AND_GREEDY = {"losses": "losses while learning"} | GREEDY
COMPUTE_TIMES_S = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)


def with_learner(config: ConvoyConfig, **changes: float | str | bool) -> ConvoyConfig:
    """Return a configuration with other fields of its learner."""
    return replace(
        config, learner=fields.from_dict(LearnerConfig, fields.to_dict(config.learner) | changes)
    )


def with_infrared(config: ConvoyConfig, **changes: float | str | bool) -> ConvoyConfig:
    """Return a configuration with other fields of its infrared sensors."""
    return replace(
        config, infrared=fields.from_dict(InfraredConfig, fields.to_dict(config.infrared) | changes)
    )


def routes() -> dict[str, tuple[ConvoyConfig, int]]:
    """Return by which a follower can be told where its predecessor is, and for how many updates."""
    infrared = replace(SETTINGS["infrared"], drive="rolling", followers=1)
    camera = {"camera": (replace(BASE, sensing="camera"), 200_000)}
    return camera | {route: (replace(infrared, sensing=route), 100_000) for route in INFRARED}


def travels() -> Sequence[tuple[Labels, ConvoyConfig, int]]:
    """Return all routes with the paper's large and small table: labels, configuration, updates."""
    return [
        (
            {"route": route, "table": f"{n}×{n}/{m}×{m}"},
            replace(base, state_tiles=(n, n), action_levels=(m, m)),
            steps,
        )
        for route, (base, steps) in routes().items()
        for n, m in ((9, 7), (5, 3))
    ]
