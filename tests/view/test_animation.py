"""Animated PNGs: as many pictures as periods, at the right speed, equal bytes for equal scenes."""

import io

import numpy as np
import pytest
from PIL import Image

import workbench as wb
from workbench.formation.laws.carrot import CarrotPI
from workbench.view.animation import animated_png
from workbench.view.scenes import LiveScene


def _scene():
    scene = LiveScene(wb.ConvoyConfig(followers=2, drive="planar"), law=CarrotPI())
    scene.advance(40)
    return scene


def test_an_animation_has_its_pictures_at_real_speed_and_equal_bytes():
    first, second = (
        animated_png(_scene(), start_s=1.0, seconds=1.0, every=2, width=96, height=72)
        for _ in range(2)
    )
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert (image.n_frames, image.size, image.info["duration"], image.info["loop"]) == (
            5,
            (96, 72),
            200,
            0,
        )
        image.seek(0)
        start = image.convert("RGB").tobytes()
        red, green, blue = np.moveaxis(np.asarray(image.convert("RGB")).astype(int), -1, 0)
        assert (
            np.sum(red - blue > 80) > 5 and np.sum(blue - red > 80) > 10
        )  # the leader is red, followers are blue
        image.seek(4)
        assert image.convert("RGB").tobytes() != start


def test_a_part_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="the scene has 4.0 s"):
        animated_png(_scene(), seconds=5.0)
