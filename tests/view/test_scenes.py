"""Scenes, the joystick and the widget's messages, without a browser."""

import math
import signal
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench import paths
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.shapes import FormationConfig
from workbench.learning.config import LearnerConfig
from workbench.logs.recordings import load_recording
from workbench.robot.description import load_robot
from workbench.robot.motors import twist
from workbench.view.drawing import draw_scene
from workbench.view.joystick import SHARE, Joystick
from workbench.view.play import scene_of, still
from workbench.view.scenes import (
    FIELDS,
    PLACES,
    LiveScene,
    StoredScene,
    describe,
    load_drive,
    whole,
)
from workbench.view.widget import CHUNK, Arena

PLANAR = wb.ConvoyConfig(drive="planar")
STOPPING = replace(PLANAR, wheel_speed_mps=(0.0, 0.09))
AT = {name: k for k, name in enumerate(FIELDS)}


def _slalom(scene, periods):
    for t in range(periods):
        scene.steer(0.8 * math.sin(t / 9), 1.0 if t % 50 < 40 else 0.0)
        scene.advance()
    return scene


# --- the joystick


def test_a_leader_by_hand_is_no_faster_than_its_followers_and_speeds_up_gently():
    joystick = Joystick(STOPPING)
    before = 0.0
    for _ in range(30):
        left, right = joystick.steer(0.0, 1.0)
        speed, turn = twist(left, right)
        assert left == right and speed - before < 0.1 * 0.1 + 1e-3
        before = speed
    assert speed == pytest.approx(STOPPING.leader_speed_mps, abs=1e-3) and turn == 0.0
    fast = Joystick(replace(STOPPING, leader_speed_mps=0.09))
    assert fast.fastest == pytest.approx(SHARE * 0.09)


@pytest.mark.parametrize("turn", [-1.0, -0.3, 0.5, 1.0, 7.0])
@pytest.mark.parametrize("speed", [-1.0, 0.0, 0.4, 1.0])
def test_every_joystick_position_is_within_what_followers_can_do(turn, speed):
    joystick = Joystick(STOPPING)
    for _ in range(20):
        left, right = joystick.steer(turn, speed)
    forward, rate = twist(left, right)
    assert max(abs(left), abs(right)) <= STOPPING.robot.steps(0.09)
    assert -1e-3 <= forward <= 0.09 and np.sign(rate) == np.sign(turn) and abs(rate) <= 1.0 + 0.01


def test_where_followers_cannot_stand_still_the_leader_creeps():
    joystick = Joystick(PLANAR)
    assert twist(*joystick.steer(0.0, -1.0))[0] == pytest.approx(0.03, abs=1e-3)
    assert joystick.steer(math.nan, math.inf) == joystick.steer(0.0, 0.0)


def test_a_large_robot_has_a_helm_of_its_own():
    joystick = Joystick(STOPPING.with_robot(load_robot("large")))
    for _ in range(30):
        left, _ = joystick.steer(0.0, 1.0)
    assert left * load_robot("large").step_m == pytest.approx(
        0.06 * load_robot("large").most_mps / 0.1288, rel=0.01
    )


# --- scenes


def test_a_live_scene_does_what_a_run_does():
    scene = LiveScene(PLANAR, learn=5_000)
    frames = scene.advance(600)
    block = wb.Convoy(PLANAR, [1], steps=10**9, horizon=5_000).run_block()[0]
    for name in ("x", "y", "heading", "phase", "left", "right"):
        np.testing.assert_array_equal(frames[..., AT[name]], block[name][:600].astype(np.float32))
    assert len(scene) == 600 and np.array_equal(scene.frames, frames)


def test_a_frame_has_what_a_follower_senses_and_its_tile():
    scene = LiveScene(replace(wb.SETTINGS["infrared"], drive="planar"), learn=2_000)
    frames = scene.advance(200)
    following = frames[:, 1:, AT["phase"]] == 0
    states = frames[:, 1:, AT["state"]]
    assert np.all(states[following] >= 0) and np.all(states[~following] == -1) and states.max() < 81
    near = frames[:, 1:, AT["distance"]] < 0.12
    assert frames[:, 1:, AT["ps0"] :][near].max() > 50 and frames[..., AT["ps0"] :].min() >= 0


def test_without_infrared_the_readings_are_shown_all_the_same():
    scene = LiveScene(replace(PLANAR, distance_m=(0.08, 0.12)), law=CarrotPI())
    assert scene.advance(100)[:, 1:, AT["ps0"] :].max() > 20


def test_restart_begins_again_with_the_same_numbers():
    scene = LiveScene(PLANAR, learn=2_000)
    first = scene.advance(100)
    scene.restart()
    assert len(scene) == 0
    np.testing.assert_array_equal(scene.advance(100), first)


