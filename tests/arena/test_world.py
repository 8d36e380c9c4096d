"""Worlds: line-up, determinism over threads, restart, and instability that is not hidden."""

import math

import numpy as np
import pytest

from workbench.arena.picture import picture
from workbench.arena.tracks import TrackConfig, make_track
from workbench.arena.world import World


def _tracks(count, **kinds):
    return [make_track(TrackConfig(**kinds), np.random.default_rng(k)) for k in range(count)]


@pytest.mark.parametrize("shape", ["circle", "stadium", "eight"])
@pytest.mark.parametrize("drive", ["wheels", "planar", "rolling"])
def test_robots_line_up_at_the_wanted_distance_looking_ahead(shape, drive):
    world = World(4, _tracks(1, shape=shape), drive=drive, spacing_m=0.15)
    for robot in range(1, 5):
        x, y, heading = world.pose(0, robot)
        ahead = world.pose(0, robot - 1)
        assert math.dist((x, y), ahead[:2]) == pytest.approx(0.15, abs=1e-6)
        assert heading == pytest.approx(math.atan2(ahead[1] - y, ahead[0] - x))


@pytest.mark.parametrize("drive", ["wheels", "planar", "rolling"])
def test_physics_is_the_same_to_the_byte_at_any_number_of_threads(drive):
    def run(threads, count):
        world = World(3, _tracks(count), drive=drive, spacing_m=0.15, threads=threads)
        rng = np.random.default_rng(0)
        for _ in range(20):
            commands = rng.integers(-1000, 1000, (4, 2))
            for formation in range(count):
                for robot in range(4):
                    world.command(formation, robot, *map(int, commands[robot]))
            world.step()
        return world.states.copy()

    assert run(1, 3).tobytes() == run(3, 3).tobytes()
    assert run(1, 3)[0].tobytes() == run(1, 1)[0].tobytes()


def test_restart_goes_back_to_the_start_and_keeps_the_clock():
    world = World(2, _tracks(1), drive="wheels", spacing_m=0.15)
    begin = [world.pose(0, robot) for robot in range(3)]
    world.command(0, 0, 500, 300)
    for _ in range(5):
        world.step()
    world.restart(0)
    assert [world.pose(0, robot) for robot in range(3)] == begin
    world.check(0, 5)


def test_unstable_physics_is_an_error(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warning into the working directory
    world = World(1, _tracks(1), drive="wheels", spacing_m=0.15)
    world.step()
    world.check(0, 1)
    world.qpos[0, 2] = math.nan
    world.step()  # MuJoCo resets such a simulation and goes on
    with pytest.raises(RuntimeError, match="physics of formation 0 became unstable"):
        world.check(0, 2)


def test_sixty_four_followers_fit_their_track():
    track = make_track(TrackConfig(), np.random.default_rng(0), convoy_length_m=64 * 0.15)
    world = World(64, [track], drive="planar", spacing_m=0.15)
    places = np.array([world.pose(0, robot)[:2] for robot in range(65)])
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + np.eye(65)
    assert gaps.min() > 0.145


def test_picture_shows_robots_and_line_and_leaves_the_world_alone():
    world = World(4, _tracks(1), drive="wheels", spacing_m=0.15)
    before = world.states.copy()
    pixels = picture(world, width=320, height=240)
    assert pixels.shape == (240, 320, 3) and pixels.dtype == np.uint8
    np.testing.assert_array_equal(world.states, before)
    red = (pixels[..., 0] > 110) & (pixels[..., 2] < 90)
    blue = (pixels[..., 2] > 90) & (pixels[..., 0] < 80)
    dark = pixels.max(axis=2) < 70
    assert 50 < red.sum() < blue.sum() and dark.sum() > 500
    with pytest.raises(ValueError, match="width, height, smooth = 0, 240, 1"):
        picture(world, width=0)
