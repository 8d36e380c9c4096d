"""The weights that a convoy begins with."""

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig


def first_weights(
    config: ConvoyConfig, count: int, policy: NDArray[np.float64] | None, *, learning: bool
) -> NDArray[np.float64]:
    """Return the main and secondary weights of ``count`` formations, (count, tables, 2, rows *
    actions): θ₀ and 0, or a policy's.

    Args:
        config: tiles, actions, whose tables, θ₀.
        policy: (tables, rows, actions) main weights, or one such array per formation; None for θ₀.
        learning: whether they will be learned on.

    Raises:
        ValueError: another shape, or weights that are not finite.
    """
    pairs = config.rows * config.action_count
    tables = config.followers if config.weights == "own" else 1
    if policy is None:
        weights = np.zeros((count, tables, 2, pairs))
        weights[:, :, 0] = config.learner.theta0 / config.tilings
        return weights
    given = np.asarray(policy, dtype=np.float64)
    if given.ndim == 3:
        given = np.repeat(given[None], count, axis=0)
    expected = (config.rows, config.action_count)
    if given.ndim != 4 or given.shape[::2] != (count, expected[0]) or given.shape[3] != expected[1]:
        raise ValueError(
            f"policy has shape {np.shape(policy)}; this convoy needs (tables, {expected[0]} "
            f"rows, {expected[1]} actions), "
            f"or one such array for each of {count} seeds"
        )
    if learning and tables == 1 and given.shape[1] != 1:
        raise ValueError(
            f"policy has {given.shape[1]} tables and weights = {config.weights!r} learns one; "
            "give a policy of one table"
        )
    if given.shape[1] not in (1, config.followers):
        raise ValueError(
            f"policy has {given.shape[1]} tables; expected 1, or one for each of "
            f"{config.followers} followers"
        )
    if not np.all(np.isfinite(given)):
        raise ValueError("policy holds weights that are not finite; it cannot be followed")
    if given.shape[1] == 1 and tables > 1:
        given = np.repeat(given, tables, axis=1)
    weights = np.zeros((count, given.shape[1], 2, pairs))
    weights[:, :, 0] = given.reshape(count, given.shape[1], pairs)
    return weights
