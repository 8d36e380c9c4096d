"""Angles."""

import math

from workbench.compiled import compiled


@compiled
def wrap(angle: float) -> float:
    """Return an angle in rad within [-π, π]."""
    return math.atan2(math.sin(angle), math.cos(angle))
