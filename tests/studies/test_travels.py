"""What studies say of weights that travel, on tables small enough to count by hand."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import workbench as wb
from workbench.plots import transfer as transfer_plots
from workbench.studies import copies, delays, gap, transfer
from workbench.studies.realities import emulated_world, judging_worlds
from workbench.studies.validation.tiles import in_the_right_tile


def _rows(study, lines, labels):
    """Return the table of a study from a line of numbers per trial."""
    rows = []
    for line in lines:
        numbers = {name: value for name, value in line.items() if name not in labels}
        label = {name: line[name] for name in labels}
        rows += [label | row for row in study.STUDY.rows.of(numbers)]
    return pd.DataFrame(rows)


def _transfer():
    lines = []
    for seed, delay in ((1, 0), (2, 3), (3, 0)):
        for training, late in (("nominal", 0.5), ("there", 1.0)):
            for table in ("9×9/7×7", "5×5/3×3"):
                lines.append(
                    {
                        "route": "camera",
                        "table": table,
                        "training": training,
                        "seed": seed,
                        "delay": delay,
                        "judged_losses": 0 if delay == 0 else 7,
                        "judged_share_inside": 1.0 if delay == 0 else late,
                        "judged_rms_distance_error_mm": 6.0 + 6 * delay,
                        "nominal_rms_distance_error_mm": 6.0 if training == "nominal" else 5.0,
                        "judged_turn_rms_deg_s": 20.0,
                        "nominal_turn_rms_deg_s": 15.0,
                        "learning_minutes_to_lossfree": np.nan
                        if (seed, training) == (2, "there")
                        else 10.0 * seed,
                        "learning_losses": 5.0,
                    }
                )
    return pd.DataFrame(lines)


def test_drives_are_compared_with_nominal_weights_in_the_nominal_simulation():
    table = transfer.judged(_transfer())
    late = table[table["delay"] == 3]
    assert (
        set(table["degradation"]) == {1.0, 4.0}
        and set(late["degradation"]) == {4.0}
        and set(late["commands"]) == {"late"}
    )
    summary = transfer.by_training(table)
    assert summary.loc[("camera", "9×9/7×7", "late", "nominal"), "mostly_inside"] == 0
    there = summary.loc[("camera", "9×9/7×7", "late", "there")]
    assert there["mostly_inside"] == 1 and there["losses"] == 7 and there["without_loss"] == 0


def test_settling_is_of_the_world_that_was_learned_in():
    table = transfer.settled(_transfer())
    emulated = table[table["where"] == "emulated"]
    assert set(emulated["turning_deg_s"]) == {20.0} and set(
        table.loc[table["where"] == "simulated", "rms_mm"]
    ) == {6.0}
    more = transfer.on_robot_against_simulation(_transfer(), "minutes", "9×9/7×7")
    whole = 200_000 / 4 * 0.1 / 60  # minutes; seed 2 never settled there and took 20 minutes here
    assert more["seeds"].tolist() == [3] and more["value"].tolist() == pytest.approx(
        [(whole - 20) / 3]
    )
    assert table["never"].sum() == 2
    assert transfer.on_robot_against_simulation(_transfer(), "turning_deg_s", "5×5/3×3")[
        "value"
    ].tolist() == [5.0]


def test_copies_are_compared_by_geometric_means():
    errors = [(1.0, 2.0), (2.0, 1.0)]  # own, copied: whichever is better by chance
    lines = []
    for seed, (own, copied) in enumerate(errors):
        line = {"setting": "s", "robots": "alike", "seed": seed}
        for kind, value in (("own", own), ("copied", copied)):
            line |= {
                f"{kind}_none_{error}_{k}": value for error in copies.ERRORS for k in range(1, 5)
            }
        lines.append(line)
    table = _rows(copies, lines, ("setting", "robots", "seed"))
    ratios = copies.copied_to_own(table, "copied")
    assert (
        len(ratios) == 8
        and np.allclose(ratios["value"], 1.0)
        and (ratios["low"] <= 1).all()
        and (ratios["high"] >= 1).all()
    )


def test_whose_weights_lost_whom_is_counted():
    line = {"setting": "s", "robots": "alike"}
    for number, kind in enumerate(copies.WHOSE):
        for k in range(1, 5):
            line |= {f"{kind}_none_losses_{k}": number * k, f"{kind}_calm_losses_{k}": 0}
            for error in ("rms_distance_error_mm", "bias_mm", "ripple_mm"):
                line |= {f"{kind}_{cures}_{error}_{k}": 1.0 * k for cures in copies.CURED}
    lines = [line | {"seed": seed} for seed in (1, 2)]
    table = _rows(copies, lines, ("setting", "robots", "seed"))
    lost, runs = copies.losses_by_weights(table), copies.runs_with_losses(table)
    assert lost.loc[("s", "none")].tolist() == [20 * k for k in range(len(copies.WHOSE))]
    assert runs.loc[("s", "none")].tolist() == [0] + [2] * (len(copies.WHOSE) - 1)
    assert (lost.loc[("s", "calm")] == 0).all() and (runs.loc[("s", "calm")] == 0).all()
    places = copies.errors_in_line(table, "s")
    assert len(places) == 4 * 3 * len(copies.WHOSE)
    assert places["value"].tolist() == places["follower"].tolist()


def test_lateness_and_noise_are_levels():
    late = [{"route": "camera", "table": "5×5/3×3", "seed": seed} for seed in (1, 2)]
    noisy = [{"route": "ir-raw", "training": "nominal", "seed": seed} for seed in (1, 2)]
    for line in late:
        line["nominal_none_rms_distance_error_mm"] = 5.0
        for k in range(4):
            numbers = {"losses": k * (line["seed"] - 1), "share_inside": 1.0}
            numbers["rms_distance_error_mm"] = 5.0 * k
            line |= {f"delay_{k}_none_{name}": value for name, value in numbers.items()}
    for line in noisy:
        for k in range(6):
            numbers = {"losses": k, "share_inside": 1 - k / 10, "rms_distance_error_mm": 3.0}
            line |= {f"{name}_noise_{k}": value for name, value in numbers.items()}
    delayed = _rows(delays, late, ("route", "table", "seed"))
    louder = _rows(gap, noisy, ("route", "training", "seed"))
    late = delays.by_delay(delayed)
    assert late[late["quantity"] == "degradation"]["value"].tolist() == [0, 1, 2, 3]
    assert set(late["late"]) == {0.0, 0.1, 0.2, 0.3} and set(late["case"]) == {"camera, 5×5/3×3"}
    lost = delays.losses_by_delay(delayed).loc[("camera", "5×5/3×3", "none")]
    assert lost["losses"].tolist() == [0, 1, 2, 3] and lost["without_loss"].tolist() == [2, 1, 1, 1]
    assert lost["worst_degradation"].tolist() == [0, 1, 2, 3]
    assert gap.losses_by_noise(louder).loc[("ir-raw", "nominal")].tolist() == [
        0,
        2,
        4,
        6,
        8,
        10,
    ]
    noisy = gap.by_noise(louder)
    assert noisy[noisy["quantity"] == "share_inside"]["value"].tolist() == pytest.approx(
        [1, 0.9, 0.8, 0.7, 0.6, 0.5]
    )


def test_judging_worlds_are_told_as_they_are():
    config = wb.ConvoyConfig(sensing="camera")
    table = judging_worlds(config, range(1, 4))
    world = emulated_world(config, 2, family="judging")
    assert (
        table.loc[2, "commands late (s)"] == world.body.delay / 10
        and table.loc[2, "slip"] == world.body.slip
    )


def test_a_world_grid_is_sorted_by_lateness_and_counts_losses():
    table = _transfer()
    ax = transfer_plots.world_grid(table[table["table"] == "5×5/3×3"], Figure().subplots())
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["1\n0.0", "3\n0.0", "2\n0.3"]
    assert [tick.get_text() for tick in ax.get_yticklabels()] == ["nominal", "there"]
    assert [text.get_text() for text in ax.texts] == ["0", "0", "7", "0", "0", "7"]
    np.testing.assert_array_equal(ax.images[0].get_array(), [[1.0, 1.0, 0.5], [1.0, 1.0, 1.0]])


def test_bars_of_agreement_fill_the_whole():
    tiles = pd.DataFrame(
        {
            "route": "ir-raw",
            "table": "5×5/3×3",
            "readings": ["as recorded", "median of 5 rows"],
            "both_inside": [60, 70],
            "model_inside": [100, 100],
            "share_same_tile": [0.5, 0.7],
            "share_within_one_tile": [0.8, 0.9],
        }
    )
    tiles["model"] = "fitted"
    right = in_the_right_tile(pd.concat([tiles, tiles.assign(share_same_tile=0.0)]))
    np.testing.assert_allclose(right, [[0.0, 0.30], [0.0, 0.49]])
    ax = transfer_plots.agreement(tiles, Figure().subplots())
    widths = np.array([bar.get_width() for bar in ax.patches]).reshape(4, 2)
    np.testing.assert_allclose(widths, [[0.30, 0.49], [0.18, 0.14], [0.12, 0.07], [0.4, 0.3]])
