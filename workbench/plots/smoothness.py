"""Plots of the smoothness protocol: deviations along the loop, and what a follower passes on.

Like all plots they take data, draw on ``ax`` and return it; the numbers come from
``workbench.measures.judder``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from workbench.measures.judder import BAND_M, Deviations, Transfer, tractrix_gain
from workbench.plots.style import CYCLE, MARKERS, new_axes


def deviation_traces(
    found: Deviations, *, loop: int = -1, spacing_mm: float = 12.0, ax: Axes | None = None
) -> Axes:
    """Draw the lateral deviation of every robot along one loop, one above the other, the leader on
    top.

    Args:
        found: from ``workbench.measures.judder.deviations``.
        loop: which of the whole loops, -1 the last.
        spacing_mm: between the zero lines of neighbours.
    """
    ax = ax or new_axes(8.0, 3.8)
    chosen = np.arange(found.loops)[loop] * found.samples + np.arange(found.samples)
    along = np.arange(found.samples) * found.step_m
    robots = len(found.lateral)
    for robot, row in enumerate(found.lateral):
        level = -spacing_mm * robot
        ax.axhline(level, color="#cccccc", linewidth=0.7, zorder=0)
        ax.plot(along, level + 1000 * row[chosen], color=CYCLE[robot % len(CYCLE)], linewidth=1.2)
    names = ["leader", *(f"follower {k}" for k in range(1, robots))]
    ax.set_yticks(-spacing_mm * np.arange(robots), names)
    ax.plot([along[-1] * 1.015] * 2, [0, 5], color="#333333", linewidth=2, clip_on=False)
    ax.text(along[-1] * 1.025, 2.5, "5 mm", va="center", fontsize=8)
    ax.set_xlim(0, along[-1])
    ax.set_xlabel("arc length along the nominal loop in m (one loop)")
    ax.set_ylabel("lateral deviation, mean removed")
    return ax


def transfer_curves(
    cases: Mapping[str, Transfer],
    distance_m: float,
    *,
    gain: Axes,
    coherence: Axes,
    wavelengths_m: tuple[float, float] = BAND_M,
) -> None:
    """Draw |H1| and coherence of the first follower against wavelength, beside the tractrix's
    formula.

    Args:
        cases: name → transfer from leader to follower; only wavelengths in the band are drawn,
            where the leader has power.
        distance_m: distance of the tractrix.
        gain, coherence: axes for the two quantities.
    """
    for number, (name, found) in enumerate(cases.items()):
        wavelength = 1 / found.frequency
        inside = (wavelength >= wavelengths_m[0] - 1e-9) & (wavelength <= wavelengths_m[1] + 1e-9)
        style: dict[str, Any] = {
            "color": CYCLE[number],
            "marker": MARKERS[number],
            "markersize": 4,
            "linewidth": 1.0,
        }
        style["linestyle"] = ("-", "-.", ":")[number % 3]
        gain.plot(wavelength[inside], found.gain[inside], label=name, **style)
        coherence.plot(wavelength[inside], found.coherence[inside], label=name, **style)
    at = np.linspace(*wavelengths_m, 100)
    gain.plot(
        at,
        tractrix_gain(distance_m, at),
        color="#333333",
        linestyle="--",
        linewidth=1.4,
        label="tractrix, formula",
    )
    gain.set_ylim(bottom=0)
    gain.set_ylabel("gain |H₁|, follower 1 over leader")
    coherence.axhline(0.8, color="#999999", linewidth=0.8, linestyle=":")
    coherence.set_ylim(0, 1.05)
    coherence.set_ylabel("coherence γ²")
    for ax in (gain, coherence):
        ax.set_xlabel("wavelength of the judder in m")
    gain.legend(fontsize=8)
