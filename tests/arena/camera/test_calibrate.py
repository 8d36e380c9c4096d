"""A camera's calibration from drawn pictures of a board, and robots found with it."""

import functools
import json
import math

import cv2
import numpy as np
import pandas as pd
import pytest

from workbench.__main__ import main
from workbench.arena.camera.calibrate import Board, calibrate, load_camera
from workbench.arena.camera.config import CameraConfig
from workbench.arena.camera.frames import Frames
from workbench.arena.camera.markers import pictures
from workbench.arena.camera.optics import Calibration, Camera
from workbench.logs.found import find_robots
from workbench.measures.motion import Motion

WIDTH, HEIGHT = 800, 600
FOCAL = 700.0
MATRIX = np.array([[FOCAL, 0, 404.0], [0, FOCAL, 297.0], [0, 0, 1]])
LENS = np.array([-0.12, 0.03, 0.0, 0.0, 0.0])
BOARD = Board(7, 5, square_m=0.04, marker_m=0.03)
PX_PER_M = 4000
FINE = 2  # sub-pixels


def _texture(board):
    size = (round(board.columns * board.square_m * PX_PER_M), round(board.rows * 0.04 * PX_PER_M))
    if board.marker_m is not None:
        return board.charuco().generateImage(size)
    y, x = np.mgrid[0 : size[1], 0 : size[0]] // round(board.square_m * PX_PER_M)
    return np.where((x + y) % 2 == 0, 0, 255).astype(np.uint8)


@functools.cache
def _rays():
    """Return the ray of every sub-pixel, through the lens."""
    matrix = MATRIX * [[FINE], [FINE], [1]]
    matrix[:2, 2] += (FINE - 1) / 2
    v, u = np.mgrid[0 : FINE * HEIGHT, 0 : FINE * WIDTH]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    rays = cv2.undistortPoints(pixels, matrix, LENS).reshape(-1, 2)
    return np.column_stack([rays, np.ones(len(rays))])


def _draw(board, vector, translation):
    """Return the picture of a board at a pose (board to camera), through the lens."""
    rotation, _ = cv2.Rodrigues(np.array(vector, np.float64))
    inside = _rays() @ rotation  # in the board's frame
    eye = -rotation.T @ np.array(translation)
    along = -eye[2] / inside[:, 2]
    at = (eye[:2] + inside[:, :2] * along[:, None]) * PX_PER_M - 0.5
    maps = at.reshape(FINE * HEIGHT, FINE * WIDTH, 2).astype(np.float32)
    paper = cv2.remap(_texture(board), maps, None, cv2.INTER_LINEAR, borderValue=180)
    return cv2.resize(paper, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


def _poses(rng, count):
    for _ in range(count):
        vector = rng.uniform(-0.5, 0.5, 3)
        rotation, _ = cv2.Rodrigues(vector)
        middle = np.array([0.14, 0.10, 0.0])
        wanted = np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.07, 0.07), rng.uniform(0.4, 0.6)])
        yield vector, wanted - rotation @ middle


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("board")
    rng = np.random.default_rng(1)
    for number, (vector, translation) in enumerate(_poses(rng, 12)):
        cv2.imwrite(str(place / f"{number:02}.png"), _draw(BOARD, vector, translation))
    cv2.imwrite(str(place / "floor.png"), _draw(BOARD, (0.1, 0.05, 0.02), (-0.14, -0.10, 0.7)))
    cv2.imwrite(str(place / "nothing.png"), np.full((HEIGHT, WIDTH), 128, np.uint8))
    return place


def test_focal_length_and_lens_come_back_from_drawn_pictures(folder):
    found = calibrate(folder, BOARD, floor="floor.png")
    matrix = np.array(found["matrix"])
    assert abs(matrix[0, 0] / FOCAL - 1) < 0.002 and abs(matrix[1, 1] / FOCAL - 1) < 0.002
    assert np.abs(matrix[:2, 2] - MATRIX[:2, 2]).max() < 2
    assert abs(found["distortion"][0] - LENS[0]) < 0.02
    assert found["reprojection_px"] < 0.2 and found["left_out"] == ["nothing.png"]
    assert found["pictures"] == 13 and 0 < found["focal_sd_px"] < 2
    # where the camera hangs: floor points, in the board's frame with y up the page and z up
    vector, translation = np.array((0.1, 0.05, 0.02)), np.array((-0.14, -0.10, 0.7))
    points = np.array([(x, y, 0.0) for x in (0.02, 0.14, 0.26) for y in (-0.02, -0.1, -0.18)])
    flat = cv2.projectPoints(points * [1, -1, -1], vector, translation, MATRIX, LENS)[0]
    calibration = Calibration(
        matrix, *(np.array(found[name]) for name in ("distortion", "rotation", "position"))
    )
    seen = calibration.plane_points(flat.reshape(-1, 2), 0.0)
    np.testing.assert_allclose(seen, points[:, :2], atol=3e-4)
    assert found["position"][2] == pytest.approx(0.7, abs=0.02)


