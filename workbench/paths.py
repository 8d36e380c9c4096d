"""Where things are, and how this process was asked to run.

Switches of the environment; all but the last are read here:

    WORKBENCH_QUICK=1        notebooks run a small version and write no figure (tests)
    WORKBENCH_STATIC=1       no progress bars, no widgets (stored notebooks, logs)
    WORKBENCH_RECORDINGS=DIR recordings of real robots, for validation only
    WORKBENCH_BATCH=1        MuJoCo as it was run formerly, for comparison (``arena.library``)

In a checkout everything is where the README's picture shows it. An installed package has its data
in itself, and makes runs/ and figures/ where the program was started.

>>> (DATA / "robots" / "epuck.json").is_file()
True
"""

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = (_PACKAGE.parent / "pyproject.toml").is_file()
ROOT = _PACKAGE.parent if _CHECKOUT else Path.cwd()
DATA = ROOT / "data" if _CHECKOUT else _PACKAGE / "data"
FIGURES = ROOT / "figures"
NOTEBOOKS = ROOT / "notebooks"
RUNS = ROOT / "runs"

QUICK = os.environ.get("WORKBENCH_QUICK", "") == "1"
STATIC = os.environ.get("WORKBENCH_STATIC", "") == "1"


def recordings() -> Path:
    """Return the folder of real-robot recordings.

    Raises:
        FileNotFoundError: WORKBENCH_RECORDINGS is unset or names no folder.
    """
    value = os.environ.get("WORKBENCH_RECORDINGS", "")
    if not value or not Path(value).is_dir():
        raise FileNotFoundError(
            f"WORKBENCH_RECORDINGS is {value!r}; set it to the folder that holds the recordings"
        )
    return Path(value)
