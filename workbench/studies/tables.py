"""Running studies: from a question to the table that answers it, and on to pictures and verdicts.

``run_study`` runs what is missing (on all cores, or on any executor), and writes one tidy table: a
row per condition and seed, or several where a trial has the same numbers for every robot
(``Rows``), with a JSON file beside it that says what was run. Finished trials are kept in
runs/.cache/, under the hash of their configuration and of everything that the measuring function
uses (``sources.digest_of``), so that a study continues after a kill, studies share what they have
in common, and an edit of what is measured runs it again; an edit of a plot beside it does not.
``draw`` and ``decide`` show what the published table says.
"""

import hashlib
import importlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from workbench import fields, paths, sources
from workbench.fields import did_you_mean
from workbench.formation.config import ConvoyConfig
from workbench.lab.storage import table_bytes, write_bytes, write_json
from workbench.lab.study import Study
from workbench.lab.sweeps import Failed, sweep
from workbench.lab.trial import Trial
from workbench.measures.verdicts import Verdict
from workbench.studies.published import FOLDER, load_study

if TYPE_CHECKING:
    from IPython.display import Image


def _found() -> dict[str, Study]:
    """Return the studies of this folder, by name: every file that binds STUDY is one."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    binding = re.compile(r"^STUDY\b.*=", re.M)
    names = [file.stem for file in files if binding.search(file.read_text(encoding="utf-8"))]
    found: dict[str, Study] = {}
    for name in names:
        study = importlib.import_module(f"workbench.studies.{name}").STUDY
        if study.name in found:
            raise ValueError(f"two studies are called {study.name!r}; rename that of {name}.py")
        found[study.name] = study
    return found


STUDIES = _found()
# one update of 81 × 49 weights, textbook NumPy on a desktop computer; measured, see the notebooks
DENSE_UPDATE_S = 24e-6


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
    """Run a study and return its table; write it to ``out`` (default data/studies/; in quick mode
    only where asked to).

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
    study = _study(name)
    if out is not None and out.exists() and not out.is_dir():
        raise NotADirectoryError(f"{out} is a file; expected a folder for the table")
    seeds = (1, 2) if quick else range(1, study.seeds + 1)
    labels, trials = study.trials(seeds, quick=quick)
    place = store or paths.RUNS / ".cache" / f"trials-{sources.digest_of(study.function)}"
    results = sweep(
        study.function, trials, executor, store=place, workers=workers, progress=progress
    )
    failures = [result for result in results if isinstance(result, Failed)]
    if failures:
        raise RuntimeError(
            f"study {name!r}: {len(failures)} of {len(trials)} trials failed; first: "
            f"{failures[0].error}"
        )
    table = pd.DataFrame(
        [
            label | row
            for label, result in zip(labels, results, strict=True)
            for row in study.rows.of(result)
        ]
    )
    folder = out if out is not None else (None if quick else FOLDER)
    if folder is not None:
        _publish(study, table, trials, folder, quick=quick)
    return table


def draw(study: str, plot: str) -> "Image":
    """Draw a figure of a study from its published table, publish it, and return the picture.

    Raises:
        ValueError: there is no such study or plot.
        FileNotFoundError: the study has not been run yet.
    """
    # pictures are imported where somebody looks: running a study needs none
    from workbench.plots.figures import publish
    from workbench.plots.style import style

    plots = _study(study).plots
    with style():
        figure, numbers = _named(plots, plot, f"study {study!r}: plot")(load_study(study))
        return publish(figure, plot, numbers=numbers)


def decide(study: str, claim: str) -> Verdict:
    """Return what a study's published table says of a claim.

    Raises:
        ValueError: there is no such study, or it does not decide this claim.
        FileNotFoundError: the study has not been run yet.
    """
    verdicts = _study(study).verdicts
    found: Verdict = _named(verdicts, claim, f"study {study!r}: claim")(load_study(study))
    return found


def _study(name: str) -> Study:
    found: Study = _named(STUDIES, name, "study")
    return found


def _named(things: Mapping[str, Any], name: str, kind: str) -> Any:
    if name not in things:
        listed = ", ".join(things) or "none"
        raise ValueError(f"{kind} {name!r}; expected one of {listed}{did_you_mean(name, things)}")
    return things[name]


def trials_digest(trials: Sequence[Trial], known: Sequence[str] | None = None) -> str:
    """Return a hash of everything that was asked for in a table.

    Args:
        trials: one per line.
        known: the fields that a header knew, see ``fields.names``; default: all of today's.

    Raises:
        ValueError: a field that the header did not know is not at its default: the table does not
            say what it does.
    """
    digest = hashlib.sha256()
    for trial in trials:
        told = fields.flat(trial)
        if known is not None:
            news = {name: value for name, value in told.items() if name not in known}
            usual = fields.flat(type(trial)())
            for name, value in news.items():
                if value != usual[name]:
                    raise ValueError(
                        f"{name} = {value!r}, a field that the table did not know; expected "
                        f"its default {usual[name]!r}"
                    )
            told = {name: value for name, value in told.items() if name in known}
        digest.update(json.dumps(told, sort_keys=True, ensure_ascii=False).encode())
    return digest.hexdigest()


def is_current(header: Mapping[str, Any], trials: Sequence[Trial]) -> bool:
    """Return whether a table's header asks for these trials; fields that it did not know must stand
    at their defaults.
    """
    return bool(header["trials_sha256"] == trials_digest(trials, header["fields"]))


def _publish(
    study: Study, table: pd.DataFrame, trials: Sequence[Trial], folder: Path, *, quick: bool
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    content = table_bytes(table, digits=10)
    write_bytes(folder / f"{study.name}.csv", content)
    write_json(
        folder / f"{study.name}.json",
        {
            "study": study.name,
            "question": study.question,
            "simulated": True,
            "quick": quick,
            "seeds": sorted({trial.config.seed for trial in trials}),
            "updates": sorted({trial.steps for trial in trials}),
            "greedy_minutes": trials[0].minutes,
            "trials": len(trials),
            "drives": sorted(
                {drive for one in trials for drive in (one.config.drive, one.unseen.drive)}
            ),
            "first_config": fields.to_dict(trials[0].config),
            "fields": sorted(fields.flat(trials[0])),
            "trials_sha256": trials_digest(trials),
            "table_sha256": hashlib.sha256(content).hexdigest(),
        },
    )


def update_time_s(factor: float, config: ConvoyConfig) -> float:
    """Return the compute time of a dense update on a robot that is ``factor`` times slower than the
    desktop computer.

    A dense update touches every weight, so that its time grows with the table; 24 µs were measured
    for 81 × 49 weights.
    """
    return factor * DENSE_UPDATE_S * config.rows * config.action_count / (81 * 49)


def factor_for(seconds: float, config: ConvoyConfig) -> float:
    """Return how many times slower than the desktop computer a robot is whose dense update takes a
    given time.
    """
    return math.inf if seconds == math.inf else seconds / update_time_s(1.0, config)
