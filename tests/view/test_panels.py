"""Panels: pure functions draw, controls only pass values on, and the static twin is the picture of
the first values.
"""

import asyncio
import re

import numpy as np
import pytest
from IPython.display import Image
from matplotlib.figure import Figure

import workbench as wb
from workbench.plots.figures import png
from workbench.view import panels
from workbench.view.explorers import (
    History,
    infrared_explorer,
    learn_history,
    learning_explorer,
    tile_explorer,
)
from workbench.view.panels import Choice, Slider, infrared_panel, learning_panel, panel, tile_panel

PLANAR = wb.ConvoyConfig(drive="planar")


@pytest.fixture(scope="module")
def history():
    return learn_history(PLANAR, steps=22_000)


@pytest.fixture
def live(monkeypatch):
    monkeypatch.setattr(panels.paths, "STATIC", False)


def test_equal_values_draw_equal_pictures_and_others_do_not(history):
    for draw, other in ((tile_explorer, {"tilings": 2}), (infrared_explorer, {"bearing_deg": 5.0})):
        assert png(draw()) == png(draw()) != png(draw(**other))
    assert png(learning_explorer(history)) != png(learning_explorer(history, block=0))


def test_the_history_is_that_of_a_run(history):
    run = wb.learn(PLANAR, steps=22_000, progress=False)
    np.testing.assert_array_equal(history.policies[-1].theta, run.policy.theta)
    np.testing.assert_array_equal(history.visits.sum(axis=0), run.visits.sum(axis=0))
    assert history.updates[-1] == 22_000 and sum(history.losses) == run.summary["losses"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "robot in front at 105 mm and +0°; it takes that for 105 mm and +0°: state 40"),
        ({"distance_mm": 160.0}, "robot in front at 160 mm and +0°; nothing is seen: no tile"),
        ({"ambient": 4000.0}, "blinded by the light, and it notices: no tile"),
        ({"bearing_deg": 10.0, "route": "ir-raw"}, "and +10°"),
    ],
)
def test_the_infrared_explorer_says_what_the_robot_makes_of_it(values, words):
    assert words in infrared_explorer(**values).get_suptitle()


def test_a_darker_cup_is_taken_for_one_that_is_farther_away():
    said = [infrared_explorer(reflectance=value).get_suptitle() for value in (1.0, 0.5)]
    near, far = (int(re.search(r"for (\d+) mm", words)[1]) for words in said)
    assert near == 105 and far > 115


def test_the_tile_explorer_says_how_large_the_middle_tile_is():
    assert (
        "81 states, 81 rows of the table; middle tile 15.6 mm × 10.0°"
        in tile_explorer().get_suptitle()
    )
    assert "25 states, 133 rows" in tile_explorer("logarithmic", 5, 5, 3.0, 4).get_suptitle()
    assert "middle tile 6.0 mm × 4.0°" in tile_explorer("logarithmic", 5, 5, 3.0, 4).get_suptitle()


def test_without_a_page_a_panel_is_its_static_twin(history):
    twin = tile_panel()
    assert isinstance(twin, Image) and twin.data == png(tile_explorer())
    assert learning_panel(history).data == png(learning_explorer(history))
    assert infrared_panel().data == png(infrared_explorer())


def test_a_control_draws_anew_and_shows_the_first_picture_as_the_twin_does(live, history):
    for made, twin, change in (
        (tile_panel(), tile_explorer(), (1, 5)),
        (infrared_panel(), infrared_explorer(), (1, -10)),
        (learning_panel(history), learning_explorer(history), (0, 1)),
    ):
        shown = made.children[-1]
        assert shown.value == png(twin)
        number, value = change
        made.children[number].value = value
        assert shown.value != png(twin)
    made = tile_panel()
    made.children[1].value = 5
    assert made.children[-1].value == png(tile_explorer(distance_tiles=5))


def test_a_combination_that_cannot_be_is_explained_and_the_picture_stays(live):
    made = panel(
        tile_explorer, spacing=Choice(("logarithmic",)), distance_tiles=Slider(3, 16, 1, 9)
    )
    before = made.children[-1].value
    made.children[1].value = 8
    assert (
        "ConvoyConfig.state_tiles = (8, 9)" in made.children[-2].value
        and made.children[-1].value == before
    )
    made.children[1].value = 7
    assert made.children[-2].value == "" and made.children[-1].value != before


def test_unknown_views_are_refused(history):
    assert isinstance(history, History)
    with pytest.raises(
        ValueError,
        match="show = 'traces'; expected one of 'visits', 'values', 'actions', 'confidence'",
    ):
        learning_explorer(history, show="traces")


async def until(done):
    for _ in range(1000):
        if done():
            return
        await asyncio.sleep(0.02)
    raise AssertionError("nothing more was drawn in 20 s")


def test_what_may_be_asked_for_next_is_drawn_in_the_pauses(live, monkeypatch):
    """With a loop that waits: haste at once, care at rest, the other values after that."""
    drawn = []

    def draw(width, kind):
        drawn.append((round(width, 6), kind))
        fig = Figure(figsize=(2, 1))
        fig.subplots().plot([0, width])
        return fig

    monkeypatch.setattr(panels, "REST_S", 0.01)

    async def slide():
        made = panel(draw, width=Slider(0.1, 0.5, 0.1, 0.1), kind=Choice(("a", "b")))
        shown, first = made.children[-1], made.children[-1].value
        made.children[0].value = 0.3
        hasty = shown.value
        assert drawn == [(0.1, "a"), (0.3, "a")] and hasty != first
        await until(lambda: len(drawn) == 6)
        assert drawn[2:] == [(0.3, "a"), (0.2, "a"), (0.4, "a"), (0.5, "a")]
        assert shown.value != hasty  # drawn with care
        made.children[0].value = 0.4
        await asyncio.sleep(0)
        assert len(drawn) == 6  # it was there
        made.children[1].value = "b"  # begins anew, in place of what was to be done
        await until(lambda: len(drawn) == 8)
        assert drawn[6:] == [(0.4, "b"), (0.4, "b")]

    asyncio.run(slide())


def test_what_cannot_be_is_passed_over_when_drawn_ahead(live, monkeypatch):
    monkeypatch.setattr(panels, "REST_S", 0.01)

    async def slide():
        made = panel(
            tile_explorer, spacing=Choice(("logarithmic",)), distance_tiles=Slider(7, 9, 1, 7)
        )
        made.children[1].value = 9
        await asyncio.sleep(3)  # 8 is even: no tile has its middle where both errors are 0
        assert made.children[-2].value == ""
        made.children[1].value = 8
        assert "ConvoyConfig.state_tiles = (8, 9)" in made.children[-2].value

    asyncio.run(slide())
