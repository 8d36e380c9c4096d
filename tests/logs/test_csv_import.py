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
        (PLAIN, {"robot": None}, 'which robot it was: add --robot "e-puck2 4521"'),
        (PLAIN.replace("left_c", "l_c"), {}, "add --map COLUMN=left_command, or --no-commands"),
        (PLAIN.replace("t_s", "when"), {}, "has no column t_s: add --map COLUMN=t_s"),
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


def test_everything_that_is_open_is_asked_for_at_once(tmp_path):
    path = _log(tmp_path, "Zeit;x;y;Winkel\n0;1,5;2;10\n100;2,5;2;20\n")
    with pytest.raises(ValueError) as caught:
        import_table(path)
    for remedy in (
        "--robot",
        "--map COLUMN=t_s",
        "--map COLUMN=left_command, or --no-commands",
        "--unit x_m=UNIT, one of m, cm, mm",
        "--unit y_m=UNIT",
    ):
        assert remedy in str(caught.value)
    names = {"Zeit": "t_s", "Winkel": "heading_rad"}
    units = {"x": "mm", "y_m": "mm", "Winkel": "deg"}  # by either name
    recording = _imported(path, names=names, units=units, commands=False)
    assert recording.frame["x_m"].tolist() == [0.0015, 0.0025]
    assert recording.frame["heading_rad"].tolist() == pytest.approx([np.pi / 18, np.pi / 9])
    with pytest.raises(ValueError, match=r"--unit bogus=mm: no column 'bogus'; there are"):
        _imported(path, names=names, units={"bogus": "mm"}, commands=False, overwrite=True)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ({"x_m": "mm", "heading_rad": "rad"}, r"heading_rad reaches 350; .*--unit heading_rad=deg"),
        ({"x_m": "m", "heading_rad": "deg"}, r"x_m changes by 50 m/s; no small robot is faster"),
    ],
)
def test_units_that_cannot_be_right_are_refused(tmp_path, units, message):
    path = _log(tmp_path, "t_s,x,heading\n0,10,340\n0.1,15,350\n0.2,20,350\n")
    with pytest.raises(ValueError, match=message):
        _imported(path, units=units, commands=False)


def test_comments_thousands_words_and_rows_with_holes(tmp_path):
    text = "# Versuch 3\nt_s;prox0;Ort;gyro_x\n0;1.234,5;Ulm;3\n0,1;;Ulm;4\n0,2;99,5;Ulm;5\n"
    path = _log(tmp_path, text)
    with pytest.raises(ValueError, match="row 2: no number for ps0; add --cut"):
        _imported(path, commands=False)
    recording = _imported(path, commands=False, cut=True)
    assert recording.frame["ps0"].tolist() == [1234.5, 99.5]
    note = recording.header["note"]
    for told in ("1 lines of comments", "hold no numbers: Ort", "1 rows without a number"):
        assert told in note


def test_the_name_of_what_is_written_ends_in_csv_and_is_not_taken_twice(tmp_path):
    path = _log(tmp_path, PLAIN)
    with pytest.raises(ValueError, match=r"expected a name that ends in \.csv"):
        _imported(path, out=tmp_path / "c2")
    _imported(path, out=tmp_path / "c2.csv")
    with pytest.raises(FileExistsError, match="add --out NAME.csv, or --overwrite"):
        _imported(path, out=tmp_path / "c2.csv")
    _imported(path, out=tmp_path / "c2.csv", overwrite=True)


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
