"""One writer per folder."""

import os
import subprocess
import sys
import threading

import pytest

from workbench.lab.locks import FolderInUse, in_use, locked, owner

_HOLD = """
import sys
from pathlib import Path
from workbench.lab.locks import locked
with locked(Path(sys.argv[1])):
    print("holds", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """A process that holds the folder until its standard input is closed."""
    command = [sys.executable, "-c", _HOLD, str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "holds\n"
        yield process
        if process.poll() is None:
            process.communicate()


def test_the_second_process_is_told_who_writes(tmp_path, other):
    assert in_use(tmp_path) and f"process {other.pid} on" in owner(tmp_path)
    with (
        pytest.raises(
            FolderInUse, match=rf"is in use by process {other.pid} on .*choose another folder"
        ),
        locked(tmp_path),
    ):
        pass


def test_a_killed_owner_holds_nothing(tmp_path, other):
    other.kill()
    other.wait()
    assert not in_use(tmp_path)
    with locked(tmp_path):
        assert f"process {os.getpid()} on" in owner(tmp_path)


@pytest.mark.filterwarnings("ignore:.*waiting until it is done")
def test_who_waits_gets_the_folder_when_it_is_free(tmp_path, other):
    threading.Timer(1.5, other.stdin.close).start()
    with locked(tmp_path, wait_s=60.0):
        assert other.wait(timeout=10) == 0


def test_a_lock_of_the_same_process_counts_too(tmp_path):
    with (
        locked(tmp_path),
        pytest.raises(FolderInUse, match=f"process {os.getpid()}"),
        locked(tmp_path),
    ):
        pass
