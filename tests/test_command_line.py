"""The command line and the package as a user meets them."""

import contextlib
import json
import os
import signal
import subprocess
import sys

import pytest

import workbench as wb
from workbench.__main__ import _same_sources, main
from workbench.studies.tables import STUDIES

FAST = ["--drive", "planar", "--followers", "2", "--steps", "3000"]


def _run(*arguments):
    command = [sys.executable, "-W", "error", "-m", "workbench", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_learn_evaluate_and_resume_print_one_json_object_last(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert (
        main(
            [
                "learn",
                *FAST,
                "--seed",
                "3",
                "--out",
                out,
                "--set",
                "learner.alpha=0.2",
                "--set",
                "reward=alive",
            ]
        )
        == 0
    )
    learned = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert learned["steps"] == 3000 and learned["seed"] == 3 and learned["wall_s"] > 0
    run = wb.load_run(out)
    assert (
        run.config.learner.alpha == 0.2
        and run.config.reward == "alive"
        and run.config.followers == 2
    )
    assert (
        main(["learn", "--resume", "--out", out]) == 0
    )  # complete: shown again, nothing is learned
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {**again, "wall_s": 0} == {**learned, "wall_s": 0}
    assert main(["evaluate", out, "--minutes", "1", "--seed", "2", "--drive", "wheels"]) == 0
    judged = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"losses", "rms_distance_error_mm", "bearing_std_deg", "share_best_3x3"} <= set(judged)
    assert judged["drive"] == "wheels" and judged["simulated_minutes"] == pytest.approx(1)


def test_a_terminal_gets_lines_and_a_machine_json(tmp_path):
    """A real terminal: what a person sees, and what --json makes of it."""
    command = [sys.executable, "-m", "workbench", "evaluate", "carrot", "--minutes", "0.2"]
    command += ["--set", "drive=rolling"]
    for machine in ([], ["--json"]):
        person, terminal = os.openpty()
        with subprocess.Popen([*command, *machine], stdout=terminal, stderr=subprocess.PIPE) as run:
            os.close(terminal)
            shown = b""
            with contextlib.suppress(OSError):  # Linux's way to say that nobody writes any more
                while part := os.read(person, 4096):
                    shown += part
            os.close(person)
            assert run.wait() == 0
        lines = shown.decode().splitlines()
        if machine:
            assert json.loads(lines[-1])["losses"] == 0
        else:
            words = dict(line.split(maxsplit=1) for line in lines)
            assert words["losses"] == "0" and float(words["rms_distance_error_mm"]) > 0


def test_a_classical_law_is_evaluated_by_its_name(capsys):
    assert (
        main(
            [
                "evaluate",
                "carrot",
                "--minutes",
                "1",
                "--drive",
                "planar",
                "--set",
                "sensing=truth-relative",
            ]
        )
        == 0
    )
    judged = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (
        judged["losses"] == judged["collisions"] == 0 and 0 < judged["rms_distance_error_mm"] < 10
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["learn", "--out", "x", "--steps", "0"], "steps = 0; expected a whole number, at least 1"),
        (
            ["learn", "--out", "x", "--drive", "hover"],
            "ConvoyConfig.drive = 'hover'; expected one of 'wheels', 'planar'",
        ),
        (
            ["learn", "--out", "x", "--set", "learner.alpha=2"],
            "LearnerConfig.alpha = 2; expected a number from 1e-09 to 1",
        ),
        (["learn", "--out", "x", "--set", "alpha"], "--set 'alpha'; expected NAME=VALUE"),
        (["learn", "--out", "x", "--set", "seed.x=1"], "'seed' has no parts"),
        (
            ["learn", "--out", "x", "--setting", "best"],
            "--setting 'best'; expected one of paper, paper-robot",
        ),
        (
            ["learn", "--out", "x", "--setting", "paper", "--resume"],
            "a run that is resumed keeps its own",
        ),
        (
            ["evaluate", "nowhere"],
            "nowhere holds no run, and is no classical law (carrot, leader-frame, l-psi",
        ),
        (
            ["evaluate", "l-psi", "--set", "sensing=truth-relative"],
            "law 'l-psi' needs the predecessor's heading, speed",
        ),
        (["study", "everything"], "study 'everything'; expected one of actions, bound"),
        (["study", "inner", "--workers", "-1"], "workers = -1"),
        (
            ["validate", "moon"],
            "validate 'moon'; expected drive, infrared, tiles, camera or deadlines",
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert message in error and "\n" not in error
    assert list(tmp_path.iterdir()) == []  # nothing half-written


def test_a_named_setting_is_where_a_run_starts_from(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["learn", *FAST, "--setting", "recommended", "--out", out]) == 0
    config = wb.load_run(out).config
    assert (config.output, config.state_tiles, config.followers) == ("interpolated", (5, 3), 2)
    judged = main(["evaluate", out, "--minutes", "1"])
    assert judged == 0 and "rms_distance_error_mm" in capsys.readouterr().out


def test_studies_are_listed_with_their_questions(capsys):
    assert main(["study", "list"]) == 0
    printed = capsys.readouterr().out
    assert (
        "buffer" in printed
        and "From which compute time on does the update buffer matter?" in printed
    )


def test_an_interruption_is_one_line_and_code_130(monkeypatch, capsys):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("workbench.studies.tables.run_study", interrupt)
    assert main(["study", "inner"]) == 130
    assert "the same command continues" in capsys.readouterr().err


def test_help_explains_units_and_fields():
    text = _run("learn", "--help").stdout
    for words in (
        "Units:",
        "motor steps/s",
        "learner.alpha",
        "leader_speed_mps = 0.06: constant speed of the leader",
    ):
        assert words in text


def test_import_is_light_and_works_without_a_graphics_library():
    code = (
        "import sys, workbench; print([m for m in ('cv2', 'ipywidgets', 'OpenGL') if m in "
        "sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_no_opengl_library_is_loaded_by_learning_and_drawing():
    code = (
        "import workbench as wb; import numpy as np; run = "
        "wb.learn(wb.ConvoyConfig(drive='planar'), steps=50, progress=False); "
        "wb.picture(wb.still_world(run.config, run.records['samples'][0]), width=16, height=12); "
        "print([line for line in open('/proc/self/maps') if 'libEGL' in line or 'libGL' in "
        "line or 'libOSMesa' in line])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"


def test_the_public_surface_is_small_and_sorted_out():
    assert 15 < len(wb.__all__) < 50 and set(wb.__all__) <= set(dir(wb))
    assert all(getattr(wb, name).__doc__ for name in wb.__all__)
    with pytest.raises(AttributeError, match="module 'workbench' has no attribute 'lern'"):
        _ = wb.lern


@pytest.mark.parametrize(
    ("code", "seconds", "absent"),
    [
        ("import workbench", 0.15, "numpy numba mujoco pandas scipy matplotlib gymnasium"),
        ("import workbench.robot.api", 0.25, "numba mujoco pandas scipy matplotlib"),
        (
            "import workbench.formation.convoy",
            0.8,
            "pandas scipy.stats scipy.spatial matplotlib gymnasium IPython cv2",
        ),
        (
            "import workbench as wb; wb.learn",
            0.8,
            "pandas scipy.stats matplotlib gymnasium IPython cv2",
        ),
    ],
)
def test_a_name_costs_what_it_needs(code, seconds, absent):
    tell = (
        f"{code}\nimport sys, time; print(time.process_time(), *[name for name in "
        f"{absent.split()} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", tell], capture_output=True, text=True, check=True)
    took, *loaded = done.stdout.split()
    assert loaded == []
    print(f"{code}: {took} s of {seconds} s")  # shown, not asserted: clocks differ


def test_gymnasium_knows_the_environments_whatever_is_imported_first():
    for imports in (
        "import gymnasium, workbench",
        "import workbench, gymnasium",
        "import workbench as wb; wb.ConvoyConfig; import gymnasium.vector",
    ):
        command = [
            sys.executable,
            "-c",
            f"{imports}; print(gymnasium.spec('workbench/Follow-v0').id)",
        ]
        assert (
            subprocess.run(command, capture_output=True, text=True, check=True).stdout
            == "workbench/Follow-v0\n"
        )


def test_a_tilde_behind_an_equals_sign_is_the_home(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    assert main(["learn", *FAST, "--out=~/runs/a"]) == 0
    assert (tmp_path / "home" / "runs" / "a" / "summary.json").is_file()
    assert wb.load_run("~/runs/a").length == 3000 and not (tmp_path / "~").exists()


@pytest.mark.parametrize("verb", [["--help"], ["learn", "--help"], ["study", "list"]])
def test_a_terminal_without_these_letters_gets_others(verb):
    command = [sys.executable, "-m", "workbench", *verb]
    environment = os.environ | {"PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert done.returncode == 0 and done.stdout and not done.stderr


def test_nobody_who_reads_on_is_no_error():
    command = f"{sys.executable} -m workbench study list | head -1"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.stdout.count("\n") == 1 and not done.stderr


def test_being_told_to_end_is_an_interruption(tmp_path):
    command = [sys.executable, "-m", "workbench", "learn", "--drive", "planar"]
    command += ["--steps", "100000000", "--out", str(tmp_path / "run")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        while not (tmp_path / "run" / "config.json").is_file():
            assert child.poll() is None
        child.send_signal(signal.SIGTERM)
        said = child.communicate()[1]
    assert child.returncode == 130 and "interrupted: what is finished is stored" in said


def test_unknown_flags_are_refused_with_a_hint(capsys):
    assert main(["learn", "--outt", "x"]) == 2
    assert "No such option" in capsys.readouterr().err


def test_workers_that_measure_otherwise_are_refused():
    class Cluster:
        """Two workers: one has this process's sources, the other those that it is told."""

        def __init__(self, other):
            self.other = other

        def run(self, function, argument):
            ours = function(argument)
            return {"tcp://one": ours, "tcp://two": self.other or ours}

    functions = [STUDIES[name].function for name in ("inner", "copies")]
    _same_sources(Cluster(""), functions)
    with pytest.raises(RuntimeError, match="with other sources or versions.*: tcp://two; update"):
        _same_sources(Cluster("0" * 16), functions)


def test_a_robot_of_a_file_scales_the_task_and_what_is_set_after_it_stays(tmp_path, capsys):
    place = tmp_path / "mine.json"
    place.write_text(json.dumps({"body_radius_m": 0.07, "most_mps": 0.25}))
    told = ["--minutes", "1", "--drive", "rolling", "--set", f"robot={place}"]
    assert main(["evaluate", "carrot", *told, "--set", "distance_m=0.2,0.5"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["losses"] == 0
    assert main(["evaluate", "carrot", "--set", "robot=larg"]) == 2
    assert "expected a path that ends in .json, or one of: epuck, large" in capsys.readouterr().err


def test_a_run_is_evaluated_on_another_track_from_the_shell_as_from_python(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["learn", *FAST, "--out", out]) == 0
    assert main(["evaluate", out, "--minutes", "2"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    same = wb.evaluate(wb.load_run(out), minutes=2, progress=False).summary
    assert found["seed"] == 1001 and found["losses"] == same["losses"]
    assert found["rms_distance_error_mm"] == same["rms_distance_error_mm"]


def test_help_lists_the_fields_of_every_part(capsys):
    assert main(["learn", "--help"]) == 0
    told = capsys.readouterr().out
    for name in ("robot", "camera", "infrared", "body", "track", "estimate", "learner"):
        assert f"\n{name}:\n" in told
    assert "most_steps" in told and "judder_rms_m" in told
