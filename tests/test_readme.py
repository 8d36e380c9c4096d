"""The README: short, its links lead somewhere, its snippets run as they stand, its numbers are
those of the tables.
"""

import importlib.util
import os
import re
import subprocess
import sys

import pytest

from workbench import paths
from workbench.studies import controllers
from workbench.studies.published import load_study

README = (paths.ROOT / "README.md").read_text(encoding="utf-8")
HOUSE = (paths.ROOT / "workbench" / "README.md").read_text(encoding="utf-8")
PYTHON = ".venv/bin/python"


def _blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def _commands(word):
    lines = [line for block in _blocks("sh") for line in block.splitlines()]
    # two blanks and a hash begin what is said of a line
    return [re.split(r"\s{2,}#", line)[0].strip() for line in lines if line.startswith(word)]


def test_it_is_short():
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize("text", [README, HOUSE])
def test_its_links_lead_somewhere(text):
    folder = paths.ROOT if text is README else paths.ROOT / "workbench"
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        place, _, anchor = target.partition("#")
        if "://" in place:
            continue
        if place:
            assert (folder / place).exists(), target
        if anchor:
            where = text if not place else HOUSE
            titles = re.findall(r"^#+ (.*)$", where, re.MULTILINE)
            assert anchor in {title.lower().replace(" ", "-") for title in titles}, target


def test_its_python_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {}
    for block in _blocks("python"):
        if "stable_baselines3" in block and not importlib.util.find_spec("stable_baselines3"):
            continue
        exec(compile(block, "README.md", "exec"), scope)
    assert scope["run"].summary["losses"] > 0  # type: ignore[attr-defined]


@pytest.mark.parametrize("targets", [_commands("make")])
def test_its_make_targets_are_there(targets):
    assert len(targets) == 3
    for line in targets:
        done = subprocess.run(
            [*line.split(), "-n"], cwd=paths.ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_its_shell_lines_run_as_they_stand(tmp_path):
    """One after the other, in one folder: later ones use what earlier ones made."""
    environment = os.environ | {"PYTHONPATH": str(paths.ROOT)}
    lines = _commands(PYTHON)
    assert len(lines) >= 8
    for line in lines:
        words = [sys.executable, *line.removeprefix(PYTHON).split()]
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, (line, done.stderr[-500:])


def _told(name, pattern):
    [found] = re.findall(pattern, README)
    assert found, name
    return found


def test_its_numbers_are_those_of_the_tables():
    recommended = load_study("recommended")
    own = recommended[recommended["track"] == "as learned"]
    rms = own.groupby("setting")["greedy_rms_distance_error_mm"].mean()
    paper, best = _told("errors", r"error (\S+) mm with the paper's tiles, (\S+) mm with the")
    assert (paper, best) == (f"{rms['paper']:.1f}", f"{rms['recommended']:.1f}")

    beside = controllers.beside_peers(load_study("controllers"))
    beside = beside[(beside["noise"] == "none") & (beside["beside"] == "carrot, tuned")]
    value = beside.set_index(["learner", "measure"])["value"]
    better, restless, calm = _told(
        "classical",
        r"is (\S+) mm better; turning rates vary (\S+) times as much as its with the paper's "
        r"tiles, (\S+) times with the recommended",
    )
    distance, _, turning = controllers.COMPARED.values()
    first, last = controllers.LEARNERS[0], controllers.LEARNERS[-1]
    assert better == f"{value[last, distance[0]]:.1f}"
    assert (restless, calm) == (f"{value[first, turning[0]]:.0f}", f"{value[last, turning[0]]:.2f}")

    late = load_study("delays")
    late = late[
        (late["world"] == "judging") & (late["late_s"] == 0.2) & (late["route"] == "camera")
    ]
    lost = late.groupby(["table", "prediction"])["losses"].sum()
    few, many = _told(
        "late commands", r"loses (\S+) leaders instead of (\S+ \S+) at a delay of 0.2 s"
    )
    assert int(few) == lost["9×9/7×7", "both"]
    assert int(many.replace(" ", "")) == lost["9×9/7×7", "none"]
    at_3 = load_study("delays").query("world == 'judging' and late_s == 0.3 and route == 'camera'")
    smooth = at_3[(at_3["table"] == "9×9/7×7, interpolated") & (at_3["prediction"] == "both")]
    assert f"with interpolated commands only {smooth['losses'].sum():.0f} at 0.3 s" in README

    copies = load_study("copies")
    calmed = copies[(copies["weights"] == "copied") & (copies["cures"] == "calm")]
    assert "none of these copies lost anybody" in README
    assert calmed["losses"].sum() == 0

    stored = (paths.NOTEBOOKS / "04_state_visitation.ipynb").read_text(encoding="utf-8")
    block, cell = _told("visits", r"(\S+) % of visits in the best 3×3 .* (\S+) % in the best one")
    assert f"wheels: median 3×3 {block}% (paper 98.7 %), best cell {cell}%" in stored
