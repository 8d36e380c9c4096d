"""The paper's simulation, and the test of its explanation: every run that the figures are made of.

* "wheels": 1.3 million updates, four followers, each learning its own weights, 9×9 states, 7×7 actions; seeds 1 to 3;
* "planar": the same on the planar drive; seeds 1 to 10;
* "greedy": the policies of the wheels runs, frozen, on ten evaluation seeds of 30 simulated minutes, taking turns;
* "shift/TRACK/REWARD": what moves the visits sideways (E3): a circle in both directions and a figure-eight, under three
  rewards, 100 000 updates on the planar drive; seeds 1 to 10.

Runs are kept in runs/.cache/ under a name that depends on everything that they depend on, sources included; what is there is
loaded and what is missing is run, on all cores, one process per core.
"""

import hashlib
import json
import multiprocessing
import os
import queue
import shutil
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from workbench import fields, paths
from workbench.arena.tracks import TrackConfig
from workbench.formation.config import ConvoyConfig
from workbench.study.progress import report
from workbench.study.runs import Run, evaluate_seeds, learn_seeds, load_run

SHIFT_TRACKS = {
    "clockwise": TrackConfig(direction="clockwise"),
    "anticlockwise": TrackConfig(direction="anticlockwise"),
    "eight": TrackConfig(shape="eight"),
}
SHIFT_REWARDS = ("quadratic", "absolute", "distance")
_COST = {"wheels": 10, "planar": 1}  # relative time of one control period, for the progress bar only
_SOURCES = (
    "learning",
    "robot",
    "arena",
    "formation",
    "study/runs.py",
    "study/checkpoints.py",
    "study/records.py",
    "study/statistics.py",
    "fields.py",
)


@dataclass(frozen=True)
class Job:
    """One batch of formations: learning (steps > 0), or the evaluation of other jobs' policies (minutes > 0)."""

    name: str
    config: ConvoyConfig
    seeds: tuple[int, ...]
    steps: int = 0
    minutes: float = 0.0
    policies: tuple[str, ...] = ()  # jobs of one run each, whose policies the seeds follow in turn

    @property
    def units(self) -> int:
        """Updates or control periods of the whole batch."""
        return len(self.seeds) * (self.steps or round(self.minutes * 600))

    @property
    def unit_cost(self) -> int:
        """Relative time of one unit."""
        per_period = _COST[self.config.drive] * (1 if self.minutes else 1 / self.config.followers)
        return round(8 * per_period)


def paper_jobs(*, quick: bool) -> list[Job]:
    """Return all jobs; quick ones, three blocks long, only exercise the code."""
    full = not quick
    steps, minutes, shift_steps = (1_300_000, 30.0, 100_000) if full else (27_000, 13.0, 27_000)
    seeds = tuple(range(1, 11)) if full else (1, 2)
    base = ConvoyConfig()
    planar = replace(base, drive="planar")
    jobs = [Job(f"wheels/{seed}", base, (seed,), steps) for seed in (1, 2, 3)]
    jobs.append(Job("planar", planar, seeds, steps))
    for track, layout in SHIFT_TRACKS.items():
        for reward in SHIFT_REWARDS:
            config = replace(planar, track=layout, reward=reward)
            jobs.append(Job(f"shift/{track}/{reward}", config, seeds, shift_steps))
    judged = tuple(range(101, 111)) if full else (101, 102)
    wheels = tuple(job.name for job in jobs if job.name.startswith("wheels/"))
    jobs.append(Job("greedy", base, judged, minutes=minutes, policies=wheels))
    return jobs


def paper_runs(*, quick: bool = paths.QUICK, workers: int = 0) -> dict[str, list[Run]]:
    """Return the runs of every job by name, running what is not stored yet.

    Args:
        quick: the short version, for tests.
        workers: processes, 0 for one per core.
    """
    jobs = paper_jobs(quick=quick)
    folder = _cache(jobs, quick)
    _run_missing([job for job in jobs if not _complete(folder, job)], folder, workers)
    return {job.name: [load_run(_place(folder, job) / f"seed-{seed}") for seed in job.seeds] for job in jobs}


