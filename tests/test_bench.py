"""The benchmark: what it reports, and that bare physics really replays the recorded run.

No times are asserted.
"""

from dataclasses import replace

import pytest

from workbench import bench
from workbench.formation.config import ConvoyConfig


@pytest.mark.parametrize("drive", ["wheels", "planar"])
def test_bare_physics_reproduces_the_recorded_block_exactly(drive):
    loop = bench._Loop(replace(ConvoyConfig(), drive=drive))
    loop.turn()  # raises if the replay ends anywhere else
    assert len(loop.full) == len(loop.bare) == 1


def test_a_replay_that_ends_elsewhere_is_an_error(monkeypatch):
    loop = bench._Loop(replace(ConvoyConfig(), drive="planar"))
    controls = loop._controls
    monkeypatch.setattr(loop, "_controls", lambda block: controls(block) * 1.000001)
    with pytest.raises(RuntimeError, match="bare physics did not reproduce the recorded run"):
        loop.turn()


def test_bench_reports_all_numbers(monkeypatch):
    monkeypatch.setattr(bench, "_EVERY", {"wheels": 1, "planar": 1, "4": 1, "64": 1})
    result = bench.bench(turns=1, runs=20)
    wanted = (
        "wheels_us wheels_bare_us planar_us planar_bare_us update_us_15x15 "
        "update_us_5x5 robot_us_4 robot_us_64 "
    )
    wanted += "environment_steps_per_s robot_bare_us_4 robot_bare_us_64 peak_mib"
    assert set(wanted.split()) <= set(result)
    assert all(value > 0 for value in result.values())
