"""A learned policy with the description of what its numbers mean: tiles, actions, their units, and
how it was sensed.

A table of action values is only usable with the tilings, action levels and sensing that it was
learned with; a policy carries them and refuses to drive anything else. ``transferred`` takes it to
another sensing on purpose, where the units are the same.

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
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.senses.table import SENSES, SENSING
from workbench.learning.tiles import TileGrid, Tiling, offset_grids

SCHEMA = 3
UNITS = {row.name: row.units for row in SENSES.values()}  # of both dimensions of the state


@dataclass(frozen=True, eq=False)
class Policy:
    """Action values and their meaning.

    Attributes:
        theta: (tables, rows, actions) main weights; one table for all followers, or one each. With
            one tiling a row is a state; with several, the value of an action is the sum over the
            active row of each, see ``ConvoyConfig.grids``.
        distance_edges, bearing_edges: borders of the tiles of e_d in m and of o_err in rad; with
            sensing "ir-raw" of the left and the right reading in counts.
        left_steps, right_steps: action levels in steps/s; action = i_left * len(right_steps) +
            i_right.
        tilings: () number of offset tilings.
        sensing: () how distance and bearing were known, one of SENSING.
        kind: () what the levels are, one of ``output.ACTIONS``.
    """

    theta: NDArray[np.float64]
    distance_edges: NDArray[np.float64]
    bearing_edges: NDArray[np.float64]
    left_steps: NDArray[np.int64]
    right_steps: NDArray[np.int64]
    tilings: NDArray[np.int64] = field(default_factory=lambda: np.array(1))
    sensing: NDArray[np.str_] = field(default_factory=lambda: np.array("truth"))
    kind: NDArray[np.str_] = field(default_factory=lambda: np.array("wheels"))

    def __post_init__(self) -> None:
        for part in fields(self):
            array = np.array(getattr(self, part.name))
            array.flags.writeable = False
            object.__setattr__(self, part.name, array)
        if str(self.sensing) not in SENSING:
            raise ValueError(
                f"sensing = {str(self.sensing)!r}; expected one of {', '.join(map(repr, SENSING))}"
            )
        if not np.all(np.isfinite(self.theta)):
            raise ValueError("theta holds weights that are not finite; nothing can follow them")
        rows = sum(grid.n for grid in self.grids())
        expected = (rows, self.left_steps.size * self.right_steps.size)
        if self.theta.ndim != 3 or self.theta.shape[1:] != expected:
            raise ValueError(
                f"theta has shape {self.theta.shape}; its tiles and levels ask for (tables, "
                f"{expected[0]}, {expected[1]})"
            )

    def __repr__(self) -> str:
        """Say what it maps from and to."""
        first, second = (len(edges) - 1 for edges in (self.distance_edges, self.bearing_edges))
        tilings = f", {int(self.tilings)} tilings" if self.tilings > 1 else ""
        left, right = self.left_steps.size, self.right_steps.size
        return (
            f"Policy({first}×{second} tiles{tilings}, {left}×{right} actions, "
            f"{self.theta.shape[0]} tables, sensing {str(self.sensing)!r})"
        )

    def _repr_html_(self) -> str:
        """Show the best value of every tile of the first tiling, from worst to best."""
        from workbench import markup

        shape = (len(self.distance_edges) - 1, len(self.bearing_edges) - 1)
        best = self.theta.max(axis=2)[:, : shape[0] * shape[1]]
        low, high = best.min(), best.max()
        scaled = 0.02 + 0.98 * (best - low) / (high - low if high > low else 1.0)
        words = f"best value, {low:.2f} to {high:.2f}"
        maps = markup.heats(scaled.reshape(-1, *shape), f"table {{}}: {words}")
        return markup.table([], repr(self)) + maps

    def grids(self) -> tuple[TileGrid, ...]:
        """Return the offset grids whose cells are the rows of a table, as
        ``ConvoyConfig.grids``.
        """
        grid = TileGrid(
            Tiling(self.distance_edges, "of a policy"), Tiling(self.bearing_edges, "of a policy")
        )
        return offset_grids(grid, int(self.tilings))

    @classmethod
    def of(cls, config: ConvoyConfig, theta: NDArray[np.float64]) -> "Policy":
        """Return the policy of weights that were learned under a configuration."""
        distance, bearing = config.grid().tilings
        return cls(
            theta,
            distance.edges,
            bearing.edges,
            *config.levels(),
            np.array(config.tilings),
            np.array(config.sensing),
            np.array(config.actions),
        )

    @property
    def units(self) -> tuple[str, str]:
        """Units of the two dimensions of the state."""
        return UNITS[str(self.sensing)]

    def transferred(self, sensing: str) -> "Policy":
        """Return the same weights for robots that sense otherwise: a claim that distance and
        bearing mean the same there (E8).

        Raises:
            ValueError: an unknown sensing, or one whose tiles have other units.
        """
        if sensing not in SENSING:
            raise ValueError(
                f"sensing = {sensing!r}; expected one of {', '.join(map(repr, SENSING))}"
            )
        if UNITS[sensing] != self.units:
            raise ValueError(
                f"the policy was learned with sensing = {str(self.sensing)!r}, tiles in "
                f"{' and '.join(self.units)}; {sensing!r} "
                f"has tiles in {' and '.join(UNITS[sensing])}: learn anew, no weights can "
                "mean the same there"
            )
        return replace(self, sensing=np.array(sensing))

    def values(self) -> NDArray[np.float64]:
        """Return the action values in the middle of every state, (tables, states, actions); with
        one tiling that is theta.

        Where an offset tiling has an edge in the middle of a state, its upper cell counts, as it
        does for a follower there.
        """
        base, *others = self.grids()
        total = self.theta[:, : base.n].copy()
        first = base.n
        for grid in others:
            rows = [first + grid.index(*base.centre(state)) for state in range(base.n)]
            total += self.theta[:, rows]
            first += grid.n
        return total

    def greedy(self) -> NDArray[np.int64]:
        """Return the greedy action in the middle of every state, (tables, states), the lowest index
        on ties.
        """
        greedy: NDArray[np.int64] = np.argmax(self.values(), axis=2)
        return greedy

    def check(self, config: ConvoyConfig) -> None:
        """Refuse a configuration whose tiles, actions or sensing differ.

        Raises:
            ValueError: what differs, with both sides.
        """
        own = Policy.of(config, np.zeros((1, config.rows, config.action_count)))
        for name in (
            "sensing",
            "tilings",
            "distance_edges",
            "bearing_edges",
            "kind",
            "left_steps",
            "right_steps",
        ):
            mine = getattr(self, name)
            theirs = getattr(own, name)
            if not np.array_equal(mine, theirs):
                remedy = "use the configuration that the policy was learned with"
                if name == "sensing" and UNITS[str(mine)] == UNITS[str(theirs)]:
                    remedy += (
                        f", or say that both mean the same: policy.transferred({str(theirs)!r})"
                    )
                told = [repr(side.tolist()) for side in (mine, theirs)]
                if mine.size != theirs.size:
                    told = [f"{side.size} numbers" for side in (mine, theirs)]
                raise ValueError(
                    f"the policy has {name} = {told[0]}, the configuration {told[1]}; {remedy}"
                )
        if self.theta.shape[0] not in (1, config.followers):
            raise ValueError(
                f"the policy has {self.theta.shape[0]} tables, the convoy {config.followers} "
                "followers; expected one table "
                "for all, or one each"
            )

    def sha256(self) -> str:
        """Return a hash of everything that the policy holds."""
        digest = hashlib.sha256()
        for part in fields(self):
            array = getattr(self, part.name)
            if part.name == "kind" and array == "wheels":  # as it was before there were others
                continue
            digest.update(f"{part.name}{array.shape}".encode() + array.tobytes())
        return digest.hexdigest()

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the policy as plain arrays, for a file."""
        return {"schema": np.array(SCHEMA)} | {
            part.name: getattr(self, part.name) for part in fields(self)
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> "Policy":
        """Read what ``arrays`` wrote.

        Raises:
            ValueError: another schema, or an array is missing.
        """
        arrays = {"kind": np.array("wheels")} | dict(arrays)  # older files know no other
        missing = [part.name for part in fields(cls) if part.name not in arrays]
        if missing or int(arrays.get("schema", np.array(-1))) != SCHEMA:
            raise ValueError(
                f"not a policy of schema {SCHEMA}: schema {arrays.get('schema', 'missing')}, "
                f"missing arrays {missing}"
            )
        parts = {part.name: arrays[part.name] for part in fields(cls)}
        return cls(**parts)
