"""The weights file: action values together with what they mean and where they come from, so that
they can travel.

``weights.npz`` of a run holds the arrays of its policy (``workbench.formation.policy``), the
secondary weights, and as JSON under ``about``: tiles with edges and units, action levels in
steps/s, sensing, reward, learner, the whole configuration, and provenance (hashes, seed, updates,
version). The JSON repeats the arrays' meaning in words that other programs can read; the loader
holds the two against each other, and the arrays against their hashes.

>>> config = ConvoyConfig()
>>> about = describe(Policy.of(config, np.zeros((1, 81, 49))), config, 0)
>>> about["tiles"]["bearing"]["unit"], about["actions"]["unit"], len(about["actions"]["left"])
('rad', 'steps/s', 7)

Contract: nothing is pickled; a file is either loaded whole or refused with an error that names it.
What is accepted comes back bit for bit.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench import fields
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws.table import Controller, controller_from_arrays
from workbench.formation.policy import Policy
from workbench.lab.storage import plain, read_npz, sha256_of, write_npz
from workbench.sources import version

FORMAT = 1
FILE = "weights.npz"


@dataclass(frozen=True, eq=False)
class Weights:
    """What a weights file holds.

    Attributes:
        policy: action values with their meaning, or the classical law that drove.
        w: (tables, rows, actions) secondary weights.
        updates: learning updates done.
        about: the file's JSON, see ``describe``.
    """

    policy: Controller
    w: NDArray[np.float64]
    updates: int
    about: dict[str, Any]

    def learned(self, path: str | Path) -> Policy:
        """Return the policy; raise ValueError, naming the path, if a law drove."""
        if not isinstance(self.policy, Policy):
            raise ValueError(
                f"{path} was driven by the law {self.policy.name!r} and has no weights; give "
                "a run that learned"
            )
        return self.policy


def describe(policy: Controller, config: ConvoyConfig, updates: int) -> dict[str, Any]:
    """Return what is to be known about weights, as plain JSON values.

    Args:
        policy: the weights, or a law.
        config: what they were learned with.
        updates: over how many learning updates.
    """
    about: dict[str, Any] = {
        "format": FORMAT,
        "kind": "policy" if isinstance(policy, Policy) else policy.name,
    }
    if isinstance(policy, Policy):
        about |= _meaning(policy)
    about["reward"] = {"preset": config.reward, "terminal_factor": config.terminal_factor}
    about["learner"] = fields.to_dict(config.learner)
    about["config"] = fields.to_dict(config)
    about["provenance"] = {
        "config_sha256": sha256_of(about["config"]),
        "seed": config.seed,
        "updates": updates,
        "workbench": version("workbench"),
        "policy_sha256": policy.sha256(),
    }
    kept: dict[str, Any] = plain(about)
    return kept


def write_weights(folder: Path, weights: Weights) -> None:
    """Write weights.npz into a folder, whole or not at all."""
    about = weights.about | {"w_sha256": _digest(weights.w)}
    extra = {
        "w": weights.w,
        "updates": np.array(weights.updates),
        "about": np.array(json.dumps(about, sort_keys=True)),
    }
    write_npz(folder / FILE, weights.policy.arrays() | extra)


def load_weights(path: str | Path) -> Weights:
    """Load a weights file, or that of a run's folder.

    Raises:
        FileNotFoundError: there is none.
        ValueError: it is damaged, of another format, or its JSON says something else than its
            arrays.
    """
    place = Path(path).expanduser()
    place = place / FILE if place.is_dir() else place
    arrays = read_npz(place)
    try:
        missing = sorted({"w", "updates", "about"} - set(arrays))
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        about = json.loads(str(arrays["about"]))
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError(f"its description is not of format {FORMAT}")
        lacking = sorted({"kind", "reward", "learner", "config", "provenance"} - set(about))
        if lacking:
            raise ValueError(f"its description lacks {', '.join(lacking)}")
        policy = controller_from_arrays(arrays)
        if arrays["updates"].dtype.kind not in "iu":
            raise ValueError(
                f"updates are of type {arrays['updates'].dtype}; expected a whole number"
            )
        updates = int(arrays["updates"])
        w = arrays["w"]
        _compare(about, policy, w, updates)
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, OverflowError) as error:
        raise ValueError(
            f"{place} holds no weights that can be used: {error}; restore it or learn again"
        ) from error
    return Weights(policy, w, updates, about)


def load_policy(path: str | Path, config: ConvoyConfig | None = None) -> Policy:
    """Load a policy from a run's folder or a weights file, for a configuration.

    Args:
        path: folder or file.
        config: what it is to drive; checked if given.

    Raises:
        FileNotFoundError, ValueError: see ``load_weights``; a law drove; tiles, actions or sensing
            are not the configuration's.
    """
    policy = load_weights(path).learned(path)
    if config is not None:
        policy.check(config)
    return policy


def _digest(w: NDArray[np.float64]) -> str:
    return hashlib.sha256(
        f"{w.dtype}{w.shape}".encode() + np.ascontiguousarray(w).tobytes()
    ).hexdigest()


def _meaning(policy: Policy) -> dict[str, Any]:
    tiles = {
        name: {"unit": unit, "edges": edges.tolist()}
        for name, unit, edges in zip(
            ("distance", "bearing"),
            policy.units,
            (policy.distance_edges, policy.bearing_edges),
            strict=True,
        )
    }
    about = {} if policy.kind == "wheels" else {"about": "the speed of the robot in front"}
    return {
        "sensing": str(policy.sensing),
        "tiles": tiles | {"tilings": int(policy.tilings)},
        "actions": {
            "unit": "steps/s",
            "left": policy.left_steps.tolist(),
            "right": policy.right_steps.tolist(),
        }
        | about,
        "tables": int(policy.theta.shape[0]),
    }


def _compare(
    about: dict[str, Any], policy: Controller, w: NDArray[np.float64], updates: int
) -> None:
    """Raise ValueError unless description and arrays agree."""
    if isinstance(policy, Policy):
        for name, mine in _meaning(policy).items():
            if about.get(name) != plain(mine):
                raise ValueError(
                    f"its description says {name} = {about.get(name)!r}, its arrays {mine!r}"
                )
        if w.dtype != np.float64 or w.shape != policy.theta.shape:
            raise ValueError(
                f"secondary weights have shape {w.shape} and type {w.dtype}, the main ones "
                f"{policy.theta.shape}"
            )
    if about["kind"] != ("policy" if isinstance(policy, Policy) else policy.name):
        raise ValueError(
            f"its description says kind = {about['kind']!r}, its arrays hold something else"
        )
    if about.get("w_sha256") != _digest(w):
        raise ValueError("secondary weights are not those of its description's hash")
    provenance = about["provenance"]
    if provenance.get("policy_sha256") != policy.sha256():
        raise ValueError(
            f"its arrays have the hash {policy.sha256()}, its description says "
            f"{provenance.get('policy_sha256')}"
        )
    if provenance.get("updates") != updates:
        raise ValueError(
            f"its description says {provenance.get('updates')} updates, its arrays {updates}"
        )
