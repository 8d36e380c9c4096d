"""Configurations: every field of every config refuses what is out of range, of the wrong type, or
unknown.
"""

import dataclasses
import json
import math

import numpy as np
import pytest

from workbench import fields
from workbench.arena.tracks import TrackConfig
from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.learning.config import PRESETS, LearnerConfig
from workbench.robot.infrared import InfraredConfig

CONFIGS = (ConvoyConfig, TrackConfig, LearnerConfig)
EVERY = [(cls, field) for cls in CONFIGS for field in dataclasses.fields(cls)]


def _wrong_type(default):
    return {bool: "yes", int: 1.5, float: "fast", str: 7, tuple: 3}.get(type(default), 12)


def _out_of_range(field):
    default = field.default
    if isinstance(default, (bool, dict)) or dataclasses.is_dataclass(default):
        return []
    if isinstance(default, str):
        return ["sideways", ""]
    if isinstance(default, tuple):
        whole = isinstance(default[0], int)
        bad = [(10**9, 10**9), (-(10**9), 1), default[:1], (*default, default[0])]
        return bad if whole else [*bad, (math.nan, default[1]), (default[0], math.inf)]
    return [10**30, -(10**30), 10**400] + ([] if isinstance(default, int) else [math.nan, math.inf])


@pytest.mark.parametrize(
    ("cls", "field"), EVERY, ids=lambda part: getattr(part, "name", getattr(part, "__name__", ""))
)
def test_every_field_refuses_bad_values_naming_field_value_and_range(cls, field):
    with pytest.raises(TypeError) as caught:
        cls(**{field.name: _wrong_type(field.default)})
    message = str(caught.value)
    assert f"{cls.__name__}.{field.name} = {_wrong_type(field.default)!r}" in message
    assert field.metadata["expected"] in message
    for value in _out_of_range(field):
        with pytest.raises(ValueError) as caught:
            cls(**{field.name: value})
        message = str(caught.value)
        assert f"{cls.__name__}.{field.name} = {value!r}" in message and "expected" in message
        assert field.metadata["expected"].split(" m")[0] in message
    assert field.metadata["doc"]


@pytest.mark.parametrize("cls", CONFIGS)
def test_unknown_names_are_refused_with_the_valid_ones(cls):
    name = dataclasses.fields(cls)[0].name
    with pytest.raises(
        TypeError,
        match=rf"{cls.__name__} has no field '{name}s' \(given 3\); fields: .*did you mean "
        rf"'{name}'",
    ):
        cls(**{f"{name}s": 3})
    with pytest.raises(TypeError, match="has no field"):
        fields.from_dict(cls, {"nonsense": 1})


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: ConvoyConfig(distance_m=(0.2, 0.1)),
            r"ConvoyConfig.distance_m = \(0.2, 0.1\); expected \(low, high\)",
        ),
        (lambda: ConvoyConfig(wheel_speed_mps=(0.09, 0.03)), "wheel_speed_mps"),
        (
            lambda: ConvoyConfig(leader_speed_mps=0.1),
            "leader_speed_mps = 0.1; followers can only keep pace",
        ),
        (
            lambda: ConvoyConfig(distance_tiling="logarithmic", state_tiles=(8, 9)),
            r"state_tiles = \(8, 9\).*n = 8.*odd",
        ),
        (
            lambda: ConvoyConfig(distance_tiling="logarithmic", inner_distance_m=0.08),
            "inner_distance_m = 0.08",
        ),
        (
            lambda: ConvoyConfig(tilings=3),
            "ConvoyConfig.tilings = 3: 3 tilings; expected a power of two",
        ),
        (
            lambda: ConvoyConfig(compute_time_s=1e-12),
            "compute_time_s = 1e-12; expected a multiple of 0.01 s",
        ),
        (
            lambda: ConvoyConfig(compute_time_s=0.015),
            "compute_time_s = 0.015; expected a multiple of 0.01 s",
        ),
        (
            lambda: ConvoyConfig(drive="planar", compute_time_s=0.03),
            "expected a multiple of 0.02 s",
        ),
        (lambda: ConvoyConfig(sensing="radar"), "sensing = 'radar'; expected one of 'truth'"),
        (lambda: ConvoyConfig(drive="weels"), "did you mean 'wheels'"),
        (lambda: TrackConfig(wavelengths_m=(0.3, 0.1)), "shortest < longest"),
        (lambda: LearnerConfig(gamma=0.999, lam=1.0), "gamma \\* lam = 0.999 with epsilon = 0.05"),
        (
            lambda: ConvoyConfig(sight_m=0.1),
            "sight_m = 0.1; expected at least the terminal distance 0.22 m",
        ),
        (lambda: ConvoyConfig(distance_m=(0.3, 1.0)), "enlarge track.radius_m"),
        (
            lambda: LearnerConfig(epsilon_schedule="exponential", epsilon_final=0.0),
            "expected both above 0",
        ),
        (
            lambda: LearnerConfig(rule="true-online-sarsa", buffer=False),
            "buffer = False with rule = 'true-online-sarsa'.*expected buffer = True",
        ),
        (
            lambda: ConvoyConfig(weights="shared", learner=LearnerConfig(rule="true-online-sarsa")),
            "weights = 'shared' with learner.rule = 'true-online-sarsa'.*expected weights = "
            "'own' or 'first'",
        ),
    ],
)
def test_values_that_do_not_fit_together_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    "config",
    [
        ConvoyConfig(),
        ConvoyConfig(
            followers=64,
            drive="planar",
            seed=7,
            track=TrackConfig(shape="eight"),
            learner=LearnerConfig(alpha=0.05),
        ),
        ConvoyConfig(
            bearing_tiling="logarithmic",
            state_tiles=(5, 5),
            tilings=2,
            action_levels=(3, 3),
            reward="alive",
            weights="shared",
        ),
    ],
)
def test_config_to_json_and_back_is_equal(config):
    assert fields.from_dict(ConvoyConfig, json.loads(json.dumps(fields.to_dict(config)))) == config


