"""Figures on a page: text large enough, labels that fit, shared notes once, and the same bytes
however often they are drawn.
"""

import matplotlib as mpl
from matplotlib.figure import Figure

from workbench.plots.figures import png
from workbench.plots.style import legible, note, style


def _wide():
    with style():
        fig = Figure(figsize=(11.0, 3.0), layout="constrained")
        for ax in fig.subplots(1, 3):
            ax.plot([1, 10], [2, 6], label="case")
            ax.set(
                xlabel="a label that is far too long for a third of the page, in millimetres",
                ylabel="y",
                yscale="log",
            )
            note(ax, "mean, interval over seeds")
            ax.legend()
    return fig


def test_wide_figures_get_larger_text_and_their_labels_fit():
    fig = _wide()
    small = fig.axes[0].yaxis.label.get_fontsize()
    legible(fig)
    assert fig.axes[0].yaxis.label.get_fontsize() > 1.3 * small
    ticks = {round(text.get_fontsize(), 3) for text in fig.axes[0].get_yticklabels(which="both")}
    assert len(ticks) == 1 and ticks.pop() > 1.3 * small
    for ax in fig.axes:
        assert ax.xaxis.label.get_window_extent().width <= 1.05 * ax.get_window_extent().width


def test_notes_and_legends_that_are_shared_stand_once():
    fig = _wide()
    legible(fig)
    assert [bool(ax.get_title(loc="left")) for ax in fig.axes] == [True, False, False]
    assert [ax.get_legend() is not None for ax in fig.axes] == [True, False, False]


def test_a_figure_is_the_same_picture_however_often_it_is_drawn():
    fig = _wide()
    first = png(fig)
    assert first == png(fig) == png(_wide())


def test_a_narrow_figure_keeps_its_text():
    fig = Figure(figsize=(6.0, 3.0))
    label = fig.subplots().set_xlabel("x").get_fontsize()
    legible(fig)
    assert fig.axes[0].xaxis.label.get_fontsize() == label and fig.get_figheight() == 3.0


def test_a_matplotlibrc_of_the_user_s_changes_no_published_figure():
    def drawn():
        fig = Figure(figsize=(2, 2))
        with style():
            fig.add_subplot().plot([0, 1])
        return png(fig)

    before = drawn()
    with mpl.rc_context({"font.family": "serif", "axes.grid": True, "savefig.bbox": "tight"}):
        assert drawn() == before
