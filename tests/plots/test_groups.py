"""Groups of runs beside each other."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb

BASE = wb.ConvoyConfig(drive="rolling", followers=1)


def _runs(config, seeds):
    return [wb.learn(config.with_seed(seed), steps=500, progress=False) for seed in seeds]


@pytest.fixture(scope="module")
def runs():
    return _runs(BASE, (1, 2, 3)) + _runs(replace(BASE, state_tiles=(5, 5)), (1, 2, 3))


def test_groups_are_named_by_what_differs_beside_the_seed(runs):
    found = wb.compare(runs, quantities=["losses", "ripple_mm"])
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
    found = wb.compare({"one": runs[:1], "some": runs[1:3]}, quantities=["losses"]).table.set_index(
        "group"
    )
    assert math.isnan(found.loc["one", "low"]) and found.loc["some", "high"] > 0
    assert found["seeds"].to_dict() == {"one": 1, "some": 2}


def test_differences_are_from_the_first_group_seed_by_seed(runs):
    found = wb.compare({"nine": runs[:3], "five": runs[5:2:-1]}, quantities="losses")
    losses = np.array([run.summary["losses"] for run in runs])
    [line] = found.differences.to_dict("records")
    assert line["group"] == "five" and line["seeds"] == 3
    assert line["value"] == pytest.approx((losses[3:] - losses[:3]).mean())
    assert line["low"] < line["value"] < line["high"]
    assert "Differences from nine, seed by seed" in found._repr_html_()
    assert (
        len(wb.compare({"nine": runs[:3], "five": runs[4:]}, quantities="losses").differences) == 0
    )


def test_who_drove_and_for_what_makes_groups_too():
    def slow(distance, bearing):
        return 0.06 + (distance - 0.15), 4.0 * bearing

    laws = (wb.LAWS["carrot"](), wb.LAWS["pursuit"](), wb.OwnLaw(function=slow))
    driven = [
        wb.evaluate(law, BASE.with_seed(seed), minutes=1, progress=False)
        for law in laws
        for seed in (1, 2)
    ]
    groups = wb.compare(driven, quantities="losses").table["group"].tolist()
    assert [group.split()[2] for group in groups] == ["carrot", "pursuit", "own"]
    rewards = (lambda u, v: -u * u, lambda u, v: -v * v)
    learned = [wb.learn(BASE, steps=300, reward=one, progress=False) for one in rewards]
    assert len(wb.compare(learned, quantities="losses").table) == 2


def test_odd_names_and_single_runs_are_drawn(runs):
    found = wb.compare({r"$\frac$ " + 60 * "long ": runs[:1], math.nan: runs[3:4]})
    figure = found.figure
    figure.savefig(io.BytesIO(), format="png")
    assert figure.axes[0].get_title(loc="left") == "single runs: no intervals"
    assert len(found.table) == 10
    assert wb.compare(runs[0]).runs["group"].tolist() == ["all"]


def test_what_cannot_be_compared_is_refused(runs):
    with pytest.raises(ValueError, match="expected finished runs, such as those of learn_seeds"):
        wb.compare([])
    with pytest.raises(ValueError, match=r"without runs: \['b'\]"):
        wb.compare({"a": runs[:2], "b": []})
    with pytest.raises(TypeError, match="runs has a list in it; expected runs, or groups of them"):
        wb.compare([runs[:2]])
    with pytest.raises(ValueError, match="'drive' of group 'all', seed 1, is 'rolling'"):
        wb.compare(runs[:1], quantities=["drive"])
    short = wb.evaluate(wb.LAWS["carrot"](), BASE, minutes=1, progress=False)
    with pytest.raises(ValueError, match="is None: there was too little of it"):
        wb.compare([short], quantities="rms_distance_error_mm_last_third")
    with pytest.raises(ValueError, match="seed 1 is twice in group 'a'"):
        wb.compare({"a": [runs[0], runs[3]]})
    with pytest.raises(ValueError, match="quantity 'loses'; expected one of"):
        wb.compare(runs, quantities=["loses"])


def test_no_interval_of_what_counts_or_spreads_reaches_below_0(runs):
    runs = [replace(run) for run in runs[:3]]
    for run, losses in zip(runs, (0, 0, 40), strict=True):
        vars(run)["summary"] = run.summary | {"losses": losses, "mean_reward": losses - 20.0}
    table = wb.compare({"all": runs}, quantities=["losses", "mean_reward"]).table.set_index(
        "quantity"
    )
    assert table.loc["losses", "low"] == 0.0 < table.loc["losses", "value"]
    assert table.loc["mean_reward", "low"] < -20.0  # has a sign
