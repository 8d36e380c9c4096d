"""Real readings among tiles, on recordings that are made here."""

import json

import numpy as np
import pandas as pd
import pytest

from workbench.logs.importers import PS, ROW_MM
from workbench.robot.infrared import BEARINGS, CONTACT, saturate
from workbench.studies.validation.infrared import wall_light
from workbench.studies.validation.tiles import validate_tiles


def _recording(folder, left_gain, right_gain):
    """Write a backing-off run as the model would read it with these gains."""
    gap = 1.0 + np.arange(200) * ROW_MM
    table = pd.DataFrame({"step": np.arange(200)} | dict.fromkeys(PS, 0.0))
    for k, gain in ((7, left_gain), (0, right_gain), (1, 1.0), (6, 1.0)):
        light = gain * wall_light(gap, np.full(200, abs(BEARINGS[k])))
        table[PS[k]] = np.vectorize(saturate)(light, CONTACT)
    (folder / "wii42_epuck2_ir_ground").mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "wii42_epuck2_ir_ground" / "IRsensors.csv", index=False)


@pytest.mark.parametrize(("gains", "matched"), [((1.0, 1.0), True), ((1.6, 0.6), False)])
def test_readings_of_the_model_itself_are_in_its_tiles_and_gains_bring_others_there(
    tmp_path, monkeypatch, gains, matched
):
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path))
    _recording(tmp_path, *gains)
    result = validate_tiles(out=tmp_path / "out", seeds=1, steps=2000)
    table = pd.read_csv(tmp_path / "out" / "tiles.csv").set_index(
        ["route", "table", "readings", "model", "run"]
    )
    for route in ("ir-metric", "ir-raw"):
        nominal, fitted = (
            table.loc[(route, "9×9/7×7", "as recorded", model, "all")]
            for model in ("nominal", "fitted")
        )
        assert fitted["share_same_tile"] > 0.9 and fitted["rows"] > 30
        assert (nominal["share_same_tile"] > 0.9) == matched
        assert nominal["real_inside"] == fitted["real_inside"] > 0
    changes = pd.read_csv(tmp_path / "out" / "tile_changes.csv")
    part = changes[
        (changes["route"] == "ir-raw")
        & (changes["table"] == "5×5/3×3")
        & (changes["readings"] == "as recorded")
    ]
    assert part[part["model"] == "fitted"]["rows"].sum() == nominal["rows"]
    told = json.loads((tmp_path / "out" / "tiles.json").read_text())
    assert told["seeds"] == 1 and len(told["aggregates"]) == len(result["aggregates"]) == 16


def test_missing_recordings_are_named(tmp_path, monkeypatch):
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="wii42"):
        validate_tiles(out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
