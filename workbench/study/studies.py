"""The studies: which choices matter, one question each, and the table that answers it.

``run_study`` runs what is missing (on all cores, or on any executor), and writes one tidy table: a line per condition and seed,
with a JSON file beside it that says what was run. Finished trials are kept in runs/.cache/, under the hash of their
configuration and of the sources, so that a study continues after a kill and studies share what they have in common.

All conditions differ from the defaults of ConvoyConfig in what their label says and in nothing else. They run on the planar
drive, 200 000 updates and a greedy evaluation of 20 simulated minutes each, ten seeds; "recommended" runs on wheels.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from workbench import fields, paths
from workbench.arena.tracks import TrackConfig
from workbench.formation.config import SETTINGS, TILINGS, ConvoyConfig
from workbench.learning.config import PRESETS, LearnerConfig
from workbench.study.experiment import sources_digest
from workbench.study.storage import write_bytes, write_json
from workbench.study.sweeps import Failed, sweep
from workbench.study.trials import Trial, measure, measure_sections, measure_widely

Labels = dict[str, Any]
BASE = ConvoyConfig(drive="planar")
ROBOT = replace(SETTINGS["paper-robot"], drive="planar")
LOGARITHMIC = replace(SETTINGS["logarithmic"], drive="planar")
FOLDER = paths.DATA / "studies"
DENSE_UPDATE_S = 24e-6  # one update of 81 × 49 weights, textbook NumPy on a desktop computer; measured, see the notebooks
COMPUTE_TIMES_S = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)


@dataclass(frozen=True)
class Study:
    """A question, the function that measures a trial, and the labelled conditions that it is measured on."""

    name: str
    question: str
    cases: Callable[[], list[tuple[Labels, ConvoyConfig]]]
    function: Callable[[Trial], Mapping[str, float]] = measure
    steps: int = 200_000
    minutes: float = 20.0

    def trials(self, seeds: Sequence[int], *, quick: bool = False) -> tuple[list[Labels], list[Trial]]:
        """Return the labels and the trials of all conditions and seeds, one of each per line of the table."""
        labels, trials = [], []
        for label, config in self.cases():
            steps = int(label.get("steps", self.steps))
            for seed in seeds:
                labels.append(label | {"seed": seed})
                minutes = 1.0 if quick else self.minutes
                trials.append(Trial(config=config.with_seed(seed), steps=min(steps, 2000) if quick else steps, minutes=minutes))
        return labels, trials


def _learner(config: ConvoyConfig, **changes: float | str | bool) -> ConvoyConfig:
    return replace(config, learner=fields.from_dict(LearnerConfig, fields.to_dict(config.learner) | changes))


def _tiles() -> list[tuple[Labels, ConvoyConfig]]:
    cases = []
    both = (True, True)
    for axis, along, theta0 in (
        ("distance", (True, False), -0.1), ("bearing", (False, True), -0.1), ("both", both, -0.1), ("both", both, 0.0),
    ):  # fmt: skip
        for spacing in TILINGS:
            for count in (3, 5, 7, 9, 11, 13, 15):
                numbers = (count if along[0] else 9, count if along[1] else 9)
                kinds = (spacing if along[0] else "uniform", spacing if along[1] else "uniform")
                config = replace(BASE, state_tiles=numbers, distance_tiling=kinds[0], bearing_tiling=kinds[1])
                label = {"axis": axis, "spacing": spacing, "tiles": count, "theta0": theta0}
                cases.append((label, _learner(config, theta0=theta0)))
    return cases


def _inner() -> list[tuple[Labels, ConvoyConfig]]:
    cases = []
    for mm, degrees in ((1.0, 0.7), (2.0, 1.3), (3.0, 2.0), (4.5, 3.0), (6.0, 4.0), (7.8, 5.0)):
        config = replace(LOGARITHMIC, inner_distance_m=mm / 1000, inner_bearing_rad=math.radians(degrees))
        cases.append(({"inner_distance_mm": mm, "inner_bearing_deg": degrees}, config))
    return cases


def _offsets() -> list[tuple[Labels, ConvoyConfig]]:
    return [
        ({"tiles": f"{n}×{n}", "tilings": m}, replace(BASE, state_tiles=(n, n), tilings=m))
        for n in (3, 5, 7, 9)
        for m in (1, 2, 4, 8)
    ]


def _actions() -> list[tuple[Labels, ConvoyConfig]]:
    levels = [("levels", f"{n}×{n}", replace(BASE, action_levels=(n, n))) for n in (3, 5, 7, 9, 11)]
    ranges = [
        ("range", f"{1000 * low:.0f}–{1000 * high:.0f} mm/s", replace(BASE, wheel_speed_mps=(low, high)))
        for low, high in ((0.0, 0.12), (0.015, 0.105), (0.03, 0.09), (0.045, 0.075), (0.0525, 0.0675))
    ]
    settings = [("setting", name, replace(SETTINGS[name], drive="planar")) for name in ("paper", "paper-robot")]
    return [({"factor": factor, "level": level}, config) for factor, level, config in levels + ranges + settings]


def _parameters() -> list[tuple[Labels, ConvoyConfig]]:
    values: dict[str, Sequence[float]] = {
        "lam": (0.0, 0.4, 0.6, 0.8, 0.9, 1.0), "gamma": (0.0, 0.5, 0.7, 0.8, 0.9, 0.95), "alpha": (0.01, 0.03, 0.1, 0.3, 0.6),
        "eta": (0.0, 0.01, 0.1, 1.0), "theta0": (-1.0, -0.3, -0.1, -0.03, 0.0),
    }  # fmt: skip
    cases = [({"factor": n, "level": f"{v:g}"}, _learner(BASE, **{n: v})) for n, several in values.items() for v in several]
    schedules: dict[str, dict[str, float | str]] = {
        "0.05 → 0.01": {}, "0.05 → 0": {"epsilon_final": 0.0}, "0.2 → 0.01": {"epsilon": 0.2},
        "0.05 → 0.01, exponential": {"epsilon_schedule": "exponential"}, "0.05": {"epsilon_schedule": "constant"},
        "0.01": {"epsilon_schedule": "constant", "epsilon": 0.01}, "0": {"epsilon_schedule": "constant", "epsilon": 0.0},
    }  # fmt: skip
    cases += [({"factor": "epsilon", "level": name}, _learner(BASE, **changes)) for name, changes in schedules.items()]
    return cases + [({"factor": "preset", "level": name}, replace(BASE, learner=learner)) for name, learner in PRESETS.items()]


def _rewards() -> list[tuple[Labels, ConvoyConfig]]:
    presets = ("quadratic", "absolute", "distance", "alive")
    cases = [({"reward": name, "terminal_factor": 1.0, "theta0": -0.1}, replace(BASE, reward=name)) for name in presets]
    for factor in (2.0, 10.0):
        cases.append(({"reward": "quadratic", "terminal_factor": factor, "theta0": -0.1}, replace(BASE, terminal_factor=factor)))
    optimistic = {"quadratic": 0.0, "absolute": 0.0, "distance": 0.0, "alive": 5.0}  # no reward sums up to more: 1 / (1 - γ) = 5
    for name, theta0 in optimistic.items():
        label = {"reward": name, "terminal_factor": 1.0, "theta0": theta0}
        cases.append((label, _learner(replace(BASE, reward=name), theta0=theta0)))
    return cases


def _buffer() -> list[tuple[Labels, ConvoyConfig]]:
    cases = []
    for table, config in (("9×9 states, 7×7 actions", BASE), ("5×5 states, 3×3 actions", ROBOT)):
        cases.append(({"table": table, "buffer": "on", "compute_time_s": 0.0}, config))  # the same at every compute time
        for seconds in COMPUTE_TIMES_S:
            timed = replace(_learner(config, buffer=False), compute_time_s=seconds)
            cases.append(({"table": table, "buffer": "off", "compute_time_s": seconds}, timed))
    return cases


def _reset() -> list[tuple[Labels, ConvoyConfig]]:
    return [
        (
            {"track": shape, "reset": reset, "steps": steps},
            replace(BASE, reset=reset, track=TrackConfig(shape=shape)),
        )
        for shape in ("circle", "eight")
        for steps in (2_500, 5_000, 10_000, 20_000, 40_000, 80_000)
        for reset in ("manoeuvre", "restart")
    ]


def _recommended() -> list[tuple[Labels, ConvoyConfig]]:
    settings = {name: SETTINGS[name] for name in ("paper", "logarithmic", "recommended")}
    settings["logarithmic 3×3"] = replace(SETTINGS["logarithmic"], state_tiles=(3, 3))  # the smallest table that follows well
    settings["recommended, 3×3 actions"] = replace(SETTINGS["recommended"], action_levels=(3, 3))
    return [({"setting": name}, replace(config, drive="wheels")) for name, config in settings.items()]


STUDIES = {
    study.name: study
    for study in (
        Study("tiles", "How many tiles, uniform or logarithmic, for distance and for bearing?", _tiles),
        Study("inner", "How wide should the middle cell of logarithmic tiles be?", _inner),
        Study("offsets", "What do several offset tilings do that the paper's single one does not?", _offsets),
        Study("actions", "How many speed levels, over which range?", _actions),
        Study("parameters", "Which of λ, γ, α, η, θ₀ and the ε schedule matter?", _parameters),
        Study("rewards", "What does the reward decide, and the punishment of a loss?", _rewards),
        Study("buffer", "From which compute time on does the update buffer matter?", _buffer),
        Study("reset", "What does restarting the simulation do to sections that are seldom reached?", _reset, measure_sections),
        Study("recommended", "How do the settings follow on wheels?", _recommended, measure_widely, 400_000, 30.0),
    )
}


def run_study(
    name: str,
    *,
    executor: Executor | None = None,
    workers: int = 0,
    out: Path | None = None,
    store: Path | None = None,
    quick: bool = paths.QUICK,
    progress: bool = True,
) -> pd.DataFrame:
    """Run a study and return its table; write it to ``out`` (default data/studies/; in quick mode only where asked to).

    Args:
        name: one of STUDIES.
        executor, workers: see ``sweep``.
        out: folder of the table.
        store: folder of finished trials, default runs/.cache/.
        quick: two seeds and 2 000 updates per trial: exercises the code, means nothing.

    Raises:
        ValueError: an unknown study.
        RuntimeError: trials failed; the others are stored, no table is written.
    """
    if name not in STUDIES:
        raise ValueError(f"study {name!r}; expected one of {', '.join(STUDIES)}")
    study, seeds = STUDIES[name], (1, 2) if quick else tuple(range(1, 11))
    labels, trials = study.trials(seeds, quick=quick)
    place = store or paths.RUNS / ".cache" / f"trials-{sources_digest('study/trials.py').hexdigest()[:12]}"
    results = sweep(study.function, trials, executor, store=place, workers=workers, progress=progress)
    failures = [result for result in results if isinstance(result, Failed)]
    if failures:
        raise RuntimeError(f"study {name!r}: {len(failures)} of {len(trials)} trials failed; first: {failures[0].error}")
    table = pd.DataFrame([label | result for label, result in zip(labels, results, strict=True)])
    folder = out if out is not None else (None if quick else FOLDER)
    if folder is not None:
        _publish(study, table, trials, folder, quick=quick)
    return table


def load_study(name: str) -> pd.DataFrame:
    """Return the published table of a study.

    Raises:
        FileNotFoundError: it has not been run yet.
    """
    path = FOLDER / f"{name}.csv"
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; run: python -m workbench study {name}")
    return pd.read_csv(path)


def trials_digest(trials: Sequence[Trial]) -> str:
    """Return a hash of everything that was asked for in a table."""
    requests = "\n".join(repr(fields.to_dict(trial)) for trial in trials)
    return hashlib.sha256(requests.encode()).hexdigest()


def _publish(study: Study, table: pd.DataFrame, trials: Sequence[Trial], folder: Path, *, quick: bool) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    content = table.to_csv(index=False, float_format="%.10g", lineterminator="\n").encode()
    write_bytes(folder / f"{study.name}.csv", content)
    write_json(
        folder / f"{study.name}.json",
        {
            "study": study.name, "question": study.question, "simulated": True, "quick": quick,
            "seeds": sorted({trial.config.seed for trial in trials}), "updates": sorted({trial.steps for trial in trials}),
            "greedy_minutes": trials[0].minutes, "trials": len(trials),
            "first_config": fields.to_dict(trials[0].config), "trials_sha256": trials_digest(trials),
            "table_sha256": hashlib.sha256(content).hexdigest(),
        },
    )  # fmt: skip


def update_time_s(factor: float, config: ConvoyConfig) -> float:
    """Return the compute time of a dense update on a robot that is ``factor`` times slower than the desktop computer.

    A dense update touches every weight, so that its time grows with the table; 24 µs were measured for 81 × 49 weights.
    """
    return factor * DENSE_UPDATE_S * config.rows * config.actions / (81 * 49)


def factor_for(seconds: float, config: ConvoyConfig) -> float:
    """Return how many times slower than the desktop computer a robot is whose dense update takes a given time."""
    return math.inf if seconds == math.inf else seconds / update_time_s(1.0, config)
