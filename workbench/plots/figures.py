"""Published figures: one writer, a manifest, and a check against what is there.

``save_figure`` writes a picture (PNG, SVG), the plotted numbers beside it (CSV) and a row in
``figures/manifest.json``: inputs, seeds, versions, mode, and the sha256 of every file. There are no
clocks in any of them: drawing the same numbers again changes no byte. In quick mode
(WORKBENCH_QUICK=1) nothing is written.

``regenerate`` runs the experiment and all notebooks; ``compare_numbers`` tells which plotted
numbers differ and by how much, for machines whose arithmetic differs in the last digits.
"""

import hashlib
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from IPython.display import Image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from workbench import fields, paths
from workbench.lab.runs import Run
from workbench.lab.storage import read_json, write_json
from workbench.plots.style import legible, style
from workbench.sources import version

try:
    import fcntl
except ImportError:  # not on Windows: there, figures are made by one process
    fcntl = None  # type: ignore[assignment]  # a module, or nothing

MANIFEST = "manifest.json"
_VERSIONS = ("workbench", "matplotlib", "mujoco", "numba", "numpy", "pandas", "scipy")


def save_figure(
    fig: Figure,
    name: str,
    *,
    numbers: pd.DataFrame | Mapping[str, Any],
    sources: Sequence[Run] = (),
    svg: bool = True,
    folder: Path | None = None,
) -> list[Path]:
    """Write a figure, its numbers and its row in the manifest; does nothing in quick mode.

    Args:
        fig: the figure.
        name: file name without ending, e.g. "fig4_visit_map_wheels".
        numbers: what is plotted, as a tidy table (or columns of one).
        sources: the runs that the numbers come from.
        svg: also write a vector picture (not for photographs of the arena).
        folder: default figures/.

    Returns:
        The files written; empty in quick mode.

    Raises:
        ValueError: the name is not a plain file name.
    """
    _check_name(name)
    if paths.QUICK:
        return []
    contents = {f"{name}.png": png(fig)}
    if svg:
        contents[f"{name}.svg"] = _draw(fig, "svg")
    return _write(name, contents, numbers, sources, folder or paths.FIGURES)


def _check_name(name: str) -> None:
    if not name or not all(letter.isalnum() or letter in "_-" for letter in name):
        raise ValueError(
            f"name = {name!r}; expected letters, digits, _ and - only: it becomes a file name"
        )


def _write(
    name: str,
    contents: dict[str, bytes],
    numbers: pd.DataFrame | Mapping[str, Any],
    sources: Sequence[Run],
    target: Path,
) -> list[Path]:
    """Write a figure's files, its numbers and its row in the manifest."""
    target.mkdir(parents=True, exist_ok=True)
    table = numbers if isinstance(numbers, pd.DataFrame) else pd.DataFrame(dict(numbers))
    contents[f"{name}.csv"] = table.to_csv(
        index=False, float_format="%.10g", lineterminator="\n"
    ).encode()
    for file, content in contents.items():
        (target / file).write_bytes(content)
    row = {
        "files": {file: hashlib.sha256(content).hexdigest() for file, content in contents.items()},
        "sources": [_describe(group) for group in _alike(sources)],
        "versions": {package: version(package) for package in _VERSIONS},
        "mode": "full",
    }
    with _alone(target):
        manifest = read_json(target / MANIFEST) if (target / MANIFEST).is_file() else {}
        write_json(target / MANIFEST, dict(sorted((manifest | {name: row}).items())))
    return [target / file for file in contents]


def publish_png(
    content: bytes,
    name: str,
    *,
    numbers: pd.DataFrame | Mapping[str, Any],
    sources: Sequence[Run] = (),
    width: int = 640,
) -> Image:
    """Write a picture that is a PNG already, an animated one for example, as ``save_figure`` does a
    figure; return it.
    """
    _check_name(name)
    if not paths.QUICK:
        _write(name, {f"{name}.png": content}, numbers, sources, paths.FIGURES)
    return Image(content, width=width)


def publish(
    fig: Figure,
    name: str,
    *,
    numbers: pd.DataFrame | Mapping[str, Any],
    sources: Sequence[Run] = (),
    svg: bool = True,
) -> Image:
    """Write a figure as ``save_figure`` does and return it as the picture that a notebook shows and
    stores.
    """
    save_figure(fig, name, numbers=numbers, sources=sources, svg=svg)
    return Image(png(fig), width=round(100 * fig.get_figwidth()))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes from a folder's manifest: notebooks are executed side by side."""
    name = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:16]
    with open(Path(tempfile.gettempdir()) / f"workbench-{name}.lock", "a") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def numbers_in(folder: Path) -> dict[str, pd.DataFrame]:
    """Return the plotted numbers of every figure in a folder, by file name."""
    return {path.name: pd.read_csv(path) for path in sorted(folder.glob("*.csv"))}


