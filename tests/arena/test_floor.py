"""The floor raster: where the line is, and how wide."""

import numpy as np
import pytest

from workbench.arena.floor import draw_floors, floor_darkness
from workbench.arena.tracks import TrackConfig, make_track


def _floor(width=0.015, **kinds):
    track = make_track(TrackConfig(**kinds), np.random.default_rng(0))
    return track, draw_floors([track], width)


@pytest.mark.parametrize("width", [0.010, 0.015, 0.030])
def test_half_darkness_lies_at_the_line_s_edge(width):
    _, floor = _floor(width, judder="none")
    at = np.linspace(0.46, 0.54, 801)
    dark = np.array(
        [floor_darkness(floor.raster[0], floor.column0, floor.row0, x, 0.0) for x in at]
    )
    inside = at[dark >= 0.5]
    assert inside.max() - inside.min() == pytest.approx(width, abs=0.0006)
    assert inside.mean() == pytest.approx(0.5, abs=0.0003)


@pytest.mark.parametrize("width", [0.015, 0.1, 0.5])
def test_the_edge_of_any_line_is_where_it_is(width):
    track, floor = _floor(width, judder="none", radius_m=1.0)
    edge = width / 2 + np.linspace(-0.0006, 0.0006, 7)
    for angle in np.linspace(0, 2 * np.pi, 60):
        out = np.array([np.cos(angle), np.sin(angle)])
        dark = floor.darkness(0, (1.0 + edge)[:, None] * out)
        # half a millimetre of edge is darkness of a third
        np.testing.assert_allclose(dark, 0.5 - (edge - width / 2) / 0.0016, atol=0.06)


def test_the_whole_line_is_dark_and_far_away_is_white():
    track, floor = _floor(shape="eight")

    def look(x, y):
        return floor_darkness(floor.raster[0], floor.column0, floor.row0, x, y)

    assert min(look(x, y) for x, y in track.line[::7]) > 0.9
    assert look(0.75, 0.0) == 0.0
    assert look(1e6, 0.0) == look(-1e6, 5.0) == look(float("nan"), 0.0) == 0.0


def test_floors_of_a_batch_equal_single_ones():
    tracks = [make_track(TrackConfig(), np.random.default_rng(seed)) for seed in (1, 2)]
    both = draw_floors(tracks, 0.015)
    for k, track in enumerate(tracks):
        alone = draw_floors([track], 0.015)
        for x, y in track.line[::50] + 0.005:
            seen = floor_darkness(both.raster[k], both.column0, both.row0, x, y)
            assert seen == floor_darkness(
                alone.raster[0], alone.column0, alone.row0, x, y
            )  # to the last bit
    assert not np.array_equal(both.raster[0], both.raster[1])
