"""Anybody's own log becomes a recording: what it says is taken, what it does not is asked for."""

import numpy as np
import pytest

from workbench.__main__ import main
from workbench.logs.csv_import import import_table
from workbench.logs.recordings import load_recording
from workbench.robot.geometry import STEP

GERMAN = "Zeit [ms];ps0;links [mm/s];rechts [mm/s]\n0;10,5;38,64;0\n100;11,5;0;38,64\n"
PLAIN = "t_s,ps0,ps7,left_command,right_command\n0,10,12,300,300\n0.1,11,14,300,-300\n"


def _log(tmp_path, text, name="mylog.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def _imported(path, **kinds):
    return load_recording(import_table(path, robot="e-puck1 12", **kinds)["written"])


def test_a_plain_log_needs_no_more_than_which_robot_it_was(tmp_path):
    recording = _imported(_log(tmp_path, PLAIN))
    assert recording.frame["ps7"].tolist() == [12.0, 14.0]
    assert recording.frame["right_command"].tolist() == [300, -300]
    assert recording.header["robot"] == "e-puck1 12" and not recording.header["real"]
    assert recording.summary()["rate_hz"] == pytest.approx(10)


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (GERMAN, "utf-8"),
        (GERMAN.replace("\n", "\r\n"), "utf-8-sig"),
        (GERMAN.replace(";", "\t"), "utf-16"),
    ],
    ids=["semicolons and decimal commas", "windows, with a mark", "tabs, utf-16"],
)
def test_delimiters_decimal_commas_encodings_and_units_are_found_and_said(tmp_path, text, encoding):
    path = _log(tmp_path, text, encoding=encoding)
    names = {
        "Zeit [ms]": "t_s",
        "links [mm/s]": "left_command",
        "rechts [mm/s]": "right_command",
    }
    recording = _imported(path, names=names)
    assert recording.frame["t_s"].tolist() == [0.0, 0.1]
    assert recording.frame["ps0"].tolist() == [10.5, 11.5]
    assert recording.frame["left_command"][0] == round(0.03864 / STEP)
    assert "decimal comma" in recording.header["note"] and "mm/s" in recording.header["note"]


@pytest.mark.parametrize(
    ("times", "unit"),
    [((0, 0.1, 0.2), "s"), ((0, 100, 200), "ms"), ((1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2), "s, since")],
)
def test_times_are_taken_by_the_size_of_their_steps_and_that_is_said(tmp_path, times, unit):
    rows = "".join(f"{t!r},5\n" for t in times)
    path = _log(tmp_path, "timestamp,ps0\n" + rows)
    recording = _imported(path, commands=False)
    np.testing.assert_allclose(recording.frame["t_s"], [0, 0.1, 0.2], atol=1e-6)
    assert f"times taken as {unit}" in recording.header["note"]


@pytest.mark.parametrize(
    ("text", "kinds", "message"),
    [
        (PLAIN, {"robot": None}, 'which robot it was; add --robot "e-puck2 4521"'),
        (PLAIN.replace("left_c", "l_c"), {}, "add --map COLUMN=left_command, or --no-commands"),
        (PLAIN.replace("t_s", "when"), {}, "no column of times.*add --map COLUMN=t_s"),
        ("t_s,left speed,right_command\n0,1,2\n", {}, "add --unit left_command=UNIT, one of st"),
        (PLAIN, {"names": {"psx": "ps1"}}, "--map psx=ps1: no column 'psx'"),
        (PLAIN, {"names": {"ps0": "nose"}}, "a recording has no column 'nose'"),
        ("a b c\n1 2 3\n", {}, "none of the delimiters"),
        (PLAIN.replace("ps7", "ps0"), {}, r"columns \['ps0'\] occur more than once"),
        (PLAIN + "0.2,1,2\n", {}, "row 3: 3 columns; expected 5"),
        (PLAIN + "0.2,x,2,3,4\n", {}, "row 3: no number for ps0"),
        ("t_s,ps0\n", {}, "expected a header and rows"),
    ],
)
def test_what_a_log_does_not_say_is_asked_for(tmp_path, text, kinds, message):
    path = _log(tmp_path, text)
    with pytest.raises(ValueError, match=message):
        import_table(path, **({"robot": "mine"} | kinds))
    assert list(tmp_path.iterdir()) == [path]  # nothing half-written


def test_the_command_line_names_the_import_and_says_what_it_took(tmp_path, capsys):
    path = _log(tmp_path, PLAIN.replace("t_s", "time"))
    assert main(["check", str(path)]) == 2
    assert f"python -m workbench import {path}" in capsys.readouterr().err
    assert main(["import", str(path), "--robot", "mine", "--map", "ps7=ps6"]) == 0
    told = capsys.readouterr().out
    assert "'time' taken as t_s" in told and "delimiter ','" in told
    assert main(["check", str(tmp_path / "mylog_recording.csv")]) == 0
    with pytest.raises(FileExistsError, match="add --out"):
        import_table(path, robot="mine")