def fingerprint(jobs: list[Job]) -> str:
    """Return a short hash of everything that the runs depend on: requests, sources and versions."""
    digest = sources_digest()
    for job in jobs:
        digest.update(
            json.dumps([job.name, fields.to_dict(job.config), job.seeds, job.steps, job.minutes, job.policies]).encode()
        )
    return str(digest.hexdigest()[:12])


def sources_digest(*others: str) -> Any:
    """Return a hash object that has taken in everything but the request: the sources that runs depend on, and versions."""
    digest = hashlib.sha256()
    package = paths.ROOT / "workbench"
    for source in (*_SOURCES, *others):
        files = sorted((package / source).glob("*.py")) if (package / source).is_dir() else [package / source]
        for file in files:
            digest.update(file.read_bytes())
    for name in ("mujoco", "numba", "numpy"):
        digest.update(f"{name}=={version(name)}".encode())
    return digest


def _cache(jobs: list[Job], quick: bool) -> Path:
    """Return the folder of these runs, and remove those of older sources."""
    prefix = "quick-" if quick else "paper-"
    folder = paths.RUNS / ".cache" / f"{prefix}{fingerprint(jobs)}"  # its own place: nobody else's runs are there
    for old in folder.parent.glob(f"{prefix}*"):
        if old != folder:
            shutil.rmtree(old)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _place(folder: Path, job: Job) -> Path:
    return folder / job.name.replace("/", "-")


def _complete(folder: Path, job: Job) -> bool:
    return all((_place(folder, job) / f"seed-{seed}" / "summary.json").is_file() for seed in job.seeds)


def _run_missing(missing: list[Job], folder: Path, workers: int) -> None:
    if not missing:
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    context = multiprocessing.get_context("spawn")
    with context.Manager() as manager, ProcessPoolExecutor(workers or cores, mp_context=context) as pool:
        ticks = manager.Queue()
        waiting = sorted(missing, key=lambda job: -job.units * job.unit_cost)  # longest first: no core idles at the end
        running = set[Future[None]]()
        total = sum(job.units * job.unit_cost for job in missing)
        with report(True, total, f"{len(missing)} batches of runs", unit="") as tell:
            while waiting or running:
                for job in [job for job in waiting if _ready(folder, job)][: (workers or cores) - len(running)]:
                    waiting.remove(job)
                    running.add(pool.submit(_run_job, job, folder, ticks))
                done, running = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()  # raises what the job raised
                _drain(ticks, tell)


def _learned(folder: Path, job: Job) -> list[Path]:
    """Return the runs whose policies an evaluation follows: the job "wheels/2" has the one seed 2."""
    return [folder / name.replace("/", "-") / f"seed-{name.rsplit('/', 1)[1]}" for name in job.policies]


def _ready(folder: Path, job: Job) -> bool:
    return all((place / "summary.json").is_file() for place in _learned(folder, job))


def _drain(ticks: Any, tell: Callable[[int], None]) -> None:
    while True:
        try:
            tell(ticks.get_nowait())
        except queue.Empty:
            return


def _run_job(job: Job, folder: Path, ticks: Any) -> None:
    """Run one job in a worker process, on one thread."""

    def tell(count: int) -> None:
        ticks.put(count * job.unit_cost)

    place = _place(folder, job)
    if job.steps:
        learn_seeds(job.config, job.seeds, steps=job.steps, out=place, resume=True, progress=tell, threads=1)
        return
    learned = [load_run(run).policy for run in _learned(folder, job)]
    policies = [learned[k % len(learned)] for k in range(len(job.seeds))]
    evaluate_seeds(policies, job.config, job.seeds, minutes=job.minutes, out=place, resume=True, progress=tell, threads=1)