def test_a_chessboard_serves_as_well(tmp_path):
    plain = Board(9, 6, square_m=0.04)
    for number, (vector, translation) in enumerate(_poses(np.random.default_rng(2), 8)):
        picture = _draw(plain, vector, translation + np.array([-0.04, -0.02, 0.15]))
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    found = calibrate(tmp_path, plain)
    assert abs(np.array(found["matrix"])[0, 0] / FOCAL - 1) < 0.005
    assert found["rotation"] is None
    (tmp_path / "camera.json").write_text(json.dumps(found))
    with pytest.raises(ValueError, match="does not say where the camera hangs; calibrate again"):
        load_camera(tmp_path / "camera.json", marker_m=0.05)


def test_what_cannot_be_calibrated_is_refused_with_the_reason(folder, tmp_path):
    with pytest.raises(ValueError, match=r"found in 0 of 14 pictures .* is it the right board"):
        calibrate(folder, Board(7, 5, square_m=0.04, marker_m=0.03, markers="6X6_250"))
    with pytest.raises(ValueError, match="floor = 'nothing.png': no board found in it"):
        calibrate(folder, BOARD, floor="nothing.png")
    with pytest.raises(ValueError, match="floor = 'flor.png': not one of the pictures"):
        calibrate(folder, BOARD, floor="flor.png")
    for shape in ((60, 80), (80, 60)):
        cv2.imwrite(str(tmp_path / f"{shape[0]}.png"), np.zeros(shape, np.uint8))
    with pytest.raises(ValueError, match="several sizes: 60.png 80×60, 80.png 60×80"):
        calibrate(tmp_path, BOARD)
    for wrong in ({"square_m": 0.0}, {"square_m": 0.04, "marker_m": 0.05}):
        with pytest.raises(ValueError, match="expected"):
            Board(7, 5, **wrong)
    with pytest.raises(ValueError, match="2×5 squares; expected 4 or more"):
        Board(2, 5, square_m=0.04)
    (tmp_path / "no.json").write_text("{}")
    with pytest.raises(ValueError, match="is no camera; write one"):
        load_camera(tmp_path / "no.json", marker_m=0.05)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Return a folder of pictures of two robots, the camera's file, and their true poses."""
    place = tmp_path_factory.mktemp("drive")
    camera = Camera(CameraConfig())
    truth: Calibration = camera.truth()
    said = {
        "kind": "workbench camera",
        "width_px": 1280,
        "height_px": 960,
        "matrix": truth.matrix.tolist(),
        "distortion": truth.distortion.tolist(),
        "rotation": truth.rotation.tolist(),
        "position": truth.position.tolist(),
    }
    (place / "camera.json").write_text(json.dumps(said))
    (place / "pictures").mkdir()
    frames = Frames(camera, None, 2, np.random.default_rng(0))
    poses = np.array([[(0.1 + 0.006 * t, 0.2, 0.0), (-0.3, 0.006 * t, 1.5)] for t in range(8)])
    for t, pose in enumerate(poses):
        shown = pose if t != 4 else pose + [[0, 0, 0], [5.0, 0, 0]]  # the second is hidden once
        cv2.imwrite(str(place / "pictures" / f"{t:03}.png"), frames.frame(shown))
    return place, poses


def test_robots_in_pictures_become_a_motion(drive, tmp_path):
    place, poses = drive
    out = tmp_path / "poses.csv"
    found = find_robots(place / "pictures", place / "camera.json", out, robots=2, rate=10.0)
    assert found["pictures"] == 8 and found["found"] == [1.0, 0.875]
    motion = Motion.of_table(pd.read_csv(out))
    assert motion.fs == pytest.approx(10)
    np.testing.assert_allclose(motion.position, poses[..., :2], atol=2e-3)
    np.testing.assert_allclose(motion.heading, poses[..., 2], atol=math.radians(1.5))
    assert json.loads(out.with_suffix(".json").read_text())["rate_hz"] == 10.0
    with pytest.raises(FileExistsError, match="exists already; add --out"):
        find_robots(place / "pictures", place / "camera.json", out, robots=2, rate=10.0)


