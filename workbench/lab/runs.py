"""Runs: learn, evaluate greedily, store, load and continue.

A run is a folder: ``config.json`` (configuration, length, versions), ``weights.npz``,
``records.npz``, ``summary.json`` (written last: a folder that has it is complete) and
``checkpoint.npz``. A run that is killed at any moment continues from its last checkpoint and ends
with the same bytes as one that never stopped. Clocks stay out of the folder.

>>> from workbench.formation.config import ConvoyConfig
>>> run = learn(ConvoyConfig(followers=1, drive="planar"), steps=200, progress=False)
>>> int(run.visits.sum()), run.summary["steps"]
(200, 200)

Contract: one seed gives the same run alone or in a batch of seeds, at any number of threads.
"""

import contextlib
import json
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench import fields, markup
from workbench.formation.config import ConvoyConfig, expect_config
from workbench.formation.convoy import Convoy
from workbench.formation.laws.law import ControlLaw
from workbench.formation.laws.own import OwnLaw
from workbench.formation.laws.table import Controller, check_controller
from workbench.formation.own_reward import OwnReward, Reward, check_reward, with_reward
from workbench.formation.policy import Policy
from workbench.lab import storage
from workbench.lab.checkpoints import load_checkpoint, save_checkpoint
from workbench.lab.compiling import compile_blocks
from workbench.lab.locks import locked
from workbench.lab.progress import Progress, report
from workbench.lab.records import RECORDS, Recorder, Records, summarise
from workbench.lab.weights import Weights, describe, load_weights, write_weights
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.sources import version

