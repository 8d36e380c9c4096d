"""Which of λ, γ, α, η, θ₀ and the ε schedule matter?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.learning.config import PRESETS
from workbench.studies.conditions import BASE, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    values: dict[str, Sequence[float]] = {
        "lam": (0.0, 0.4, 0.6, 0.8, 0.9, 1.0),
        "gamma": (0.0, 0.5, 0.7, 0.8, 0.9, 0.95),
        "alpha": (0.01, 0.03, 0.1, 0.3, 0.6),
        "eta": (0.0, 0.01, 0.1, 1.0),
        "theta0": (-1.0, -0.3, -0.1, -0.03, 0.0),
    }
    cases = [
        ({"factor": n, "level": f"{v:g}"}, with_learner(BASE, **{n: v}))
        for n, several in values.items()
        for v in several
    ]
    schedules: dict[str, dict[str, float | str]] = {
        "0.05 → 0.01": {},
        "0.05 → 0": {"epsilon_final": 0.0},
        "0.2 → 0.01": {"epsilon": 0.2},
        "0.05 → 0.01, exponential": {"epsilon_schedule": "exponential"},
        "0.05": {"epsilon_schedule": "constant"},
        "0.01": {"epsilon_schedule": "constant", "epsilon": 0.01},
        "0": {"epsilon_schedule": "constant", "epsilon": 0.0},
    }
    cases += [
        ({"factor": "epsilon", "level": name}, with_learner(BASE, **changes))
        for name, changes in schedules.items()
    ]
    return cases + [
        ({"factor": "preset", "level": name}, replace(BASE, learner=learner))
        for name, learner in PRESETS.items()
    ]


STUDY = Study("parameters", __doc__, cases)
