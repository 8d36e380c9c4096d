"""Shares, intervals and summaries by hand-computed numbers."""

import math

import numpy as np
import pytest

from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import LOSS
from workbench.formation.records import PERIOD
from workbench.formation.reset import LOST, TURN
from workbench.lab.records import SUMS, Recorder, sampled_blocks, summarise
from workbench.lab.statistics import (
    best_block,
    best_cell,
    interval,
    iqm,
    moments,
    paired,
    share_interval,
    share_of_block,
    time_to_criterion,
    time_to_stable,
)


def test_best_cell_and_block_by_hand():
    visits = np.zeros((5, 5))
    visits[1, 1] = 5
    visits[2, 2] = 10
    visits[3, 3] = 4
    visits[0, 4] = 1
    assert best_cell(visits) == (0.5, (2, 2))
    assert best_block(visits) == (0.95, (1, 1))  # 5 + 10 + 4 of 20
    assert share_of_block(visits, (0, 2)) == pytest.approx(11 / 20)
    assert best_block(np.ones((2, 5))) == (0.6, (0, 0))  # a grid lower than the block
    assert best_cell(np.zeros((3, 3)))[0] == 0.0
    with pytest.raises(ValueError, match=r"visits have shape \(4, 9, 9\)"):
        best_cell(np.zeros((4, 9, 9)))


def test_interval_covers_the_mean_and_needs_two_seeds():
    values = np.array([1.0, 2.0, 3.0, 4.0])
    mean, low, high = interval(values)
    # Student's t: nothing is skewed
    assert mean == 2.5 and (low, high) == pytest.approx((0.446, 4.554), abs=1e-3)
    assert interval([3.0, 3.0, 3.0]) == (3.0, 3.0, 3.0)
    with pytest.raises(ValueError, match="1 values have no interval"):
        interval([1.0])


@pytest.mark.parametrize(
    ("draw", "truth"),
    [
        (lambda rng: rng.normal(size=10), 0.0),
        (lambda rng: np.exp(0.25 * rng.normal(size=10)), np.exp(0.25**2 / 2)),
        (lambda rng: np.exp(0.5 * rng.normal(size=10)), np.exp(0.5**2 / 2)),
    ],
    ids=["normal", "log-normal 0.25", "log-normal 0.5"],
)
def test_an_interval_of_ten_seeds_covers_what_it_says(draw, truth):
    rng = np.random.default_rng(0)
    intervals = (interval(draw(rng)) for _ in range(8000))
    covered = np.mean([low <= truth <= high for _, low, high in intervals])
    assert 0.93 <= covered <= 0.96


def test_medians_and_interquartile_means_have_intervals_that_cover_them():
    rng = np.random.default_rng(1)
    for statistic in ("median", "iqm"):
        found = (interval(rng.normal(size=10), statistic=statistic) for _ in range(2000))
        assert np.mean([low <= 0 <= high for _, low, high in found]) > 0.93


def test_shares_of_runs_have_exact_intervals():
    """Clopper and Pearson (1934): none of ten still allows 31 %."""
    share, low, high = share_interval(0, 10)
    assert (share, low) == (0.0, 0.0) and high == pytest.approx(0.3085, abs=1e-4)
    assert share_interval(10, 10)[1] == pytest.approx(0.6915, abs=1e-4)
    chance = np.random.default_rng(2).binomial(10, 0.1, 4000)
    holds = [low <= 0.1 <= high for _, low, high in (share_interval(k, 10) for k in range(11))]
    assert np.mean(np.array(holds)[chance]) >= 0.95


def test_moments_by_hand():
    # values 1, 2, 6: mean 3, RMS sqrt(41/3), variance 41/3 - 9
    mean, std, rms = moments(3, 9, 41)
    assert (mean, rms) == (3.0, math.sqrt(41 / 3)) and std == pytest.approx(math.sqrt(41 / 3 - 9))
    assert all(math.isnan(value) for value in moments(0, 0, 0))


def _block(length, **fields):
    block = np.zeros((length, 2), PERIOD)
    block["state"] = -1
    for name, values in fields.items():
        block[name][:, 1] = values
    return block


