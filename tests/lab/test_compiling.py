"""The bar while something is compiled, and that nothing is left to compile afterwards."""

import subprocess
import sys
import threading

import numba

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
    assert 0.8 < int(first.out) / compiling.FUNCTIONS[True] < 1.2
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
