"""The bar while something is compiled, who compiles, and that nothing is left to compile
afterwards.
"""

import multiprocessing
import subprocess
import sys
import threading
from dataclasses import replace

import numba
import pytest

from workbench.formation.convoy import Convoy
from workbench.lab import compiling

PLAIN = Convoy(compiling.LOOPS["line"][0], [1], steps=1)
FIRST = """
import workbench as wb
from workbench.lab import compiling
counted = []
count = compiling._Watch.on_end
compiling._Watch.on_end = lambda self, event: (counted.append(event), count(self, event))
wb.prepare()
print(len(counted))
"""


def _prepare(folder, capfd):
    subprocess.run(
        [sys.executable, "-c", FIRST], check=True, env={"NUMBA_CACHE_DIR": str(folder), "HOME": "/"}
    )
    return capfd.readouterr()


def test_a_bar_shows_at_the_first_time_alone_and_knows_how_long_it_is(tmp_path, capfd):
    first = _prepare(tmp_path, capfd)
    assert "compiling, once" in first.err
    expected = compiling.LOOPS["line"][1] * compiling._OWN_SHARE
    assert 0.8 < int(first.out) / expected < 1.2
    later = _prepare(tmp_path, capfd)
    assert later.out.strip() == "0" and "compiling" not in later.err
    # what two processes compiled apart was for the types of the loop: there is one code of each
    parts = [part for half in (0, 1) for part, _ in PLAIN.parts(half)]
    codes = {part: list(tmp_path.rglob(f"*.{part.py_func.__qualname__}-*.nbc")) for part in parts}
    assert len(codes) == 6 and {len(files) for files in codes.values()} == {1}


def test_a_bar_leaves_other_threads_alone():
    other = threading.Thread(target=lambda: numba.njit(lambda x: x + 1)(1.0))
    other.start()  # in the middle of compiling
    errors = []
    threading.excepthook, before = errors.append, threading.excepthook
    try:
        with compiling.watched(True, 10):
            other.join()
    finally:
        threading.excepthook = before
    assert not errors


class _Convoy:
    """Notes what is compiled of it."""

    plain = True
    config = compiling.LOOPS["line"][0]
    loop = "compiled"

    def __init__(self, error=None):
        self.compiled = []
        self._error = error

    def parts(self, half):
        self.compiled.append(half)
        if self._error:
            raise self._error
        return []

    def compile(self, *, periods):
        self.compiled.append("all")


@pytest.fixture
def helpers(monkeypatch):
    """Processes that half of the work was given to; on two cores, with nothing on disk."""
    begun = []

    def popen(*arguments, _popen=subprocess.Popen, **options):
        begun.append(_popen(*arguments, **options))
        return begun[-1]

    monkeypatch.setattr(compiling.subprocess, "Popen", popen)
    monkeypatch.setattr(compiling, "on_disk", lambda loop: False)
    monkeypatch.setattr(compiling, "cores", lambda: 2)
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    return begun


def test_what_a_helper_cannot_do_is_left_to_this_process(helpers, monkeypatch):
    monkeypatch.setattr(compiling, "_HELP", "raise SystemExit(3)")
    convoy = _Convoy()
    compiling.compile_blocks(convoy, False)
    assert convoy.compiled == [0, "all"] and helpers[0].returncode == 3


def test_where_no_process_can_begin_this_one_does_all(helpers, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    convoy = _Convoy()
    compiling.compile_blocks(convoy, False)
    assert convoy.compiled == [0, "all"] and not helpers


def test_an_interrupt_ends_the_helper_too(helpers, monkeypatch):
    monkeypatch.setattr(compiling, "_HELP", "import time; time.sleep(1000)")
    with pytest.raises(KeyboardInterrupt):
        compiling.compile_blocks(_Convoy(KeyboardInterrupt()), False)
    assert helpers[0].returncode not in (None, 0)


def test_a_helper_imports_nothing_from_where_it_is_called(helpers, monkeypatch, tmp_path):
    (tmp_path / "tqdm.py").write_text("raise SystemExit(9)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compiling, "_HELP", "import tqdm, workbench; raise SystemExit(4)")
    compiling.compile_blocks(_Convoy(), False)
    assert helpers[0].returncode == 4


@pytest.mark.parametrize("what", ["on disk", "one core", "worker", "pictures"])
def test_nobody_helps_where_nothing_is_missing_or_no_core_is_free(helpers, monkeypatch, what):
    convoy = _Convoy()
    if what == "on disk":
        monkeypatch.setattr(compiling, "on_disk", lambda loop: True)
    if what == "one core":
        monkeypatch.setattr(compiling, "cores", lambda: 1)
    if what == "worker":
        monkeypatch.setattr(multiprocessing, "parent_process", lambda: "somebody")
    if what == "pictures":
        convoy.loop = None
    compiling.compile_blocks(convoy, False)
    assert convoy.compiled == ["all"] and not helpers


def test_pictures_are_run_without_blocks():
    config = replace(PLAIN.config, followers=1, sensing="pixels")
    assert Convoy(config, [1], steps=1).loop is None
