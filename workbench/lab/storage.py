"""Files that a kill at any moment cannot spoil: written under a temporary name, flushed to disk,
then renamed.

Contract: after ``write_npz`` or ``write_json`` returns, the whole file is there; if it raises, the
previous file is untouched. Nothing is pickled. Equal contents give equal bytes.
"""

import hashlib
import json
import math
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from workbench.lab.locks import FILE as LOCK

if TYPE_CHECKING:
    import pandas as pd

_TEMPORARY = (
    ".tmp"  # the end of a temporary name; before it stand the file's name and who writes it
)


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays to an .npz file."""
    # a mapping of arrays
    _write(path, lambda file: np.savez(file, **arrays))  # type: ignore[arg-type]


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Read all arrays of an .npz file, refusing pickles.

    Raises:
        FileNotFoundError, ValueError: with the path and what is wrong.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; expected an .npz file of a run")
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, KeyError) as error:
        raise ValueError(
            f"{path} is not a readable .npz file: {error}; restore it or run again"
        ) from error
    except Exception as error:  # zipfile.BadZipFile, zlib.error: the file is damaged
        raise ValueError(f"{path} is damaged: {error}; restore it or run again") from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file from bytes."""
    _write(path, lambda file: file.write(content))


def write_table(path: Path, table: "pd.DataFrame", digits: int) -> None:
    """Write a table as CSV with numbers of so many digits."""
    write_bytes(path, table_bytes(table, digits))


def table_bytes(table: "pd.DataFrame", digits: int) -> bytes:
    """Return a table as CSV with numbers of so many digits."""
    text: str = table.to_csv(index=False, float_format=f"%.{digits}g", lineterminator="\n")
    return text.encode()


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON; numbers that are not finite become null."""
    text = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    _write(path, lambda file: file.write(text.encode()))


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        FileNotFoundError, ValueError: with the path and what is wrong.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is not valid JSON: {error}") from error


def plain(value: Any) -> Any:
    """Return a value with numpy scalars as Python numbers and non-finite numbers as None."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def sha256_of(value: Any) -> str:
    """Return a hash of plain JSON values, whatever the order of their names."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()


def remove_temporaries(folder: Path, names: Sequence[str]) -> None:
    """Delete what interrupted writes of the named files left in a folder."""
    for name in names:
        for path in folder.glob(f".{name}.*{_TEMPORARY}"):
            path.unlink(missing_ok=True)


def refuse_existing(folder: Path) -> None:
    """Raise FileExistsError if a folder has something in it."""
    if folder.exists() and (
        not folder.is_dir() or any(path.name != LOCK for path in folder.iterdir())
    ):
        raise FileExistsError(
            f"{folder} already has something in it; choose another folder, or resume=True "
            "(--resume) to continue it"
        )


def _write(path: Path, fill: Callable[[BinaryIO], object]) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}{_TEMPORARY}")
    try:
        with open(temporary, "wb") as file:
            fill(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except Exception:
        temporary.unlink(missing_ok=True)
        raise
