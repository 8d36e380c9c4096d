"""Published figures: one writer, deterministic bytes, a manifest, and a check that finds what
differs.
"""

import hashlib
import json
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.formation.config import ConvoyConfig
from workbench.lab.runs import learn
from workbench.plots import figures, runs as plots
from workbench.plots.style import style
from workbench.publishing import regenerate


@pytest.fixture
def full_mode(monkeypatch):
    monkeypatch.setattr(paths, "QUICK", False)


def _figure():
    with style():
        ax = plots.visit_map(np.eye(9) * 100, ConvoyConfig(), label="test")
        return ax.figure


def test_the_same_figure_has_the_same_bytes_and_a_row_in_the_manifest(tmp_path, full_mode):
    run = learn(ConvoyConfig(drive="planar"), steps=300, progress=False)
    numbers = {"x": [1.0, 1 / 3], "name": ["a", "b"]}
    for folder in (tmp_path / "one", tmp_path / "two"):
        files = figures.save_figure(_figure(), "map", numbers=numbers, sources=[run], folder=folder)
        assert [path.name for path in files] == ["map.png", "map.svg", "map.csv"]
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    row = json.loads((tmp_path / "one" / "manifest.json").read_text())["map"]
    for name, digest in row["files"].items():
        assert hashlib.sha256((tmp_path / "one" / name).read_bytes()).hexdigest() == digest
    assert row["sources"][0]["seeds"] == [1] and row["sources"][0]["config"]["drive"] == "planar"
    assert set(row["versions"]) >= {"mujoco", "numpy", "matplotlib"} and row["mode"] == "full"
    assert b"Date" not in (tmp_path / "one" / "map.svg").read_bytes().replace(b"Date of", b"")


def test_quick_mode_writes_nothing(tmp_path):
    assert paths.QUICK
    assert figures.save_figure(_figure(), "map", numbers={"x": [1]}, folder=tmp_path) == []
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(
        RuntimeError, match="WORKBENCH_QUICK=1 is set; figures are only made in full mode"
    ):
        regenerate()


def test_names_that_are_no_file_names_are_refused(tmp_path, full_mode):
    for name in ("", "../map", "a b"):
        with pytest.raises(ValueError, match="expected letters, digits"):
            figures.save_figure(_figure(), name, numbers={"x": [1]}, folder=tmp_path)


def test_the_check_tells_which_numbers_differ_and_by_how_much():
    before = {
        "a.csv": pd.DataFrame({"x": [1.0, 2.0, np.nan], "word": ["p", "q", "r"]}),
        "old.csv": pd.DataFrame({"x": [1]}),
    }
    same = {name: table.copy() for name, table in before.items()}
    assert figures.compare_numbers(before, same).empty
    after = {
        "a.csv": pd.DataFrame({"x": [1.0, 2.5, np.nan], "word": ["p", "Q", "r"]}),
        "new.csv": pd.DataFrame({"y": [1]}),
    }
    table = figures.compare_numbers(before, after).set_index(["file", "column"])
    assert table.loc[("a.csv", "x"), "largest_difference"] == 0.5
    assert table.loc[("a.csv", "x"), "relative"] == pytest.approx(0.2)
    assert table.loc[("a.csv", "word"), "note"] == "words differ"
    assert set(table["note"]) >= {"only before", "only now"}
    assert figures.changed_files({"a": b"1", "b": b"2"}, {"a": b"1", "b": b"3", "c": b""}) == [
        "b",
        "c",
    ]


def test_every_published_figure_is_as_its_manifest_says():
    manifest = json.loads((paths.FIGURES / "manifest.json").read_text())
    assert {"fig1_error_measures", "fig2_state_tiles", "fig3_formation", "fig4_visit_map"} <= set(
        manifest
    )
    listed = {
        "manifest.json",
        "live_arena.png",
        "change_of_shape.png",
        "five_shapes.png",
    }  # films: view/filming, reforming
    for name, row in manifest.items():
        for file, digest in row["files"].items():
            assert hashlib.sha256((paths.FIGURES / file).read_bytes()).hexdigest() == digest, (
                f"{name}: {file}"
            )
            listed.add(file)
    assert {path.name for path in paths.FIGURES.iterdir()} == listed


@pytest.mark.slow
def test_figures_saved_by_two_processes_at_once_are_all_in_the_manifest(tmp_path):
    script = (
        "import sys; from pathlib import Path; from matplotlib.figure import Figure\n"
        "from workbench.plots.figures import save_figure\n"
        "for k in range(8):\n"
        "    fig = Figure(figsize=(1, 1)); fig.add_subplot().plot([0, k])\n"
        "    save_figure(fig, f'{sys.argv[1]}_{k}', numbers={'k': [k]}, svg=False, "
        "folder=Path(sys.argv[2]))\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "WORKBENCH_QUICK"}
    started = [
        subprocess.Popen([sys.executable, "-c", script, name, str(tmp_path)], env=environment)
        for name in ("a", "b")
    ]
    assert [process.wait(timeout=120) for process in started] == [0, 0]
    assert len(json.loads((tmp_path / "manifest.json").read_text())) == 16
