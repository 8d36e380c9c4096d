"""Weights files: what is accepted comes back bit for bit, what does not fit is refused with both
sides.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import workbench as wb
from workbench.formation.policy import UNITS
from workbench.formation.senses.table import SENSING
from workbench.lab.weights import Weights, describe, load_policy, load_weights, write_weights

BASE = wb.ConvoyConfig(followers=1, drive="planar")
IR = replace(wb.SETTINGS["infrared"], followers=1)


def _random(config, seed=0, tables=1):
    rng = np.random.default_rng(seed)
    shape = (tables, config.rows, config.action_count)
    return wb.Policy.of(config, rng.normal(size=shape)), rng.normal(size=shape)


def _write(folder, config=BASE, seed=0):
    policy, w = _random(config, seed)
    folder.mkdir(exist_ok=True, parents=True)
    write_weights(folder, Weights(policy, w, 123, describe(policy, config, 123)))
    return policy, w


MISMATCHES = {
    "state_tiles": st.tuples(st.sampled_from([3, 5, 7, 11]), st.sampled_from([3, 5, 7, 11])),
    "action_levels": st.tuples(st.integers(2, 6), st.integers(2, 6)),
    "tilings": st.sampled_from([2, 4]),
    "distance_m": st.tuples(st.floats(0.075, 0.079), st.floats(0.2, 0.3)),
    "bearing_limit_rad": st.floats(0.3, 0.7),
    "distance_tiling": st.just("logarithmic"),
    "bearing_tiling": st.just("logarithmic"),
    "wheel_speed_mps": st.tuples(st.floats(0.01, 0.025), st.floats(0.1, 0.12)),
    "sensing": st.sampled_from(["camera", "pixels"]),
}


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_every_kind_of_mismatch_is_refused_with_both_sides(data):
    name = data.draw(st.sampled_from(sorted(MISMATCHES)))
    other = replace(BASE, **{name: data.draw(MISMATCHES[name])})
    policy, _ = _random(BASE)
    with pytest.raises(
        ValueError, match=r"the policy has \w+ = .*, the configuration .*; use the configuration"
    ):
        policy.check(other)
    with pytest.raises(ValueError, match=r"the policy has \w+ = "):
        _random(other)[0].check(BASE)


@pytest.mark.parametrize("mine", SENSING)
@pytest.mark.parametrize("theirs", SENSING)
def test_another_sensing_is_refused_and_taken_over_only_where_units_agree(mine, theirs):
    configs = {sensing: replace(IR, sensing=sensing) for sensing in (mine, theirs)}
    policy, _ = _random(configs[mine])
    if mine == theirs:
        policy.check(configs[theirs])
        return
    both = re.escape(f"the policy has sensing = '{mine}', the configuration '{theirs}'")
    with pytest.raises(ValueError, match=both):
        policy.check(configs[theirs])
    if UNITS[mine] == UNITS[theirs]:
        taken = policy.transferred(theirs)
        taken.check(configs[theirs])
        np.testing.assert_array_equal(taken.theta, policy.theta)
    else:
        with pytest.raises(ValueError, match="tiles in .* learn anew"):
            policy.transferred(theirs)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_what_is_written_comes_back_bit_for_bit(tmp_path, data):
    sensing = data.draw(st.sampled_from(sorted(SENSING)))
    base = replace(IR if sensing.startswith("ir") else BASE, sensing=sensing)
    n = st.sampled_from([3, 5, 7])
    tiles = (data.draw(n), data.draw(n))
    levels = (data.draw(st.integers(1, 5)), data.draw(st.integers(1, 5)))
    config = replace(base, state_tiles=tiles, action_levels=(levels[0] + 1, levels[1] + 1))
    policy, w = _write(tmp_path / "run", config, data.draw(st.integers(0, 1000)))
    loaded = load_weights(tmp_path / "run")
    assert (
        loaded.policy.sha256() == policy.sha256()
        and loaded.w.tobytes() == w.tobytes()
        and loaded.updates == 123
    )
    load_policy(tmp_path / "run" / "weights.npz", config)
    before = (tmp_path / "run" / "weights.npz").read_bytes()
    write_weights(tmp_path / "run", loaded)
    assert (tmp_path / "run" / "weights.npz").read_bytes() == before


def test_two_hundred_damaged_files_are_each_refused_or_unharmed(tmp_path):
    policy, w = _write(tmp_path / "run")
    good = (tmp_path / "run" / "weights.npz").read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for number in range(200):
        bad = bytearray(good)
        kind = number % 4
        at = int(rng.integers(len(good)))
        size = int(rng.integers(1, 400))
        if kind == 0:
            bad = bad[:at]
        elif kind == 1:
            bad[at] ^= int(rng.integers(1, 256))
        elif kind == 2:
            bad[at : at + size] = rng.integers(
                0, 256, len(bad[at : at + size]), dtype=np.uint8
            ).tobytes()
        else:
            del bad[at : at + size]
        path = tmp_path / f"{number}.npz"
        path.write_bytes(bytes(bad))
        try:
            loaded = load_weights(path)
        except ValueError as error:
            assert str(path) in str(error) and ("restore it" in str(error))
            refused += 1
        else:  # a byte that means nothing, a time stamp for example
            assert (
                kind == 1
                and loaded.policy.sha256() == policy.sha256()
                and loaded.w.tobytes() == w.tobytes()
            )
    assert refused >= 180


def test_descriptions_that_contradict_the_arrays_and_pickles_are_refused(tmp_path):
    policy, w = _write(tmp_path / "run")
    path = tmp_path / "run" / "weights.npz"
    stored = dict(np.load(path))

    def refuse(match, **changes):
        np.savez(tmp_path / "bad.npz", **(stored | changes))
        with pytest.raises(ValueError, match=match):
            load_weights(tmp_path / "bad.npz")

    about = json.loads(str(stored["about"]))

    def told(**changes):
        return np.array(json.dumps(about | changes))

    tiles = json.loads(json.dumps(about["tiles"]))
    tiles["distance"]["unit"] = "mm"
    refuse("its description says tiles = .*'mm'.*, its arrays .*'m'", about=told(tiles=tiles))
    refuse(
        "its description says sensing = 'camera', its arrays 'truth'", about=told(sensing="camera")
    )
    refuse("its description says actions", about=told(actions={"unit": "rad/s"}))
    refuse("its arrays have the hash", theta=stored["theta"] + 1)
    refuse("its description says 123 updates, its arrays 7", updates=np.array(7))
    refuse("secondary weights have shape", w=w[:, :5])
    refuse("description is not of format", about=told(format=99))
    refuse("bad.npz holds no weights", about=np.array("[1, 2]"))
    refuse("bad.npz holds no weights", about=told(provenance=3))
    refuse("not a policy of schema", schema=np.array(1))
    refuse("bad.npz", theta=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_weights(tmp_path / "nothing")


def test_a_run_says_where_its_weights_come_from(tmp_path):
    run = wb.learn(BASE, steps=200, out=tmp_path / "run", progress=False)
    loaded = load_weights(tmp_path / "run")
    about = loaded.about
    assert (
        about["provenance"]["seed"] == 1 and about["provenance"]["updates"] == 200 == loaded.updates
    )
    assert (
        about["provenance"]["policy_sha256"] == run.policy.sha256() and about["sensing"] == "truth"
    )
    assert (
        about["tiles"]["distance"]["unit"] == "m"
        and about["learner"]["gamma"] == BASE.learner.gamma
    )
    assert (
        about["reward"]["preset"] == BASE.reward
        and about["actions"]["left"] == BASE.levels()[0].tolist()
    )
    law = wb.evaluate(wb.LAWS["carrot"](), BASE, minutes=0.1, progress=False)
    law.save(tmp_path / "law")
    assert load_weights(tmp_path / "law").about["kind"] == "carrot"
    with pytest.raises(ValueError, match="driven by the law 'carrot' and has no weights"):
        load_policy(tmp_path / "law")
