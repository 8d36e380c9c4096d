"""Make everything that is published: the experiment, every notebook in full mode, and with them
``figures/``.

A notebook is executed again when it has changed, or anything that it may read: the package, the
data, the figures. What the last call left behind is noted in the cache of runs.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from workbench import paths
from workbench.lab.storage import read_json, write_json
from workbench.lab.sweeps import Failed, sweep
from workbench.notebooks import execute_and_store
from workbench.plots.figures import changed_files, compare_numbers, numbers_in
from workbench.sources import LIBRARIES, PACKAGE, version
from workbench.studies.paper import paper_runs
from workbench.studies.replication import write_card


def regenerate(*, check: bool = False) -> tuple[list[str], pd.DataFrame]:
    """Run the experiment (or load it where it is stored) and the notebooks that are not up to date,
    and compare with what was there before.

    Args:
        check: run all notebooks, put the earlier figures and notebooks back afterwards; only tell
            what would change.

    Returns:
        (files, numbers): names of figure files whose bytes differ, and the plotted numbers that
        differ, see ``compare_numbers``.

    Raises:
        RuntimeError: in quick mode, which publishes nothing; or a notebook failed.
    """
    if paths.QUICK:
        raise RuntimeError("WORKBENCH_QUICK=1 is set; figures are only made in full mode: unset it")
    before = _figure_bytes()
    numbers = numbers_in(paths.FIGURES)
    notebooks = sorted(paths.NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))
    stored = {path: path.read_bytes() for path in notebooks}
    inputs = _inputs()  # as they are before anything is made of them
    try:
        paper_runs(quick=False)
        due = notebooks if check else _out_of_date(notebooks)
        for result in sweep(execute_and_store, due) if due else []:
            if isinstance(result, Failed):
                raise RuntimeError(result.error)
        if not check:
            write_card()
            _note().parent.mkdir(parents=True, exist_ok=True)
            write_json(_note(), {"inputs": inputs} | _made(notebooks))
        return changed_files(before, _figure_bytes()), compare_numbers(
            numbers, numbers_in(paths.FIGURES)
        )
    finally:
        if check:
            for path in paths.FIGURES.glob("*"):
                if path.name not in before:
                    path.unlink()
            for name, content in before.items():
                (paths.FIGURES / name).write_bytes(content)
            for path, content in stored.items():
                path.write_bytes(content)


def _out_of_date(notebooks: list[Path]) -> list[Path]:
    """Return the notebooks that are not as the last call left them, all if anything else is not."""
    try:
        before = read_json(_note())
        known = dict(before["notebooks"])
    except (OSError, ValueError, KeyError, TypeError):
        return notebooks
    now = {"inputs": _inputs()} | _made(notebooks)
    if any(now[name] != before.get(name) for name in ("inputs", "figures")):
        return notebooks
    return [path for path in notebooks if known.get(path.name) != now["notebooks"][path.name]]


def _inputs() -> str:
    """Return a hash of all that notebooks read."""
    sources = sorted(PACKAGE.rglob("*.py")) + sorted(PACKAGE.rglob("*.js"))
    data = sorted(path for path in paths.DATA.rglob("*") if path.is_file())
    versions = " ".join(version(library) for library in (*LIBRARIES, "matplotlib", "pandas"))
    return f"{_hash(sources, PACKAGE)} {_hash(data, paths.DATA)} {versions}"


def _made(notebooks: list[Path]) -> dict[str, Any]:
    """Return hashes of figures and notebooks as they are now."""
    figures = sorted(path for path in paths.FIGURES.glob("*") if path.is_file())
    return {
        "figures": _hash(figures, paths.FIGURES),
        "notebooks": {path.name: _hash([path], paths.NOTEBOOKS) for path in notebooks},
    }


def _hash(files: Iterable[Path], folder: Path) -> str:
    digest = hashlib.sha256()
    for path in files:
        name = path.relative_to(folder).as_posix()
        digest.update(name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _note() -> Path:
    return paths.RUNS / ".cache" / "figures.json"


def _figure_bytes() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in paths.FIGURES.glob("*") if path.is_file()}
