"""What a log says of a policy that did not make it: off-policy evaluation, and learning from a log
with Greedy-GQ(λ).

A log has, step by step, the state, the action and the probability with which the behaviour took it;
reward and next state are read from the next row. ``log_of`` makes one from a recording: readings go
through the follower's own perception.

The value of a policy is its mean discounted return from the states that the log visits.
``evaluate_log`` estimates it doubly robustly (Jiang and Li 2016), backwards through every stretch
of steps, with the policy's own values Q and V(s) = Q(s, π(s)):

    v_t = V(s_t) + ρ_t (r_{t+1} + γ v_{t+1} - Q(s_t, a_t))   ρ_t = π(a_t | s_t) / b(a_t | s_t)

with π greedy.

With Q = 0 that is per-decision importance sampling, reported beside it. Intervals: bootstrap over
blocks of the log.

Contract: behaviour probabilities are those that were logged; importance ratios and the effective
sample size are part of the result, so that nobody has to trust an estimate that rests on a few
steps.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled
from workbench.formation.config import ConvoyConfig
from workbench.formation.follower import reward_at, sense_cells
from workbench.formation.policy import Policy
from workbench.formation.records import ROBOT
from workbench.formation.senses.infrared import UNSEEN, look
from workbench.formation.senses.table import INFRARED
from workbench.formation.task import fill_task
from workbench.learning.gq import GreedyGQ
from workbench.logs.recordings import Recording
from workbench.robot.infrared import DARK, SENSORS

BLOCK = 300  # steps of the log that are resampled together: 30 s
RESAMPLES = 2000

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Log:
    """Steps in the order in which they were made.

    Attributes:
        state, action: (n,) indices.
        probability: (n,) with which the behaviour took the action.
        reward: (n,) of the step.
        next_state: (n,) -1 where the step ended an episode.
        ends: (n,) whether the next row is not the next step: a terminal, or the log breaks off.
    """

    state: NDArray[np.int64]
    action: NDArray[np.int64]
    probability: Floats
    reward: Floats
    next_state: NDArray[np.int64]
    ends: NDArray[np.bool_]


@compiled
def _perceive(task: Any, robot: Any, readings: Any, light: Any, states: Any, rewards: Any) -> None:
    for t in range(readings.shape[0]):
        for k in range(readings.shape[1]):
            robot[0].infrared.readings[k] = readings[t, k]
            robot[0].infrared.headroom[k] = light[t, k]
        distance, bearing = look(task[0], robot[0])
        e_d = distance - task[0].bounds.middle
        states[t] = -1
        rewards[t] = task[0].reward.terminal
        if distance < UNSEEN:
            states[t] = sense_cells(task[0], robot[0], e_d, bearing)
        if states[t] >= 0:
            rewards[t] = reward_at(task[0], robot[0], e_d, bearing)


def perceive(
    config: ConvoyConfig, readings: Floats, light: Floats | None = None
) -> tuple[NDArray[np.int64], Floats]:
    """Return the state (-1 outside the bounds) and the reward of arriving there, each (n,), for
    calibrated readings.

    Args:
        config: with sensing by infrared.
        readings: (n, 8) counts; light: (n, 8) ambient counts, dark if left out.

    Raises:
        ValueError: another sensing, readings of another shape or not finite.
    """
    if config.sensing not in INFRARED:
        raise ValueError(
            f"sensing = {config.sensing!r}; readings are perceived with one of "
            f"{', '.join(map(repr, INFRARED))}"
        )
    seen = np.ascontiguousarray(readings, dtype=np.float64)
    if seen.ndim != 2 or seen.shape[1] != SENSORS or not np.all(np.isfinite(seen)):
        raise ValueError(f"readings have shape {seen.shape}; expected (n, {SENSORS}) finite counts")
    states = np.zeros(len(seen), np.int64)
    rewards = np.zeros(len(seen))
    ambient = (
        np.full_like(seen, DARK) if light is None else np.ascontiguousarray(light, dtype=np.float64)
    )
    if ambient.shape != seen.shape or not np.all(np.isfinite(ambient)):
        raise ValueError(f"light has shape {ambient.shape}; expected {seen.shape}, finite counts")
    _perceive(fill_task(config, 0), np.zeros(1, ROBOT), seen, ambient, states, rewards)
    return states, rewards


def log_of(recording: Recording) -> Log:
    """Return the steps that a recorded follower made; rows without an action, such as those of a
    reset, are left out.

    Raises:
        ValueError: the recording has no configuration, no proximity readings, an output stage, or
            states that its readings do not give.
    """
    config = recording.config
    if config is None or "proximity" not in recording.sensors:
        raise ValueError(
            "the recording has no follower's configuration or no proximity readings; record a drive"
        )
    for name, value, plain in (
        ("output", config.output, "greedy"),
        ("trim", config.trim, 0.0),
        ("filter", config.filter, "none"),
        ("prediction", config.prediction, "none"),
    ):
        if value != plain:
            raise ValueError(
                f"ConvoyConfig.{name} = {value!r}; the recorded robot did not drive by the action "
                f"of the state that it read: expected a drive with {name} = {plain!r}"
            )
    frame = recording.frame
    light = (
        frame[[f"light{k}" for k in range(SENSORS)]].to_numpy(float)
        if "light" in recording.sensors
        else None
    )
    states, rewards = perceive(
        config, frame[[f"ps{k}" for k in range(SENSORS)]].to_numpy(float), light
    )
    acted = (frame["action"].to_numpy() >= 0) & (frame["phase"].to_numpy() == 0)
    wrong = np.flatnonzero(acted & (states != frame["state"].to_numpy()))
    if wrong.size:
        row = int(wrong[0])
        raise ValueError(
            f"row {row + 1}, column state: {frame['state'].iloc[row]}; its readings give "
            f"{states[row]}: the recording was made "
            "with another configuration than its sidecar says"
        )
    return make_log(
        states, frame["action"].to_numpy(), frame["probability"].to_numpy(float), rewards, acted
    )


def make_log(
    states: NDArray[np.int64],
    actions: NDArray[np.int64],
    probabilities: Floats,
    rewards: Floats,
    acted: NDArray[np.bool_],
) -> Log:
    """Return the log of rows in order: a step is a row with an action, its reward and next state
    are the next row's.
    """
    steps = np.flatnonzero(acted[:-1])
    after = steps + 1
    ends = (states[after] < 0) | ~acted[after]
    ends[-1:] = True
    return Log(
        states[steps], actions[steps], probabilities[steps], rewards[after], states[after], ends
    )


def ratios(log: Log, policy: Policy, *, table: int = 0) -> Floats:
    """Return ρ of every step for the greedy policy, (n,)."""
    greedy = policy.greedy()[table]
    return np.where(log.action == greedy[log.state], 1.0 / log.probability, 0.0)


def _check_resampled(log: Log, policy: Policy) -> None:
    """Refuse a log or a policy that cannot be evaluated block by block."""
    if int(policy.tilings) != 1:
        raise ValueError(
            f"the policy has {int(policy.tilings)} tilings; expected one: a log stores one state"
        )
    _check(log, policy.theta.shape[1], policy.theta.shape[2])
    if len(log.state) < 2 * BLOCK:
        raise ValueError(
            f"the log has {len(log.state)} steps; expected at least {2 * BLOCK}, two blocks "
            "to resample"
        )


def evaluate_log(
    log: Log, policy: Policy, *, gamma: float, table: int = 0, level: float = 0.95, seed: int = 0
) -> dict[str, float]:
    """Return the value of the greedy policy from the log's states, its interval, and how much the
    log supports it.

    Args:
        log: what the behaviour did.
        policy: with one tiling; its own action values make the estimate doubly robust.
        gamma: discount.
        table: which table of the policy.
        level: of the interval (percentile bootstrap over blocks of 30 s).

    Returns:
        "value", "low", "high" (doubly robust), "sampled" (importance sampling alone), "steps",
        "mean_ratio" (1 where logged probabilities are right), "effective_share" of the steps
        (Kish), for weights over 1 / (1 - γ) steps.

    Raises:
        ValueError: several tilings, fewer steps than two blocks, probabilities that are none.
    """
    if not (0 <= gamma < 1 and 0 < level < 1 and 0 <= table < policy.theta.shape[0]):
        raise ValueError(
            f"gamma = {gamma!r}, level = {level!r}, table = {table!r}; expected a discount "
            "below 1, a level between 0 and 1 and "
            f"one of {policy.theta.shape[0]} tables"
        )
    _check_resampled(log, policy)
    values = policy.theta[table]
    greedy = policy.greedy()[table]
    rho = ratios(log, policy, table=table)
    q = values[log.state, log.action]
    v = values[np.arange(len(values)), greedy]
    robust = _backwards(log, rho, gamma, q, v)
    sampled = _backwards(log, rho, gamma, np.zeros_like(q), np.zeros_like(v))
    blocks = np.array_split(robust, max(2, len(robust) // BLOCK))
    sums = np.array([part.sum() for part in blocks])
    sizes = np.array([len(part) for part in blocks])
    picks = np.random.default_rng(seed).integers(0, len(blocks), (RESAMPLES, len(blocks)))
    means = sums[picks].sum(axis=1) / sizes[picks].sum(axis=1)
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    weights = _products(log, rho, max(1, round(1 / (1 - gamma))))
    return {
        "value": float(robust.mean()),
        "low": float(low),
        "high": float(high),
        "sampled": float(sampled.mean()),
        "steps": float(len(robust)),
        "mean_ratio": float(rho.mean()),
        "effective_share": float(
            weights.sum() ** 2 / max(np.sum(weights**2), 1e-300) / len(weights)
        ),
    }


def _backwards(log: Log, rho: Floats, gamma: float, q: Floats, v: Floats) -> Floats:
    """Return the doubly robust estimate from every step on; where the log breaks off, V of the next
    state stands for the rest.

    Returns are not cut: of γ = 0.8 nothing is left after 500 steps.
    """
    estimate = np.zeros(len(rho))
    following = 0.0
    for t in range(len(rho) - 1, -1, -1):
        if log.ends[t]:
            following = 0.0 if log.next_state[t] < 0 else float(v[log.next_state[t]])
        following = v[log.state[t]] + rho[t] * (log.reward[t] + gamma * following - q[t])
        estimate[t] = following
    return estimate


def _products(log: Log, rho: Floats, length: int) -> Floats:
    """Return from every step on the product of ρ over a number of steps, or up to where the episode
    or the log ends before.
    """
    product = rho.copy()
    alive = ~log.ends
    for k in range(1, length):
        product[:-k] *= np.where(alive[:-k], rho[k:], 1.0)
        alive[:-k] &= ~log.ends[k:]
        alive[-k:] = False
    return product


def _check(log: Log, rows: int, actions: int) -> None:
    """Raise ValueError unless a log's states and actions are those of a table, with probabilities
    and rewards that are some.
    """
    if len(log.state) and not (
        0 <= log.state.min() and max(log.state.max(), log.next_state.max()) < rows
    ):
        raise ValueError(
            f"the log has states {log.state.min()} to {log.state.max()}; expected those of a "
            f"table of {rows} rows"
        )
    if len(log.action) and not 0 <= log.action.min() <= log.action.max() < actions:
        raise ValueError(
            f"the log has actions {log.action.min()} to {log.action.max()}; expected 0 to "
            f"{actions - 1}"
        )
    if not np.all((log.probability > 0) & (log.probability <= 1)):
        raise ValueError(
            "the log has probabilities outside (0, 1]; importance sampling needs those of the "
            "actions that were taken"
        )
    if not np.all(np.isfinite(log.reward)):
        raise ValueError("the log has rewards that are not finite")


def learn_from_log(log: Log, config: ConvoyConfig, *, passes: int = 1) -> Policy:
    """Return what Greedy-GQ(λ) learns from a log, with the logged probabilities as importance
    ratios.

    Args:
        log: what the behaviour did.
        config: tiles, actions and learner, one tiling.
        passes: how often it goes through the log.
    """
    learner = config.learner
    if config.tilings != 1 or learner.rule != "greedy-gq" or passes < 1:
        raise ValueError(
            f"tilings = {config.tilings!r}, learner.rule = {learner.rule!r}, passes = "
            f"{passes!r}; expected 1, 'greedy-gq' and at "
            "least 1"
        )
    _check(log, config.rows, config.action_count)
    gq = GreedyGQ(
        config.rows,
        config.action_count,
        alpha=learner.alpha,
        beta=learner.beta,
        gamma=learner.gamma,
        lam=learner.lam,
        cutoff=learner.trace_cutoff,
        theta0=learner.theta0,
    )
    for _ in range(passes):
        gq.begin_episode()
        for t in range(len(log.state)):
            s = int(log.state[t])
            a = int(log.action[t])
            after = int(log.next_state[t])
            rho = 1.0 / float(log.probability[t]) if gq.greedy(s) == a else 0.0
            gq.update(s, a, float(log.reward[t]), after if after >= 0 else None, rho=rho)
            if log.ends[t]:
                gq.begin_episode()
    return Policy.of(config, gq.theta[None].copy())
