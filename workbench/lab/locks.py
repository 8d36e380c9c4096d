"""One writer per folder: a lock that its owner signs, and that ends with the process whatever ends
it.

>>> import tempfile
>>> with tempfile.TemporaryDirectory() as folder, locked(Path(folder)):
...     print(owner(Path(folder)) == f"process {os.getpid()} on {socket.gethostname()}")
True

Contract: the lock is the operating system's (``filelock``), on the file ``.lock`` in the folder,
which stays there empty.
"""

import contextlib
import os
import socket
import warnings
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

FILE = ".lock"
_SAY_AFTER_S = 1.0  # of waiting


class FolderInUse(RuntimeError):
    """Another process, or another thread of this one, writes to the folder."""


@contextlib.contextmanager
def locked(folder: Path, *, wait_s: float = 0.0) -> Iterator[None]:
    """Keep a folder, which is made if there is none, to this process.

    Args:
        folder: to be written to.
        wait_s: seconds to wait for another owner.

    Raises:
        FolderInUse: it has another owner, who is named.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / FILE, on_acquired=_sign)
    try:
        try:
            lock.acquire(timeout=min(wait_s, _SAY_AFTER_S))
        except Timeout:
            if wait_s <= _SAY_AFTER_S:
                raise
            warnings.warn(
                f"{folder} is in use by {owner(folder)}; waiting until it is done", stacklevel=3
            )
            lock.acquire(timeout=wait_s - _SAY_AFTER_S)
    except Timeout:
        raise FolderInUse(
            f"{folder} is in use by {owner(folder)}; wait until it is done and resume, or "
            "choose another folder"
        ) from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.truncate(folder / FILE, 0)
        lock.release()


def in_use(folder: Path) -> bool:
    """Return whether somebody writes to a folder now."""
    if not (folder / FILE).is_file():
        return False
    lock = FileLock(folder / FILE)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    lock.release()
    return False


def owner(folder: Path) -> str:
    """Return who has signed a folder's lock, in words."""
    try:
        return (folder / FILE).read_text(encoding="utf-8").strip() or "another process"
    except OSError:
        return "another process"


def _sign(descriptor: int) -> None:
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
