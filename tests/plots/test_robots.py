"""Plots of the robot show what they are given, with units."""

import numpy as np
import pandas as pd

from workbench.formation.config import SETTINGS
from workbench.plots import diagrams, robots as robot_plots


def test_motor_speeds_are_drawn_relative_to_the_command_with_the_levels_marked():
    speeds = pd.DataFrame(
        {"command": [100, 200], "e-puck1": [101.0, 204.0], "e-puck2": [100.0, 200.0]}
    )
    ax = robot_plots.motor_speeds(speeds, [100, 150, 200], leader=150)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [1.0, 2.0])
    assert ax.get_ylabel() == "real speed above command in %"
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["e-puck1", "e-puck2", "levels of the followers", "leader"]


def test_speed_and_path_plots_name_every_model():
    path = pd.DataFrame(
        {"t_s": [0.0, 0.02, 0.04], "x_m": [0.0, 0.001, 0.003], "y_m": [0.0, 0.0, 0.001]}
    )
    ax = robot_plots.speed_after_a_step({"wheels": path, "exact rolling": path})
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [50.0, 100.0])
    np.testing.assert_allclose(ax.lines[0].get_xdata(), [10.0, 30.0])
    ax = robot_plots.paths_in_the_plane({"wheels": path, "exact rolling": path})
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["wheels", "exact rolling"]


def test_the_line_under_the_leader_is_the_loop_minus_its_own_distance():
    path = pd.DataFrame(
        {"t_s": [0.0, 0.1], "from_line_mm": [1.0, -1.0], "from_loop_mm": [3.0, 4.0]}
    )
    ax = robot_plots.leader_and_line(path)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [2.0, 5.0])


def test_the_comparison_with_recordings_shows_every_run_once_per_motor_rule():
    lines = [
        {"log": log, "set_points": points, "firmware": rule, "distance_ratio": 1.0 + 0.01 * k}
        for log in ("9 Hz", "9 Hz, with gaps")
        for points in ("constant", "changing")
        for rule in ("e-puck1", "e-puck2")
        for k in range(3)
    ]
    ax = robot_plots.drive_validation(pd.DataFrame(lines))
    assert sum(len(line.get_xdata()) for line in ax.lines[1:]) == len(lines)
    assert [tick.get_text() for tick in ax.get_yticklabels()][0] == "9 Hz\nconstant (n = 3)"


def test_offset_tilings_are_drawn_over_the_first_one():
    one, four = (diagrams.tile_fan(SETTINGS[name]) for name in ("paper-robot", "offset"))
    # three shifted grids of 5 inner rays each; arcs are patches
    assert len(four.lines) - len(one.lines) == sum(
        grid.tilings[1].n - 1 for grid in SETTINGS["offset"].grids()[1:]
    )
