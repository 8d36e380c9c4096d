"""The lean loop: what it does is the whole loop's to the last bit, and who gets it."""

from dataclasses import replace

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from workbench.arena.tracks import TrackConfig
from workbench.formation import convoy as module
from workbench.formation.body import BodyConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.control import control_step
from workbench.formation.convoy import Convoy
from workbench.formation.laws.carrot import CarrotPI
from workbench.formation.lean import lean
from workbench.formation.own_reward import own_reward
from workbench.formation.shapes import FormationConfig
from workbench.lab.compiling import LOOPS
from workbench.learning.config import LearnerConfig

ROLLING = ConvoyConfig(drive="rolling")
WEDGE = FormationConfig(shape="wedge", frame="heading")
EIGHT = TrackConfig(shape="eight", radius_m=1.0)
PLAIN = {
    "paper": ROLLING,
    "planar": ConvoyConfig(drive="planar"),
    "recommended": replace(SETTINGS["recommended"], drive="rolling"),
    "relative": replace(ROLLING, sensing="truth-relative"),
    "noise": replace(ROLLING, noise_distance_m=0.002, noise_bearing_rad=0.03),
    "restart": replace(ROLLING, reset="restart"),
    "shared": replace(ROLLING, weights="shared"),
    "wide": replace(ROLLING, track=TrackConfig(line_width_m=0.03)),
    "qrc": replace(ROLLING, learner=LearnerConfig(rule="qrc", eta=1.0)),
    "wedge": replace(ROLLING, formation=WEDGE, track=EIGHT, leader_speed_mps=0.05),
    "path": replace(
        ROLLING, formation=replace(WEDGE, frame="path"), track=EIGHT, leader_speed_mps=0.05
    ),
    "sarsa": replace(ROLLING, learner=LearnerConfig(rule="expected-sarsa")),
}


@pytest.mark.parametrize("name", PLAIN)
def test_the_lean_loop_does_what_the_whole_one_does(name, monkeypatch):
    plain = Convoy(PLAIN[name], [1, 2], steps=10_000)
    assert plain.plain
    records = plain.run_block().tobytes()
    monkeypatch.setattr(module, "is_plain", lambda config, law: False)
    whole = Convoy(PLAIN[name], [1, 2], steps=10_000)
    assert not whole.plain and whole.run_block().tobytes() == records
    np.testing.assert_array_equal(plain.weights, whole.weights)


def test_whoever_needs_more_gets_the_whole_loop():
    more = {
        "camera": replace(ROLLING, sensing="camera"),
        "infrared": SETTINGS["infrared"],
        "body": replace(ROLLING, body=BodyConfig(slip=0.1)),
        "no buffer": replace(ROLLING, learner=LearnerConfig(buffer=False)),
        "rule": replace(ROLLING, learner=LearnerConfig(rule="true-online-sarsa")),
    }
    for config in more.values():
        assert not Convoy(config, [1], steps=1).plain
    assert not Convoy(ROLLING, [1], periods=1, policy=CarrotPI()).plain


def test_a_law_drives_beside_a_reward_of_one_s_own():
    reward = own_reward(lambda u, v: -abs(u) - abs(v))
    config = replace(ROLLING, followers=2, reward="own")
    own = Convoy(config, [1], periods=200, policy=CarrotPI(), reward=reward)
    usual = Convoy(replace(config, reward="quadratic"), [1], periods=200, policy=CarrotPI())
    np.testing.assert_array_equal(own.whole()["left"], usual.whole()["left"])


def _called(one):
    """Return what compiled functions a compiled function calls, by the names that it has for
    them.
    """
    plain = one.py_func
    known = {name: plain.__globals__.get(name) for name in plain.__code__.co_names}
    cells = zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True)
    known |= {name: cell.cell_contents for name, cell in cells}
    return {name: what for name, what in known.items() if isinstance(what, Dispatcher)}


def _name(one):
    return one.py_func.__module__, one.py_func.__qualname__


def _all_of(functions):
    """Return compiled functions and all that they call."""
    todo, seen = list(functions), set()
    while todo:
        one = todo.pop()
        if one not in seen:
            seen.add(one)
            todo += _called(one).values()
    return seen


@pytest.mark.parametrize("loop", LOOPS)
def test_what_two_processes_compile_is_part_of_the_loop(loop):
    convoy = Convoy(LOOPS[loop][0], [1], steps=1)
    parts = {_name(part) for half in (0, 1) for part, _ in convoy.parts(half)}
    assert len(parts) == 5 + convoy.plain
    assert parts <= {_name(one) for one in _all_of([convoy.loop])}


def test_no_two_functions_of_the_loops_have_one_name():
    """Compiled code from disk is linked by names: of two with one name, one would run for both."""
    meant = {}
    loops = [Convoy(config, [1], steps=1).loop for config, _ in LOOPS.values()]
    seen = _all_of([*loops, control_step, lean(control_step, shaped=False)])
    for one in seen:
        called = {name: _name(what) for name, what in _called(one).items()}
        means = one.py_func.__code__, called
        assert meant.setdefault(_name(one), means) == means, _name(one)
    assert len(seen) > 200 and len(meant) > 150
