"""How objects look in a notebook: small tables and maps as HTML, without a library."""

import html
from collections.abc import Iterable, Sequence
from typing import Any

from numpy.typing import ArrayLike, NDArray

_SIDE = 99  # px
_TILES = 25  # a side, at most
_MAPS = 8  # at most


def table(rows: Iterable[Sequence[object]], title: str = "") -> str:
    """Return rows of plain values as an HTML table; numbers have four digits."""
    cell = "<td style='text-align:left'>{}</td>"
    lines = "".join(f"<tr>{''.join(cell.format(_word(x)) for x in row)}</tr>" for row in rows)
    head = f"<b>{html.escape(title)}</b>" if title else ""
    return f"{head}<table>{lines}</table>" if lines else f"<div>{head}</div>"


def _word(cell: object) -> str:
    if isinstance(cell, float):
        return f"{cell:.4g}"
    return html.escape(str(cell))


def heat(values: ArrayLike, label: str) -> str:
    """Return a map of (rows, columns) values from 0 to 1 as a small SVG, first row at the bottom
    as in every figure; 0 is grey.
    """
    import numpy as np

    shares: NDArray[np.float64] = np.asarray(values, dtype=float)
    for axis, tiles in enumerate(shares.shape):  # of many tiles the largest of every few
        few = np.arange(0, tiles, -(-tiles // _TILES))
        shares = np.maximum.reduceat(shares, few, axis=axis)
    rows, columns = shares.shape
    size = max(4, min(16, _SIDE // max(rows, columns)))
    parts = []
    for (row, column), value in np.ndenumerate(shares):
        colour = f"hsl({250 - 190 * value:.0f} 70% {28 + 42 * value:.0f}%)" if value > 0 else "#ccc"
        x, y = column * size, (rows - 1 - row) * size
        parts.append(
            f"<rect x='{x}' y='{y}' width='{size - 1}' height='{size - 1}' fill='{colour}'/>"
        )
    return (
        f"<figure style='display:inline-block;margin:4px'><svg width='{columns * size}' "
        f"height='{rows * size}' role='img' aria-label='{html.escape(label, quote=True)}'>"
        f"{''.join(parts)}</svg>"
        f"<figcaption style='font-size:11px'>{html.escape(label)}</figcaption></figure>"
    )


def heats(values: NDArray[Any], label: str) -> str:
    """Return a map of each of the first few (maps, rows, columns); label has a place for their
    number.
    """
    maps = [heat(one, label.format(k)) for k, one in enumerate(values[:_MAPS], 1)]
    more = f"<div>… and {len(values) - _MAPS} more</div>" if len(values) > _MAPS else ""
    return "".join(maps) + more