@pytest.mark.parametrize("learn", [0, 3_000])
def test_a_drive_is_saved_and_driven_again_to_the_last_bit(tmp_path, learn):
    run = wb.learn(STOPPING, steps=20_000, progress=False)
    scene = _slalom(
        LiveScene(STOPPING.with_seed(4), policy=run.policy, learn=learn, drive=True), 120
    )
    path = scene.save_drive(tmp_path / "drive.csv")
    recording = load_recording(path)
    assert (
        recording.summary()["rows"] == 120
        and not recording.header["real"]
        and recording.header["complete"]
    )
    assert {"proximity", "floor", "motor_position"} <= set(recording.sensors)
    config, commands = load_drive(path)
    again = scene_of(path, run.policy, learn=learn)
    np.testing.assert_array_equal(again.advance(500), scene.frames)
    assert (
        config == scene.config
        and commands.tolist() == [list(pair) for pair in scene.commands]
        and again.ended
    )
    with pytest.raises(FileExistsError, match="never overwritten"):
        scene.save_drive(path)


def test_a_drive_of_a_scene_that_was_changed_by_hand_is_not_saved(tmp_path):
    scene = _slalom(LiveScene(STOPPING, law=CarrotPI(), drive=True), 20)
    scene.convoy.world.place(0, 2, 0.0, 0.0, 0.0)
    scene.advance(20)
    with pytest.raises(RuntimeError, match="nothing is saved"):
        scene.save_drive(tmp_path / "drive.csv")
    assert not list(tmp_path.iterdir())


def test_a_drive_of_large_fast_robots_can_be_read_again(tmp_path):
    large = load_robot("large")
    config = replace(
        STOPPING.with_robot(large),
        wheel_speed_mps=(0.0, large.most_mps),
        leader_speed_mps=0.9 * large.most_mps,
    )
    scene = LiveScene(config, law=CarrotPI(), drive=True)
    scene.steer(0.3, 1.0)
    scene.advance(80)
    _, commands = load_drive(scene.save_drive(tmp_path / "drive.csv"))
    assert commands.max() > 1100


def test_frames_commands_and_time_agree_after_an_interrupt(monkeypatch):
    scene = LiveScene(STOPPING, law=CarrotPI(), drive=True)
    step = scene.convoy.world.step
    count = [0]

    def interrupted():
        count[0] += 1
        if count[0] == 7:
            signal.raise_signal(signal.SIGINT)
        step()

    monkeypatch.setattr(scene.convoy.world, "step", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        scene.advance(100)
    signal.signal(signal.SIGINT, before)
    assert scene.t == len(scene) == len(scene.commands) == 7


def test_other_followers_can_be_judged_on_the_same_road(tmp_path):
    scene = _slalom(LiveScene(STOPPING, law=CarrotPI(), drive=True), 80)
    other = scene_of(
        scene.save_drive(tmp_path / "drive.csv"), wb.OwnLaw(function=lambda d, b: (d - 0.1, 2 * b))
    )
    frames = other.advance(80)
    np.testing.assert_array_equal(frames[:, 0, :3], scene.frames[:, 0, :3])
    assert not np.array_equal(frames[:, 1], scene.frames[:, 1])


def test_stored_scenes_show_the_run_and_the_motion():
    run = wb.learn(PLANAR, steps=12_000, progress=False)
    stored = StoredScene.of_run(run)
    steps = run.records["samples"][-len(stored.frames) :]
    np.testing.assert_array_equal(stored.frames[..., 0], steps["x"])
    assert not stored.live and "block after" in stored.title
    at, follower = np.argwhere(steps["state"][1:, 1:] >= 0)[5]
    assert stored.frames[at, follower + 1, AT["state"]] == steps["state"][at + 1, follower + 1]
    motion = wb.follow(run.policy, PLANAR, minutes=0.5)
    moved = StoredScene.of_motion(motion, PLANAR)
    np.testing.assert_allclose(moved.frames[..., :2], motion.position, rtol=1e-6)
    with pytest.raises(ValueError, match="a motion of 5 robots at 10 Hz; expected 3 robots"):
        StoredScene.of_motion(motion, replace(PLANAR, followers=2))


def test_pictures_of_scenes_have_every_robot_and_the_time():
    scene = LiveScene(PLANAR, law=CarrotPI())
    scene.advance(50)
    ax = draw_scene(scene, 20)
    assert (
        "2.0 s" in ax.get_title(loc="left")
        and len([text for text in ax.texts if text.get_text() in "L1234"]) == 5
    )
    with pytest.raises(IndexError, match="t = 50; the scene has 50 frames"):
        draw_scene(scene, 50)
    assert still(LiveScene(STOPPING, law=CarrotPI(), drive=True), 3.0).data[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: LiveScene(PLANAR, learn=-1), ValueError, "learn = -1"),
        (lambda: LiveScene(PLANAR, learn=2.5), ValueError, "learn = 2.5.* expected a whole number"),
        (
            lambda: LiveScene(replace(PLANAR, reset="restart"), drive=True),
            ValueError,
            "expected 'manoeuvre'",
        ),
        (
            lambda: LiveScene(PLANAR, commands=[(1, 2, 3)]),
            ValueError,
            r"commands have shape \(1, 3\); expected \(T, 2\)",
        ),
        (
            lambda: LiveScene(PLANAR, commands=[(1, 2000)]),
            ValueError,
            "whole steps/s from -1000 to 1000",
        ),
        (
            lambda: wb.play(PLANAR, folder="nowhere"),
            FileNotFoundError,
            "folder = 'nowhere' does not exist",
        ),
        (
            lambda: LiveScene(PLANAR, law=CarrotPI(), learn=10),
            ValueError,
            "no law where they learn",
        ),
        (lambda: scene_of(3), TypeError, "source is a int; expected a configuration, a run"),
        (lambda: scene_of("nowhere.csv"), FileNotFoundError, "nowhere.csv does not exist"),
        (
            lambda: scene_of("nowhere.csv", drive=True),
            ValueError,
            "drive = True with a recorded drive",
        ),
        (lambda: scene_of(PLANAR, "carrot"), TypeError, "expected a run, its policy"),
        (
            lambda: LiveScene(PLANAR, drive=True).save_drive("x.csv"),
            ValueError,
            "nobody has driven yet",
        ),
        (
            lambda: LiveScene(
                replace(PLANAR, compute_time_s=0.04, learner=LearnerConfig(buffer=False))
            ),
            ValueError,
            "expected learner.buffer = True",
        ),
        (
            lambda: load_drive("data/recordings/emulated_overo_following.csv"),
            ValueError,
            "no drive of a leader by hand",
        ),
    ],
)
def test_what_cannot_be_shown_is_refused(call, error, message, monkeypatch):
    monkeypatch.chdir(paths.ROOT)
    with pytest.raises(error, match=message):
        call()


