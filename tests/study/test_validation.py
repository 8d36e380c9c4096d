"""The comparison with recordings finds what it should in recordings whose truth is known."""

import json

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.study.validation import replay, start_up_delay, validate_drive


def _recording(folder, delay_s=1.3, scale=1.0, drop=()):
    """Write a file in the layout of the recordings: what the planar robot with e-puck2 motors really drives, delayed."""
    source = folder / "ttu_epuck2_leader_follower"
    source.mkdir(parents=True, exist_ok=True)
    time = np.arange(186) * 0.108
    units = np.where(time < 8, 7.5, np.where(time < 14, 3.0, -4.0))
    position = scale * replay("planar", "e-puck2", time + delay_s, 100 * units, time) - 0.13
    for row in drop:
        position[row] = 4.2
    columns = {"timestamp_s": time, "leader_position_m": position}
    columns |= {f"leader_{side}_setpoint_radps": units for side in ("left", "right")}
    columns |= {"follower_position_m": np.full(186, -0.3)}  # a robot that never moved
    columns |= {f"follower_{side}_setpoint_radps": np.zeros(186) for side in ("left", "right")}
    pd.DataFrame(columns).to_csv(source / "epuck-exp-1.csv", index=False)


def test_a_recording_of_the_model_itself_is_met_and_its_delay_found(tmp_path, monkeypatch):
    _recording(tmp_path / "in", drop=(50, 120))
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path / "in"))
    validate_drive(out=tmp_path / "out")
    table = pd.read_csv(tmp_path / "out" / "drive.csv").set_index(["drive", "firmware"])
    assert len(table) == 4  # two drives, two rules; the robot that never moved has no line
    own = table.loc[("planar", "e-puck2")]
    assert own.start_up_delay_s == pytest.approx(1.3, abs=0.02)
    assert own.distance_ratio == pytest.approx(1, abs=0.003) and own.rms_error_mm < 2 and own.rms_error_1s_mm < 1.5
    assert own.rows_dropped == 2
    # e-puck1 motors turn 7.5 units (750 steps/s) into 10000 // 750 = 13 ticks, 769.2 steps/s; e-puck2 into 757.6
    assert table.loc[("planar", "e-puck1")].distance_ratio > 1.008
    assert json.loads((tmp_path / "out" / "drive.json").read_text())["robot_runs"] == 1


def test_a_robot_that_drives_five_percent_less_is_reported_as_such(tmp_path, monkeypatch):
    _recording(tmp_path / "in", scale=0.95)
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path / "in"))
    result = validate_drive(out=tmp_path / "out")
    line = next(line for line in result["aggregates"] if (line["drive"], line["firmware"]) == ("planar", "e-puck2"))
    assert line["distance_ratio"]["median"] == pytest.approx(1 / 0.95, rel=0.005)
    assert line["rms_error_mm"]["median"] > 15


def test_the_start_of_motion_is_placed_between_two_rows():
    time = np.arange(10) * 0.1
    position = np.maximum(time - 0.34, 0) * 0.1  # 0.1 m/s from 0.34 s on
    assert start_up_delay(time, np.ones(10), position) == pytest.approx(0.34)
    assert np.isnan(start_up_delay(time, np.zeros(10), position))
    assert np.isnan(start_up_delay(time, np.ones(10), np.zeros(10)))


def test_missing_recordings_and_steering_robots_are_refused(tmp_path, monkeypatch):
    monkeypatch.delenv("WORKBENCH_RECORDINGS", raising=False)
    with pytest.raises(FileNotFoundError, match="WORKBENCH_RECORDINGS is ''; set it"):
        validate_drive(out=tmp_path)
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="holds no epuck-exp-"):
        validate_drive(out=tmp_path)
    _recording(tmp_path)
    path = tmp_path / "ttu_epuck2_leader_follower" / "epuck-exp-1.csv"
    frame = pd.read_csv(path)
    frame["leader_left_setpoint_radps"] += 1
    frame.to_csv(path, index=False)
    with pytest.raises(ValueError, match="leader steers"):
        validate_drive(out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not (paths.DATA / "validation").is_dir(), reason="no published comparison")
def test_the_published_comparison_is_one_of_aggregates_and_names_its_source():
    stored = json.loads((paths.DATA / "validation" / "drive.json").read_text())
    assert "ttu_dp_elisa3_python" in stored["source"]
    table = pd.read_csv(paths.DATA / "validation" / "drive.csv")
    assert len(table) == 4 * stored["robot_runs"] and table["rows"].min() > 20
