"""The benchmark: what it reports, and that bare physics really replays the recorded run.

No times are asserted.
"""

import math
import os
import sys
import types
from dataclasses import replace
from pathlib import Path

import pytest

from workbench import bench
from workbench.formation.config import ConvoyConfig
from workbench.peers import peers


@pytest.mark.parametrize("drive", ["wheels", "planar"])
def test_bare_physics_reproduces_the_recorded_block_exactly(drive):
    loop = bench._Loop(replace(ConvoyConfig(), drive=drive))
    loop.turn()  # raises if the replay ends anywhere else
    assert len(loop.full) == len(loop.bare) == 1


def test_the_former_way_does_the_same():
    loops = [bench._Loop(ConvoyConfig(drive="planar"), former=former) for former in (False, True)]
    for loop in loops:
        loop.turn()
    now, former = (loop.convoy for loop in loops)
    assert former._engine is None and now._engine is not None
    assert former.world.physics.ngeom > now.world.physics.ngeom
    assert now.state()["robots"].tobytes() == former.state()["robots"].tobytes()
    assert "WORKBENCH_BATCH" not in os.environ


def test_a_replay_that_ends_elsewhere_is_an_error(monkeypatch):
    loop = bench._Loop(replace(ConvoyConfig(), drive="planar"))
    controls = loop._controls
    monkeypatch.setattr(loop, "_controls", lambda block: controls(block) * 1.000001)
    with pytest.raises(RuntimeError, match="bare physics did not reproduce the recorded run"):
        loop.turn()


def test_bench_reports_all_numbers(monkeypatch):
    # what takes long is shortened, and what starts processes
    monkeypatch.setattr(bench, "_EVERY", {})
    monkeypatch.setattr(bench, "FOLLOWERS", (4, 8))
    monkeypatch.setattr(bench, "FORMATIONS", (1, 2))
    monkeypatch.setattr(bench, "PLANAR_FORMATIONS", 3)
    monkeypatch.setattr(bench, "_starts", lambda: {"first_start_s": 1.0, "cached_start_s": 1.0})
    monkeypatch.setattr(bench, "peers", lambda: {"nobody": lambda periods: None})
    warm_up = bench._Loop.warm_up
    monkeypatch.setattr(bench._Loop, "warm_up", lambda loop, blocks: warm_up(loop, 1))
    steps = bench._environment
    monkeypatch.setattr(bench, "_environment", lambda drive: steps(drive, steps=50, turns=1))
    whole = bench._whole_run
    monkeypatch.setattr(bench, "_whole_run", lambda: whole(20_000))
    result = bench.bench(turns=1, runs=4, others=True)
    machine = result.pop("machine")
    assert machine["cores"] >= 1 and machine["mujoco"]
    wanted = (
        "wheels_us wheels_bare_us wheels_ratio planar_us planar_bare_us planar_ratio rolling_us "
        "recommended_us wheels_former_us planar_former_us wheels_over_former planar_over_former "
        "rolling_over_former robot_us_4 "
        "robot_us_64 robot_bare_us_4 robot_bare_us_64 robot_growth_over_bare update_us_15x15 "
        "update_us_5x5 update_ratio rolling_us_camera rolling_us_ir-metric rolling_us_ir-raw "
        "rolling_robot_us_4 rolling_robot_us_8 rolling_robot_growth rolling_two_threads_2 "
        "rolling_us_1_formations_1_threads rolling_us_2_formations_2_threads planar_two_threads_3 "
        "rolling_1300000_updates_s environment_steps_per_s environment_rolling_steps_per_s "
        "peak_mib first_start_s cached_start_s sweep_speedup trial_ms_local trial_ms_dask "
        "peer_us_nobody peer_over_rolling_nobody"
    )
    assert set(wanted.split()) <= set(result)
    # a trial's own time is a difference, which other work on the machine can turn around
    assert all(value > 0 for name, value in result.items() if not name.startswith("trial_ms"))
    assert all(math.isfinite(value) for value in result.values())


def test_both_starts_are_of_the_same_program_with_an_empty_cache_and_with_what_that_left(
    monkeypatch,
):
    begun = []

    def run(command, env, **kinds):
        assert kinds["check"]
        folder = Path(env["NUMBA_CACHE_DIR"])
        begun.append((command, folder, len(list(folder.iterdir()))))
        (folder / "compiled").touch()

    monkeypatch.setattr(bench.subprocess, "run", run)
    assert all(seconds > 0 for seconds in bench._starts().values())
    [(first, folder, nothing), (later, same, something)] = begun
    assert first == later == [sys.executable, "-m", "workbench", "learn", "--steps", "1000"]
    assert folder == same and (nothing, something) == (0, 1) and not folder.exists()


def test_peers_that_are_not_what_their_name_says_are_left_out(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyenki", types.ModuleType("pyenki"))
    monkeypatch.setitem(sys.modules, "navground", None)
    monkeypatch.setitem(sys.modules, "pymunk", None)
    assert peers() == {}