# --- the widget


class _Ear:
    """What a page would hear."""

    def __init__(self, arena):
        self.arena = arena
        self.said = []
        arena.send = lambda message, buffers=(): self.said.append((message, buffers))

    def tell(self, **message):
        self.said.clear()
        self.arena._hear(None, message, [])
        return self.said

    def frames(self, **message):
        [(head, [data])] = self.tell(**message)
        return head, np.frombuffer(data, np.float32).reshape(-1, 5, len(FIELDS))


def _advance(periods, have, generation=1, turn=0.0, speed=0.0):
    return {
        "type": "advance",
        "periods": periods,
        "turn": turn,
        "speed": speed,
        "generation": generation,
        "have": have,
    }


def test_the_page_gets_the_frames_that_it_asks_for_and_two_pages_the_same_ones():
    scene = LiveScene(PLANAR, law=CarrotPI())
    ear = _Ear(Arena(scene))
    head, frames = ear.frames(type="history")
    assert head["first"] == 0 and head["live"] and len(frames) == 1
    head, frames = ear.frames(**_advance(5, 1))
    assert head["first"] == 1 and np.array_equal(frames, scene.frames[1:6])
    head, frames = ear.frames(**_advance(5, 3))  # another page that is behind
    assert head["first"] == 3 and np.array_equal(frames, scene.frames[3:6]) and len(scene) == 6
    assert len(ear.frames(**_advance(10**6, 6))[1]) == 200


def test_a_page_that_slept_through_a_restart_begins_anew():
    scene = LiveScene(PLANAR, law=CarrotPI())
    ear = _Ear(Arena(scene))
    ear.tell(type="history")
    ear.tell(**_advance(20, 1))
    head, frames = ear.frames(type="restart")
    assert head["first"] == 0 and head["generation"] == 2 and len(frames) == 1
    head, frames = ear.frames(**_advance(5, 21))  # its generation is over
    assert head["generation"] == 2 and head["first"] == 0 and len(frames) == len(scene) == 1


def test_a_long_history_comes_in_pieces():
    run = wb.learn(PLANAR, steps=12_000, progress=False)
    said = _Ear(Arena(StoredScene.of_run(run))).tell(type="history")
    assert [head["first"] for head, _ in said] == [0, CHUNK] and all(
        head["over"] for head, _ in said
    )


