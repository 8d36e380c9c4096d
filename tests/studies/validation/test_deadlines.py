"""The control loop against the clock, on an emulated Overo link."""

import json

import pandas as pd
import pytest

from workbench import paths
from workbench.studies.validation import deadlines


def test_slow_updates_make_commands_late_without_the_buffer_and_periods_late_either_way(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(deadlines, "LEARNED", 2_000)
    result = deadlines.measure_deadlines(
        seconds=0.5, seeds=1, factors=(0.0, 10_000.0), out=tmp_path
    )
    table = pd.read_csv(tmp_path / "deadlines.csv").set_index(["factor", "buffer"])
    assert len(table) == 4 and len(result["medians"]) == 4
    assert (
        table.loc[(10_000.0, "off"), "latency_ms"] > 150 > table.loc[(10_000.0, "on"), "latency_ms"]
    )
    assert (
        table.loc[(10_000.0, "off"), "commands_met"]
        < 0.5
        < table.loc[(10_000.0, "on"), "commands_met"]
    )
    assert (table.loc[10_000.0, "periods_met"] < 0.5).all()  # the buffer saves no time
    assert json.loads((tmp_path / "deadlines.json").read_text())["baud"] == 230_400


@pytest.mark.skipif(
    not (paths.DATA / "validation" / "deadlines.csv").is_file(), reason="no published measurement"
)
def test_the_published_measurement_has_ten_drives_per_condition():
    table = pd.read_csv(paths.DATA / "validation" / "deadlines.csv")
    assert (table.groupby(["table", "factor", "buffer"]).size() == 10).all()
    assert table[["periods_met", "commands_met"]].stack().between(0, 1).all()
