"""Learning rules as data: which target policy, which ratio ρ and which step sizes make a learner of
the one kernel, and which rule has an update of its own.

    rule                target                              ρ               β     κ
    greedy-gq           the greedy policy                   1/b or 0        αη    0   (the paper's)
    watkins-q           the greedy policy                   1 or 0          0     0
    expected-sarsa      the ε-greedy behaviour, expected    1               0     0
    qrc                 the greedy policy                   1/b or 0        αη    1   (η = 1 there)
    true-online-sarsa   the ε-greedy behaviour, sampled     its own update (``learning.sarsa``)

QRC(λ): Ghiassian et al., ICML 2020. A rule more is a row more, and a function where it has an
update of its own.
"""

from typing import NamedTuple

GREEDY, EXPECTED, SAMPLED = range(3)  # targets: whose value the next state has
IMPORTANCE, GREEDY_ONLY, ON_POLICY = range(3)  # ratios ρ of the action that was taken


class Rule(NamedTuple):
    """What makes a learning rule.

    Attributes:
        target: GREEDY, EXPECTED or SAMPLED.
        ratio: IMPORTANCE (1/b or 0), GREEDY_ONLY (1 or 0) or ON_POLICY (1).
        corrected: whether it has a gradient correction with secondary weights.
        kappa: regularisation of these weights.
        true_online: whether the update is that of ``learning.sarsa`` instead of the kernel's.
    """

    target: int
    ratio: int
    corrected: bool
    kappa: float = 0.0
    true_online: bool = False


RULES = {
    "greedy-gq": Rule(GREEDY, IMPORTANCE, corrected=True),
    "watkins-q": Rule(GREEDY, GREEDY_ONLY, corrected=False),
    "expected-sarsa": Rule(EXPECTED, ON_POLICY, corrected=False),
    "qrc": Rule(GREEDY, IMPORTANCE, corrected=True, kappa=1.0),
    "true-online-sarsa": Rule(SAMPLED, IMPORTANCE, corrected=False, true_online=True),
}
