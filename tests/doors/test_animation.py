"""Animated PNGs: as many pictures as periods, at the right speed, equal bytes for equal scenes."""

import pytest
from PIL import Image

import workbench as wb
from workbench.doors.animation import save_animation
from workbench.doors.scenes import LiveScene
from workbench.formation.classical import CarrotPI


def _scene():
    scene = LiveScene(wb.ConvoyConfig(followers=2, drive="planar"), law=CarrotPI())
    scene.advance(40)
    return scene


def test_an_animation_has_its_pictures_at_real_speed_and_equal_bytes(tmp_path):
    first, second = (
        save_animation(_scene(), tmp_path / name, start_s=1.0, seconds=1.0, every=2, width=96, height=72)
        for name in ("a.png", "b.png")
    )
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as image:
        assert (image.n_frames, image.size, image.info["duration"], image.info["loop"]) == (5, (96, 72), 200, 0)
        image.seek(0)
        start = image.convert("RGB").tobytes()
        image.seek(4)
        assert image.convert("RGB").tobytes() != start


def test_refusals(tmp_path):
    with pytest.raises(ValueError, match="expected a name that ends in .png"):
        save_animation(_scene(), tmp_path / "a.gif")
    with pytest.raises(ValueError, match="the scene has 4.0 s"):
        save_animation(_scene(), tmp_path / "a.png", seconds=5.0)