def test_summary_by_hand():
    config = ConvoyConfig(followers=1)
    recorder = Recorder(config, 6)
    # 4 visits: three in the optimum's tile, one to its right; then a loss, and two periods away,
    # one of them lost
    recorder.add(
        _block(
            6,
            state=[40, 40, 40, 39, -1, -1],
            event=[0, 0, 0, LOSS, 0, 0],
            phase=[0, 0, 0, TURN, TURN, LOST],
            distance_error=[0.003, -0.003, 0.001, 0.005, 0, 0],
            bearing=np.radians([0, 2, 0, -6, 0, 0]),
            reward=[-1, -1, -1, -5, 0, 0],
        ),
        0,
    )
    numbers = summarise(config, 6, 4, recorder.records())
    assert numbers["share_best_cell"] == 0.75 and numbers["share_best_3x3"] == 1.0
    assert numbers["share_best_cell_all_time"] == pytest.approx(0.75 * 4 / 6)
    assert numbers["share_best_3x3_all_time"] == pytest.approx(4 / 6)
    assert numbers["best_cell"] == [4, 4] and numbers["losses"] == 1
    assert numbers["rms_distance_error_mm"] == pytest.approx(
        math.sqrt((9 + 9 + 1 + 25) / 4), rel=1e-6
    )
    assert numbers["bearing_mean_deg"] == pytest.approx(-1.0, rel=1e-6)
    assert numbers["bearing_std_deg"] == pytest.approx(math.sqrt((1 + 9 + 1 + 25) / 4), rel=1e-6)
    assert numbers["mean_reward"] == -2.0
    assert numbers["share_of_time_away"] == pytest.approx(0.5)
    assert numbers["simulated_minutes"] == pytest.approx(0.01)


def test_the_last_third_is_counted_apart():
    config = ConvoyConfig(followers=1)
    recorder = Recorder(config, 30)
    for start, state in ((0, 0), (10, 0), (20, 40)):
        recorder.add(_block(10, state=[state] * 10), start)
    numbers = summarise(config, 30, 30, recorder.records())
    assert numbers["best_cell"] == [0, 0] and numbers["share_best_cell"] == pytest.approx(2 / 3)
    assert numbers["share_best_cell_last_third"] == 1.0


def test_sampled_blocks_are_the_stated_ones_and_survive_saving_and_loading():
    config = ConvoyConfig(followers=1)
    recorder = Recorder(config, 1000)
    twin = Recorder(config, 1000)
    for start in range(0, 1000, 100):
        recorder.add(_block(10 if start < 900 else 3, left=start), start)
        if start == 400:
            twin.load(recorder.records())
        elif start > 400:
            twin.add(_block(10 if start < 900 else 3, left=start), start)
    blocks = sampled_blocks(recorder.records())
    assert [start for start, _ in blocks] == [
        0,
        100,
        200,
        500,
        800,
    ]  # 0, 1 %, 10 %, 50 %, and the last whole one
    assert all(block[0, 1]["left"] == start and len(block) == 10 for start, block in blocks)
    for name, array in recorder.records().items():
        assert array.tobytes() == twin.records()[name].tobytes(), name
    assert recorder.records()["sums"].shape == (10, 1, len(SUMS))


def _row(*places):
    """One period with robots at these x (m)."""
    block = np.zeros((1, len(places)), PERIOD)
    block["x"] = places
    return block


def test_collisions_are_counted_when_they_begin_also_across_blocks():
    config = ConvoyConfig(followers=2)
    recorder = Recorder(config, 10)
    apart = _row(0.3, 0.15, 0.0)
    touch = _row(0.219, 0.15, 0.0)
    both = _row(0.137, 0.068, 0.0)
    recorder.add(
        np.concatenate([apart, touch, touch, apart, touch]), 0
    )  # the first follower touches the leader twice
    recorder.add(
        np.concatenate([touch, touch, both, both, apart]), 5
    )  # still; then the second touches the first as well
    sums = recorder.records()["sums"][:, :, SUMS.index("collisions")]
    np.testing.assert_array_equal(sums, [[2, 0], [0, 1]])
    assert summarise(config, 10, 0, recorder.records())["collisions"] == 3
    whole = Recorder(config, 10)
    whole.add(
        np.concatenate([apart, touch, touch, apart, touch, touch, touch, both, both, apart]), 0
    )
    assert whole.records()["sums"][0, :, SUMS.index("collisions")].tolist() == [2, 1]


