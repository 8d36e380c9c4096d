"""What does the reward decide, and the punishment of a loss?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    presets = ("quadratic", "absolute", "distance", "alive")
    cases = [
        ({"reward": name, "terminal_factor": 1.0, "theta0": -0.1}, replace(BASE, reward=name))
        for name in presets
    ]
    for factor in (2.0, 10.0):
        cases.append(
            (
                {"reward": "quadratic", "terminal_factor": factor, "theta0": -0.1},
                replace(BASE, terminal_factor=factor),
            )
        )
    optimistic = {
        "quadratic": 0.0,
        "absolute": 0.0,
        "distance": 0.0,
        "alive": 5.0,
    }  # no reward sums up to more: 1 / (1 - γ) = 5
    for name, theta0 in optimistic.items():
        label = {"reward": name, "terminal_factor": 1.0, "theta0": theta0}
        cases.append((label, with_learner(replace(BASE, reward=name), theta0=theta0)))
    return cases


STUDY = Study("rewards", __doc__, cases)
