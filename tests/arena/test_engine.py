"""Physics in compiled code does what MuJoCo's batch does, to the last bit."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from workbench.arena import engine
from workbench.arena.proximity import add_box
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.measures.motion import Motion

PLANAR = ConvoyConfig(drive="planar")
UNBUFFERED = replace(PLANAR.learner, buffer=False)
CASES = {
    "planar": PLANAR,
    "wheels": ConvoyConfig(),
    "restart": replace(PLANAR, reset="restart"),
    "late": replace(PLANAR, compute_time_s=0.04, learner=UNBUFFERED),
    "late restart": replace(PLANAR, compute_time_s=0.1, learner=UNBUFFERED, reset="restart"),
    "infrared": replace(SETTINGS["infrared"], drive="planar"),
    "rolling": replace(PLANAR, drive="rolling"),
    "rolling late": replace(PLANAR, drive="rolling", compute_time_s=0.04, learner=UNBUFFERED),
    "rolling late restart": replace(
        PLANAR, drive="rolling", compute_time_s=0.1, learner=UNBUFFERED, reset="restart"
    ),
}


def _run(config, *, batch, blocks=3, **kinds):
    convoy = Convoy(config, (1, 2, 3), **({"steps": 25_000} | kinds))
    if batch:
        convoy._engine = None  # as where MuJoCo cannot be called from compiled code
    records = [convoy.run_block().tobytes() for _ in range(blocks) if not convoy.finished]
    return convoy, records


@pytest.mark.parametrize("name", CASES)
def test_blocks_in_compiled_code_are_the_batchs_to_the_last_bit(name):
    assert engine.address(), "MuJoCo cannot be called from compiled code here"
    blocks, fast = _run(CASES[name], batch=False, threads=2)
    batch, slow = _run(CASES[name], batch=True)
    assert fast == slow
    for left, right in ((blocks.weights, batch.weights), (blocks.world.states, batch.world.states)):
        np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("drive", ["planar", "rolling"])
def test_a_checkpoint_is_the_same_on_both_ways(drive):
    config = replace(PLANAR, drive=drive)
    _, whole = _run(config, batch=True, blocks=4)
    first, _ = _run(config, batch=False, blocks=2)
    second = Convoy(config, (1, 2, 3), steps=25_000)
    second.load(first.state())
    assert [second.run_block().tobytes() for _ in range(2) if not second.finished] == whole[2:]


def test_robots_that_touch_and_walls_are_touched_on_both_ways():
    close = replace(PLANAR, distance_m=(0.0702, 0.09))

    def wall(spec):
        add_box(spec, "wall", (0.0, 0.52), (0.1, 0.02))

    for kinds in ({}, {"furnish": wall}):
        convoy, fast = _run(close, batch=False, blocks=2, **kinds)
        _, slow = _run(close, batch=True, blocks=2, **kinds)
        assert fast == slow
        motion = Motion.of_steps(convoy.run_block()[0])
        assert motion.gaps_m().min() < 0  # they did touch


def test_without_the_address_the_batch_does_it(monkeypatch):
    monkeypatch.setenv("WORKBENCH_BATCH", "1")
    convoy = Convoy(PLANAR, (1,), steps=100)
    convoy.run_block()
    assert convoy._engine is None and convoy.updates[0] == 100
    assert convoy.world.physics.ngeom == convoy.world.model.ngeom  # with all that is seen
    rolling = Convoy(replace(PLANAR, drive="rolling"), (1,), steps=100)
    rolling.run_block()
    assert rolling._engine is not None and rolling.updates[0] == 100


def test_what_is_not_mj_step_is_not_taken_for_it(monkeypatch):
    other = ctypes.cast(engine.library().mj_kinematics, ctypes.c_void_p).value
    assert not engine._is_mj_step(other)
    monkeypatch.setattr(engine, "library", lambda: None)
    engine._address.cache_clear()
    assert engine.address() == 0
    engine._address.cache_clear()
