"""Recordings: safe to kill, checked to the cell, replayed; importers of the public tables."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.formation.config import SETTINGS
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.lab.runs import learn
from workbench.lab.weights import load_weights
from workbench.logs import importers, sessions
from workbench.logs.driving import drive
from workbench.logs.hello import hello
from workbench.logs.recordings import POSES, Recorder, load_recording
from workbench.logs.replay import RecordingEnded
from workbench.logs.sessions import drive_robot, record_robot
from workbench.robot.open import open_robot
from workbench.robot.wire.emulator import Emulator

CONFIG = replace(SETTINGS["infrared"], followers=1, drive="planar", seed=3)

KILLED = """
import os, sys
from workbench.robot.api import Robot
from workbench.logs.recordings import Recorder

class Quick(Robot):
    capabilities = frozenset({"proximity", "motor_position"})
    def _open(self): pass
    def _close(self): pass
    def _drive(self, left, right): pass
    def _exchange(self, sensors): return {"proximity": (1.0,) * 8, "motor_position": (2.0, 3.0)}

robot = Quick(period_s=0.0, watchdog_s=None)
robot.enable("proximity", "motor_position")
robot.connect()
robot.step()
for folder in sys.stdin:  # a fresh process for every kill, without the second that starting takes
    child = os.fork()
    if child:
        print(child, flush=True)
        os.waitpid(child, 0)
        print("gone", flush=True)
        continue
    for number in range(30):
        path = f"{folder.strip()}/emulated-{number}.csv"
        recorder = Recorder(path, robot, link="none", real=False)
        for row in range(60):
            recorder.add(row / 10, robot, command=(1, 2))
        recorder.close()
    os._exit(0)
