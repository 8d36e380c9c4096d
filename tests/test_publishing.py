"""What ``figures`` and ``validate`` do around their long work: compare, restore, refuse."""

import importlib
import inspect
import json

import pandas as pd
import pytest

from workbench import paths, publishing
from workbench.__main__ import VALIDATIONS, main


@pytest.fixture
def published(tmp_path, monkeypatch):
    """A folder of figures and one of notebooks, and notebooks that draw other numbers."""
    figures, notebooks = tmp_path / "figures", tmp_path / "notebooks"
    figures.mkdir()
    notebooks.mkdir()
    (figures / "curve.csv").write_text("x,y\n1,2.0\n2,3.0\n")
    (figures / "curve.png").write_bytes(b"before")
    (notebooks / "01_curve.ipynb").write_text("before")

    def execute(path):
        (figures / "curve.csv").write_text("x,y\n1,2.0\n2,3.5\n")
        (figures / "curve.png").write_bytes(b"after")
        (figures / "more.png").write_bytes(b"new")
        path.write_text("after")

    monkeypatch.setattr(paths, "QUICK", False)
    monkeypatch.setattr(paths, "FIGURES", figures)
    monkeypatch.setattr(paths, "NOTEBOOKS", notebooks)
    monkeypatch.setattr(paths, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(paths, "DATA", tmp_path / "data")
    monkeypatch.setattr(publishing, "paper_runs", lambda *, quick: None)
    monkeypatch.setattr(publishing, "execute_and_store", execute)
    monkeypatch.setattr(publishing, "sweep", lambda run, items: [run(item) for item in items])
    return tmp_path


def _contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_figures_tells_what_differs_and_keeps_it(published, capsys):
    assert main(["figures"]) == 0
    told = capsys.readouterr().out
    assert "plotted numbers that differ" in told and '"numbers_that_differ": 1' in told
    assert _contents(published)["curve.png"] == b"after" and "more.png" in _contents(published)


def test_a_notebook_is_executed_again_only_when_something_has_changed(published, monkeypatch):
    executed = []
    execute = publishing.execute_and_store
    monkeypatch.setattr(
        publishing, "execute_and_store", lambda path: (executed.append(path.name), execute(path))
    )
    (published / "notebooks" / "02_more.ipynb").write_text("before")
    publishing.regenerate()
    assert sorted(executed) == ["01_curve.ipynb", "02_more.ipynb"]
    publishing.regenerate()
    assert len(executed) == 2  # nothing has changed
    (published / "notebooks" / "02_more.ipynb").write_text("edited")
    publishing.regenerate()
    assert executed[2:] == ["02_more.ipynb"]
    for change in ("data/table.csv", "figures/curve.png"):
        (published / change).parent.mkdir(exist_ok=True)
        (published / change).write_text("other")
        publishing.regenerate()
        assert len(executed) % 2 == 1 and len(executed) > 4
    publishing.regenerate(check=True)
    assert len(executed) == 9  # a check is of everything


def test_an_edit_while_notebooks_run_is_not_forgotten(published, monkeypatch):
    executed = []

    def execute(path):
        executed.append(path.name)
        (published / "data").mkdir(exist_ok=True)
        (published / "data" / "table.csv").write_text(f"edited {len(executed)}")

    monkeypatch.setattr(publishing, "execute_and_store", execute)
    publishing.regenerate()
    publishing.regenerate()
    assert len(executed) == 2


@pytest.mark.parametrize("note", ["{}", "[]", "not json"])
def test_a_note_that_says_nothing_means_everything(note, published):
    publishing.regenerate()
    (published / "runs" / ".cache" / "figures.json").write_text(note)
    (published / "figures" / "a folder").mkdir()
    assert publishing._out_of_date([published / "notebooks" / "01_curve.ipynb"])


def test_figures_check_tells_the_same_and_leaves_everything_as_it_was(published, capsys):
    before = _contents(published)
    assert main(["figures", "--check"]) == 1
    assert '"numbers_that_differ": 1' in capsys.readouterr().out
    assert _contents(published) == before


def test_a_notebook_that_fails_leaves_what_was_published_under_check(published, monkeypatch):
    before = _contents(published)
    execute = publishing.execute_and_store

    def fail(path):
        execute(path)
        raise RuntimeError("01_curve.ipynb: a cell failed")

    monkeypatch.setattr(publishing, "execute_and_store", fail)
    with pytest.raises(RuntimeError, match="a cell failed"):
        publishing.regenerate(check=True)
    assert _contents(published) == before


def test_figures_are_never_made_in_quick_mode(monkeypatch, capsys):
    monkeypatch.setattr(paths, "QUICK", True)
    assert main(["figures"]) == 2
    assert "unset it" in capsys.readouterr().err


@pytest.mark.parametrize("what", VALIDATIONS)
def test_every_validation_is_there_and_takes_a_folder(what):
    module, name = VALIDATIONS[what].split(":")
    assert "out" in inspect.signature(getattr(importlib.import_module(module), name)).parameters


@pytest.mark.parametrize("what", ["drive", "infrared", "tiles"])
def test_validations_with_recordings_say_where_these_are_to_be(what, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("WORKBENCH_RECORDINGS", raising=False)
    assert main(["validate", what, "--out", str(tmp_path / "out")]) == 2
    assert "WORKBENCH_RECORDINGS" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_validate_writes_what_it_measured_and_nothing_else(tmp_path):
    from workbench.studies.validation.camera import validate_camera

    told = validate_camera(out=tmp_path, seeds=1, pictures=2)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(told["written"])
    table = pd.read_csv(tmp_path / "camera.csv")
    assert set(table["conditions"]) == set(told["fitted_noise"]) and table["markers"].sum() > 10


def test_a_container_and_binder_take_the_same_two_files():
    container = json.loads((paths.ROOT / ".devcontainer" / "devcontainer.json").read_text())
    makefile = (paths.ROOT / "Makefile").read_text()
    target = container["postCreateCommand"].removeprefix("make ")
    assert f"\n{target}: $(READY)\n" in makefile
    assert "-r environment.txt" in makefile
    line = (paths.ROOT / ".binder" / "requirements.txt").read_text().split()
    assert line == ["-r", "../environment.txt"]
    pinned = (paths.ROOT / "environment.txt").read_text().splitlines()
    assert "-e ." in pinned  # pyproject.toml
    version = (paths.ROOT / ".binder" / "runtime.txt").read_text().strip().removeprefix("python-")
    assert f'requires-python = ">={version}' in (paths.ROOT / "pyproject.toml").read_text()
