"""Learning rules as data: which target policy, which ratio ρ and which step sizes make a learner of
the one kernel, and which rule has an update of its own.

    rule                target                              ρ               β     κ
    greedy-gq           the greedy policy                   1/b or 0        αη    0   (the paper's)
    watkins-q           the greedy policy                   1 or 0          0     0
    expected-sarsa      the ε-greedy behaviour, expected    1               0     0
    qrc                 the greedy policy                   1/b or 0        αη    1   (η = 1 there)
    true-online-sarsa   the ε-greedy behaviour, sampled     its own update (``learning.sarsa``)

QRC(λ): Ghiassian et al., ICML 2020. A rule more is a row more, and a function where it has an
update of its own; with a parameter of its own also a field of LearnerConfig and of LEARNER in
``formation.follower``.
"""

from typing import Any, NamedTuple

from workbench.compiled import chosen, compiled
from workbench.learning.kernel import gq_update
from workbench.learning.sarsa import sarsa_update

GREEDY, EXPECTED, SAMPLED = range(3)  # targets: whose value the next state has
IMPORTANCE, GREEDY_ONLY, ON_POLICY = range(3)  # ratios ρ of the action that was taken


@compiled
def gq_step(
    learner: Any,
    n: int,
    phi: Any,
    bar: Any,
    signal: Any,
    decay: float,
    gamma: float,
    lam: float,
    memory: float,
    sizes: Any,
) -> tuple[int, float, float, float]:
    """Learn a transition as ``kernel.gq_update`` does; its arguments, and the number that the last
    call handed on.

    Returns:
        (n, δ_t, memory, w·e_t): the trace's new length, the temporal-difference error, what the
        next call is handed, and the correction's factor.
    """
    n, delta, w_e = gq_update(learner, n, phi, bar, signal, decay, gamma, lam, sizes)
    return n, delta, memory, w_e


@compiled
def sarsa_step(
    learner: Any,
    n: int,
    phi: Any,
    bar: Any,
    signal: Any,
    decay: float,
    gamma: float,
    lam: float,
    memory: float,
    sizes: Any,
) -> tuple[int, float, float, float]:
    """Learn a transition as ``sarsa.sarsa_update`` does; see ``gq_step``."""
    n, delta, memory = sarsa_update(
        learner, n, phi, bar, signal.reward, decay, gamma, memory, sizes
    )
    return n, delta, memory, 0.0


class Rule(NamedTuple):
    """What makes a learning rule.

    Attributes:
        target: GREEDY, EXPECTED or SAMPLED.
        ratio: IMPORTANCE (1/b or 0), GREEDY_ONLY (1 or 0) or ON_POLICY (1).
        corrected: whether it has a gradient correction with secondary weights.
        kappa: regularisation of these weights.
        update: the compiled function that learns a transition, see ``gq_step``.
        remembers: whether the update hands a number on to its next call.
    """

    target: int
    ratio: int
    corrected: bool
    kappa: float = 0.0
    update: Any = gq_step
    remembers: bool = False


RULES = {
    "greedy-gq": Rule(GREEDY, IMPORTANCE, corrected=True),
    "watkins-q": Rule(GREEDY, GREEDY_ONLY, corrected=False),
    "expected-sarsa": Rule(EXPECTED, ON_POLICY, corrected=False),
    "qrc": Rule(GREEDY, IMPORTANCE, corrected=True, kappa=1.0),
    "true-online-sarsa": Rule(
        SAMPLED, ON_POLICY, corrected=False, update=sarsa_step, remembers=True
    ),
}

UPDATES = list(dict.fromkeys(rule.update for rule in RULES.values()))
update = chosen(UPDATES)
