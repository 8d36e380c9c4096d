"""Runs: stored, loaded, continued; kills at random moments; refusals."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.lab import storage
from workbench.lab.runs import evaluate, evaluate_seeds, learn, learn_seeds, load_run
from workbench.learning.config import LearnerConfig

PLANAR = ConvoyConfig(drive="planar")


def _files(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_run_is_stored_and_loaded_complete(tmp_path):
    run = learn(PLANAR, steps=4000, out=tmp_path / "run", progress=False)
    assert sorted(_files(tmp_path / "run")) == [
        ".lock",
        "checkpoint.npz",
        "config.json",
        "records.npz",
        "summary.json",
        "weights.npz",
    ]
    back = load_run(tmp_path / "run")
    assert back.config == PLANAR and back.summary == run.summary and back.kind == "learn"
    np.testing.assert_array_equal(back.policy.theta, run.policy.theta)
    np.testing.assert_array_equal(back.w, run.w)
    assert back.visits.shape == (4, 9, 9) and back.visits.sum() == 4000
    run.save(tmp_path / "copy")
    for name in ("config.json", "records.npz", "summary.json", "weights.npz"):
        assert _files(tmp_path / "copy")[name] == _files(tmp_path / "run")[name]


def test_the_summary_has_the_keys_that_others_rely_on():
    summary = learn(PLANAR, steps=500, progress=False).summary
    wanted = (
        "steps share_best_cell share_best_3x3 share_best_3x3_last_third losses "
        "losses_last_third rms_distance_error_mm "
    )
    wanted += "bearing_std_deg bearing_mean_deg share_best_cell_all_time share_best_3x3_all_time"
    assert set(wanted.split()) <= set(summary)
    assert "wall_s" not in summary  # clocks stay out of stored runs


def test_existing_folders_are_refused_and_left_alone(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(
        FileExistsError, match="already has something in it; choose another folder, or resume"
    ):
        learn(PLANAR, steps=100, out=tmp_path, progress=False)
    run = learn(PLANAR, steps=100, progress=False)
    with pytest.raises(FileExistsError):
        run.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
    run.save(tmp_path, overwrite=True)
    assert load_run(tmp_path).summary == run.summary


def test_seeds_in_a_batch_are_stored_as_the_runs_that_they_would_be_alone(tmp_path):
    batch = learn_seeds(PLANAR, [4, 2], steps=3000, out=tmp_path / "batch", progress=False)
    alone = learn(PLANAR.with_seed(2), steps=3000, out=tmp_path / "alone", progress=False)
    assert batch[1].summary == alone.summary
    for name in ("config.json", "records.npz", "summary.json", "weights.npz"):
        assert (tmp_path / "batch" / "seed-2" / name).read_bytes() == (
            tmp_path / "alone" / name
        ).read_bytes()
    again = learn_seeds(
        PLANAR, [4, 2], steps=3000, out=tmp_path / "batch", resume=True, progress=False
    )
    assert [run.summary for run in again] == [run.summary for run in batch]


def test_continuing_another_request_is_refused(tmp_path):
    learn(PLANAR, steps=1000, out=tmp_path / "run", progress=False)
    with pytest.raises(ValueError, match=r"was started with length = 1000, this run asks for 2000"):
        learn(PLANAR, steps=2000, out=tmp_path / "run", resume=True, progress=False)
    with pytest.raises(ValueError, match=r"was started with config = "):
        learn(
            replace(PLANAR, reward="alive"),
            steps=1000,
            out=tmp_path / "run",
            resume=True,
            progress=False,
        )


def test_a_batch_continues_only_what_it_began(tmp_path):
    learn_seeds(PLANAR, [1, 2], steps=1000, out=tmp_path / "batch", progress=False)
    for seeds in ([3, 4], [2, 1], [1, 2, 3]):
        with pytest.raises(ValueError, match="another request"):
            (tmp_path / "batch" / "seed-1" / "summary.json").unlink(missing_ok=True)
            learn_seeds(
                PLANAR, seeds, steps=1000, out=tmp_path / "batch", resume=True, progress=False
            )
    with pytest.raises(ValueError, match="each may occur once"):
        learn_seeds(PLANAR, [7, 7], steps=1000, out=tmp_path / "twice", progress=False)


def test_the_policy_is_part_of_the_request(tmp_path):
    one, two = (learn(PLANAR.with_seed(seed), steps=1000, progress=False).policy for seed in (1, 2))
    evaluate(one, PLANAR, minutes=0.5, out=tmp_path / "judged", progress=False)
    with pytest.raises(ValueError, match="was started with policy_sha256"):
        evaluate(two, PLANAR, minutes=0.5, out=tmp_path / "judged", resume=True, progress=False)
    learn(PLANAR, steps=1000, policy=one, out=tmp_path / "warm", progress=False)
    with pytest.raises(ValueError, match="was started with policy_sha256"):
        learn(PLANAR, steps=1000, out=tmp_path / "warm", resume=True, progress=False)


def test_resume_leaves_other_people_s_files_alone(tmp_path):
    strangers = {"thesis.tmp", ".DS_Store", "slurm-1.out", ".ipynb_checkpoints"}
    for name in strangers:
        (tmp_path / name).write_text("chapter 1")
    left = tmp_path / ".weights.npz.123-abcd.tmp"  # of a write that was interrupted
    left.write_text("half")
    learn(PLANAR, steps=100, out=tmp_path, resume=True, progress=False)
    assert load_run(tmp_path).length == 100 and not left.exists()
    assert all((tmp_path / name).read_text() == "chapter 1" for name in strangers)


def test_two_processes_on_one_folder_never_mix_their_files(tmp_path):
    def start(seed):
        return subprocess.Popen(
            [sys.executable, "-c", _SEED, str(tmp_path / "run"), str(seed)],
            stderr=subprocess.PIPE,
            text=True,
        )

    ends = [(child.communicate()[1], child.returncode) for child in [start(1), start(2)]]
    refused = [said for said, code in ends if code]
    assert len(refused) == 1, ends
    assert "is in use by process" in refused[0] or "already has something in it" in refused[0]
    run = load_run(tmp_path / "run")  # compares configurations
    assert run.policy.sha256() == learn(run.config, steps=4000, progress=False).policy.sha256()


def test_an_edited_configuration_is_refused_and_other_versions_are_warned_of(tmp_path):
    place = tmp_path / "run"
    with pytest.raises(ZeroDivisionError):
        learn(PLANAR, steps=60_000, out=place, checkpoint_s=0.0, progress=_fail_after(25_000))
    header = json.loads((place / "config.json").read_text())
    header["versions"]["mujoco"] = "3.1.0"
    (place / "config.json").write_text(json.dumps(header))
    with pytest.warns(
        UserWarning, match="was begun with mujoco 3.1.0; continued with other versions"
    ):
        learn(PLANAR, steps=60_000, out=place, resume=True, progress=False)
    for name in ("records.npz", "weights.npz"):
        whole = (place / name).read_bytes()
        other = learn(PLANAR.with_seed(5), steps=3000, progress=False)
        other.save(tmp_path / name)
        (place / name).write_bytes((tmp_path / name / name).read_bytes())
        with pytest.raises(ValueError, match=f"{name} was made under another configuration"):
            load_run(place)
        (place / name).write_bytes(whole)
    header["config"]["learner"]["alpha"] = 0.5
    (place / "config.json").write_text(json.dumps(header))
    with pytest.raises(
        ValueError, match="weights.npz was made under another configuration than config.json says"
    ):
        load_run(place)


def _fail_after(updates):
    done = []

    def tell(count):
        done.append(count)
        if sum(done) > updates:
            raise ZeroDivisionError

    return tell


_SEED = """
import sys
from workbench.formation.config import ConvoyConfig
from workbench.lab.runs import learn
config = ConvoyConfig(drive="planar", followers=2, seed=int(sys.argv[2]))
learn(config, steps=4000, out=sys.argv[1], progress=False)
"""


def test_missing_interrupted_and_damaged_runs_are_told_apart(tmp_path):
    with pytest.raises(FileNotFoundError, match="holds no run: config.json is missing"):
        load_run(tmp_path / "nowhere")
    learn(PLANAR, steps=1000, out=tmp_path / "run", progress=False)
    summary = (tmp_path / "run" / "summary.json").read_bytes()
    (tmp_path / "run" / "summary.json").unlink()
    with pytest.raises(FileNotFoundError, match="is not complete; continue it with resume=True"):
        load_run(tmp_path / "run")
    (tmp_path / "run" / "summary.json").write_bytes(summary)
    (tmp_path / "run" / "weights.npz").write_bytes(b"PK nonsense")
    with pytest.raises(ValueError, match=r"weights.npz is"):
        load_run(tmp_path / "run")
    learn(PLANAR, steps=1000, out=tmp_path / "other", progress=False)
    np.savez(tmp_path / "other" / "records.npz", starts=np.zeros(1))
    with pytest.raises(
        ValueError,
        match="the stored run lacks sample_lengths, sample_starts, samples, sums, visits",
    ):
        load_run(tmp_path / "other")
    (tmp_path / "run" / "config.json").write_text('{"schema": 1}')
    with pytest.raises(ValueError, match="is not a run of schema 5"):
        load_run(tmp_path / "run")
    (tmp_path / "run" / "config.json").write_text('{"schema": 99}')
    with pytest.raises(ValueError, match="is not a run of schema 5"):
        load_run(tmp_path / "run")


def test_evaluation_is_greedy_frozen_and_checked(tmp_path):
    run = learn(PLANAR, steps=20_000, progress=False)
    judged = evaluate(
        run.policy, replace(PLANAR, seed=9), minutes=2, out=tmp_path / "judged", progress=False
    )
    assert judged.summary["steps"] == 0 and judged.kind == "evaluate"
    assert judged.summary["simulated_minutes"] == pytest.approx(2)
    np.testing.assert_array_equal(judged.policy.theta, run.policy.theta)
    assert load_run(tmp_path / "judged").summary == judged.summary
    pair = evaluate_seeds([run.policy] * 2, PLANAR, [3, 9], minutes=2, progress=False)
    assert pair[1].summary == judged.summary
    with pytest.raises(ValueError, match=r"the policy has distance_edges = .*, the configuration"):
        evaluate(run.policy, replace(PLANAR, state_tiles=(5, 9)), progress=False)
    with pytest.raises(ValueError, match="the policy has left_steps = "):
        evaluate(run.policy, replace(PLANAR, wheel_speed_mps=(0.02, 0.09)), progress=False)
    with pytest.raises(ValueError, match="the policy has 4 tables, the convoy 2 followers"):
        evaluate(run.policy, replace(PLANAR, followers=2), progress=False)
    with pytest.raises(ValueError, match="minutes = 0"):
        evaluate(run.policy, PLANAR, minutes=0, progress=False)
    with pytest.raises(ValueError, match="1 policies for 2 seeds"):
        evaluate_seeds([run.policy], PLANAR, [1, 2], progress=False)


def test_learning_can_start_from_a_policy():
    run = learn(PLANAR, steps=20_000, progress=False)
    warm = learn(PLANAR.with_seed(7), steps=4000, policy=run.policy, progress=False)
    cold = learn(PLANAR.with_seed(7), steps=4000, progress=False)
    assert warm.summary["losses"] < 0.6 * cold.summary["losses"]


def test_bad_requests_are_refused():
    for steps in (0, -3, 1.5, True):
        with pytest.raises(ValueError, match=f"steps = {steps}"):
            learn(PLANAR, steps=steps, progress=False)


def test_divergence_stops_the_run_and_names_the_seed():
    config = replace(PLANAR, learner=LearnerConfig(alpha=1.0, eta=100.0, lam=0.0, gamma=0.9))
    with pytest.raises(
        FloatingPointError,
        match=r"seed 1: learning diverged at update \d+: \|theta\| = .*alpha = 1",
    ):
        learn(config, steps=200_000, progress=False)


_CHILD = """
import sys
from workbench.formation.config import ConvoyConfig
from workbench.lab.runs import learn_seeds
config = ConvoyConfig(drive=sys.argv[2], followers=2)
asked = {"steps": int(sys.argv[3]), "out": sys.argv[1], "resume": True}
learn_seeds(config, [1, 2], progress=False, checkpoint_s=0, **asked)
"""


def _tree(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class _Killed(BaseException):
    """What a kill is like for the process: nothing catches it, nothing is tidied up."""


@pytest.mark.parametrize("moment", ["before the file has its name", "in the middle of a write"])
def test_an_end_at_any_write_is_continued_to_the_same_bytes(tmp_path, monkeypatch, moment):
    def start(folder):
        config = replace(PLANAR, followers=2)
        kinds = {"resume": True, "progress": False, "checkpoint_s": 0}
        learn_seeds(config, [1, 2], steps=9_000, out=folder, **kinds)

    start(tmp_path / "whole")
    wanted = _tree(tmp_path / "whole")
    assert len(wanted) == 12  # four files and a lock for each seed; a checkpoint and a lock
    real = os.replace
    for strike in itertools.count(1):
        left = [strike]

        def rename(source, target, left=left):
            left[0] -= 1
            if left[0] == 0:
                if moment == "in the middle of a write":
                    os.truncate(source, os.path.getsize(source) // 2)
                raise _Killed
            real(source, target)

        folder = tmp_path / f"strike{strike}"
        monkeypatch.setattr(storage.os, "replace", rename)
        try:
            start(folder)
            break  # there are fewer writes than that
        except _Killed:
            monkeypatch.setattr(storage.os, "replace", real)
        start(folder)
        assert _tree(folder) == wanted, f"a kill at write {strike} changed the result"
    assert strike > 9


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "steps"), [("planar", 100_000), ("wheels", 18_000)])
def test_a_kill_between_two_checkpoints_ends_with_the_same_bytes(tmp_path, drive, steps):
    def start(folder):
        command = [sys.executable, "-c", _CHILD, str(folder), drive, str(steps)]
        return subprocess.Popen(command, start_new_session=True)

    child = start(tmp_path / "killed")
    while not (tmp_path / "killed" / "checkpoint.npz").is_file():
        assert child.poll() is None
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    assert not (tmp_path / "killed" / "seed-2" / "summary.json").is_file()
    assert start(tmp_path / "killed").wait() == 0 and start(tmp_path / "whole").wait() == 0
    assert _tree(tmp_path / "killed") == _tree(tmp_path / "whole")
