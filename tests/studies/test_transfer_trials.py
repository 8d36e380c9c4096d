"""Emulated realities, and weights that travel into them."""

from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.formation.body import BodyConfig
from workbench.formation.estimate import PREDICTIONS
from workbench.formation.follower import LEARNED, LOSS
from workbench.formation.records import PERIOD
from workbench.lab.trial import Trial
from workbench.studies import transfer_trials
from workbench.studies.realities import FAMILIES, emulated_world
from workbench.studies.transfer_trials import (
    DELAYS,
    NOISE_FACTORS,
    TRAININGS,
    Transfer,
    measure_copies,
    measure_delays,
    measure_gap,
    measure_transfer,
    measure_warm,
    with_noise,
)

BASE = wb.ConvoyConfig(drive="planar", followers=2, seed=1)
INFRARED = replace(wb.SETTINGS["infrared"], drive="planar", followers=1)


@pytest.mark.parametrize("sensing", ["camera", "ir-metric", "ir-raw"])
def test_a_world_changes_robots_link_and_senses_and_leaves_the_task(sensing):
    config = replace(INFRARED if sensing.startswith("ir") else BASE, sensing=sensing)
    worlds = [
        emulated_world(config, number, family=family) for family in FAMILIES for number in range(20)
    ]
    assert len({world.fleet for world in worlds}) == 40 and {
        world.body.delay for world in worlds
    } == {0, 1, 2, 3}
    theta = np.zeros((1, config.rows, config.action_count))
    for world in worlds:
        assert (
            replace(
                world, body=config.body, infrared=config.infrared, camera=config.camera, fleet=0
            )
            == config
        )
        wb.Policy.of(config, theta).check(world)  # weights fit
    assert emulated_world(config, 3, family="tuning", delay=1).body.delay == 1


def test_unknown_families_and_numbers_are_refused():
    with pytest.raises(ValueError, match="family = 'real'; expected one of 'tuning', 'judging'"):
        emulated_world(BASE, 1, family="real")
    with pytest.raises(ValueError, match="number = -1"):
        emulated_world(BASE, -1, family="tuning")


@pytest.mark.parametrize("training", TRAININGS)
def test_every_training_is_judged_in_its_world_and_in_the_nominal_one(training, monkeypatch):
    monkeypatch.setattr(transfer_trials, "STRETCHES", 20)
    trial = Transfer(
        config=replace(BASE, sensing="camera"),
        steps=2000,
        there_steps=500,
        minutes=0.5,
        training=training,
    )
    numbers = measure_transfer(trial)
    assert numbers["delay"] == emulated_world(BASE, 1, family="judging").body.delay
    assert np.isnan(numbers["learning_losses"]) == (training == "randomised")
    assert 0 <= numbers["judged_share_inside"] <= 1 and numbers["nominal_losses"] >= 0
    assert measure_transfer(trial) == pytest.approx(numbers, nan_ok=True)


@pytest.mark.parametrize("measure", [measure_transfer, measure_gap])
def test_nothing_that_was_learned_on_judges_and_the_nominal_robots_stay_the_same(
    monkeypatch, measure
):
    made = []

    class Watched(wb.Convoy):
        def __init__(self, config, seeds, **more):
            made.append((config.fleet, seeds[0], "periods" in more))
            super().__init__(config, seeds, **more)

    monkeypatch.setattr(transfer_trials, "Convoy", Watched)
    monkeypatch.setattr(transfer_trials, "STRETCHES", 12)
    for seed in (1, 84):  # 12 · 84 would reach 1008
        for training in ("nominal", "randomised"):
            made.clear()
            measure(
                Transfer(
                    config=replace(BASE, sensing="truth", seed=seed),
                    steps=240,
                    minutes=0.5,
                    training=training,
                )
            )
            learned, judged = (
                {entry[:2] for entry in made if entry[2] == kind} for kind in (False, True)
            )
            assert (
                learned
                and judged
                and not {chance for _, chance in learned} & {chance for _, chance in judged}
            )
            assert seed in {fleet for fleet, _ in judged} and (
                training == "randomised" or {fleet for fleet, _ in learned} == {seed}
            )


def test_settling_begins_after_the_last_loss_before_a_long_quiet():
    steps = np.zeros((6000, 2), PERIOD)
    steps["event"][:, 1] = LEARNED
    steps["event"][[100, 1500, 3400], 1] |= LOSS
    assert transfer_trials._quiet_from(steps) == 3401
    assert np.isnan(transfer_trials._quiet_from(steps[:5000]))


def test_delays_are_judged_in_one_world():
    numbers = measure_delays(
        Trial(config=replace(BASE, sensing="camera"), steps=20_000, minutes=0.5)
    )
    worlds = ["nominal", *(f"delay_{k}" for k in DELAYS)]
    assert {name for name in numbers if name.endswith("losses")} == {
        f"{world}_{prediction}_losses" for world in worlds for prediction in PREDICTIONS
    }
    late = [numbers[f"delay_{k}_none_rms_distance_error_mm"] for k in DELAYS]
    assert len(set(late)) == len(DELAYS)


def test_prediction_is_asked_only_of_what_knows_distances():
    raw = replace(INFRARED, sensing="ir-raw")
    numbers = measure_delays(Trial(config=raw, steps=5_000, minutes=0.5))
    assert not any("_own_" in name or "_both_" in name for name in numbers)


def test_copies_are_judged_follower_by_follower_on_the_robots_that_learned():
    different = replace(BASE, body=BodyConfig(wheel_spread=0.02, axle_spread=0.02))
    numbers = measure_copies(Trial(config=different, steps=20_000, minutes=1.0))
    for cures in ("none", "calm"):
        for kind in ("own", "copied", "last", "shared", "range"):
            for follower in (1, 2):
                assert 0 < numbers[f"{kind}_{cures}_rms_distance_error_mm_{follower}"] < 70
        own, copied = (
            [numbers[f"{kind}_{cures}_rms_distance_error_mm_{k}"] for k in (1, 2)]
            for kind in ("own", "copied")
        )
        assert own[0] == copied[0]  # the first keeps its own weights
        assert own[1] != copied[1]
    own, last = (
        wb.Policy.of(different, np.zeros((n, different.rows, different.action_count)))
        for n in (2, 1)
    )
    assert (
        own.check(different) is None and last.check(different) is None
    )  # one table per follower, or one for all


def test_a_warm_start_is_compared_with_a_cold_one_on_the_same_task():
    numbers = measure_warm(
        Trial(config=replace(BASE, leader_speed_mps=0.05), steps=30_000, minutes=0.5)
    )
    assert numbers["warm_learning_losses"] < numbers["cold_learning_losses"]
    assert not numbers["warm_updates_to_quiet"] > numbers["cold_updates_to_quiet"]


def test_noise_is_multiplied_where_it_comes_from():
    assert (
        with_noise(INFRARED, 3).infrared.noise == 3 and with_noise(INFRARED, 0).infrared.noise == 0
    )
    noisy = replace(BASE, noise_distance_m=0.001, noise_bearing_rad=0.01)
    assert (
        with_noise(noisy, 2).noise_distance_m == 0.002
        and with_noise(noisy, 2).noise_bearing_rad == 0.02
    )
    for training in ("nominal", "randomised"):
        numbers = measure_gap(Transfer(config=noisy, steps=5000, minutes=0.5, training=training))
        assert all(0 <= numbers[f"share_inside_noise_{factor}"] <= 1 for factor in NOISE_FACTORS)
