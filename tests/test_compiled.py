"""The cache of compiled code never outlives the sources that it was made of."""

import os
import shutil
import subprocess
import sys

import numba

from workbench import compiled as module, paths
from workbench.compiled import compiled, uncompiled

SCRIPT = """
from workbench.formation.leader import follow_line
import numpy as np
from workbench.formation.leader import GROUND
from workbench.formation.reset import RESET
leader = np.zeros(1, [("ground", GROUND), ("reset", RESET)])
leader["ground"]["knows_white"] = 948.0
leader["ground"]["knows_black"] = 300.0
from numba import njit
call = njit(lambda leader: follow_line(leader[0], 700.0, 300.0, 948.0, 466.0, 1.0))
print(*call(leader), follow_line.stats.cache_hits if hasattr(follow_line, "stats") else 0)
"""


def _run(folder):
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()[:2]


def test_an_edit_of_a_called_module_takes_effect_at_the_next_start(tmp_path):
    # the leader's rule is compiled in one module and calls the ground sensor's darkness in another
    shutil.copytree(
        paths.ROOT / "workbench",
        tmp_path / "workbench",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    first = _run(tmp_path)
    again = _run(tmp_path)
    source = tmp_path / "workbench" / "robot" / "ground.py"
    text = source.read_text()
    assert text.count("return min(max(share, 0.0), 1.0)") == 1
    source.write_text(
        text.replace("return min(max(share, 0.0), 1.0)", "return min(max(share, 0.0), 0.1)")
    )
    edited = _run(tmp_path)
    assert first == again != edited
    folders = list(
        (tmp_path / "workbench" / "__pycache__" / "numba").glob("workbench.formation.leader-*")
    )
    assert len(folders) == 2 and all(any(folder.rglob("*.nbi")) for folder in folders)
    plot = tmp_path / "workbench" / "plots" / "runs.py"
    plot.write_text(plot.read_text() + "\nEDITED = 1\n")
    compiled_before = set((tmp_path / "workbench" / "__pycache__" / "numba").iterdir())
    assert _run(tmp_path) == edited
    assert set((tmp_path / "workbench" / "__pycache__" / "numba").iterdir()) == compiled_before


def test_other_users_of_numba_are_left_alone():
    before = numba.config.CACHE_DIR
    compiled(lambda: None)
    assert numba.config.CACHE_DIR == before


def test_a_folder_that_cannot_be_written_is_passed_over_for_one_that_all_processes_of_a_user_share(
    tmp_path, monkeypatch
):
    (tmp_path / "package").write_text("no folder")  # whatever would lie below cannot be made
    monkeypatch.setattr(module.sources, "PACKAGE", tmp_path / "package")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert module.parent.__wrapped__() == tmp_path / "home" / ".cache" / "workbench" / "numba"
    monkeypatch.setenv("HOME", str(tmp_path / "package"))
    monkeypatch.setattr(module.tempfile, "gettempdir", lambda: str(tmp_path))
    shared = module.parent.__wrapped__()
    assert (
        shared == tmp_path / f"workbench-{module._user()}" / "numba" == module.parent.__wrapped__()
    )
    assert shared.stat().st_mode & 0o077 == 0  # code that only this user can have put there
    monkeypatch.setattr(
        module.getpass, "getuser", lambda: (_ for _ in ()).throw(KeyError("no such user"))
    )
    assert str(module.os.getuid()) == module._user()


def test_a_function_can_be_called_as_it_was_written_with_all_that_it_calls():
    from workbench.robot.infrared import InfraredConfig, front_pair

    assert uncompiled(front_pair)(0.1, 0.2, InfraredConfig()) == front_pair(
        0.1, 0.2, InfraredConfig()
    )


def test_a_cache_takes_over_what_it_has_nothing_of(tmp_path, monkeypatch):
    mine, other = tmp_path / "mine", tmp_path / "other"
    monkeypatch.setattr(module, "parent", lambda: mine)
    for place, words in ((mine, "mine"), (other, "other")):
        (place / "folder").mkdir(parents=True)
        for kind in ("nbi", "1.nbc"):
            (place / "folder" / f"both.f-1.py311.{kind}").write_text(words)
    for kind in ("nbi", "1.nbc", "2.nbc"):
        (other / "folder" / f"own.f-1.py311.{kind}").write_text("other")
    (other / "folder" / "half.g-1.py311.1.nbc").touch()  # a process ended before its index
    module.adopt(other)
    found = {path.name: path.read_text() for path in (mine / "folder").iterdir()}
    assert found == {
        "both.f-1.py311.nbi": "mine",
        "both.f-1.py311.1.nbc": "mine",
        "own.f-1.py311.nbi": "other",
        "own.f-1.py311.1.nbc": "other",
        "own.f-1.py311.2.nbc": "other",
    }
