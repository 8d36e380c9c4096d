"""Paths at constant commands: exact rolling by hand, and the leader's deviation on a line without
judder.
"""

import math

import pytest

from workbench.arena.tracks import TrackConfig
from workbench.formation.config import ConvoyConfig
from workbench.measures.drives import drive_path, exact_rolling, fidelity, leader_on_the_line
from workbench.robot.geometry import STEP, TRACK


def test_exact_rolling_by_hand():
    # 250 and 500 steps/s are met exactly (40 and 20 ticks): v = 375 steps/s, turn = 250 steps/s
    # over the track
    path = exact_rolling(250, 500, 2.0).iloc[-1]
    speed = 375 * STEP
    turn = 250 * STEP / TRACK
    assert path["heading_rad"] == pytest.approx(2 * turn)
    assert path["x_m"] == pytest.approx(speed / turn * math.sin(2 * turn))
    assert exact_rolling(500, 500, 1.0)["x_m"].iloc[-1] == pytest.approx(500 * STEP)


@pytest.mark.parametrize("drive", ["wheels", "planar", "rolling"])
def test_headings_count_on_beyond_half_a_turn(drive):
    path = drive_path(drive, -500, 500, 4.0)
    assert path["heading_rad"].iloc[-1] == pytest.approx(
        exact_rolling(-500, 500, 4.0)["heading_rad"].iloc[-1], rel=0.01
    )
    assert path["heading_rad"].iloc[-1] > 2 * math.pi


def test_the_table_of_fidelity_has_all_drives_beside_wheels():
    table = fidelity()
    assert set(table.columns) == {"unit", "margin", "wheels", "planar", "rolling", "exact rolling"}
    assert table.loc["straight, way in 1 s", "wheels"] == pytest.approx(61.1, abs=0.3)
    assert abs(table.loc["straight, way in 1 s", "exact rolling"]) < 0.3
    assert abs(table.loc["spin, angle in 1 s", "planar"]) < 0.5


def test_without_judder_the_leader_stays_close_to_the_loop():
    config = ConvoyConfig(drive="planar", track=TrackConfig(judder="none"))
    summary, path = leader_on_the_line(config, [1, 2], seconds=20)
    assert summary["line_rms_mm"].tolist() == [0, 0] and summary["rms_mm"].max() < 1.5
    assert len(path) == 200 and path["from_line_mm"].abs().max() < 5
