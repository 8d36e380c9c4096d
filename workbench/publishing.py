"""Make everything that is published: the experiment, every notebook in full mode, and with them
``figures/``.
"""

import pandas as pd

from workbench import paths
from workbench.lab.sweeps import Failed, sweep
from workbench.notebooks import execute_and_store
from workbench.plots.figures import changed_files, compare_numbers, numbers_in
from workbench.studies.paper import paper_runs


def regenerate(*, check: bool = False) -> tuple[list[str], pd.DataFrame]:
    """Run the experiment (or load it where it is stored) and all notebooks, and compare with what
    was there before.

    Args:
        check: put the earlier figures and notebooks back afterwards; only tell what would change.

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
    try:
        paper_runs(quick=False)
        for result in sweep(execute_and_store, notebooks):
            if isinstance(result, Failed):
                raise RuntimeError(result.error)
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


def _figure_bytes() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in paths.FIGURES.glob("*") if path.is_file()}
