"""How far is what was learned from the best that its table could do?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from workbench.formation.config import SETTINGS, ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.formation.follower import LOSS
from workbench.formation.laws.table import Controller, quantised_carrot
from workbench.formation.policy import Policy
from workbench.formation.reward import terminal_reward, worst_step_reward
from workbench.lab.runs import UNSEEN, evaluate
from workbench.lab.study import Case, Rows, Study
from workbench.lab.trial import Trial
from workbench.learning.config import LearnerConfig
from workbench.measures.comparisons import difference
from workbench.plots.comparisons import dot_panels
from workbench.studies.calm_trials import MAIN, OUTPUTS, judged

EXPLORING = 0.5  # share of random actions while transitions are counted
COUNTED = 2_000_000  # transitions
SWEEPS = 200  # of value iteration: γ to that power is nothing

Counts = NDArray[np.float64]


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        (
            {"setting": name},
            replace(SETTINGS[name], drive="rolling", followers=1, output="greedy", trim=0.0),
        )
        for name in ("paper", "paper-robot", "recommended")
    ]


def transitions(config: ConvoyConfig, theta: Counts, steps: int) -> tuple[Counts, Counts]:
    """Return how often every state and action led to every state, and to a loss (last column),
    (states, actions, states + 1), and their mean rewards, (states, actions); counted while a
    follower explores about a policy that it does not change.
    """
    exploring = LearnerConfig(alpha=1e-9, lam=0.0, epsilon=EXPLORING, epsilon_schedule="constant")
    convoy = Convoy(
        replace(config, learner=exploring), [config.seed], steps=steps, policy=theta, threads=1
    )
    states, actions = config.grid().n, config.action_count
    counts = np.zeros((states * actions, states + 1))
    rewards = np.zeros(states * actions)
    last: NDArray[np.void] | None = None
    for [block] in convoy.steps():
        at = block[:, 1] if last is None else np.concatenate([last, block[:, 1]])
        last = at[-1:].copy()
        begun, after = at[:-1], at[1:]
        ended = begun["event"] & LOSS != 0
        # a transition is recorded when it has ended; its next state is where the next one begins
        kept = (begun["state"] >= 0) & (ended | (after["state"] >= 0))
        pair = begun["state"][kept].astype(int) * actions + begun["action"][kept]
        to = np.where(ended, states, after["state"])[kept]
        np.add.at(counts, (pair, to), 1)
        np.add.at(rewards, pair, begun["reward"][kept])
    seen = np.maximum(counts.sum(axis=1), 1)
    shape = (states, actions)
    return counts.reshape(*shape, states + 1), (rewards / seen).reshape(shape)


def optimal_values(counts: Counts, rewards: Counts, gamma: float, terminal: float) -> Counts:
    """Return the action values of the optimal policy of a finite MDP with these counts, by value
    iteration (Sutton & Barto, 2nd ed., section 4.4); what was never tried counts as a loss.
    """
    total = counts.sum(axis=2)
    chance = counts[:, :, :-1] / np.maximum(total, 1)[:, :, None]
    step = np.where(total > 0, rewards, terminal)
    values = np.zeros_like(rewards)
    for _ in range(SWEEPS):
        values = step + gamma * chance @ values.max(axis=1)
    return values


def measure_bound(trial: Trial) -> dict[str, float]:
    """Return drives by the learned table, by the optimal one of the estimated MDP, and by the
    carrot on the same tiles and levels, greedy and calm.
    """
    config = trial.config
    convoy = Convoy(config, [config.seed], steps=trial.steps, threads=1)
    convoy.whole()
    learned, _ = convoy.tables(0)
    counts, rewards = transitions(config, learned, COUNTED if trial.steps > 10_000 else 20_000)
    terminal = terminal_reward(
        worst_step_reward(config.reward), config.learner.gamma, config.terminal_factor
    )
    best = optimal_values(counts, rewards, config.learner.gamma, terminal)
    drivers: dict[str, Controller] = {
        "learned": Policy.of(config, learned),
        "optimal": Policy.of(config, best[None]),
        "quantised carrot": quantised_carrot(config),
    }
    found = {"pairs_tried": float((counts.sum(axis=2) > 0).mean())}
    world = config.with_seed(config.seed + UNSEEN)
    for who, driver in drivers.items():
        for name, output in (("greedy", "greedy"), ("calm", MAIN)):
            options = OUTPUTS[output]
            told = replace(world, **options)
            found |= {
                f"{who}|{name}|{key}": value
                for key, value in judged(driver, told, trial.minutes).items()
            }
            run = evaluate(driver, told, minutes=trial.minutes, progress=False)
            found[f"{who}|{name}|mean_reward"] = float(run.summary["mean_reward"])
    return found


TICKS = ((0.001, 0.01, 0.1), (0.5, 1, 2, 5, 10, 20), (1, 2, 5, 10, 20, 50))
PANELS = {
    "cost": "− mean reward per step",
    "rms_distance_error_mm": "RMS distance error in mm",
    "turning": "turning above 1 Hz in °/s",
}


def drives(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row per setting, driver, output and seed; ``cost`` is what a step costs on
    average.
    """
    rows = table[table["driver"].notna()]
    return rows.assign(cost=-rows["mean_reward"])


def short_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return how much more a step costs than with the optimal table, by setting, driver and output,
    paired by seed.
    """
    keys = ["setting", "output", "driver"]
    return difference(drives(table), keys, "cost", {"driver": "optimal"})


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw cost, error and turning of the three tables, greedy and calm."""
    rows = drives(table)
    driver = rows["driver"].replace("quantised carrot", "carrot")
    name = rows["setting"] + ", " + driver + ", " + rows["output"]
    fig = dot_panels(rows.assign(name=name), "name", PANELS, size=(11.4, 5.2))
    fig.set_layout_engine("constrained", w_pad=0.2)
    for ax, ticks in zip(fig.axes, TICKS, strict=True):
        ax.set_xscale("log")
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.minorticks_off()
    return fig, short_of(table)


ROWS = Rows(
    ("driver", "output"),
    {
        (who, output): f"{who}|{output}|{{}}"
        for who in ("learned", "optimal", "quantised carrot")
        for output in ("greedy", "calm")
    },
)
STUDY = Study(
    "bound",
    __doc__,
    cases,
    function=measure_bound,
    steps=100_000,
    rows=ROWS,
    plots={"value_iteration_bound": plot},
)
