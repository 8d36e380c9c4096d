"""Summaries of studies and their plots, on tables small enough to work out by hand."""

import numpy as np
import pandas as pd
import pytest

from workbench.measures.comparisons import (
    by_condition,
    clear_from,
    criterion_times,
    difference,
    said,
)
from workbench.plots.comparisons import beside, curves, dots
from workbench.plots.style import new_axes


def _table():
    rng = np.random.default_rng(0)
    lines = []
    for spacing in ("uniform", "logarithmic"):
        for tiles in (9, 3):
            for seed in range(1, 11):
                lines.append(
                    (
                        spacing,
                        tiles,
                        seed,
                        10.0 / tiles + seed + (spacing == "logarithmic") + 0.01 * rng.normal(),
                    )
                )
    return pd.DataFrame(lines, columns=["spacing", "tiles", "seed", "error"])


def test_conditions_keep_their_order_and_count_their_seeds():
    summary = by_condition(_table(), ["spacing", "tiles"], "error")
    assert summary[["spacing", "tiles"]].values.tolist() == [
        ["uniform", 9],
        ["uniform", 3],
        ["logarithmic", 9],
        ["logarithmic", 3],
    ]
    assert set(summary["seeds"]) == {10}
    assert summary["value"][0] == pytest.approx(10 / 9 + 5.5, abs=0.02)
    assert np.all((summary["low"] < summary["value"]) & (summary["value"] < summary["high"]))


def test_differences_are_paired_within_the_other_keys():
    effect = difference(_table(), ["spacing", "tiles"], "error", {"spacing": "uniform"}).set_index(
        ["spacing", "tiles"]
    )
    assert effect.loc[("uniform", 3)][["value", "low", "high"]].tolist() == [0, 0, 0]
    for tiles in (3, 9):
        line = effect.loc[("logarithmic", tiles)]
        assert (
            0.98 < line["low"] < line["high"] < 1.02
        )  # although the seeds themselves spread over 9
    with pytest.raises(ValueError, match=r"has seeds \[\]"):
        difference(_table(), ["spacing", "tiles"], "error", {"spacing": "square"})


def test_criterion_times_count_what_was_never_reached():
    table = _table().query("spacing == 'uniform'")
    table = table.assign(time=np.where(table["tiles"] == 3, np.nan, 50.0))
    times = criterion_times(table, ["tiles"], "time", 200.0).set_index("tiles")
    assert times.loc[9][["seeds", "reached", "median", "value"]].tolist() == [10, 10, 50, 50]
    assert times.loc[3][["reached", "median", "value"]].tolist() == [0, np.inf, 200]


def test_keys_that_mix_conditions_or_clash_with_the_result_are_refused():
    with pytest.raises(ValueError, match="has seeds more than once: it mixes several conditions"):
        by_condition(_table(), ["tiles"], "error")
    with pytest.raises(ValueError, match=r"keys \['value'\] are names of the result"):
        by_condition(_table().rename(columns={"tiles": "value"}), ["spacing", "value"], "error")
    unnamed = _table().assign(spacing=lambda t: t["spacing"].where(t["spacing"] == "uniform"))
    assert (
        len(by_condition(unnamed, ["spacing", "tiles"], "error")) == 4
    )  # a missing name is a name


@pytest.mark.parametrize(
    ("lows", "wanted"),
    [
        ([-1, 0.5, -0.1, 2, 3], 4),
        ([1, 1, 1, 1, 1], 1),
        ([1, 1, 1, 1, -1], np.inf),
        ([-1, -1, -1, -1, 0.1], 5),
    ],
)
def test_an_effect_is_clear_from_the_level_after_which_every_interval_is_above_zero(lows, wanted):
    lines = pd.DataFrame({"level": [1, 2, 3, 4, 5], "low": lows}).sample(frac=1, random_state=0)
    assert clear_from(lines, "level") == wanted


def test_numbers_in_words():
    assert (
        said({"value": 3.21, "low": 2.9, "high": 3.64, "seeds": 10}, "mm")
        == "3.2 mm [2.9, 3.6], n = 10"
    )


def test_plots_show_every_condition_with_its_seeds_and_kind_of_interval():
    summary = by_condition(_table(), ["spacing", "tiles"], "error")
    assert (
        curves(summary, "tiles", by="spacing", xlabel="", ylabel="", log=True).get_yscale() == "log"
    )
    ax = curves(summary, "tiles", by="spacing", xlabel="tiles", ylabel="error in mm")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["uniform", "logarithmic"]
    assert "95 % interval over seeds, n = 10" in ax.get_title(loc="left")
    left, right = new_axes(), new_axes()
    dots(summary, "tiles", xlabel="error in mm", ax=left, reference=3.0)
    dots(summary, "tiles", xlabel="error in mm", ax=right)
    beside([left, right])
    assert [tick.get_text() for tick in left.get_yticklabels()] == ["9", "3", "9", "3"]
    assert {tick.get_text() for tick in right.get_yticklabels()} == {""}
    assert left.get_ylim()[0] > left.get_ylim()[1]  # first condition on top
