"""The bar while something is compiled, who compiles, and that nothing is left to compile
afterwards.
"""

import multiprocessing
import subprocess
import sys
import threading

import numba
import pytest

from workbench.lab import compiling

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
    assert 0.8 < int(first.out) / compiling.LOOPS["line"][1] < 1.2
    later = _prepare(tmp_path, capfd)
    assert later.out.strip() == "0" and "compiling" not in later.err


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
    loop = None

    def __init__(self, error=None):
        self.compiled = []
        self._error = error

    def compile_half(self, half):
        self.compiled.append(half)
        if self._error:
            raise self._error

    def compile(self, *, periods):
        self.compiled.append("all")


@pytest.fixture
def others(monkeypatch):
    """Whom half of the work was given to; on a machine of two cores, with nothing on disk."""
    begun = []

    def popen(*arguments, _popen=subprocess.Popen, **options):
        begun.append(_popen(*arguments, **options))
        return begun[-1]

    monkeypatch.setattr(compiling.subprocess, "Popen", popen)
    monkeypatch.setattr(compiling, "on_disk", lambda loop: False)
    monkeypatch.setattr(compiling, "cores", lambda: 2)
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    return begun


def test_another_process_that_fails_leaves_the_work_to_this_one(others, monkeypatch):
    monkeypatch.setattr(compiling, "_HALF", "raise SystemExit(3)")
    convoy = _Convoy()
    compiling.compile_blocks(convoy, False)
    assert convoy.compiled == [0, "all"] and others[0].returncode == 3


def test_an_interrupt_ends_the_other_process_too(others, monkeypatch):
    monkeypatch.setattr(compiling, "_HALF", "import time; time.sleep(1000)")
    with pytest.raises(KeyboardInterrupt):
        compiling.compile_blocks(_Convoy(KeyboardInterrupt()), False)
    assert others[0].returncode not in (None, 0)


@pytest.mark.parametrize("what", ["on_disk", "cores", "worker"])
def test_nobody_else_compiles_what_is_there_nor_where_no_core_is_free(others, monkeypatch, what):
    if what == "on_disk":
        monkeypatch.setattr(compiling, "on_disk", lambda loop: True)
    if what == "cores":
        monkeypatch.setattr(compiling, "cores", lambda: 1)
    if what == "worker":
        monkeypatch.setattr(multiprocessing, "parent_process", lambda: "somebody")
    convoy = _Convoy()
    compiling.compile_blocks(convoy, False)
    assert convoy.compiled == ["all"] and not others
