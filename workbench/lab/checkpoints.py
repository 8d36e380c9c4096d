"""Checkpoints: everything that the next block of a batch depends on, with the request that it
belongs to.

Contract: written whole or not at all (``workbench.lab.storage``); a checkpoint of another request
is refused.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.formation.convoy import Convoy
from workbench.lab.records import Recorder
from workbench.lab.storage import read_npz, write_npz


def save_checkpoint(path: Path, convoy: Convoy, recorders: list[Recorder], request: str) -> None:
    """Write the state of a batch; raise OSError that says what is left if the disk refuses."""
    arrays: dict[str, NDArray[Any]] = {"request": np.array(request)}
    arrays |= {f"convoy.{name}": array for name, array in convoy.state().items()}
    for b, recorder in enumerate(recorders):
        arrays |= {f"recorder{b}.{name}": array for name, array in recorder.records().items()}
    try:
        write_npz(path, arrays)
    except OSError as error:
        kept = (
            "the last good checkpoint is kept there"
            if path.is_file()
            else "there is no earlier checkpoint"
        )
        raise OSError(
            f"could not write {path} at update {int(convoy.updates.sum())}: {error}; {kept}. "
            "Make room, then continue with resume"
        ) from error


def load_checkpoint(path: Path, convoy: Convoy, recorders: list[Recorder], request: str) -> None:
    """Continue a batch from a checkpoint; raise ValueError if it belongs to another request or is
    damaged.
    """
    arrays = read_npz(path)
    if str(arrays.get("request")) != request:
        raise ValueError(
            f"{path} belongs to another request (seeds, their order, configuration, length or "
            "policy differ); continue with "
            "the same request, or choose another folder"
        )

    def under(prefix: str) -> dict[str, NDArray[Any]]:
        return {
            name.removeprefix(prefix): array
            for name, array in arrays.items()
            if name.startswith(prefix)
        }

    convoy.load(under("convoy."))
    for b, recorder in enumerate(recorders):
        recorder.load(under(f"recorder{b}."))
