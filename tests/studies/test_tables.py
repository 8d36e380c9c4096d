"""Studies: what their tables hold, that a kill costs nothing, and the numbers of a trial."""

import hashlib
import json
import os
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.arena.tracks import TrackConfig, make_track
from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import BLOCK
from workbench.formation.follower import RECOVERED
from workbench.formation.records import PERIOD
from workbench.lab import trial as module
from workbench.lab.records import SUMS
from workbench.lab.runs import evaluate, learn
from workbench.lab.trial import (
    UNSEEN,
    Trial,
    first_lossfree,
    measure,
    measure_sections,
    measure_widely,
)
from workbench.studies.tables import (
    STUDIES,
    factor_for,
    is_current,
    load_study,
    run_study,
    trials_digest,
    update_time_s,
)

PLANAR = ConvoyConfig(drive="planar")


@pytest.mark.parametrize("study", STUDIES.values(), ids=list(STUDIES))
def test_studies_have_ten_seeds_or_more_and_conditions_that_are_told_apart_by_their_labels(study):
    assert study.seeds >= 10
    labels, trials = study.trials(range(1, 11))
    words = [json.dumps(label, sort_keys=True, ensure_ascii=False) for label in labels]
    assert len(set(words)) == len(words) == len(trials)
    without_seed = {
        json.dumps({k: v for k, v in label.items() if k != "seed"}, sort_keys=True)
        for label in labels
    }
    assert len(trials) == 10 * len(without_seed) and {trial.config.seed for trial in trials} == set(
        range(1, 11)
    )


@pytest.mark.parametrize("name", STUDIES)
def test_published_tables_have_all_trials_of_the_study_as_it_is_defined_now(name):
    study = STUDIES[name]
    table = load_study(name)
    seeds = list(range(1, study.seeds + 1))
    labels, trials = study.trials(seeds)
    conditions = table[list(labels[0])].drop_duplicates(ignore_index=True)
    pd.testing.assert_frame_equal(conditions, pd.DataFrame(labels), check_dtype=False)
    rows = table.groupby(list(labels[0]), dropna=False).size()
    conditions = [name for name in labels[0] if name != "seed"]
    assert len(rows) == len(trials)
    assert (rows.groupby(level=conditions, dropna=False).nunique() == 1).all()  # for every seed
    header = json.loads((paths.DATA / "studies" / f"{name}.json").read_text())
    assert (header["simulated"], header["quick"], header["seeds"]) == (True, False, seeds)
    assert is_current(header, trials)
    assert (
        header["table_sha256"]
        == hashlib.sha256((paths.DATA / "studies" / f"{name}.csv").read_bytes()).hexdigest()
    )


def test_a_quick_study_writes_table_and_header_the_same_serially_and_on_two_processes(tmp_path):
    one = run_study(
        "inner", out=tmp_path / "a", store=tmp_path / "s1", quick=True, workers=1, progress=False
    )
    run_study(
        "inner", out=tmp_path / "b", store=tmp_path / "s2", quick=True, workers=2, progress=False
    )
    for name in ("inner.csv", "inner.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert one["inner_distance_mm"].tolist() == [
        1.0,
        1.0,
        2.0,
        2.0,
        3.0,
        3.0,
        4.5,
        4.5,
        6.0,
        6.0,
        7.8,
        7.8,
    ]
    header = json.loads((tmp_path / "a" / "inner.json").read_text())
    assert header["quick"] is True and header["seeds"] == [1, 2] and header["updates"] == [2000]


@pytest.mark.slow
def test_a_study_killed_half_way_continues_and_ends_with_the_same_table(tmp_path):
    script = (
        "import sys; from pathlib import Path; from workbench.studies.tables import run_study\n"
        "if __name__ == '__main__':\n"
        "    run_study('inner', out=Path(sys.argv[1]), store=Path(sys.argv[2]), quick=True, "
        "workers=2, progress=False)\n"
    )
    (tmp_path / "run.py").write_text(script)
    command = [sys.executable, str(tmp_path / "run.py")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [*command, str(tmp_path / "out"), str(tmp_path / "store")], env=environment
    )
    for _ in range(600):
        stored = list((tmp_path / "store").glob("*.json"))
        if len(stored) >= 3:
            break
        time.sleep(0.1)
    process.kill()
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "store").glob("*.json")}
    assert 3 <= len(before) < 12 and not (tmp_path / "out").exists()
    subprocess.run(
        [*command, str(tmp_path / "out"), str(tmp_path / "store")], env=environment, check=True
    )
    assert all(
        path.stat().st_mtime_ns == changed for path, changed in before.items()
    )  # nothing was run twice
    run_study(
        "inner",
        out=tmp_path / "whole",
        store=tmp_path / "fresh",
        quick=True,
        workers=1,
        progress=False,
    )
    assert (tmp_path / "out" / "inner.csv").read_bytes() == (
        tmp_path / "whole" / "inner.csv"
    ).read_bytes()


def test_unknown_studies_and_missing_tables_are_refused(monkeypatch, tmp_path):
    with pytest.raises(ValueError, match="study 'tile'; expected one of actions, bound"):
        run_study("tile")
    monkeypatch.setitem(load_study.__globals__, "FOLDER", tmp_path)
    with pytest.raises(FileNotFoundError, match="python -m workbench study tiles"):
        load_study("tiles")


def test_failed_trials_leave_the_table_unwritten(tmp_path, monkeypatch):
    study = replace(STUDIES["inner"], function=_refuse)
    monkeypatch.setitem(STUDIES, "inner", study)
    with (
        pytest.warns(RuntimeWarning, match="12 of 12 runs failed"),
        pytest.raises(RuntimeError, match="study 'inner': 12 of 12"),
    ):
        run_study(
            "inner",
            out=tmp_path / "out",
            store=tmp_path / "s",
            quick=True,
            workers=1,
            progress=False,
        )
    assert not (tmp_path / "out").exists()


