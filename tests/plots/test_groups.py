"""Groups of runs beside each other."""

import math
from dataclasses import replace

import pytest

import workbench as wb

BASE = wb.ConvoyConfig(drive="rolling", followers=1)


def _runs(config, seeds):
    return [wb.learn(config.with_seed(seed), steps=500, progress=False) for seed in seeds]


@pytest.fixture(scope="module")
def runs():
    return _runs(BASE, (1, 2, 3)) + _runs(replace(BASE, state_tiles=(5, 5)), (1, 2, 3))


def test_groups_are_named_by_what_differs_beside_the_seed(runs):
    found = wb.compare(runs, ["losses", "ripple_mm"])
    assert found.table["group"].unique().tolist() == [
        "state_tiles = (9, 9)",
        "state_tiles = (5, 5)",
    ]
    assert found.table["seeds"].tolist() == [3] * 4
    losses = [run.summary["losses"] for run in runs[:3]]
    line = found.table.iloc[0]
    assert line["value"] == pytest.approx(sum(losses) / 3) and line["low"] < line["value"]
    assert found.runs["losses"].tolist()[:3] == losses
    assert found._repr_html_().count("<img") == 1
    ticks = [text.get_text() for text in found.figure.axes[0].get_yticklabels()]
    assert ticks == ["state_tiles = (9, 9)", "state_tiles = (5, 5)"]


def test_a_single_run_has_no_interval(runs):
    found = wb.compare({"one": runs[:1], "some": runs[1:3]}, ["losses"]).table.set_index("group")
    assert math.isnan(found.loc["one", "low"]) and found.loc["some", "high"] > 0
    assert found["seeds"].to_dict() == {"one": 1, "some": 2}


def test_what_cannot_be_compared_is_refused(runs):
    with pytest.raises(ValueError, match="runs is empty; expected finished runs"):
        wb.compare([])
    with pytest.raises(ValueError, match="seed 1 is twice in group 'a'"):
        wb.compare({"a": [runs[0], runs[3]]})
    with pytest.raises(ValueError, match="quantity 'loses'; expected one of"):
        wb.compare(runs, ["loses"])


def test_no_interval_of_what_counts_or_spreads_reaches_below_0(runs):
    runs = [replace(run) for run in runs[:3]]
    for run, losses in zip(runs, (0, 0, 40), strict=True):
        vars(run)["summary"] = run.summary | {"losses": losses, "mean_reward": losses - 20.0}
    table = wb.compare({"all": runs}, ["losses", "mean_reward"]).table.set_index("quantity")
    assert table.loc["losses", "low"] == 0.0 < table.loc["losses", "value"]
    assert table.loc["mean_reward", "low"] < -20.0  # has a sign
