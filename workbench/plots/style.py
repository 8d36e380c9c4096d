"""The look of all figures: one rc context, colours and small helpers.

Colour-blind safe cycle (Okabe and Ito), repeated by markers; viridis on a log scale for counts;
zero visits in a distinct light grey.
"""

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text

CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
NEVER = "#e8e8e8"  # cells without a visit
INK = "#333333"

RC: Any = {
    "figure.dpi": 110,
    "savefig.dpi": 160,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "font.size": 9.5,
    "axes.labelsize": 9.5,
    "axes.titlesize": 10,
    "legend.fontsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "axes.prop_cycle": cycler(color=CYCLE),
    "image.cmap": "viridis",
    "svg.hashsalt": "workbench",
    "svg.fonttype": "path",
}


@contextmanager
def style() -> Iterator[None]:
    """Draw with the project's look inside a ``with`` block, whatever a matplotlibrc says."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(RC)
        yield


def new_axes(width_in: float = 5.0, height_in: float = 4.0) -> Axes:
    """Return the axes of a new figure that belongs to no window."""
    return Figure(figsize=(width_in, height_in), layout="constrained").add_subplot()


def legible(fig: Figure, width_in: float = 7.0) -> None:
    """Make a figure readable on a page (7 inches at 700 pixels), once: larger text where it is
    wider, labels that fit their axes.

    Notes and legends that several plots side by side share are left to the first.
    """
    if getattr(fig, "_legible", False):
        return
    fig._legible = True  # type: ignore[attr-defined]  # ours
    factor = max(1.0, fig.get_figwidth() / width_in) ** 0.7
    _leave_to_the_first(fig.axes)
    fig.set_figheight(factor * fig.get_figheight())
    every = [ax for ax in fig.findobj(Axes) if isinstance(ax, Axes)]  # insets too
    for ax in every:
        for axis in (ax.xaxis, ax.yaxis):
            size = axis.get_tick_params().get("labelsize") or mpl.rcParams["xtick.labelsize"]
            for which in ("major", "minor"):
                axis.set_tick_params(
                    which=which, labelsize=factor * FontProperties(size=size).get_size_in_points()
                )
    ticks = {
        text
        for ax in every
        for text in (*ax.get_xticklabels(which="both"), *ax.get_yticklabels(which="both"))
    }
    for text in fig.findobj(Text):
        assert isinstance(text, Text)
        if text not in ticks:
            text.set_fontsize(factor * text.get_fontsize())
    fig.draw_without_rendering()
    for ax in fig.axes:
        box = ax.get_window_extent()
        for label, room in ((ax.xaxis.label, box.width), (ax.yaxis.label, box.height)):
            extent = label.get_window_extent()
            length = extent.width if label is ax.xaxis.label else extent.height
            if label.get_text() and length > room and "\n" not in label.get_text():
                label.set_text(
                    textwrap.fill(
                        label.get_text(), max(10, int(len(label.get_text()) * room / length))
                    )
                )
    fig.draw_without_rendering()
    fig.set_layout_engine("none")  # frozen: a constrained layout moves a little at every drawing


def _leave_to_the_first(axes: Sequence[Axes]) -> None:
    notes = set[str]()
    legends = set[tuple[str, ...]]()
    for ax in axes:
        said = ax.get_title(loc="left")
        if said.startswith(("mean, ", "difference ")) and said in notes:
            ax.set_title("", loc="left")
        notes.add(said)
        legend = ax.get_legend()
        names = tuple(text.get_text() for text in legend.get_texts()) if legend is not None else ()
        if legend is not None and names in legends:
            legend.remove()
        legends.add(names)


def note(ax: Axes, text: str) -> None:
    """Write n and what a band means under the axes' title line, small."""
    ax.set_title(text, loc="left", fontsize=9, color="#555555")
