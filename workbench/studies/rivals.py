"""What do other linear learners do in its place?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.lab.study import Case, Study
from workbench.studies.conditions import with_learner
from workbench.studies.motion_trials import measure_rival

RIVALS = ("greedy-gq", "watkins-q", "expected-sarsa", "qrc", "true-online-sarsa")


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for setting, alphas in (("paper", (0.03, 0.1, 0.3)), ("recommended", (0.1,))):
        base = replace(SETTINGS[setting], drive="planar")
        for rule in RIVALS:
            for alpha in alphas:
                several = (
                    (0.01, 0.1, 1.0)
                    if rule == "greedy-gq" and alpha == 0.1
                    else (1.0 if rule == "qrc" else 0.01,)
                )
                for eta in several:
                    config = with_learner(base, rule=rule, alpha=alpha, eta=eta)
                    used = round(
                        config.learner.beta / alpha, 9
                    )  # rules without a correction have none
                    cases.append(
                        ({"setting": setting, "rule": rule, "eta": used, "alpha": alpha}, config)
                    )
    return cases


STUDY = Study("rivals", __doc__, cases, minutes=10.0, seeds=30, function=measure_rival)
