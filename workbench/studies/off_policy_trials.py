"""Trials of off-policy evaluation: what a log of an exploring follower says of its greedy policy,
beside what that policy does.

The follower explores with a fixed ε around a learned policy and writes a log. The truth is found by
doing it: the same robot drives on exploring, then suddenly greedily, again and again; the mean
discounted return of the greedy stretches is the policy's value from the states that the log visits.
Returns are summed over 60 steps; of a horizon of 500 the rest weighs less than 10⁻⁵ at γ = 0.8.

>>> from workbench.formation.config import SETTINGS
>>> config = replace(SETTINGS["infrared"], sensing="ir-raw", followers=1, drive="planar")
>>> policy = Policy.of(config, np.zeros((1, config.rows, config.action_count)))
>>> log = Driver(config, policy).log(epsilon=0.5, periods=200)
>>> len(log.state) > 20, bool(np.all(log.probability > 0))
(True, True)

Contract: nothing is learned while a log is written; estimate and truth are of the same robot,
sensors and track.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import LOSS
from workbench.formation.policy import Policy
from workbench.formation.simulated import SimulatedRobot
from workbench.formation.solo import SoloFollower
from workbench.lab.runs import UNSEEN, learn
from workbench.lab.trial import Trial
from workbench.measures.off_policy import Log, evaluate_log, make_log

EPSILON = 0.1
PERIODS = 12_000  # control periods of the log: twenty minutes
# greedy stretches for the truth, steps of each
STRETCHES = 4_000
LENGTH = 60


class Driver:
    """A follower of a learned policy on a simulated robot, exploring as much as it is told.

    Args:
        config: one follower with infrared.
        policy: what it follows.
    """

    def __init__(self, config: ConvoyConfig, policy: Policy) -> None:
        self._robot = SimulatedRobot(config)
        self._robot.connect()
        self._robot.enable("proximity", "light")
        self._robot.calibrate_proximity_sensors()
        self._follower = SoloFollower(config, policy)
        self._chance = np.random.default_rng([config.seed, *b"stretches"])

    def log(self, *, epsilon: float, periods: int) -> Log:
        """Drive on, exploring, and return the log."""
        rows = [self._step(epsilon) for _ in range(periods)]
        states, actions = (np.array([row[k] for row in rows], np.int64) for k in (0, 1))
        probabilities, rewards = (np.array([row[k] for row in rows]) for k in (2, 3))
        return make_log(states, actions, probabilities, rewards, states >= 0)

    def returns(self, *, epsilon: float, gamma: float, stretches: int) -> NDArray[np.float64]:
        """Drive on and return discounted returns of greedy stretches that begin where exploring
        happens to lead, (stretches,).
        """
        found: list[float] = []
        while len(found) < stretches:
            for _ in range(int(self._chance.integers(20, 60))):
                self._step(epsilon)
            if self._step(0.0)[0] < 0:
                continue  # in a reset, which is no state of a log
            total = 0.0
            weight = 1.0
            for _ in range(LENGTH):
                total = total + weight * self._step(0.0)[3]
                weight = weight * gamma
                if self._follower.step["event"] & LOSS:
                    break
            found.append(total)
        return np.array(found)

    def _step(self, epsilon: float) -> tuple[int, int, float, float]:
        """Drive a control period; return state and action (-1: none), the action's probability, and
        the reward of arriving.
        """
        follower = self._follower
        follower.epsilon = epsilon
        self._robot.step()
        self._robot.set_motors_speed(
            *follower.decide(self._robot.get_proximity(), self._robot.get_light_sensor())
        )
        state = int(follower.record["choice"]["state"])
        return (
            state,
            int(follower.record["choice"]["action"]) if state >= 0 else -1,
            follower.probability,
            float(follower.step["reward"]),
        )


def measure_off_policy(trial: Trial) -> dict[str, float]:
    """Return estimate, interval, support and truth of the greedy value of a policy that was learned
    on this trial.
    """
    config = replace(trial.config, followers=1)
    gamma = trial.config.learner.gamma
    policy = learn(config, steps=trial.steps, progress=False).policy
    assert isinstance(policy, Policy)
    driver = Driver(config.with_seed(config.seed + UNSEEN), policy)
    found = evaluate_log(
        driver.log(epsilon=EPSILON, periods=PERIODS), policy, gamma=gamma, seed=config.seed
    )
    truth = driver.returns(epsilon=EPSILON, gamma=gamma, stretches=STRETCHES)
    half = (found["high"] - found["low"]) / 2
    return found | {
        "half_width_share": half / abs(found["value"]),
        "truth": float(truth.mean()),
        "truth_error": float(truth.std(ddof=1) / np.sqrt(len(truth))),
        "contains_truth": float(found["low"] <= truth.mean() <= found["high"]),
    }