def test_a_page_that_looks_on_does_not_take_the_wheel():
    scene = LiveScene(STOPPING, law=CarrotPI(), drive=True)
    ear = _Ear(Arena(scene))
    ear.tell(type="history")
    ear.tell(**_advance(20, 1, speed=1.0))
    ear.tell(type="advance", periods=5, generation=1, have=21)
    assert scene.commands[-1] == (466, 466)


def test_the_joystick_drives_and_saving_takes_plain_names_only(tmp_path):
    scene = LiveScene(STOPPING, law=CarrotPI(), drive=True)
    arena = Arena(scene, folder=tmp_path)
    ear = _Ear(arena)
    ear.tell(type="history")
    ear.tell(**_advance(30, 1, speed=1.0))
    assert scene.commands[-1] == (466, 466)
    for name in ("../drive.csv", "/tmp/drive.csv", ".csv"):
        [(said, _)] = ear.tell(type="save", name=name)
        assert "expected a plain file name" in said["text"] and said["stop"]
    [(said, _)] = ear.tell(type="save", name="drive.txt")
    assert "expected a name that ends in .csv" in said["text"]
    [(said, _)] = ear.tell(type="save", name="drive.csv")
    assert "saved 3.1 s; wb.play(" in said["text"] and (tmp_path / "drive.csv").is_file()


def test_whatever_goes_wrong_the_page_hears_of_it():
    stored = _Ear(Arena(StoredScene.of_run(wb.learn(PLANAR, steps=12_000, progress=False))))
    for message in ({"type": "restart"}, {"type": "dance"}, {}, {"type": "save"}):
        [(said, _)] = stored.tell(**message)
        assert said["type"] == "said" and said["stop"]


def test_divergence_is_said_on_the_page_and_stops_it():
    wild = replace(PLANAR, learner=LearnerConfig(alpha=1.0, eta=100.0, lam=0.0, gamma=0.9))
    ear = _Ear(Arena(LiveScene(wild, learn=10**6)))
    have = 1
    ear.tell(type="history")
    for _ in range(500):
        [(head, _)] = ear.tell(**_advance(200, have))
        have += 200
        if head["type"] == "said":
            break
    assert "FloatingPointError: seed 1: learning diverged" in head["text"] and head["stop"]


def test_an_interrupt_waits_until_the_period_is_whole():
    happened = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt), whole():
        signal.raise_signal(signal.SIGINT)
        happened.append("after the signal")
    assert happened and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_a_formation_is_asked_for_shapes_by_buttons_and_by_places_that_are_drawn():
    track = wb.TrackConfig(shape="eight", radius_m=1.0, judder="none")
    config = replace(
        PLANAR,
        drive="rolling",
        track=track,
        leader_speed_mps=0.05,
        wheel_speed_mps=(0.0, 0.12),
        formation=FormationConfig(shape="wedge"),
    )
    scene = LiveScene(config, law=CarrotPI())
    assert scene.about["shapes"] == ["column", "line", "wedge", "diamond", "circle"]
    assert describe(PLANAR, np.zeros((2, 2)))["shapes"] == []
    told = []
    arena = Arena(scene)
    arena.send = lambda message, buffers=None: told.append(message)
    arena._hear(None, {"type": "instruct", "shape": "diamond"}, None)
    assert told[-1]["text"] == "asked for: diamond"
    frames = scene.advance(600)
    apart = np.hypot(*(frames[-1, 1:, PLACES] - frames[-1, 1:, :2]).T)
    assert apart.max() < 0.02
    points = [[-0.2, 0.2], [-0.2, -0.2], [-0.4, 0.0], [-0.6, 0.0]]
    arena._hear(None, {"type": "instruct", "shape": "points", "points": points}, None)
    place = scene.convoy.robots["place"][0, 1:]
    assert sorted(map(tuple, np.stack([place["goal_x"], place["goal_y"]], -1).tolist())) == sorted(
        map(tuple, points)
    )
    arena._hear(None, {"type": "instruct", "shape": "points", "points": points[:1]}, None)
    assert "points have shape (1, 2); expected (4, 2)" in told[-1]["text"]
    with pytest.raises(ValueError, match="nobody has driven yet"):
        scene.save_drive("drive.csv")


def test_a_drive_with_changes_of_shape_is_not_saved_as_if_there_were_none(tmp_path):
    track = wb.TrackConfig(shape="eight", radius_m=1.0, judder="none")
    config = replace(
        PLANAR, track=track, wheel_speed_mps=(0.0, 0.12), formation=FormationConfig(shape="wedge")
    )
    scene = LiveScene(config, law=CarrotPI(), drive=True)
    scene.steer(0.0, 0.5)
    scene.advance(5)
    scene.instruct("diamond")
    with pytest.raises(ValueError, match="asked for another shape on the way"):
        scene.save_drive(tmp_path / "drive.csv")
