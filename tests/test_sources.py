"""What depends on what: an edit of what is called changes the hash, an edit of anything else does
not.
"""

import os
import shutil
import subprocess
import sys

import pytest

from workbench import paths, sources

_TELL = """
from workbench.sources import digest, digest_of
from workbench.studies.tables import STUDIES
for name in ("tiles", "copies", "transfer"):
    print(name, digest_of(STUDIES[name].function))
print("compiled", digest("workbench.formation.control"))
"""


def _digests(folder):
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", _TELL]
    done = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    return dict(line.split() for line in done.stdout.splitlines())


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edited")
    shutil.copytree(
        paths.ROOT / "workbench", folder / "workbench", ignore=shutil.ignore_patterns("__pycache__")
    )
    return folder, _digests(folder)


EDITS = {  # file: what an edit of it changes
    "plots/runs.py": "",
    "studies/transfer_trials.py": "copies transfer",  # what both of its functions use
    "studies/realities.py": "transfer",  # the emulated realities, which copies does not use
    "lab/trial.py": "copies transfer",  # "tiles" is measured there, by another function
    "formation/reward.py": "tiles copies transfer compiled",
    "robot/ground.py": "tiles copies transfer compiled",
}


@pytest.mark.parametrize(("file", "changed"), EDITS.items())
def test_an_edit_runs_again_what_depends_on_it_and_nothing_else(package, file, changed):
    folder, before = package
    path = folder / "workbench" / file
    text = path.read_text()
    try:
        other = text.replace("1000 * math.sqrt", "1001 * math.sqrt").replace("mean())", "max())")
        path.write_text(other + "\n_EDITED = 1\n")
        edited = _digests(folder)
    finally:
        path.write_text(text)
    assert {name for name in before if edited[name] != before[name]} == set(changed.split())


def test_comments_run_nothing_again(package):
    folder, before = package
    files = [folder / "workbench" / file for file in EDITS]
    texts = [path.read_text() for path in files]
    try:
        for path, text in zip(files, texts, strict=True):
            path.write_text(text + "\n# a comment\n")
        commented = _digests(folder)
    finally:
        for path, text in zip(files, texts, strict=True):
            path.write_text(text)
    assert {name for name in before if commented[name] != before[name]} <= {"compiled"}


def test_a_function_depends_on_what_it_uses_of_its_own_module_only(tmp_path, monkeypatch):
    text = (
        "import math\nFACTOR = 2\n_helper = lambda x: x * FACTOR\n\ndef measure(x):\n    "
        "return _helper(x) + math.pi\n\n"
        "def plot(x):\n    return x\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def told(name, content):
        (tmp_path / f"{name}.py").write_text(content)
        return [node.lineno for node in sources._used(sources.ast.parse(content), "measure")[0]]

    assert told("one", text) == [1, 2, 3, 5]


def test_imports_of_every_form_are_followed():
    text = (
        "from workbench import fields, paths\nfrom workbench.learning import (\n    gq,  # "
        "first\n    tiles,\n)\n"
        "    from workbench.robot.api import Robot\nimport workbench.arena.world\nTABLE = "
        "'workbench.formation.reset:manoeuvre'\n"
        "from workbench.robot import geometry as g\n"
    )
    names = (
        "fields paths learning.gq learning.tiles robot.api arena.world formation.reset "
        "robot.geometry"
    )
    assert set(sources._modules(text)) == {f"workbench.{name}" for name in names.split()}


def test_unknown_modules_are_refused_and_missing_metadata_is_no_error(monkeypatch):
    with pytest.raises(ValueError, match="module 'workbench.nothing'; expected one of the package"):
        sources.files("workbench.nothing")
    assert sources.version("no-such-package") == "unknown"