def test_configs_are_frozen_documented_and_numbers_become_plain():
    with pytest.raises(dataclasses.FrozenInstanceError):
        ConvoyConfig().seed = 3
    assert (
        "leader_speed_mps = 0.06: constant speed of the leader; a number from 0.005 to 10 m/s"
        in ConvoyConfig.__doc__
    )
    assert type(ConvoyConfig(leader_speed_mps=0.05).leader_speed_mps) is float
    assert ConvoyConfig(state_tiles=[5, 5]).state_tiles == (5, 5)


def test_exploring_always_is_legal_without_a_trace():
    assert LearnerConfig(epsilon=1.0, lam=0.0).epsilon == 1.0


def test_learner_presets_are_named_and_legal():
    assert PRESETS["default"] == LearnerConfig()
    like = PRESETS["aykin-2015-like"]
    assert (like.lam, like.gamma, like.alpha) == (0.6, 0.8, 1 / 2205)


def test_both_presets_of_the_paper_have_their_sizes():
    simulation = ConvoyConfig()
    robot = ConvoyConfig(state_tiles=(5, 5), action_levels=(3, 3))
    assert (simulation.grid().n, simulation.action_count, robot.grid().n, robot.action_count) == (
        81,
        49,
        25,
        9,
    )


def test_action_levels_hold_the_leader_s_speed_and_are_whole_steps():
    left, right = ConvoyConfig().levels()
    assert left.dtype == right.dtype == int
    assert 466 in left  # 0.06 m/s
    assert list(left) == sorted(left)


def test_rules_whose_ratio_is_at_most_one_may_keep_long_traces():
    for rule in ("watkins-q", "expected-sarsa", "true-online-sarsa"):
        assert LearnerConfig(rule=rule, gamma=0.97, lam=1.0).beta == 0.0
    for rule in ("greedy-gq", "qrc"):
        with pytest.raises(ValueError, match="lets the trace grow without bound"):
            LearnerConfig(rule=rule, gamma=0.97, lam=1.0)


def test_infrared_beyond_what_two_readings_are_inverted_for_is_refused():
    beacon = InfraredConfig(target="beacon")
    with pytest.raises(ValueError, match=r"distance_m = \(0.08, 0.5\) .* inverted up to 0.25 m"):
        dataclasses.replace(SETTINGS["infrared"], infrared=beacon, distance_m=(0.08, 0.5))


def test_numbers_truth_values_and_arrays_out_of_numpy_are_taken_as_pythons_own():
    config = ConvoyConfig(
        seed=np.array(3),
        state_tiles=np.array([5, 5]),
        drive=np.str_("planar"),
        followers=np.int32(2),
    )
    plain = ConvoyConfig(seed=3, state_tiles=(5, 5), drive="planar", followers=2)
    assert config == plain and type(config.drive) is str and type(config.state_tiles[0]) is int
    assert LearnerConfig(buffer=np.True_).buffer is True
    with pytest.raises(TypeError, match="expected 2 whole numbers"):
        ConvoyConfig(state_tiles=np.array([5.5, 5.0]))
