"""Emulated realities: simulated worlds that differ from the nominal one as a real laboratory might,
an honest stand-in for one.

Every world has robots whose sensors, wheels and axles are not matched, ambient light, wheels that
slip, a link that is late by 0 to 3 control periods and loses readings, and a camera with its own
conditions, latency and dropout. How large all this is in reality nobody measured for these robots:
ranges are our assumptions, wide on purpose. Two families are drawn from the same ranges: worlds for
tuning and training may be looked at, worlds for judging only judge.

>>> one = emulated_world(ConvoyConfig(sensing="camera"), 3, family="judging")
>>> again = emulated_world(ConvoyConfig(sensing="camera"), 3, family="judging")
>>> one == again, one.body.delay in range(4)
(True, True)

Contract: a world changes who the robots are and what they meet, never the task: tiles, actions,
speeds and bounds stay. Another seed in the same world is the same robots on another track.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from workbench import fields
from workbench.arena.camera.config import CameraConfig
from workbench.formation.body import BodyConfig
from workbench.formation.config import ConvoyConfig
from workbench.robot.infrared import InfraredConfig

FAMILIES = ("tuning", "judging")
WHEEL_SPREAD = 0.02
AXLE_SPREAD = 0.03
SLIP = (0.0, 0.05)  # share of speed, half-normal spread
MISSED = (0.0, 0.1)  # share of readings
GAIN_SPREAD = (0.1, 0.3)
NOISE = (1.0, 2.0)
AMBIENT = (0.0, 2500.0)  # counts: below what blinds
LATENCY_S = (0.03, 0.1)
DROPOUT = (0.0, 0.1)


def emulated_world(
    config: ConvoyConfig, number: int, *, family: str, delay: int | None = None
) -> ConvoyConfig:
    """Return a configuration in one world of a family; task and seed stay.

    Args:
        config: the nominal one.
        number: of the world, from 0 on.
        family: one of FAMILIES.
        delay: control periods from command to wheels, default what the world has.

    Raises:
        ValueError: an unknown family, a negative number.
    """
    if family not in FAMILIES:
        raise ValueError(f"family = {family!r}; expected one of {', '.join(map(repr, FAMILIES))}")
    if number < 0:
        raise ValueError(f"number = {number!r}; expected a whole number from 0 on")
    rng = np.random.default_rng([number, *family.encode()])
    late = int(rng.integers(0, 4))
    body = BodyConfig(
        wheel_spread=WHEEL_SPREAD,
        axle_spread=AXLE_SPREAD,
        slip=float(rng.uniform(*SLIP)),
        missed=float(rng.uniform(*MISSED)),
        delay=late if delay is None else delay,
    )
    infrared = _changed(
        config.infrared,
        gain_spread=float(rng.uniform(*GAIN_SPREAD)),
        noise=float(rng.uniform(*NOISE)),
        ambient_counts=float(rng.uniform(*AMBIENT)),
        ambient_direction_rad=float(rng.uniform(-math.pi, math.pi)),
    )
    camera: CameraConfig = fields.from_dict(
        CameraConfig,
        fields.to_dict(config.camera)
        | {
            "conditions": str(rng.choice(["clear", "bad"])),
            "latency_s": round(float(rng.uniform(*LATENCY_S)), 3),
            "dropout": float(rng.uniform(*DROPOUT)),
        },
    )
    return replace(
        config, body=body, infrared=infrared, camera=camera, fleet=int(rng.integers(1, 2**31))
    )


def _changed(infrared: InfraredConfig, **changes: float) -> InfraredConfig:
    changed: InfraredConfig = fields.from_dict(InfraredConfig, fields.to_dict(infrared) | changes)
    return changed


def judging_worlds(config: ConvoyConfig, numbers: Iterable[int]) -> pd.DataFrame:
    """Return one line per judging world: what is different there."""
    lines = []
    for number in numbers:
        world = emulated_world(config, number, family="judging")
        body = world.body
        infrared = world.infrared
        camera = world.camera
        lines.append(
            {
                "world": number,
                "commands late (s)": body.delay / 10,
                "slip": body.slip,
                "missed readings": body.missed,
                "gain spread": infrared.gain_spread,
                "noise ×": infrared.noise,
                "ambient (counts)": infrared.ambient_counts,
                "picture": camera.conditions,
                "camera latency (s)": camera.latency_s,
                "markers missed": camera.dropout,
            }
        )
    return pd.DataFrame(lines).set_index("world")
