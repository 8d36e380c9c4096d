"""A learned policy with the description of what its numbers mean: tiles, actions and their units.

A table of action values is only usable with the tilings and action levels that it was learned with; a policy carries
them and refuses to drive anything else.

>>> from workbench.formation.config import ConvoyConfig
>>> config = ConvoyConfig()
>>> policy = Policy.of(config, np.zeros((1, 81, 49)))
>>> policy.check(config)
>>> policy.greedy().shape
(1, 81)

Contract: a policy is immutable; its arrays are read-only copies.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.learning.tiles import TileGrid, Tiling, offset_grids

SCHEMA = 2


@dataclass(frozen=True, eq=False)
class Policy:
    """Action values and their meaning.

    Attributes:
        theta: (tables, rows, actions) main weights; one table for all followers, or one each. With one tiling a row is a
            state; with several, the value of an action is the sum over the active row of each, see ``ConvoyConfig.grids``.
        distance_edges, bearing_edges: borders of the tiles of e_d in m and of o_err in rad.
        left_steps, right_steps: action levels in steps/s; action = i_left * len(right_steps) + i_right.
        tilings: () number of offset tilings.
    """

    theta: NDArray[np.float64]
    distance_edges: NDArray[np.float64]
    bearing_edges: NDArray[np.float64]
    left_steps: NDArray[np.int64]
    right_steps: NDArray[np.int64]
    tilings: NDArray[np.int64] = field(default_factory=lambda: np.array(1))

    def __post_init__(self) -> None:
        for part in fields(self):
            array = np.array(getattr(self, part.name))
            array.flags.writeable = False
            object.__setattr__(self, part.name, array)
        rows = sum(grid.n for grid in self._grids())
        expected = (rows, self.left_steps.size * self.right_steps.size)
        if self.theta.ndim != 3 or self.theta.shape[1:] != expected:
            raise ValueError(
                f"theta has shape {self.theta.shape}; its tiles and levels ask for (tables, {expected[0]}, {expected[1]})"
            )

    def _grids(self) -> tuple[TileGrid, ...]:
        grid = TileGrid(Tiling(self.distance_edges, "of a policy"), Tiling(self.bearing_edges, "of a policy"))
        return offset_grids(grid, int(self.tilings))

    @classmethod
    def of(cls, config: ConvoyConfig, theta: NDArray[np.float64]) -> "Policy":
        """Return the policy of weights that were learned under a configuration."""
        distance, bearing = config.grid().tilings
        return cls(theta, distance.edges, bearing.edges, *config.levels(), np.array(config.tilings))

    def values(self) -> NDArray[np.float64]:
        """Return the action values in the middle of every state, (tables, states, actions); with one tiling that is theta.

        Where an offset tiling has an edge in the middle of a state, its upper cell counts, as it does for a follower there.
        """
        base, *others = self._grids()
        total = self.theta[:, : base.n].copy()
        first = base.n
        for grid in others:
            rows = [first + grid.index(*base.centre(state)) for state in range(base.n)]
            total += self.theta[:, rows]
            first += grid.n
        return total

    def greedy(self) -> NDArray[np.int64]:
        """Return the greedy action in the middle of every state, (tables, states), the lowest index on ties."""
        greedy: NDArray[np.int64] = np.argmax(self.values(), axis=2)
        return greedy

    def check(self, config: ConvoyConfig) -> None:
        """Refuse a configuration whose tiles or actions differ.

        Raises:
            ValueError: what differs, with both sides.
        """
        own = Policy.of(config, np.zeros((1, config.rows, config.actions)))
        for part in fields(self)[1:]:
            mine, theirs = getattr(self, part.name), getattr(own, part.name)
            if not np.array_equal(mine, theirs):
                raise ValueError(
                    f"{part.name} of the policy are {mine.tolist()}, of the configuration {theirs.tolist()}; "
                    "use the configuration that the policy was learned with"
                )
        if self.theta.shape[0] not in (1, config.followers):
            raise ValueError(
                f"the policy has {self.theta.shape[0]} tables, the convoy {config.followers} followers; expected one table "
                "for all, or one each"
            )

    def sha256(self) -> str:
        """Return a hash of everything that the policy holds."""
        digest = hashlib.sha256()
        for part in fields(self):
            array = getattr(self, part.name)
            digest.update(f"{part.name}{array.shape}".encode() + array.tobytes())
        return digest.hexdigest()

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the policy as plain arrays, for a file."""
        return {"schema": np.array(SCHEMA)} | {part.name: getattr(self, part.name) for part in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> "Policy":
        """Read what ``arrays`` wrote.

        Raises:
            ValueError: another schema, or an array is missing.
        """
        missing = [part.name for part in fields(cls) if part.name not in arrays]
        if missing or int(arrays.get("schema", np.array(-1))) != SCHEMA:
            raise ValueError(
                f"not a policy of schema {SCHEMA}: schema {arrays.get('schema', 'missing')}, missing arrays {missing}"
            )
        return cls(**{part.name: arrays[part.name] for part in fields(cls)})  # type: ignore[arg-type]