def test_a_video_says_its_rate_and_a_folder_is_asked_for_it(drive, tmp_path):
    place, _ = drive
    writer = cv2.VideoWriter(
        str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (1280, 960)
    )
    for picture in sorted((place / "pictures").glob("*.png")):
        writer.write(cv2.imread(str(picture)))
    writer.release()
    camera = place / "camera.json"
    found = find_robots(tmp_path / "v.avi", camera, tmp_path / "v.csv", robots=2)
    assert found["rate_hz"] == pytest.approx(10) and min(found["found"]) >= 0.8
    with pytest.raises(ValueError, match="is a folder; add --rate"):
        find_robots(place / "pictures", camera, tmp_path / "w.csv", robots=2)
    with pytest.raises(ValueError, match="is no video that OpenCV can read"):
        find_robots(camera, camera, tmp_path / "w.csv", robots=2)
    with pytest.raises(ValueError, match="no marker 0 to 1 of 20 mm"):
        find_robots(place / "pictures", camera, tmp_path / "w.csv", robots=2, rate=1.0, marker=0.02)
    assert not (tmp_path / "w.csv").exists()


def test_both_verbs_from_a_shell(folder, drive, tmp_path, capfd):
    place, _ = drive
    board = ["--square", "0.04", "--marker", "0.03", "--floor", "floor.png"]
    out = tmp_path / "camera.json"
    assert main(["calibrate-camera", str(folder), *board, "--out", str(out)]) == 0
    assert '"pictures": 13' in capfd.readouterr().out
    assert load_camera(out, marker_m=0.05).project(np.array([[0.1, -0.1, 0.0]])).shape == (1, 2)
    options = ["--camera", str(place / "camera.json"), "--robots", "2", "--rate", "10"]
    poses = tmp_path / "poses.csv"
    assert main(["find", str(place / "pictures"), *options, "--out", str(poses)]) == 0
    assert "found" in capfd.readouterr().out and poses.is_file()
    assert main(["find", str(place / "pictures"), *options, "--out", str(poses)]) == 2
    assert "exists already" in capfd.readouterr().err


def test_pictures_that_cannot_tell_the_focal_length_make_no_camera(folder, tmp_path):
    for number in range(6):  # the board always faces the camera
        place = (-0.14 + 0.02 * number, -0.10, 0.6)
        cv2.imwrite(str(tmp_path / f"{number}.png"), _draw(BOARD, (0.0, 0.0, 0.1), place))
    with pytest.raises(ValueError, match=r"tilted by \d+° at most .* expected 15°"):
        calibrate(tmp_path, BOARD)
    with pytest.raises(ValueError, match="agree on no camera: corners are off by"):
        calibrate(folder, Board(4, 4, square_m=0.04))


def test_a_chessboard_cannot_be_the_world(folder):
    with pytest.raises(ValueError, match="does not say which corner is its first; expected a ChA"):
        calibrate(folder, Board(7, 5, square_m=0.04), floor="floor.png")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("matrix", None),
        ("position", "there"),
        ("distortion", [0.0, 0.0, 0.0]),
        ("rotation", [[1, 2, 3], [4, 5, 6], [7, 8, 9]]),
        ("width_px", "wide"),
        ("position", [0.0, 0.0, float("nan")]),
    ],
)
def test_a_damaged_camera_is_refused_by_the_name_of_what_is_wrong(drive, tmp_path, name, value):
    said = json.loads((drive[0] / "camera.json").read_text())
    for wrong in (said | {name: value}, {key: part for key, part in said.items() if key != name}):
        (tmp_path / "camera.json").write_text(json.dumps(wrong))
        with pytest.raises(ValueError, match=name):
            load_camera(tmp_path / "camera.json", marker_m=0.05)


def test_pictures_come_by_the_numbers_in_their_names_without_hidden_ones(tmp_path):
    for name in ("a10.png", "a9.png", "b1.jpg", "._a9.png"):
        cv2.imwrite(str(tmp_path / name.lstrip(".")), np.zeros((4, 4), np.uint8))
    (tmp_path / "_a9.png").rename(tmp_path / "._a9.png")
    assert [name for name, _ in pictures(tmp_path)] == ["a9.png", "a10.png", "b1.jpg"]
    (tmp_path / "a9.png").rename(tmp_path / "\udcff.png")
    with pytest.raises(ValueError, match="is no UTF-8 name; rename it"):
        list(pictures(tmp_path))


def test_a_video_that_lost_pictures_and_a_table_with_another_ending_are_refused(drive, tmp_path):
    place, _ = drive
    camera = place / "camera.json"
    kind = cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), kind, 10.0, (1280, 960))
    for picture in sorted((place / "pictures").glob("*.png")):
        writer.write(cv2.imread(str(picture)))
    writer.release()
    whole = (tmp_path / "v.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"cut.avi: \d of 8 pictures could be read; repair it"):
        find_robots(tmp_path / "cut.avi", camera, tmp_path / "cut.csv", robots=2)
    for out in ("poses.json", "poses"):
        with pytest.raises(ValueError, match="expected a name that ends in .csv"):
            find_robots(place / "pictures", camera, tmp_path / out, robots=2, rate=1.0)
    with pytest.raises(ValueError, match="is one picture; give the folder of all"):
        one = next((place / "pictures").glob("*.png"))
        find_robots(one, camera, tmp_path / "one.csv", robots=2)
