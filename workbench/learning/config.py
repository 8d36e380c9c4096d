"""The learner's parameters.

The paper gives none of them: all defaults are our choice (see the README's limits).
"""

from workbench.fields import choice, configuration, flag, real
from workbench.learning.behaviour import SCHEDULES
from workbench.learning.rules import RULES, SAMPLED


@configuration
class LearnerConfig:
    """Parameters of the learner, by default Greedy-GQ(λ), and of its ε-greedy behaviour."""

    rule: str = choice(
        tuple(RULES), "learning rule: the paper's, or one of its rivals", default="greedy-gq"
    )
    alpha: float = real(
        1e-9, 1.0, "", "main step size α, shared out among the tilings", default=0.1
    )
    eta: float = real(
        0.0, 100.0, "", "ratio η of the secondary to the main step size, β = αη", default=0.01
    )
    gamma: float = real(0.0, 0.9999, "", "discount γ", default=0.8)
    lam: float = real(0.0, 1.0, "", "trace decay λ", default=0.8)
    theta0: float = real(
        -1e6, 1e6, "", "initial action value θ₀, shared out among the tilings", default=-0.1
    )
    epsilon: float = real(0.0, 1.0, "", "exploration rate ε at the start", default=0.05)
    epsilon_final: float = real(
        0.0, 1.0, "", "exploration rate ε at the end of its schedule", default=0.01
    )
    epsilon_fraction: float = real(
        1e-6, 1.0, "of the run", "part of the run over which ε falls", default=0.25
    )
    epsilon_schedule: str = choice(SCHEDULES, "how ε falls", default="linear")
    trace_cutoff: float = real(
        0.0,
        1.0,
        "",
        "trace entries at or below this magnitude are dropped, 0 keeps all",
        default=1e-8,
    )
    buffer: bool = flag(
        "update buffer of depth 1: act first, learn while the action runs (paper II-D)",
        default=True,
    )

    @property
    def beta(self) -> float:
        """Secondary step size: β = αη for rules with a gradient correction, otherwise 0."""
        return self.alpha * self.eta if RULES[self.rule].corrected else 0.0

    def _check(self) -> None:
        if RULES[self.rule].target == SAMPLED and not self.buffer:
            raise ValueError(
                f"LearnerConfig.buffer = False with rule = {self.rule!r}; Sarsa learns "
                "after it has chosen its next action, "
                "which is what the buffer does: expected buffer = True"
            )
        exploring = (
            self.epsilon
            if self.epsilon_schedule == "constant"
            else max(self.epsilon, self.epsilon_final)
        )
        if not RULES[self.rule].corrected:
            exploring = 0.0  # for the trace: their ρ is at most 1
        if self.gamma * self.lam >= 1.0 - exploring and self.gamma * self.lam > 0:
            raise ValueError(
                f"LearnerConfig: gamma * lam = {self.gamma * self.lam:g} with epsilon = "
                f"{exploring:g} lets the trace grow "
                "without bound on greedy steps (ρ up to 1/(1 - ε)); expected gamma * lam < "
                f"{1 - exploring:g}: "
                "lower gamma, lam or epsilon"
            )
        if self.epsilon_schedule == "exponential" and min(self.epsilon, self.epsilon_final) <= 0.0:
            raise ValueError(
                f"LearnerConfig.epsilon_final = {self.epsilon_final!r} and epsilon = "
                f"{self.epsilon!r}; an exponential "
                "schedule never reaches 0: expected both above 0, or epsilon_schedule='linear'"
            )


# named settings of the learner (requirement L3); "default" is what our trials found best
PRESETS = {
    "default": LearnerConfig(),
    "aykin-2015-like": LearnerConfig(lam=0.6, gamma=0.8, alpha=1 / (5 * 441)),
}