SCHEMA = 5
FILES = ("config.json", "weights.npz", "records.npz", "summary.json", "checkpoint.npz")
REQUEST = (
    "kind",
    "length",
    "policy_sha256",
    "reward_sha256",
    "config",
)  # what must agree for a run to be continued
CHECKPOINT_S = 20.0  # seconds of wall-clock time between checkpoints
UNSEEN = 1000  # added to the seed for what follows greedily: another track, other noise
_SHOWN = {  # of a summary, for people
    "simulated_minutes": "simulated minutes",
    "losses": "losses",
    "collisions": "collisions",
    "share_best_3x3": "visits in the best 3×3 tiles",
    "rms_distance_error_mm": "RMS distance error, mm",
    "bias_mm": "… bias, mm",
    "ripple_mm": "… ripple, mm",
    "bearing_std_deg": "bearing spread, °",
}


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run: print it, or let a notebook show it.

    Attributes:
        kind: "learn", "learn-own" (a learner of one's own) or "evaluate".
        config: what it ran with.
        length: learning updates asked for, or control periods ("evaluate").
        updates: learning updates done.
        policy: the learned (or the followed) action values with their tiles and levels, or the law
            that drove.
        w: (tables, rows, actions) secondary weights.
        records: see ``workbench.lab.records.Recorder.records``.
        reward_sha256: of the reward of one's own that it learned with, if it did.
    """

    kind: str
    config: ConvoyConfig
    length: int
    updates: int
    policy: Controller
    w: NDArray[np.float64]
    records: Records
    reward_sha256: str | None = None

    def __repr__(self) -> str:
        """Say what was run, for how long, and how often anybody was lost."""
        unit = "control periods" if self.kind == "evaluate" else "updates"
        losses = self.summary["losses"]
        return f"Run({self.kind}, {self.length:,} {unit}, {losses} losses, {self.config!r})"

    def _repr_html_(self) -> str:
        """Show the main numbers and where every follower saw its leader."""
        named = [(words, self.summary[name]) for name, words in _SHOWN.items()]
        rows = [(words, value) for words, value in named if value is not None]
        most = np.log1p(self.visits.max()) or 1.0
        shares = np.log1p(self.visits) / most
        return markup.table(rows, repr(self)) + markup.heats(shares, "follower {}: visits (log)")

    @property
    def visits(self) -> NDArray[np.int64]:
        """Visits of every state, (followers, distance tiles, bearing tiles)."""
        total: NDArray[np.int64] = self.records["visits"].sum(axis=0, dtype=np.int64)
        return total.reshape(-1, *self.config.state_tiles)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The numbers of the run as plain values, see ``workbench.lab.records.summarise``."""
        return summarise(self.config, self.length, self.updates, self.records)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Store the run in a folder.

        Raises:
            FileExistsError: the folder has something in it and overwrite is False.
            FolderInUse: another process writes there.
        """
        folder = Path(path).expanduser()
        if not overwrite:
            storage.refuse_existing(folder)
        self.policy.arrays()  # refuses code before anything is written
        with locked(folder):
            for name in (
                "summary.json",
                "checkpoint.npz",
            ):  # from here to the end the folder is not complete
                (folder / name).unlink(missing_ok=True)
            started = self.policy if self.kind == "evaluate" else None
            header = _header(self.kind, self.config, self.length, started, self.reward_sha256)
            storage.write_json(folder / "config.json", header)
            _store(self, folder)


def learn(
    config: ConvoyConfig,
    *,
    steps: float,
    policy: Policy | None = None,
    reward: Reward | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    wait_s: float = 0.0,
    progress: Progress = True,
    checkpoint_s: float = CHECKPOINT_S,
) -> Run:
    """Let the followers of one formation learn online.

    Args:
        config: robots, track, task, learner and seed.
        steps: learning updates, summed over the followers.
        policy: action values to start from; default: all θ₀.
        reward: a reward of your own, r(u, v), see ``workbench.functions``; the run's
            config then says reward = "own".
        out: folder of the run; checkpoints are kept there.
        resume: continue an interrupted run in ``out``, or load it if it is complete.
        wait_s: seconds to wait where another process writes to ``out``.
        progress: True for a bar, or a function called with the updates just done.
        checkpoint_s: wall-clock seconds between checkpoints, 0 for one per block.

    Raises:
        FileExistsError: ``out`` has something in it and resume is False.
        FolderInUse: another process, who is named, writes to ``out``.
        FloatingPointError: learning diverged.
        OSError: a checkpoint could not be written; the last good one is kept.
    """
    folder = _place(out)
    policies: list[Controller] | None = [policy] if policy is not None else None
    config, own = with_reward(config, reward)
    length = fields.positive("steps", steps)
    batch = _Batch(
        "learn", config, (config.seed,), length, policies, [folder] if folder else None, reward=own
    )
    return batch.run(folder, resume, wait_s, progress, checkpoint_s)[0]


def learn_seeds(
    config: ConvoyConfig,
    seeds: Sequence[int],
    *,
    steps: float,
    reward: Reward | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    wait_s: float = 0.0,
    progress: Progress = True,
    checkpoint_s: float = CHECKPOINT_S,
    threads: int = 0,
) -> list[Run]:
    """Learn with several seeds as one batch of formations; arguments as ``learn``, each run in
    ``out``/seed-N.
    """
    folder = _place(out)
    if isinstance(seeds, int):
        raise TypeError(f"seeds = {seeds!r}; expected several, such as range(1, 11)")
    folders = [folder / f"seed-{seed}" for seed in seeds] if folder else None
    config, own = with_reward(config, reward)
    length = fields.positive("steps", steps)
    batch = _Batch("learn", config, tuple(seeds), length, None, folders, threads, own)
    return batch.run(folder, resume, wait_s, progress, checkpoint_s)


def controller_of(policy: "Controller | Run") -> Controller:
    """Return who drives: a run stands for its policy."""
    return policy.policy if isinstance(policy, Run) else policy


def elsewhere(policy: "Controller | Run", config: ConvoyConfig | None) -> ConvoyConfig:
    """Return where to follow: as told, or, for a run, its own configuration with another seed, that
    is on another track.

    Raises:
        TypeError: neither a configuration nor a run.
    """
    if config is not None:
        expect_config(config)
        return config
    if not isinstance(policy, Run):
        check_controller(policy)
        raise TypeError(
            f"config is missing; a {type(policy).__name__} does not know where to follow: give a "
            "configuration, or a run in its place"
        )
    return policy.config.with_seed(policy.config.seed + UNSEEN)


def evaluate(
    policy: Controller | Run,
    config: ConvoyConfig | None = None,
    *,
    minutes: float = 30.0,
    out: str | Path | None = None,
    resume: bool = False,
    wait_s: float = 0.0,
    progress: Progress = True,
) -> Run:
    """Let all followers exploit a policy greedily, without learning, or be driven by a classical
    law, for a simulated time.

    Args:
        policy: or a run, which stands for what it learned.
        config: default for a run: its own, on a track that it did not learn on (seed + 1000).

    Raises:
        TypeError: there is no configuration.
        ValueError: the policy's tiles or actions are not the configuration's, or its sensing does
            not give what the law needs.
        FileExistsError: ``out`` has something in it and resume is False.
    """
    folder = _place(out)
    there = elsewhere(policy, config)
    drivers = [controller_of(policy)]
    batch = _evaluation(drivers, there, [there.seed], minutes, [folder] if folder else None)
    return batch.run(folder, resume, wait_s, progress, CHECKPOINT_S)[0]


def evaluate_seeds(
    policies: Sequence[Controller | Run],
    config: ConvoyConfig,
    seeds: Sequence[int],
    *,
    minutes: float = 30.0,
    out: str | Path | None = None,
    resume: bool = False,
    wait_s: float = 0.0,
    progress: Progress = True,
    threads: int = 0,
) -> list[Run]:
    """Evaluate policies[k] greedily with seeds[k], as one batch of formations; each run in
    ``out``/seed-N.

    Raises:
        ValueError: a policy does not fit the configuration, or the numbers of policies and seeds
            differ.
    """
    folder = _place(out)
    folders = [folder / f"seed-{seed}" for seed in seeds] if folder else None
    batch = _evaluation(policies, config, seeds, minutes, folders, threads)
    return batch.run(folder, resume, wait_s, progress, CHECKPOINT_S)


def _place(out: str | Path | None) -> Path | None:
    """Return the folder of a run; "~" is the user's home."""
    return None if out is None else Path(out).expanduser()


def _evaluation(
    policies: Sequence[Controller | Run],
    config: ConvoyConfig,
    seeds: Sequence[int],
    minutes: float,
    folders: list[Path] | None,
    threads: int = 0,
) -> "_Batch":
    if len(policies) != len(seeds):
        raise ValueError(
            f"{len(policies)} policies for {len(seeds)} seeds; give one policy per seed"
        )
    drivers = [controller_of(policy) for policy in policies]
    for policy in drivers:
        check_controller(policy)
    if (
        len(
            {
                policy.theta.shape if isinstance(policy, Policy) else policy.sha256()
                for policy in drivers
            }
        )
        > 1
    ):
        raise ValueError(
            "the policies differ in their numbers of tables, or are different laws; evaluate "
            "them apart"
        )
    periods = periods_of(minutes)
    return _Batch("evaluate", config, tuple(seeds), periods, drivers, folders, threads)


def periods_of(minutes: float) -> int:
    """Return a simulated time as control periods.

    Raises:
        ValueError: less than one of them, or more than 1e6 minutes.
    """
    if not CONTROL_PERIOD / 60 <= minutes <= 1e6:
        raise ValueError(
            f"minutes = {minutes!r}; expected simulated minutes, from a control period "
            f"({CONTROL_PERIOD:g} s) to 1e6"
        )
    return round(minutes * 60 / CONTROL_PERIOD)


def load_run(path: str | Path) -> Run:
    """Load a complete run.

    Raises:
        FileNotFoundError: no run there, or an interrupted one.
        ValueError: a file is damaged or of another schema.
    """
    folder = Path(path).expanduser()
    if not (folder / "config.json").is_file():
        raise FileNotFoundError(f"{folder} holds no run: config.json is missing")
    if not (folder / "summary.json").is_file():
        raise FileNotFoundError(
            f"{folder} is not complete; continue it with resume=True, or --resume on the "
            "command line"
        )
    header = _read_header(folder)
    weights = load_weights(folder)
    records = storage.read_npz(folder / "records.npz")
    lacking = sorted(set(RECORDS) - set(records))
    if lacking:
        raise ValueError(
            f"{folder}: the stored run lacks {', '.join(lacking)}; restore it or run again"
        )
    config = fields.from_dict(ConvoyConfig, header["config"])
    _check_hashes(folder, header, weights, records)
    return Run(
        header["kind"],
        config,
        header["length"],
        weights.updates,
        weights.policy,
        weights.w,
        records,
        header.get("reward_sha256"),
    )


def _check_hashes(
    folder: Path, header: dict[str, Any], weights: Any, records: dict[str, NDArray[Any]]
) -> None:
    """Compare the hash of the configuration in every file; runs of before know none."""
    known = {
        "weights.npz": weights.about["provenance"].get("config_sha256"),
        "records.npz": _word(records.pop("config_sha256", None)),
        "summary.json": storage.read_json(folder / "summary.json").get("config_sha256"),
    }
    for name, found in known.items():
        if found is not None and found != storage.sha256_of(header["config"]):
            raise ValueError(
                f"{folder}: {name} was made under another configuration than config.json says "
                "(it was edited, or files of two "
                "runs are mixed); restore config.json, or run again"
            )


def _word(array: NDArray[Any] | None) -> str | None:
    return None if array is None else str(array)


def stored_request(path: str | Path) -> tuple[ConvoyConfig, int]:
    """Return configuration and length of a run folder, complete or not."""
    header = _read_header(Path(path).expanduser())
    return fields.from_dict(ConvoyConfig, header["config"]), int(header["length"])


class _Batch:
    """One batch of formations on its way from a request to stored runs."""

    def __init__(
        self,
        kind: str,
        config: ConvoyConfig,
        seeds: tuple[int, ...],
        length: int,
        policies: list[Controller] | None,
        folders: list[Path] | None,
        threads: int = 0,
        reward: OwnReward | None = None,
    ) -> None:
        check_reward(config, reward, learning=kind == "learn")
        self.reward = reward
        self.kind = kind
        self.length = length
        self.folders = folders
        self.threads = threads
        self.config = config
        self.seeds = seeds
        self.configs = [config.with_seed(seed) for seed in seeds]
        self.policies = policies
        for policy in policies or []:
            policy.check(config)
            if folders is not None and isinstance(policy, OwnLaw):
                policy.arrays()  # refuses before anything has run
        if folders is not None and len(set(seeds)) < len(seeds):
            raise ValueError(
                f"seeds = {list(seeds)}; each may occur once where runs are stored in folders "
                "named after them"
            )

    def headers(self) -> list[dict[str, Any]]:
        """Return what each run's config.json says: everything that its result depends on."""
        given: list[Controller | None] = (
            list(self.policies) if self.policies else [None] * len(self.seeds)
        )
        own = self.reward.sha256 if self.reward is not None else None
        return [
            _header(self.kind, config, self.length, policy, own)
            for config, policy in zip(self.configs, given, strict=True)
        ]

    def run(
        self,
        folder: Path | None,
        resume: bool,
        wait_s: float,
        progress: Progress,
        checkpoint_s: float,
    ) -> list[Run]:
        if folder is None or self.folders is None:
            return self._run(None, False, progress, checkpoint_s)
        if not resume:
            storage.refuse_existing(folder)
        with contextlib.ExitStack() as stack:
            for place in dict.fromkeys([folder, *self.folders]):
                stack.enter_context(locked(place, wait_s=wait_s))
            if resume and all((place / "summary.json").is_file() for place in self.folders):
                self._check_request()
                return [load_run(place) for place in self.folders]
            self._prepare(folder, resume)
            runs = self._run(folder, resume, progress, checkpoint_s)
            for run, place in zip(runs, self.folders, strict=True):
                _store(run, place)
            return runs

    def _run(
        self, folder: Path | None, resume: bool, progress: Progress, checkpoint_s: float
    ) -> list[Run]:
        convoy = self._convoy()
        recorders = [Recorder(config, self.length) for config in self.configs]
        checkpoint = folder / "checkpoint.npz" if folder is not None else None
        request = json.dumps(
            [{key: header[key] for key in REQUEST} for header in self.headers()], sort_keys=True
        )
        if resume and checkpoint is not None and checkpoint.is_file():
            load_checkpoint(checkpoint, convoy, recorders, request)
        done = int(self._done(convoy).sum())
        unit = " updates" if self.kind == "learn" else " periods"
        compile_blocks(convoy, progress)
        with report(progress, self.length * len(self.seeds), self.kind, done, unit) as tell:
            self._loop(convoy, recorders, checkpoint, request, checkpoint_s, tell)
        return self._results(convoy, recorders)

    def _loop(
        self,
        convoy: Convoy,
        recorders: list[Recorder],
        checkpoint: Path | None,
        request: str,
        checkpoint_s: float,
        tell: Any,
    ) -> None:
        saved = time.monotonic()
        before = self._done(convoy).copy()
        for blocks in convoy.steps():
            for recorder, steps, start in zip(recorders, blocks, before, strict=True):
                if len(steps):
                    recorder.add(steps, int(start))
            tell(int((self._done(convoy) - before).sum()))
            before = self._done(convoy).copy()
            due = time.monotonic() - saved >= checkpoint_s or convoy.finished
            if checkpoint is not None and due:
                save_checkpoint(checkpoint, convoy, recorders, request)
                saved = time.monotonic()

    def _done(self, convoy: Convoy) -> NDArray[np.int64]:
        return convoy.updates if self.kind == "learn" else convoy.periods

    def _convoy(self) -> Convoy:
        learning = self.kind == "learn"
        tables = [policy.theta for policy in self.policies or [] if isinstance(policy, Policy)]
        return Convoy(
            self.config,
            self.seeds,
            steps=self.length if learning else 0,
            periods=None if learning else self.length,
            policy=np.stack(tables) if tables else self._law(),
            reward=self.reward,
            threads=self.threads,
        )

    def _law(self) -> ControlLaw | None:
        first = self.policies[0] if self.policies else None
        return first if isinstance(first, ControlLaw) else None

    def _results(self, convoy: Convoy, recorders: list[Recorder]) -> list[Run]:
        runs = []
        own = self.reward.sha256 if self.reward is not None else None
        for b, config in enumerate(self.configs):
            theta, w = convoy.tables(b)
            updates = int(convoy.updates[b])
            if self.kind == "learn" and updates < self.length:
                raise RuntimeError(
                    f"seed {config.seed}: only {updates} of {self.length} learning updates in "
                    f"{int(convoy.periods[b])} control "
                    "periods; the followers were lost most of the time: check bounds, speeds "
                    "and sight_m"
                )
            policy = self._law() or Policy.of(config, theta)
            runs.append(
                Run(self.kind, config, self.length, updates, policy, w, recorders[b].records(), own)
            )
        return runs

    def _prepare(self, folder: Path, resume: bool) -> None:
        """Begin or continue in a folder that nobody else writes to; files of others are left
        alone.
        """
        assert self.folders is not None
        if resume:
            self._check_request()
        for header, place in zip(self.headers(), self.folders, strict=True):
            if not resume:
                storage.refuse_existing(place)
            if not (place / "config.json").is_file():
                storage.write_json(place / "config.json", header)
        for place in dict.fromkeys([folder, *self.folders]):
            storage.remove_temporaries(place, FILES)

    def _check_request(self) -> None:
        """Refuse to continue a folder that was started with another request."""
        assert self.folders is not None
        for wanted, place in zip(self.headers(), self.folders, strict=True):
            if not (place / "config.json").is_file():
                continue
            header = _read_header(place)
            for key in REQUEST:
                if header[key] != json.loads(json.dumps(wanted[key])):
                    theirs, ours = _differing(header[key], json.loads(json.dumps(wanted[key])))
                    raise ValueError(
                        f"{place} was started with {key} = {theirs!r}, this run asks for {ours!r}; "
                        "continue with the same request, or choose another folder"
                    )
            others = [
                f"{name} {header['versions'].get(name)}"
                for name, now in wanted["versions"].items()
                if header["versions"].get(name) != now
            ]
            if others:
                warnings.warn(
                    f"{place} was begun with {', '.join(others)}; continued with other "
                    "versions it may not be what either "
                    "gives alone",
                    stacklevel=4,
                )


def _differing(one: Any, other: Any) -> tuple[Any, Any]:
    """Return two values, of mappings only what differs: no hint shall stand behind a whole run."""
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return one, other
    names = [name for name in {**one, **other} if one.get(name) != other.get(name)]
    pairs = {name: _differing(one.get(name), other.get(name)) for name in names}
    return {n: pair[0] for n, pair in pairs.items()}, {n: pair[1] for n, pair in pairs.items()}


def _store(run: Run, folder: Path) -> None:
    write_weights(
        folder,
        Weights(run.policy, run.w, run.updates, describe(run.policy, run.config, run.updates)),
    )
    told = storage.sha256_of(fields.to_dict(run.config))
    storage.write_npz(folder / "records.npz", run.records | {"config_sha256": np.array(told)})
    storage.write_json(folder / "summary.json", run.summary | {"config_sha256": told})


def _header(
    kind: str,
    config: ConvoyConfig,
    length: int,
    policy: Controller | None,
    reward_sha256: str | None = None,
) -> dict[str, Any]:
    versions = {name: version(name) for name in ("workbench", "mujoco", "numba", "numpy")}
    return {
        "schema": SCHEMA,
        "kind": kind,
        "length": length,
        "unit": "control periods" if kind == "evaluate" else "updates",
        "policy_sha256": policy.sha256()
        if policy is not None
        else None,  # what it started from, or followed
        "reward_sha256": reward_sha256,
        "config": fields.to_dict(config),
        "versions": versions,
    }


def _read_header(folder: Path) -> dict[str, Any]:
    header = storage.read_json(folder / "config.json")
    if (
        not isinstance(header, dict)
        or header.get("schema") != SCHEMA
        or not {*REQUEST, "versions"} <= set(header)
    ):
        raise ValueError(
            f"{folder / 'config.json'} is not a run of schema {SCHEMA}: it is damaged or of "
            "another version"
        )
    return header