def _refuse(trial):
    raise ValueError("no")


def test_a_trial_reports_what_learn_and_evaluate_report():
    trial = Trial(config=PLANAR, steps=31_000, minutes=2)
    numbers = measure(trial)
    run = learn(PLANAR, steps=31_000, progress=False)
    judged = evaluate(run.policy, PLANAR.with_seed(1 + UNSEEN), minutes=2, progress=False)
    assert numbers["losses"] == run.summary["losses"] > 0
    assert (
        numbers["rms_distance_error_mm_last_third"]
        == run.summary["rms_distance_error_mm_last_third"]
    )
    assert numbers["greedy_rms_distance_error_mm"] == judged.summary["rms_distance_error_mm"]
    assert numbers["greedy_losses"] == judged.summary["losses"]
    widely = measure_widely(replace(trial, steps=3000))
    assert {"eight_losses", "replan_rms_distance_error_mm", "greedy_losses", "losses"} <= set(
        widely
    )


def test_the_first_lossfree_block_is_a_whole_one_without_any_loss():
    sums = np.zeros((4, 2, len(SUMS)))
    sums[:, :, SUMS.index("periods")] = BLOCK
    sums[0, 0, SUMS.index("losses")] = 3
    sums[1, 1, SUMS.index("losses")] = 1
    records = {"sums": sums, "starts": np.array([0, 4000, 9000, 14000])}
    assert first_lossfree(records) == 9000
    sums[2:, 0, SUMS.index("losses")] = 1
    assert np.isnan(first_lossfree(records))
    sums[3, 0] = 0  # a short last block proves nothing
    sums[3, :, SUMS.index("periods")] = 10
    assert np.isnan(first_lossfree(records))


@pytest.mark.parametrize("shape", ["circle", "eight"])
def test_sections_count_quarters_of_the_loop_from_each_robots_own_start(shape):
    track = make_track(TrackConfig(shape=shape, judder="none"), np.random.default_rng(0))
    block = np.zeros((40, 3), PERIOD)
    for period in range(40):
        for robot, start in enumerate((1.0, 0.85, 0.7)):
            x, y, heading = track.pose(start + (period / 40 + 1e-3 * (period > 0)) * track.length_m)
            block[period, robot] = np.zeros((), PERIOD)
            block[period, robot]["x"] = x
            block[period, robot]["y"] = y
            block[period, robot]["heading"] = heading
    sections, started = module._sections(track, block, None)
    assert started == pytest.approx([0.85, 0.7], abs=2e-3)
    for follower in (0, 1):
        assert sections[:, follower].tolist() == [period // 10 for period in range(40)]


def test_reset_durations_count_on_from_block_to_block():
    at = np.zeros((6, 1), PERIOD)
    at["phase"][2:, 0] = 2  # lost at period 2, still away at the end
    away = np.zeros(1, np.int64)
    assert module._durations(at, away) == [] and away.tolist() == [4]
    following = np.zeros((6, 1), PERIOD)
    following["phase"][:3, 0] = 3
    following["event"][3, 0] = RECOVERED
    assert module._durations(following, away) == [7] and away.tolist() == [0]


def test_restarts_keep_young_followers_in_the_first_section_and_the_manoeuvre_does_not():
    restart = measure_sections(
        Trial(config=replace(PLANAR, reset="restart"), steps=3000, minutes=2)
    )
    manoeuvre = measure_sections(Trial(config=PLANAR, steps=3000, minutes=2))
    assert restart["training_share_1"] > 0.9 > manoeuvre["training_share_1"]
    assert sum(manoeuvre[f"training_share_{k}"] for k in (1, 2, 3, 4)) == pytest.approx(1)
    assert 0.2 < manoeuvre["reset_median_s"] < 3 and np.isnan(restart["reset_median_s"])


def test_a_dense_update_takes_time_in_proportion_to_its_table():
    assert update_time_s(1000, SETTINGS["paper"]) == pytest.approx(0.024)
    small = SETTINGS["paper-robot"]  # 25 × 9 weights instead of 81 × 49
    assert update_time_s(1000, small) == pytest.approx(0.024 * 225 / 3969)
    assert factor_for(update_time_s(123.0, small), small) == pytest.approx(123.0)


def test_the_offset_setting_resolves_what_its_description_says():
    config = SETTINGS["offset"]
    distance = np.unique(
        np.concatenate([grid.tilings[0].edges for grid in config.grids()]).round(9)
    )
    bearing = np.unique(np.concatenate([grid.tilings[1].edges for grid in config.grids()]).round(9))
    assert np.diff(distance) == pytest.approx(0.007, abs=1e-6) and np.degrees(
        np.diff(bearing)
    ) == pytest.approx(4.5, abs=1e-4)


def test_a_new_field_at_its_default_leaves_tables_valid_and_any_other_value_does_not():
    study = STUDIES["inner"]
    header = json.loads((paths.DATA / "studies" / "inner.json").read_text())
    _, trials = study.trials(range(1, study.seeds + 1))
    older = header | {"fields": [name for name in header["fields"] if name != "config.body.slip"]}
    older["trials_sha256"] = trials_digest(
        trials, older["fields"]
    )  # as if slip had not been there when the table was made
    assert older["trials_sha256"] != header["trials_sha256"] and is_current(older, trials)
    slipping = [
        replace(trial, config=replace(trial.config, body=BodyConfig(slip=0.1))) for trial in trials
    ]
    with pytest.raises(
        ValueError,
        match="config.body.slip = 0.1, a field that the table did not know; expected its "
        "default 0.0",
    ):
        is_current(older, slipping)
    assert not is_current(header, slipping)
