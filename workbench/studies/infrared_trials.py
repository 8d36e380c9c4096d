"""Trials of followers that see with nothing but infrared: learn, then follow greedily while being
held up again and again.

Everything is judged by true poses, which the followers never learn. The working range is 80 to 130
mm between centres and ±25° (what a configuration names as its bounds). A loss is recovered when its
follower is following again, truly inside the working range of its own predecessor, within ten
seconds.

>>> config = ConvoyConfig(**INFRARED_BASE, drive="planar", sensing="ir-metric", followers=1)
>>> trial = Trial(config=config, steps=500, minutes=1.0)
>>> numbers = measure_infrared(trial)
>>> numbers["holds"], 0 <= numbers["share_inside_last_third"] <= 1
(5.0, True)
"""

import math
from collections.abc import Callable
from dataclasses import fields as names_of, replace

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import BLINDED, GAVE_UP, LOSS
from workbench.formation.policy import Policy
from workbench.formation.reset import FOLLOW
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.lab.trial import Trial
from workbench.measures.errors import summary, true_errors, within
from workbench.robot.geometry import CONTROL_PERIOD

WITHIN = round(10.0 / CONTROL_PERIOD)  # control periods in which a loss has to be over
# times the control periods that undisturbed learning takes, after which a run ends unfinished
PATIENCE = 2
HOLDS_PER_MINUTE = 5
LONGEST_HOLD = round(1.0 / CONTROL_PERIOD)
INFRARED_BASE = {
    field.name: getattr(SETTINGS["infrared"], field.name) for field in names_of(ConvoyConfig)
}
for _name in ("drive", "sensing", "followers"):
    INFRARED_BASE.pop(_name)


def measure_infrared(trial: Trial) -> dict[str, float]:
    """Return shares inside the working range, errors in mm and degrees, losses and recoveries,
    learning and held up.
    """
    periods = PATIENCE * trial.steps // trial.config.followers + 1
    convoy = Convoy(
        trial.config, [trial.config.seed], steps=trial.steps, periods=periods, threads=1
    )
    steps = convoy.whole()
    late = steps[2 * len(steps) // 3 :]
    distance, bearing = true_errors(late)
    inside = within(trial.config, distance, bearing)
    following = within(trial.config, *true_errors(steps)) & (steps["phase"][:, 1:] == FOLLOW)
    recovered, losses = recoveries(steps["event"][:, 1:], following)
    errors = summary(distance, bearing, inside, wanted_m=trial.config.middle_m)
    theta, _ = convoy.tables(0)
    alone = replace(trial.unseen, followers=1)
    return {
        "updates": float(convoy.updates[0]),
        "share_inside_last_third": float(inside.mean()),
        "share_inside_worst_follower": float(inside.mean(axis=0).min()),
        "rms_distance_error_mm": errors["rms_distance_error_mm"],
        "bias_mm": errors["bias_mm"],
        "ripple_mm": errors["ripple_mm"],
        "bearing_std_deg": errors["bearing_std_deg"],
        "losses": float(losses),
        "recovered_within_10_s": recovered / losses if losses else math.nan,
        "losses_last_third": float(np.count_nonzero(late["event"][:, 1:] & LOSS)),
        "gave_up": float(np.count_nonzero(steps["event"][:, 1:] & GAVE_UP)),
        "share_blinded": float(np.mean(steps["event"][:, 1:] & BLINDED != 0)),
    } | _held_up(alone, Policy.of(trial.config, theta[:1]), trial)


def recoveries(events: NDArray[np.int16], following: NDArray[np.bool_]) -> tuple[int, int]:
    """Return how many losses ended within ten seconds, and how many there were; losses of the last
    ten seconds do not count.

    Args:
        events: (periods, followers) of PERIOD.event.
        following: (periods, followers), whether a follower follows, truly inside its working range.
    """
    recovered = losses = 0
    for event, follows in zip(events.T, following.T, strict=True):
        back = np.flatnonzero(follows)
        lost = np.flatnonzero(event & LOSS)
        lost = lost[lost + WITHIN < len(event)]
        next_back = np.append(back, len(event) + WITHIN)[np.searchsorted(back, lost, side="left")]
        losses += len(lost)
        recovered += int(np.count_nonzero(next_back - lost <= WITHIN))
    return recovered, losses


def _start(robot: SimulatedRobot, config: ConvoyConfig, policy: Policy) -> SoloFollower:
    if config.infrared.calibrated:
        robot.calibrate_proximity_sensors()
    return SoloFollower(config, policy)


def _recovers(follow: Callable[[], bool], follower: SoloFollower) -> tuple[bool, bool]:
    """Return whether a follower loses the leader after a hold, and whether it is back in time."""
    gone = False
    for period in range(WITHIN):
        back = follow()
        gone = gone or bool(follower.step["event"] & LOSS)
        if back and (gone or period >= LONGEST_HOLD):
            return gone, True
    return gone, False


def _held_up(config: ConvoyConfig, policy: Policy, trial: Trial) -> dict[str, float]:
    """Follow greedily behind one leader, held still for up to a second again and again; count what
    recovers in ten seconds.
    """
    rng = np.random.default_rng([config.seed, *b"holds"])
    count = max(1, round(HOLDS_PER_MINUTE * trial.minutes))
    recovered = 0
    lost = 0
    with SimulatedRobot(config) as robot:
        robot.enable("proximity", "light")
        follower = _start(robot, config, policy)

        def follow() -> bool:
            robot.step()
            robot.set_motors_speed(
                *follower.decide(robot.get_proximity(), robot.get_light_sensor())
            )
            return bool(
                follower.record["reset"]["phase"] == FOLLOW
                and within(config, *map(np.asarray, robot.true_errors()))
            )

        for _ in range(count):
            for _ in range(int(rng.integers(20, 60))):
                follow()
            for _ in range(int(rng.integers(1, LONGEST_HOLD + 1))):
                robot.set_motors_speed(0, 0)
                robot.step()
            gone, back = _recovers(follow, follower)
            lost += gone
            recovered += back
            if not back:  # the leader is gone: the next hold begins behind it again
                robot.reset()
                follower = _start(robot, config, policy)
    return {
        "holds": float(count),
        "holds_recovered": recovered / count,
        "holds_that_lost": lost / count,
    }
