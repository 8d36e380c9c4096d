"""The paper's simulation, and the test of its explanation: every run that the figures are made of.

* "wheels": 1.3 million updates, four followers, each learning its own weights, 9×9 states, 7×7
  actions; seeds 1 to 3;
* "planar": the same on the planar drive; seeds 1 to 10;
* "greedy": the policies of the wheels runs, frozen, on ten evaluation seeds of 30 simulated
  minutes, taking turns;
* "shift/TRACK/REWARD": what moves the visits sideways (E3): a circle in both directions and a
  figure-eight, under three rewards, 100 000 updates on the planar drive; seeds 1 to 10.

Runs are kept in runs/.cache/ under a name that depends on everything that they depend on, sources
included; what is there is loaded and what is missing is run, on all cores, one process per core.
"""

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from workbench import fields, paths, sources
from workbench.arena.tracks import TrackConfig
from workbench.formation.config import ConvoyConfig
from workbench.lab.locks import in_use
from workbench.lab.runs import Run, evaluate, learn, load_run
from workbench.lab.sweeps import Failed, sweep

SHIFT_TRACKS = {
    "clockwise": TrackConfig(direction="clockwise"),
    "anticlockwise": TrackConfig(direction="anticlockwise"),
    "eight": TrackConfig(shape="eight"),
}
SHIFT_REWARDS = ("quadratic", "absolute", "distance")
PATIENCE_S = 3600.0  # for another process that does the same job


@dataclass(frozen=True)
class Job:
    """One run: learning (steps > 0), or the evaluation of another job's policy (minutes > 0)."""

    group: str
    config: ConvoyConfig
    steps: int = 0
    minutes: float = 0.0
    follows: str = ""  # folder of the run whose policy is evaluated

    @property
    def name(self) -> str:
        """Folder of the run within the cache."""
        return f"{self.group.replace('/', '-')}/seed-{self.config.seed}"


def paper_jobs(*, quick: bool) -> list[Job]:
    """Return all jobs, evaluations last; quick ones, three blocks long, only exercise the code."""
    steps, minutes, shift_steps = (27_000, 13.0, 27_000) if quick else (1_300_000, 30.0, 100_000)
    seeds = (1, 2) if quick else tuple(range(1, 11))
    base = ConvoyConfig()
    planar = replace(base, drive="planar")
    wheels = [Job("wheels", base.with_seed(seed), steps) for seed in (1, 2, 3)]
    short = [Job("planar", planar.with_seed(seed), steps) for seed in seeds]
    for track, layout in SHIFT_TRACKS.items():
        for reward in SHIFT_REWARDS:
            config = replace(planar, track=layout, reward=reward)
            short += [
                Job(f"shift/{track}/{reward}", config.with_seed(seed), shift_steps)
                for seed in seeds
            ]
    judged = (101, 102) if quick else tuple(range(101, 111))
    greedy = [
        Job("greedy", base.with_seed(s), 0, minutes, wheels[k % len(wheels)].name)
        for k, s in enumerate(judged)
    ]
    third = len(
        seeds
    )  # the long runs are spread, so that no core idles at the end and the bar moves from the start
    return [
        wheels[0],
        *short[:third],
        wheels[1],
        *short[third : 4 * third],
        wheels[2],
        *short[4 * third :],
        *greedy,
    ]


def paper_runs(*, quick: bool = paths.QUICK, workers: int = 0) -> dict[str, list[Run]]:
    """Return the runs of every group by name, running what is not stored yet.

    Args:
        quick: the short version, for tests.
        workers: processes, 0 for one per core.

    Raises:
        RuntimeError: a run failed; the others are stored.
    """
    jobs = paper_jobs(quick=quick)
    folder = _cache(jobs, quick)
    missing = [job for job in jobs if not (folder / job.name / "summary.json").is_file()]
    for stage in ([job for job in missing if job.steps], [job for job in missing if not job.steps]):
        for result in (
            sweep(paper_run, [(job, folder) for job in stage], workers=workers) if stage else []
        ):
            if isinstance(result, Failed):
                raise RuntimeError(f"{result.config[0].name}: {result.error}\n{result.trace}")
    runs: dict[str, list[Run]] = {}
    for job in jobs:
        runs.setdefault(job.group, []).append(load_run(folder / job.name))
    return runs


def paper_run(request: tuple[Job, Path]) -> None:
    """Do one job in a worker process; what it makes is kept in its folder.

    Two processes may ask for the same job.
    """
    job, folder = request
    out = folder / job.name
    if job.steps:
        learn(job.config, steps=job.steps, out=out, resume=True, wait_s=PATIENCE_S, progress=False)
    else:
        policy = load_run(folder / job.follows).policy
        evaluate(
            policy,
            job.config,
            minutes=job.minutes,
            out=out,
            resume=True,
            wait_s=PATIENCE_S,
            progress=False,
        )


def fingerprint(jobs: list[Job]) -> str:
    """Return a short hash of everything that the runs depend on: requests, sources and versions."""
    digest = hashlib.sha256(sources.digest_of(paper_run).encode())
    for job in jobs:
        digest.update(
            json.dumps(
                [job.name, fields.to_dict(job.config), job.steps, job.minutes, job.follows]
            ).encode()
        )
    return digest.hexdigest()[:12]


def _cache(jobs: list[Job], quick: bool) -> Path:
    """Return the folder of these runs, and remove those of older sources."""
    prefix = "quick-" if quick else "paper-"
    folder = (
        paths.RUNS / ".cache" / f"{prefix}{fingerprint(jobs)}"
    )  # its own place: nobody else's runs are there
    for old in folder.parent.glob(f"{prefix}*"):
        if old != folder and not any(in_use(place) for place in old.glob("*/*")):
            shutil.rmtree(old, ignore_errors=True)  # another process may be removing it as well
    folder.mkdir(parents=True, exist_ok=True)
    return folder
