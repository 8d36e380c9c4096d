"""Plots of the protocol draw what they are given."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.measures.judder import Deviations, Transfer, tractrix_gain
from workbench.plots.smoothness import deviation_traces, transfer_curves


def test_traces_show_one_loop_of_every_robot_to_scale():
    lateral = np.stack([np.full(20, 0.001), np.full(20, 0.002)])
    ax = deviation_traces(Deviations(lateral, np.zeros(2), 10, 0.1), spacing_mm=10.0)
    drawn = [line.get_ydata() for line in ax.get_lines() if len(line.get_ydata()) == 10]
    np.testing.assert_allclose(drawn[0], 1.0)
    np.testing.assert_allclose(drawn[1], -10 + 2.0)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["leader", "follower 1"]


def test_transfers_are_drawn_in_the_band_beside_the_formula():
    frequency = np.array([1.0, 4.0, 5.0, 8.0, 20.0])
    found = Transfer(frequency, np.ones(5), np.ones(5), np.arange(5) / 10, np.arange(5) / 5)
    gain, coherence = Figure().subplots(1, 2)
    transfer_curves({"a": found}, 0.1, gain=gain, coherence=coherence)
    line, formula = gain.get_lines()[:2]
    np.testing.assert_allclose(line.get_xdata(), [0.25, 0.2, 0.125])
    np.testing.assert_allclose(line.get_ydata(), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(formula.get_ydata()[[0, -1]], tractrix_gain(0.1, [0.1, 0.3]))
    assert coherence.get_lines()[0].get_ydata() == pytest.approx([0.2, 0.4, 0.6])
