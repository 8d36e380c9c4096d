"""Every notebook runs in quick mode from a clean kernel, and is stored with outputs and without
noise.
"""

import json
import os
import re

import nbformat
import pytest

from workbench import paths
from workbench.notebooks import execute, normalise

NOTEBOOKS = sorted(paths.NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # Jupyter's own: zmq on a loopback port, event loop policies
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_quickly_from_top_to_bottom(path):
    stored = path.read_bytes()
    execute(path, store=False)
    assert path.read_bytes() == stored


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_notebook_has_every_output_and_no_noise(path):
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count == number + 1 for number, cell in enumerate(code))
    assert (
        sum(bool(cell.outputs) for cell in code) >= len(code) - 3
    )  # imports and parameters print nothing
    for cell in code:
        assert len(cell.source.splitlines()) <= 15
        assert all(
            out.get("name") != "stderr" and out.output_type != "error" for out in cell.outputs
        )
    text = json.dumps(notebook)
    assert not re.search(r"(/(home|root|tmp|work)/|[A-Z]:\\\\Users)", text)
    assert "parameters" in code[1].metadata.get("tags", [])
    assert normalise(nbformat.from_dict(json.loads(text))) == notebook


def test_printed_lines_are_stored_as_one_output_however_they_arrived():
    parts = [nbformat.v4.new_output("stream", name="stdout", text=text) for text in ("a\n", "b\n")]
    picture = nbformat.v4.new_output("display_data", data={"text/plain": "x"})
    cell = nbformat.v4.new_code_cell(
        "", outputs=[*parts, picture, nbformat.v4.new_output("stream", name="stdout", text="c\n")]
    )
    stored = normalise(nbformat.v4.new_notebook(cells=[cell])).cells[0].outputs
    assert [out.get("text") for out in stored] == ["a\nb\n", None, "c\n"]


def test_a_failing_notebook_is_named(tmp_path):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0")])
    nbformat.write(notebook, tmp_path / "99_bad.ipynb")
    with pytest.raises(RuntimeError, match="99_bad.ipynb"):
        execute(tmp_path / "99_bad.ipynb", store=True)


test_a_failing_notebook_is_named = pytest.mark.filterwarnings("default")(
    test_a_failing_notebook_is_named
)


@pytest.mark.filterwarnings("default")
def test_a_stored_notebook_has_pictures_where_a_live_one_has_widgets(tmp_path, monkeypatch):
    monkeypatch.delenv("WORKBENCH_STATIC")
    cell = "from workbench.view.panels import tile_panel\ntile_panel()"
    nbformat.write(
        nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell)]),
        tmp_path / "98_panel.ipynb",
    )
    execute(tmp_path / "98_panel.ipynb", store=True)
    [out] = nbformat.read(tmp_path / "98_panel.ipynb", 4).cells[0].outputs
    assert "image/png" in out.data and not any("widget" in kind for kind in out.data)
    assert "WORKBENCH_STATIC" not in os.environ
