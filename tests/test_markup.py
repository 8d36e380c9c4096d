"""What objects look like when they are printed, or a notebook shows them."""

from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench import markup

CONFIG = replace(wb.SETTINGS["recommended"], drive="rolling")


@pytest.fixture(scope="module")
def run():
    return wb.learn(CONFIG, steps=2000, progress=False)


def test_a_configuration_says_what_differs():
    assert repr(wb.ConvoyConfig()) == "ConvoyConfig()"
    config = wb.ConvoyConfig(seed=3, learner=wb.LearnerConfig(alpha=0.2))
    assert repr(config) == "ConvoyConfig(learner=LearnerConfig(alpha=0.2), seed=3)"
    assert eval(repr(config), vars(wb) | {"LearnerConfig": wb.LearnerConfig}) == config
    assert "<td style='text-align:left'>default 1</td>" in config._repr_html_()
    assert "all defaults" in wb.ConvoyConfig()._repr_html_()


def test_a_run_and_its_policy_show_themselves(run):
    assert repr(run).startswith("Run(learn, 2,000 updates, ") and "trim=0.01" in repr(run)
    assert repr(run.policy) == "Policy(5×3 tiles, 3×3 actions, 4 tables, sensing 'truth')"
    shown = run._repr_html_()
    assert shown.count("<svg") == 4 and shown.count("<rect") == 4 * 15
    assert "RMS distance error, mm" in shown
    assert run.policy._repr_html_().count("<rect") == 4 * 15
    law = wb.evaluate(wb.LAWS["carrot"](), CONFIG, minutes=0.2, progress=False)
    assert law._repr_html_().count("<svg") == 4


def test_a_map_has_its_first_row_at_the_bottom_and_nothing_is_grey():
    picture = markup.heat(np.array([[0.0, 1.0], [0.5, 0.5]]), "a < b")
    assert picture.count("#ccc") == 1 and "aria-label='a &lt; b'" in picture
    size = 16
    assert f"<rect x='0' y='{size}' width='{size - 1}' height='{size - 1}' fill='#ccc'/>" in picture
    assert "&lt;script&gt;" in markup.table([("<script>", 1.23456789)], "t")
    assert "1.235" in markup.table([("x", 1.23456789)])


def test_a_run_stands_for_what_it_learned(run):
    judged = wb.evaluate(run, minutes=0.5, progress=False)
    again = wb.evaluate(
        run.policy, CONFIG.with_seed(CONFIG.seed + 1000), minutes=0.5, progress=False
    )
    assert judged.config.seed == CONFIG.seed + 1000 and judged.summary == again.summary
    motions = wb.follow(run, minutes=0.1), wb.follow(run, judged.config, minutes=0.1)
    np.testing.assert_array_equal(motions[0].position, motions[1].position)
    with pytest.raises(TypeError, match="config is missing; a Policy does not know where"):
        wb.evaluate(run.policy)


def test_playing_a_run_with_a_driver_is_live(run):
    from workbench.view.play import scene_of

    assert not scene_of(run).live
    scene = scene_of(run, drive=True)
    assert scene.live and scene.drivable
    assert scene_of(CONFIG, run).live