def compare_numbers(
    before: Mapping[str, pd.DataFrame], after: Mapping[str, pd.DataFrame]
) -> pd.DataFrame:
    """Return which plotted numbers differ: file, column, how many, the largest difference and what
    it is relative to.

    A file or column that only one side has, or that changed its length or its words, is listed with
    difference NaN.
    """
    rows: list[tuple[Any, ...]] = []
    for name in sorted(set(before) | set(after)):
        if name not in before or name not in after:
            side = "only before" if name in before else "only now"
            rows.append((name, "(whole file)", 0, np.nan, np.nan, side))
            continue
        old = before[name]
        new = after[name]
        for column in sorted(set(old.columns) | set(new.columns)):
            if column not in old or column not in new or len(old) != len(new):
                gap = abs(len(old) - len(new))
                rows.append((name, column, gap, np.nan, np.nan, "columns or rows differ"))
            else:
                found = _compare_column(old[column], new[column])
                rows += [(name, column, *found)] if found else []
    return pd.DataFrame(
        rows, columns=["file", "column", "numbers", "largest_difference", "relative", "note"]
    )


def _compare_column(old: pd.Series, new: pd.Series) -> tuple[int, float, float, str] | None:
    """Return how many values differ, the largest difference, what it is relative to, and a note;
    None where all are the same.
    """
    if all(map(pd.api.types.is_numeric_dtype, (old, new))):
        a, b = old.to_numpy(float), new.to_numpy(float)
        differs = ~((a == b) | (np.isnan(a) & np.isnan(b)))
        if not differs.any():
            return None
        gap = np.abs(a - b)[differs]
        scale = np.maximum(np.abs(a), np.abs(b))[differs]
        largest = int(np.argmax(gap))
        return int(differs.sum()), gap[largest], gap[largest] / scale[largest], ""
    if old.equals(new):
        return None
    return int((old.astype(str) != new.astype(str)).sum()), np.nan, np.nan, "words differ"


def changed_files(before: Mapping[str, bytes], after: Mapping[str, bytes]) -> list[str]:
    """Return the names whose bytes differ, or that only one side has."""
    return sorted(name for name in set(before) | set(after) if before.get(name) != after.get(name))


def png(fig: Figure) -> bytes:
    """Return the PNG of a figure, its text legible on a page; the same figure gives the same
    bytes.
    """
    return _draw(fig, "png")


def hasty_png(fig: Figure, like: Figure, width_px: int) -> bytes | None:
    """Return the PNG of a figure with the layout of another that ``png`` has drawn, in a fraction
    of its time; None where the two have different axes.
    """
    import cv2

    pairs = list(zip(fig.axes, like.axes, strict=False))
    if len(fig.axes) != len(like.axes):
        return None
    fig.set_layout_engine("none")
    with style():
        # text is as large on the page as there: a smaller figure, enlarged
        factor = like.get_figheight() / fig.get_figheight()
        fig.set_size_inches(like.get_figwidth() / factor, fig.get_figheight())
        for ax, model in pairs:
            ax.set_position(model.get_position(original=True))
            for label, known in (
                (ax.xaxis.label, model.xaxis.label.get_text()),
                (ax.yaxis.label, model.yaxis.label.get_text()),
            ):
                if label.get_text() == known.replace("\n", " "):
                    label.set_text(known)
        fig.set_dpi(width_px / fig.get_figwidth())
        canvas = FigureCanvasAgg(fig)
        canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., [2, 1, 0]]
    done, data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return data.tobytes() if done else None


def _draw(fig: Figure, kind: str) -> bytes:
    with style():
        legible(fig)
    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    with style():  # also fixes the salt of SVG's identifiers: without it they are random
        fig.savefig(buffer, format=kind, metadata=metadata)
    return buffer.getvalue()


def _alike(runs: Sequence[Run]) -> list[list[Run]]:
    """Group runs that differ in their seed only."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        key = repr((run.kind, run.length, run.config.with_seed(0)))
        groups.setdefault(key, []).append(run)
    return list(groups.values())


def _describe(runs: list[Run]) -> dict[str, Any]:
    run = runs[0]
    config = fields.to_dict(run.config)
    del config["seed"]
    policies = hashlib.sha256("".join(run.policy.sha256() for run in runs).encode()).hexdigest()
    return {
        "kind": run.kind,
        "length": run.length,
        "seeds": [run.config.seed for run in runs],
        "config": config,
        "policies_sha256": policies,
    }
