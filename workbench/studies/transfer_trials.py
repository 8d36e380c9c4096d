"""Trials of weights that travel: from robot to robot, and from the nominal simulation into emulated
realities.

Everything is judged by true poses, on a track and with noise that were not learned on. The robots
of the nominal simulation stay the same from learning to judging (``ConvoyConfig.fleet`` is the
seed), and so do those of every emulated world. Lengths in mm, angles in degrees; names that end in
a number belong to that follower or that noise. What does not exist (errors where nobody followed)
is NaN.

>>> trial = Transfer(config=ConvoyConfig(drive="planar", followers=1), steps=2000, minutes=1.0)
>>> sorted(name for name in measure_transfer(trial) if name.startswith("nominal"))[:3]
['nominal_bias_mm', 'nominal_losses', 'nominal_ripple_mm']
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.fields import choice, configuration, integer
from workbench.formation.body import LONGEST_DELAY, BodyConfig
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import BLOCK, Convoy
from workbench.formation.estimate import PREDICTIONS
from workbench.formation.follower import LEARNED, LOSS
from workbench.formation.policy import Policy
from workbench.formation.reset import FOLLOW
from workbench.formation.senses.table import INFRARED, SENSES
from workbench.lab.runs import UNSEEN
from workbench.lab.trial import Trial
from workbench.measures.errors import summary, true_errors, within
from workbench.measures.motion import Motion, chatter
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.studies.realities import emulated_world

TRAININGS = ("nominal", "delay known", "randomised", "there", "nominal, then there")
# worlds that randomised training goes through, one after the other: chosen on tuning worlds, seeds
# 11 to 13
STRETCHES = 160
ELSEWHERE = (
    10**6
)  # from this seed on: tracks and noise of randomised training, none of which is judged on
EARLY = 5_000  # updates over which a warm start is compared with a cold one
# updates without a loss that count as settled, and updates within which they are looked for
QUIET = 2_000
LATER = 40_000
NOISE_FACTORS = (0, 1, 2, 3, 4, 5)
DELAYS = range(LONGEST_DELAY + 1)  # control periods
PACES = (0.75, 1.0)  # of the leader's speed: what followers down the line are led at
# what may be made of the same weights, see ``formation.output``
CURES: dict[str, dict[str, Any]] = {
    "none": {"output": "greedy", "trim": 0.0},
    "calm": {"output": "interpolated", "trim": 0.01},
}

Table = NDArray[np.float64]


@configuration
class Transfer(Trial):
    """A trial whose weights are learned in one world and judged in another; the judging world's
    number is the seed.
    """

    training: str = choice(TRAININGS, "where the weights are learned", default="nominal")
    there_steps: int = integer(
        0,
        10**9,
        "",
        "learning updates in the judging world, of trainings that have some",
        default=20_000,
    )


def measure_transfer(trial: Transfer) -> dict[str, float]:
    """Return how learning went, and how a policy follows greedily in its judging world and in the
    nominal one.

    ``learning_…`` is of the world that was learned in last; not of randomised training, whose
    worlds are many.
    """
    config = _own_robots(trial)
    seed = trial.config.seed
    there = emulated_world(config, seed, family="judging")
    table = None
    losses = np.full(1, math.nan)
    if trial.training == "randomised":
        worlds = (
            emulated_world(config, STRETCHES * seed + k, family="tuning") for k in range(STRETCHES)
        )
        table = _learned_in_turn(worlds, trial)
    elif trial.training != "there":
        known = (
            BodyConfig(delay=there.body.delay) if trial.training == "delay known" else BodyConfig()
        )
        table, losses = _learned(replace(config, body=known), trial.steps)
    if trial.training.endswith("there"):
        table, losses = _learned(there, trial.there_steps, table)
    assert table is not None
    free = np.flatnonzero(losses[:-1] == 0)  # of whole blocks
    numbers = {
        "delay": float(there.body.delay),
        "learning_losses": float(losses.sum()),
        "learning_minutes_to_lossfree": BLOCK * CONTROL_PERIOD / 60 * float(free[0])
        if free.size
        else math.nan,
    }
    for name, world in (("judged", there), ("nominal", config)):
        steps = _followed(world.with_seed(seed + UNSEEN), table, trial)
        numbers |= {
            f"{name}_{key}": value for key, value in _errors(world, steps, slice(None)).items()
        }
        restless = chatter(Motion.of_steps(steps)).iloc[1:]
        numbers |= {
            f"{name}_{key}": float(restless[key].mean())
            for key in ("turn_rms_deg_s", "variation_mm_s_per_m")
        }
    return numbers


def measure_delays(trial: Trial) -> dict[str, float]:
    """Return how weights of the nominal simulation follow in a judging world, were its commands 0
    to 4 control periods late, with every prediction that the route knows enough for.
    """
    config = _own_robots(trial)
    unseen = trial.config.seed + UNSEEN
    table, _ = _learned(config, trial.steps)
    worlds = {"nominal": config}
    worlds |= {
        f"delay_{k}": emulated_world(config, config.seed, family="judging", delay=k) for k in DELAYS
    }
    known = PREDICTIONS if SENSES[config.sensing].metric else ("none",)
    result: dict[str, float] = {}
    for name, world in worlds.items():
        for prediction in known:
            told = replace(world.with_seed(unseen), prediction=prediction)
            numbers = _errors(world, _followed(told, table, trial), slice(None))
            result |= {f"{name}_{prediction}_{key}": value for key, value in numbers.items()}
    return result


def measure_copies(trial: Trial) -> dict[str, float]:
    """Return each follower's errors, on the very robots that learned, with five kinds of weights,
    without and with the cures of an output stage.

    ``own`` are what it learned itself, ``copied`` what the first follower learned, ``last`` what
    the last one learned, ``shared`` one table that all followers learned together, which gets the
    updates of all of them, and ``range`` what the first follower learned behind leaders of many
    speeds.
    """
    config = _own_robots(trial)
    table, _ = _learned(config, trial.steps)
    shared, _ = _learned(replace(config, weights="shared"), trial.steps)
    paces = np.random.default_rng(config.seed).uniform(*PACES, STRETCHES)
    led = (replace(config, leader_speed_mps=pace * config.leader_speed_mps) for pace in paces)
    ranged = _learned_in_turn(led, trial)
    judged = config.with_seed(config.seed + UNSEEN)
    result: dict[str, float] = {}
    for name, weights in (
        ("own", table),
        ("copied", table[:1]),
        ("last", table[-1:]),
        ("shared", shared),
        ("range", ranged[:1]),
    ):
        for cures, options in CURES.items():
            steps = _followed(replace(judged, **options), weights, trial)
            for k in range(config.followers):
                numbers = _errors(judged, steps, slice(k, k + 1))
                result |= {f"{name}_{cures}_{key}_{k + 1}": n for key, n in numbers.items()}
    return result


def measure_warm(trial: Trial) -> dict[str, float]:
    """Return what learning a new task takes and leads to with weights that were learned on the
    nominal one, and without.

    ``trial.config`` is the new task; the old one is the same but for robots, track and the leader's
    speed. ``…_learning_losses`` are those of the first EARLY updates, ``…_updates_to_quiet`` the
    updates before the first QUIET ones without any loss (NaN if there are none in LATER),
    everything else is of a greedy drive with what EARLY updates have made of the weights.
    """
    nominal = ConvoyConfig()
    new = _own_robots(trial)
    old = replace(
        new, body=nominal.body, track=nominal.track, leader_speed_mps=nominal.leader_speed_mps
    )
    table, _ = _learned(old, trial.steps)
    again = new.with_seed(new.seed + UNSEEN)
    judged = new.with_seed(new.seed + 2 * UNSEEN)
    result: dict[str, float] = {}
    for name, begin in (("cold", None), ("warm", table)):
        later, losses = _learned(again, EARLY, begin)
        longer = Convoy(
            again, [again.seed], steps=LATER, horizon=EARLY, policy=begin, threads=1
        ).whole()
        errors = _errors(judged, _followed(judged, later, trial), slice(None))
        result |= {
            f"{name}_learning_losses": float(losses.sum()),
            f"{name}_updates_to_quiet": _quiet_from(longer),
        }
        result |= {f"{name}_{key}": value for key, value in errors.items()}
    return result


def _quiet_from(steps: NDArray[np.void]) -> float:
    """Return the updates, summed over the followers, before the first QUIET ones without any loss;
    NaN if there are none.
    """
    events = steps["event"][:, 1:]
    updates = np.cumsum(np.count_nonzero(events & LEARNED, axis=1))
    lost = updates[np.any(events & LOSS != 0, axis=1)]
    begins = np.append(0, lost)
    ends = np.append(lost, updates[-1])
    long = np.flatnonzero(ends - begins >= QUIET)
    return float(begins[long[0]]) if long.size else math.nan


def measure_gap(trial: Transfer) -> dict[str, float]:
    """Return how a policy follows with noise × 0 to × 5 that learned with noise × 1, or × 0 to × 5
    at random ("randomised").
    """
    config = _own_robots(trial)
    seed = trial.config.seed
    if trial.training == "randomised":
        factors = np.random.default_rng(seed).uniform(
            NOISE_FACTORS[0], NOISE_FACTORS[-1], STRETCHES
        )
        table = _learned_in_turn((with_noise(config, factor) for factor in factors), trial)
    else:
        table, _ = _learned(config, trial.steps)
    result: dict[str, float] = {}
    for factor in NOISE_FACTORS:
        noisy = with_noise(config, factor).with_seed(seed + UNSEEN)
        errors = _errors(noisy, _followed(noisy, table, trial), slice(None))
        result |= {f"{key}_noise_{factor}": value for key, value in errors.items()}
    return result


def with_noise(config: ConvoyConfig, factor: float) -> ConvoyConfig:
    """Return a configuration whose sensors are a factor times as noisy as it says."""
    if config.sensing in INFRARED:
        return replace(
            config, infrared=replace(config.infrared, noise=factor * config.infrared.noise)
        )
    return replace(
        config,
        noise_distance_m=factor * config.noise_distance_m,
        noise_bearing_rad=factor * config.noise_bearing_rad,
    )


def _own_robots(trial: Trial) -> ConvoyConfig:
    return replace(trial.config, fleet=trial.config.seed)


def _learned(
    config: ConvoyConfig, steps: int, table: Table | None = None
) -> tuple[Table, NDArray[np.int64]]:
    """Return the tables after a number of updates, and the losses in every block of control periods
    meanwhile.

    Infrared sees 13 cm: a robot that learns with it alone and gets lost is put back, as somebody
    would in a laboratory.
    """
    config = replace(config, reset="restart") if config.sensing in INFRARED else config
    convoy = Convoy(config, [config.seed], steps=steps, policy=table, threads=1)
    lost = [np.count_nonzero(block["event"][:, 1:] & LOSS) for [block] in convoy.steps()]
    if convoy.updates[0] < steps:
        raise RuntimeError(
            f"seed {config.seed}: only {convoy.updates[0]} of {steps} updates; the followers "
            "were lost"
        )
    return convoy.tables(0)[0], np.array(lost)


def _learned_in_turn(worlds: Iterable[ConvoyConfig], trial: Trial) -> Table:
    """Return the tables after equal stretches of learning in STRETCHES worlds, a new track in
    each.
    """
    table = None
    for k, world in enumerate(worlds):
        table, _ = _learned(
            world.with_seed(ELSEWHERE + STRETCHES * trial.config.seed + k),
            max(trial.steps // STRETCHES, 1),
            table,
        )
    assert table is not None
    return table


def _followed(config: ConvoyConfig, table: Table, trial: Trial) -> NDArray[np.void]:
    """Return the step records of a greedy drive, (periods, robots)."""
    periods = round(trial.minutes * 60 / CONTROL_PERIOD)
    theta = Policy.of(config, table).theta
    return Convoy(config, [config.seed], periods=periods, policy=theta, threads=1).whole()


def _errors(config: ConvoyConfig, steps: NDArray[np.void], who: slice) -> dict[str, float]:
    """Return losses, the share of all time truly inside the bounds, and RMS errors there, of some
    followers together.
    """
    at = steps[:, 1:][:, who]
    distance, bearing = (values[:, who] for values in true_errors(steps))
    inside = within(config, distance, bearing) & (at["phase"] == FOLLOW)
    errors = summary(distance, bearing, inside, wanted_m=config.middle_m)
    return {
        "losses": float(np.count_nonzero(at["event"] & LOSS)),
        "share_inside": float(inside.mean()),
        "rms_distance_error_mm": errors["rms_distance_error_mm"],
        "bias_mm": errors["bias_mm"],
        "ripple_mm": errors["ripple_mm"],
        "rms_bearing_deg": errors["rms_bearing_deg"],
    }