def test_robots_that_start_in_touch_have_collided_once():
    recorder = Recorder(ConvoyConfig(followers=1), 3)
    recorder.add(np.concatenate([_row(0.06, 0.0)] * 3), 0)
    assert recorder.records()["sums"][0, 0, SUMS.index("collisions")] == 1


def test_stable_is_from_where_no_block_exceeds_twice_the_final_median():
    error = np.full(9000, 0.004)
    lost = np.zeros(9000)
    assert time_to_stable(lost, error, block=1000) == 0.0
    error[2500:2600] = 0.1  # block 2: RMS over 0.03
    assert time_to_stable(lost, error, block=1000) == 3000.0
    lost[4321] = 1  # one loss where the final median is none
    assert time_to_stable(lost, error, block=1000) == 5000.0
    lost[6001::1000] = lost[6002::1000] = (
        1  # two per block at the end: a single one before is below twice that
    )
    assert time_to_stable(lost, error, block=1000) == 3000.0
    lost[8100:8105] = 1  # the last block is worse than all before: never stable
    assert math.isnan(time_to_stable(lost, error, block=1000))
    assert (
        time_to_stable(lost[:8999], error[:8999], block=1000) == 3000.0
    )  # what does not fill a block does not count


def test_the_interquartile_mean_drops_a_quarter_at_both_ends():
    assert iqm([100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -50.0]) == pytest.approx((2 + 3 + 4 + 5) / 4)
    point, low, high = interval([100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -50.0], statistic="iqm")
    assert low <= point <= high and point == pytest.approx(3.5)


def test_pairs_remove_what_seeds_have_in_common():
    rng = np.random.default_rng(0)
    seed_effect = rng.normal(0, 10, 12)
    treated = seed_effect + 1 + rng.normal(0, 0.1, 12)
    plain = seed_effect + rng.normal(0, 0.1, 12)
    mean, low, high = paired(treated, plain)
    assert 0.8 < low < mean < high < 1.2
    apart = interval(treated)[2] - interval(treated)[1]
    assert high - low < apart / 20


def test_times_to_a_criterion_count_runs_that_never_reached_it():
    nan = float("nan")
    summary = time_to_criterion([10.0, 20.0, 30.0, nan], 100.0)
    assert (summary.n, summary.reached) == (4, 3)
    assert summary.median == 20.0  # after 20, half of the runs remain: S(20) = 3/4 · 2/3 = 1/2
    assert summary.mean == pytest.approx((10 + 20 + 30 + 100) / 4) and summary.horizon == 100.0
    assert time_to_criterion([10.0, nan, nan], 100.0).median == np.inf
    early = time_to_criterion(
        [10.0, 20.0, nan], [50.0, 50.0, 15.0]
    )  # the third was stopped before the second reached it
    assert early.median == 20.0  # S(10) = 2/3, S(20) = 2/3 · 0 = 0
    assert early.horizon == 15.0 and early.mean == pytest.approx((10 + 15 + 15) / 3)
    half = time_to_criterion([*range(1, 13), *([nan] * 12)], 100.0)
    assert (half.reached, half.median) == (12, 12.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: time_to_stable(np.zeros(5), np.zeros(6), block=1),
            "5 losses, 6 errors; expected as many of each",
        ),
        (
            lambda: time_to_stable(np.zeros(9), np.full(9, np.nan), block=1),
            "losses or errors are not finite",
        ),
        (
            lambda: time_to_stable(np.zeros(9), np.zeros(9), block=0),
            "block = 0; expected at least one update",
        ),
        (lambda: time_to_stable(np.zeros(9), np.zeros(9)), "at least three blocks of 5000"),
        (lambda: interval([1.0, np.nan]), "1 of 2 values are not finite"),
        (
            lambda: interval([1.0, 2.0], statistic="mode"),
            "statistic = 'mode'; expected one of 'mean', 'median', 'iqm'",
        ),
        (lambda: paired([1.0, 2.0], [1.0]), "2 values and 1 references are no pairs"),
        (lambda: share_interval(3, 2), "3 of 2 runs; expected 0 to all of at least one run"),
        (
            lambda: time_to_criterion([10.0, 200.0], 100.0),
            "a time of 200 lies beyond the run's length of 100",
        ),
        (lambda: time_to_criterion([10.0], 100.0), "1 values have no interval"),
    ],
)
def test_statistics_refuse_what_they_cannot_answer(call, message):
    with pytest.raises(ValueError, match=message):
        call()