"""


def _record(path, rows=20, **options):
    with SimulatedRobot(CONFIG) as robot:
        robot.enable("proximity", "light", "floor", "motor_position")
        with Recorder(path, robot, link="sim:", real=False, **options) as recorder:
            for _ in range(rows):
                robot.step()
                robot.set_motors_speed(300, 200)
                recorder.add(
                    robot.time_s,
                    robot,
                    command=(300, 200),
                    poses=(0.0,) * 6 if options.get("poses") else (),
                )
    return path


def test_a_recording_is_loaded_as_it_was_written(tmp_path):
    recording = load_recording(_record(tmp_path / "a.csv", config=CONFIG, poses=True))
    assert len(recording.frame) == 20 and not recording.truncated and recording.config == CONFIG
    assert recording.sensors == ["proximity", "light", "floor", "motor_position"]
    np.testing.assert_allclose(recording.frame["t_s"], np.arange(20) / 10)
    assert (
        list(recording.frame.columns[-6:]) == POSES
        and (recording.frame["left_command"] == 300).all()
    )
    units = recording.header["units"]
    assert units["t_s"] == "s" and units["ps0"] == "counts" and units["heading_rad_ahead"] == "rad"
    summary = recording.summary()
    assert summary["rate_hz"] == pytest.approx(10) and summary["complete"] and not summary["real"]
    told = recording.header
    assert told["measured_rate_hz"] == pytest.approx(summary["rate_hz"])
    assert told["longest_interval_s"] == pytest.approx(summary["longest_interval_s"])


def test_a_followers_thoughts_are_recorded_with_the_probability_of_what_it_did(tmp_path):
    follower = SoloFollower(CONFIG, steps=150)
    with SimulatedRobot(CONFIG) as robot:
        robot.calibrate_proximity_sensors()
        robot.enable("proximity")
        with Recorder(
            tmp_path / "b.csv", robot, link="sim:", real=False, config=CONFIG, calibration="K"
        ) as recorder:
            drive(robot, follower, seconds=20, watch=recorder.watch)
    frame = load_recording(tmp_path / "b.csv").frame
    following = frame["phase"] == 0
    assert (
        following.sum() > 100
        and (frame.loc[following & (frame["state"] >= 0), "action"] >= 0).all()
    )
    assert (frame.loc[~following, "state"] == -1).all()
    assert (
        frame["probability"].between(0, 1).all() and frame["probability"].min() < 0.999
    )  # it explored, or might have
    left, right = CONFIG.levels()
    chosen = frame[following & (frame["state"] >= 0)]
    np.testing.assert_array_equal(chosen["left_command"], left[chosen["action"] // len(right)])


@pytest.mark.slow
def test_a_hundred_kills_leave_recordings_that_load(tmp_path):
    chance = np.random.default_rng(0)
    loaded = cut = 0
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", KILLED], **pipes) as parent:
        for kill in range(100):
            folder = tmp_path / str(kill)
            folder.mkdir()
            parent.stdin.write(f"{folder}\n")
            parent.stdin.flush()
            child = int(parent.stdout.readline())
            until = time.monotonic() + 30
            while not any(folder.iterdir()) and time.monotonic() < until:
                time.sleep(0.0005)  # until it has begun, however busy the machine is
            time.sleep(float(chance.uniform(0, 0.06)))
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            assert parent.stdout.readline() == "gone\n"
            for side in folder.glob("*.json"):
                recording = load_recording(side.with_suffix(".csv"))
                loaded += 1
                cut += not recording.header["complete"]
                assert (recording.frame["ps3"] == 1).all()
        parent.stdin.close()
    assert loaded > 100 and cut > 50  # most kills struck an open recording


def test_a_half_written_last_line_is_dropped_and_reported(tmp_path):
    path = _record(tmp_path / "c.csv")
    side = path.with_suffix(".json")
    header = json.loads(side.read_text())
    side.write_text(json.dumps(header | {"complete": False, "sha256": None}))
    path.write_bytes(path.read_bytes()[:-7])
    recording = load_recording(path)
    assert recording.truncated and len(recording.frame) == 19


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            lambda rows: rows.__setitem__(5, ["x", *rows[5][1:]]),
            "row 5, column t_s: 'x'; expected a number",
        ),
        (
            lambda rows: rows.__setitem__(5, [rows[4][0], *rows[5][1:]]),
            "row 5, column t_s: 0.3 after 0.3; expected rising",
        ),
        (lambda rows: rows.__setitem__(5, rows[5][:-1]), "row 5: 27 columns; expected 28"),
        (
            lambda rows: [row.__setitem__(0, str(float(row[0]) + 3)) for row in rows[5:]],
            "row 5, column t_s: 3.1 s without a row",
        ),
        (
            lambda rows: rows[7].__setitem__(1, "4096"),
            "row 7, column ps0: 4096; expected a number from 0 to 4095",
        ),
        (lambda rows: rows[7].__setitem__(1, "nan"), "row 7, column ps0: nan"),
        (
            lambda rows: rows[3].__setitem__(24, "0.5"),
            "row 3, column state: 0.5; expected a whole number",
        ),
        (lambda rows: rows[0].__setitem__(0, "time"), "row 0: columns"),
    ],
)
def test_the_first_thing_that_is_wrong_is_named_by_row_and_column(tmp_path, edit, message):
    path = _record(tmp_path / "d.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    edit(rows)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    side = path.with_suffix(".json")
    side.write_text(json.dumps(json.loads(side.read_text()) | {"complete": False}))
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        load_recording(path, gap_s=1.0)


def test_rate_and_gaps_are_told_as_they_are_and_not_refused(tmp_path):
    path = _record(tmp_path / "slow.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    for number, row in enumerate(rows[1:]):
        row[0] = str(0.14 * number + (5.0 if number > 8 else 0.0))
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    side = path.with_suffix(".json")
    side.write_text(json.dumps(json.loads(side.read_text()) | {"complete": False}))
    summary = load_recording(path).summary()
    assert summary["rate_hz"] == pytest.approx(1 / 0.14) and summary["gaps"] == 1
    assert summary["longest_interval_s"] == pytest.approx(5.14)
    with pytest.raises(ValueError, match="5.14 s without a row; expected at most 1 s"):
        open_robot(f"log:{path}", gap_s=1.0)


def test_a_column_that_occurs_twice_is_named(tmp_path):
    path = _record(tmp_path / "twice.csv")
    side = path.with_suffix(".json")
    header = json.loads(side.read_text())
    columns = ["t_s", "ps0", *header["columns"][1:]]
    lines = path.read_text().splitlines()
    doubled = [
        ",".join([line.split(",")[0], line.split(",")[1], *line.split(",")[1:]]) for line in lines
    ]
    path.write_text("\n".join(doubled) + "\n")
    side.write_text(json.dumps(header | {"columns": columns, "complete": False}))
    with pytest.raises(ValueError, match=r"columns \['ps0'\] occur more than once"):
        load_recording(path)


def test_a_changed_recording_is_refused_by_its_hash(tmp_path):
    path = _record(tmp_path / "e.csv")
    path.write_text(path.read_text().replace("300", "301"))
    with pytest.raises(ValueError, match="not what its sidecar's sha256 says"):
        load_recording(path)


def test_recordings_are_never_overwritten_and_named_as_what_they_are(tmp_path):
    path = _record(tmp_path / "f.csv")
    with pytest.raises(FileExistsError, match="never overwritten"):
        _record(path)
    with pytest.raises(ValueError, match="ends in .csv"):
        _record(tmp_path / "g.txt")
    with pytest.raises(FileNotFoundError, match="expected the .csv"):
        load_recording(tmp_path / "none.csv")


def test_shipped_recordings_are_emulated_say_so_and_load():
    folder = paths.DATA / "recordings"
    files = sorted(folder.glob("*.csv"))
    assert files and {path.suffix for path in folder.iterdir()} <= {".csv", ".json", ".md"}
    for path in files:
        recording = load_recording(path)
        assert (
            path.name.startswith("emulated")
            and recording.header["complete"]
            and not recording.header["real"]
        )
        assert "emulated" in recording.header["note"] and recording.config is not None
        assert path.stat().st_size < 300_000


def test_importers_read_the_public_tables_and_name_what_is_wrong(tmp_path):
    box = tmp_path / "tum_epuck1_box_bearing"
    box.mkdir()
    rows = [" ".join(str(100 + 10 * k + row) for k in range(8)) for row in range(36)]
    (box / "proximity_values.txt").write_text("\n".join(rows) + "\n")
    sweep = importers.tum_box_sweep(tmp_path)
    assert (
        sweep.shape == (36, 9)
        and sweep["bearing_deg"].iloc[0] == -180
        and sweep["ps7"].iloc[35] == 205
    )
    (box / "proximity_values.txt").write_text("\n".join([*rows[:4], "1 2 3", *rows[5:]]))
    with pytest.raises(ValueError, match="row 5: 3 columns; expected 8"):
        importers.tum_box_sweep(tmp_path)
    (box / "proximity_values.txt").write_text("\n".join(rows[:20]))
    with pytest.raises(ValueError, match="has 20 rows; expected 36"):
        importers.tum_box_sweep(tmp_path)
    wii = tmp_path / "wii42_epuck2_ir_ground"
    wii.mkdir()
    (wii / "IRsensors.csv").write_text(
        "step,ps0,ps1,ps2,ps3,ps4,ps5,ps6,ps7,\n0,1,2,3,4,5,6,7,8,\n1,1,2,3,4,5,6,7,8,\n"
    )
    runs = importers.wii42_backing_off(tmp_path)
    assert (
        runs["IRsensors"]["row_mm"].tolist() == pytest.approx([0, 0.597])
        and "t_s" not in runs["IRsensors"]
    )
    (wii / "IRsensors.csv").write_text(
        "step,ps0,ps1,ps2,ps3,ps4,ps5,ps6,ps7,\n0,1,2,3,x,5,6,7,8,\n"
    )
    with pytest.raises(ValueError, match="row 1, column ps3: 'x'; expected a number"):
        importers.wii42_backing_off(tmp_path)
    with pytest.raises(FileNotFoundError, match="Gsensors"):
        importers.wii42_ground(tmp_path)
    ttu = tmp_path / "ttu_epuck2_leader_follower"
    ttu.mkdir()
    pd.DataFrame({"timestamp_s": [0, 0.1], "leader_position_m": [0, 0.01]}).to_csv(
        ttu / "epuck-exp-1.csv", index=False
    )
    drives = importers.ttu_drives(tmp_path)
    assert list(drives["epuck-exp-1"].columns) == ["t_s", "leader_position_m"]


def test_a_missing_recording_folder_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="WORKBENCH_RECORDINGS has to name"):
        importers.tum_box_sweep(tmp_path)


def test_simulations_are_never_recorded_as_real_and_recordings_are_not_recorded_again(tmp_path):
    with pytest.raises(ValueError, match="that is no real robot: leave --real out"):
        record_robot("sim:", tmp_path / "a.csv", seconds=0.5, real=True)
    record_robot("sim:", tmp_path / "b.csv", seconds=0.5, speeds=(200, 300))
    stored = load_recording(tmp_path / "b.csv")
    assert (
        set(stored.frame["left_command"]) == {200}
        and set(stored.frame["right_command"]) == {300}
        and not stored.header["real"]
    )
    with pytest.raises(ValueError, match="is a recording already; copy its .csv and .json"):
        record_robot(f"log:{tmp_path / 'b.csv'}", tmp_path / "c.csv", seconds=0.5)
    wrong = ({"speeds": (5000, 0)}, {"seconds": float("nan")}, {"seconds": -5.0})
    for changes in wrong:
        with pytest.raises(ValueError, match=next(iter(changes)) + " = "):
            record_robot("sim:", tmp_path / "d.csv", **({"seconds": 0.5} | changes))
    assert not list(tmp_path.glob("[acd].*"))


def test_sidecars_that_say_nonsense_are_named(tmp_path):
    record_robot("sim:", tmp_path / "a.csv", seconds=0.5)
    side = tmp_path / "a.json"
    whole = side.read_text()
    for change, match in (
        ({"rate_hz": None}, "rate_hz = None; expected rows per second"),
        ({"rate_hz": "x"}, "rate_hz = 'x'"),
        ({"config": {"followers": 0}}, "a.json: config:"),
        ({"config": 7}, "a.json: config:"),
    ):
        side.write_text(json.dumps(json.loads(whole) | change))
        with pytest.raises(ValueError, match=match):
            load_recording(tmp_path / "a.csv")
    side.write_text(whole)
    with pytest.raises(ValueError, match="is no recording; expected a file that ends in .csv"):
        load_recording(side)
    (tmp_path / "a.csv").unlink()
    with pytest.raises(FileNotFoundError, match="its sidecar says that it is complete"):
        load_recording(tmp_path / "a.csv")


def test_a_replayed_robot_has_no_time_before_its_first_row_and_after_its_last(tmp_path):
    record_robot("sim:", tmp_path / "a.csv", seconds=0.3)
    robot = open_robot(f"log:{tmp_path / 'a.csv'}")
    robot.connect()
    with pytest.raises(RecordingEnded, match="call step"):
        _ = robot.recorded_command
    for _ in range(3):
        robot.step()
    assert robot.time_s == pytest.approx(0.2) and robot.recorded_command == (0, 0)
    with pytest.raises(RecordingEnded):
        robot.step()


def test_a_follower_that_learns_on_while_it_drives_keeps_its_weights(tmp_path):
    config = replace(
        SETTINGS["infrared"], followers=1, drive="planar", state_tiles=(5, 5), action_levels=(3, 3)
    )
    learn(config, steps=2000, progress=False, out=tmp_path / "run")
    report = drive_robot("sim:", tmp_path / "run", seconds=20, learn=1000, out=tmp_path / "more")
    kept = load_weights(tmp_path / "more")
    assert kept.updates == report["updates"] > 50
    assert kept.policy.sha256() != load_weights(tmp_path / "run").policy.sha256()
    kept.policy.check(config)
    with pytest.raises(ValueError, match="nothing to keep unless it learns"):
        drive_robot("sim:", tmp_path / "run", seconds=1, out=tmp_path / "other")
    with pytest.raises(FileExistsError):
        drive_robot("sim:", tmp_path / "run", seconds=1, learn=10, out=tmp_path / "more")
    with pytest.raises(ValueError, match="steps = -5"):
        drive_robot("sim:", tmp_path / "run", seconds=1, learn=-5)


def test_a_drive_foresees_the_delay_that_hello_measured(tmp_path, monkeypatch):
    """The same weights over an emulated link that is late, as a report says."""
    config = replace(SETTINGS["infrared"], followers=1, drive="rolling")
    learn(config, steps=3000, progress=False, out=tmp_path / "run")
    report = tmp_path / "hello.json"
    seen = []
    real = sessions.SoloFollower

    def noted(config, *arguments, **options):
        seen.append(config)
        return real(config, *arguments, **options)

    monkeypatch.setattr(sessions, "SoloFollower", noted)
    with Emulator(SimulatedRobot(config), "epuck1", delay_s=0.02) as emulator:
        hello(emulator.url, out=report)
        drive_robot(emulator.url, tmp_path / "run", seconds=2, hello=report)
        for told in ("own", "both"):
            drive_robot(
                emulator.url,
                tmp_path / "run",
                seconds=1,
                hello=report,
                change=lambda c, told=told: replace(c, output="interpolated", prediction=told),
            )
    measured = json.loads(report.read_text())["delay_s"]
    assert [each.prediction for each in seen] == ["both", "own", "both"]
    assert {each.late_s for each in seen} == {measured} and measured > 0.02
    assert [each.output for each in seen] == ["greedy", "interpolated", "interpolated"]
    with pytest.raises(ValueError, match="a simulated robot's link has the delay that"):
        drive_robot("sim:", tmp_path / "run", seconds=1, hello=report)
    report.write_text("[]")
    with pytest.raises(ValueError, match="holds no delay_s; expected a report of"):
        drive_robot("tcp://127.0.0.1:1", tmp_path / "run", seconds=1, hello=report)
