"""Tables and pictures of infrared."""

from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.plots import infrared as infrared_plots
from workbench.plots.style import new_axes

INFRARED = wb.SETTINGS["infrared"]


def test_targets_are_seen_in_the_order_of_what_they_give_back():
    table = infrared_plots.targets_by_distance(INFRARED.infrared, INFRARED.threshold_counts)
    reach = table[table["seen"]].groupby("target")["distance_m"].max()
    assert reach["shell"] < reach["tape"] <= reach["cup"] < reach["beacon"]
    assert (table["low"] <= table["counts"]).all() and (table["counts"] <= table["high"]).all()
    for _, part in table.groupby("target"):
        assert (np.diff(part["counts"]) <= 0).all()
    ax = infrared_plots.draw_targets(table, INFRARED.threshold_counts, new_axes())
    assert len(ax.get_legend().get_texts()) == 4


def test_two_readings_determine_a_place_worse_the_farther_and_the_more_aside():
    table = infrared_plots.bounds_map(INFRARED).set_index(["distance_m", "bearing_deg"])
    distances = table.index.levels[0]

    def sd(distance, bearing):
        nearest = distances[np.argmin(np.abs(distances - distance))]
        return table.loc[(nearest, bearing)]

    assert (
        sd(0.09, 0.0)["distance_sd_mm"]
        < sd(0.11, 0.0)["distance_sd_mm"]
        < sd(0.13, 0.0)["distance_sd_mm"]
    )
    assert sd(0.105, 0.0)["bearing_sd_deg"] < sd(0.105, 25.0)["bearing_sd_deg"]
    assert (
        not np.isfinite(sd(0.105, 45.0)["bearing_sd_deg"]) or sd(0.105, 45.0)["bearing_sd_deg"] > 8
    )
    left, right = sd(0.105, 20.0), sd(0.105, -20.0)
    assert left["distance_sd_mm"] == pytest.approx(right["distance_sd_mm"], rel=1e-6)
    ax = infrared_plots.draw_bounds(
        table.reset_index(), "bearing_sd_deg", INFRARED, new_axes(), levels=(1, 2, 4), label="°"
    )
    assert ax.get_xlabel() == "bearing (°)"


@pytest.mark.parametrize("sensing", ["ir-metric", "ir-raw"])
def test_states_by_place_are_those_that_a_follower_would_be_in(sensing):
    config = replace(INFRARED, sensing=sensing)
    table = infrared_plots.states_by_place(config, cells=20)
    assert len(table) == 400 and table["state"].between(0, 80).all()
    if sensing == "ir-metric":
        assert table["state"].nunique() > 60
        row = table.iloc[210]
        expected = config.grid().index(
            row["distance_m"] - config.middle_m, np.radians(row["bearing_deg"])
        )
        assert row["state"] == expected
    ax = infrared_plots.draw_states(table, config, new_axes())
    assert f"{table['state'].nunique()} of 81 tiles" in ax.get_title(loc="left")


def test_cups_cover_robots_in_pictures_and_touch_nothing():
    track = wb.make_track(wb.TrackConfig(), np.random.default_rng(1))
    bare = wb.World(1, [track], drive="planar", spacing_m=0.105)
    covered = wb.World(1, [track], drive="planar", spacing_m=0.105, furnish=infrared_plots.cups(0))
    cup = covered.model.geom("robot0/cup")
    assert cup.conaffinity == 0 and not np.any(covered.model.geom_conaffinity & cup.contype)
    assert covered.model.body_mass.sum() == bare.model.body_mass.sum()
    x, y, _ = covered.pose(0, 0)
    view = {"eye": (x, y - 0.5, 0.4), "target": (x, y, 0.03), "width": 64, "height": 48}
    red = [
        np.sum((p[..., 0].astype(int) - p[..., 1]) > 60)
        for p in (wb.picture(bare, **view), wb.picture(covered, **view))
    ]
    assert red[0] > 30 and red[1] == 0


def test_calibration_takes_the_offsets_and_light_the_headroom():
    table = infrared_plots.one_robot(replace(INFRARED, followers=1))
    assert table.loc["free air"].min() >= 60 and table.loc["free air, calibrated"].max() < 10
    front = ["ps0", "ps7"]
    bright, dark = (
        table.loc[name, front]
        for name in ("cup, light from ahead, calibrated", "cup at 85 mm, calibrated")
    )
    assert (bright < 0.8 * dark).all() and (dark > 150).all()
