"""The comparison with recordings finds what it should in recordings whose truth is known."""

import json

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.studies.validation.drives import best_delay, replay, shifted, validate_drive


def _recording(folder, delay_s=1.3, scale=1.0, drop=()):
    """Write a file in the layout of the recordings: what the planar robot with e-puck2 motors
    really drives, delayed.
    """
    source = folder / "ttu_epuck2_leader_follower"
    source.mkdir(parents=True, exist_ok=True)
    time = np.arange(186) * 0.108
    units = np.where(time < 8, 7.5, np.where(time < 14, 3.0, -4.0))
    position = (
        scale * shifted(replay("planar", "e-puck2", time, 100 * units), 0.02, time, delay_s) - 0.13
    )
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
    assert len(table) == 6  # three drives, two rules; the robot that never moved has no line
    own = table.loc[("planar", "e-puck2")]
    assert own.start_up_delay_s == pytest.approx(1.3, abs=0.02)
    assert (
        own.distance_ratio == pytest.approx(1, abs=0.003)
        and own.rms_error_mm < 2
        and own.rms_error_1s_mm < 1.5
    )
    assert own.rows_dropped == 2
    # e-puck1 motors turn 7.5 units (750 steps/s) into 10000 // 750 = 13 ticks, 769.2 steps/s;
    # e-puck2 into 757.6
    assert table.loc[("planar", "e-puck1")].distance_ratio > 1.008
    assert json.loads((tmp_path / "out" / "drive.json").read_text())["robot_runs"] == 1


def test_a_robot_that_drives_five_percent_less_is_reported_as_such(tmp_path, monkeypatch):
    _recording(tmp_path / "in", scale=0.95)
    monkeypatch.setenv("WORKBENCH_RECORDINGS", str(tmp_path / "in"))
    result = validate_drive(out=tmp_path / "out")
    line = next(
        line
        for line in result["aggregates"]
        if (line["drive"], line["firmware"]) == ("planar", "e-puck2")
    )
    assert line["distance_ratio"]["median"] == pytest.approx(1 / 0.95, rel=0.005)
    assert line["rms_error_mm"]["median"] > 15


@pytest.mark.parametrize(
    "commands",
    [np.full(120, 700.0), np.linspace(20, 700, 120), np.where(np.arange(120) < 60, 700.0, -300.0)],
)
def test_delays_are_found_for_constant_rising_and_changing_commands(commands):
    time = np.arange(120) * 0.108
    driven = replay("planar", "e-puck2", time, commands)
    real = shifted(driven, 0.02, time, 1.3)
    assert best_delay(time, real, driven, 0.02, seconds=3.0) == pytest.approx(1.3, abs=0.021)
    late = np.where(
        time > 6, shifted(driven, 0.02, time, 2.0), real
    )  # the link slows down later: the start does not notice
    assert best_delay(time, late, driven, 0.02, seconds=3.0) == pytest.approx(1.3, abs=0.021)
    assert best_delay(time, late, driven, 0.02) > 1.31


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
    frame.drop(columns=["leader_position_m"]).to_csv(path, index=False)
    with pytest.raises(FileNotFoundError, match="has set-points, positions and a robot that moves"):
        validate_drive(out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not (paths.DATA / "validation").is_dir(), reason="no published comparison")
def test_the_published_comparison_is_one_of_aggregates_and_names_its_source():
    stored = json.loads((paths.DATA / "validation" / "drive.json").read_text())
    assert "ttu_dp_elisa3_python" in stored["source"]
    table = pd.read_csv(paths.DATA / "validation" / "drive.csv")
    assert len(table) == 6 * stored["robot_runs"] and table["rows"].min() > 20
