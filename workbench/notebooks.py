"""Execute the notebooks as a reader would, and store them without anything that changes from run to
run.

Stored notebooks keep their outputs, so that a reader without a kernel sees every figure; timing,
widget state, stderr and the interpreter's patch version are removed.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import nbformat
from nbconvert.preprocessors import CellExecutionError, ExecutePreprocessor
from nbformat import NotebookNode

TIME_OUT_S = 1800  # per cell


def execute(path: Path, *, store: bool) -> None:
    """Run a notebook from a clean kernel, top to bottom, in its own folder; store it normalised if
    asked to.

    A stored notebook has the static twins of its widgets (WORKBENCH_STATIC=1): a page without a
    kernel shows nothing else.

    Raises:
        RuntimeError: a cell failed; the message names the notebook and has the cell's traceback.
    """
    notebook = nbformat.read(path, as_version=4)
    runner = ExecutePreprocessor(timeout=TIME_OUT_S, kernel_name="python3", record_timing=False)
    try:
        with _static() if store else contextlib.nullcontext():
            runner.preprocess(notebook, {"metadata": {"path": str(path.parent)}})
    except CellExecutionError as error:
        raise RuntimeError(f"{path.name}: {error}") from error
    if store:
        nbformat.write(normalise(notebook), path)


@contextlib.contextmanager
def _static() -> Iterator[None]:
    """Let kernels that are started now show pictures instead of widgets."""
    before = os.environ.get("WORKBENCH_STATIC")
    os.environ["WORKBENCH_STATIC"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["WORKBENCH_STATIC"]
        else:
            os.environ["WORKBENCH_STATIC"] = before


def execute_and_store(path: Path) -> None:
    """Run a notebook and store it, in any process."""
    execute(path, store=True)


def normalise(notebook: NotebookNode) -> NotebookNode:
    """Return the notebook without timing, widget state, stderr and interpreter details (changed in
    place).
    """
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {
                "display_name": "Python 3 (ipykernel)",
                "language": "python",
                "name": "python3",
            },
            "language_info": {
                "name": "python",
                "file_extension": ".py",
                "mimetype": "text/x-python",
            },
        }
    )
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number:02d}"
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = _one_stream([out for out in cell.outputs if out.get("name") != "stderr"])
            for out in cell.outputs:
                out.get("metadata", {}).clear()
    return notebook


def _one_stream(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """Join what was printed in a row: into how many messages it was cut depends on the clock."""
    joined: list[NotebookNode] = []
    for out in outputs:
        if (
            joined
            and out.output_type == "stream"
            and joined[-1].output_type == "stream"
            and joined[-1].name == out.name
        ):
            joined[-1].text += out.text
        else:
            joined.append(out)
    return joined
