"""The learner's parameters. The paper gives none of them: all defaults are our choice (see the README's limits)."""

from workbench.fields import choice, configuration, flag, real
from workbench.learning.behaviour import SCHEDULES


@configuration
class LearnerConfig:
    """Parameters of Greedy-GQ(λ) and of its ε-greedy behaviour."""

    alpha: float = real(0.1, 1e-9, 1.0, "", "main step size α")
    eta: float = real(0.01, 0.0, 100.0, "", "ratio η of the secondary to the main step size, β = αη")
    gamma: float = real(0.8, 0.0, 0.9999, "", "discount γ")
    lam: float = real(0.8, 0.0, 1.0, "", "trace decay λ")
    theta0: float = real(-0.1, -1e6, 1e6, "", "initial main weights θ₀")
    epsilon: float = real(0.05, 0.0, 1.0, "", "exploration rate ε at the start")
    epsilon_final: float = real(0.01, 0.0, 1.0, "", "exploration rate ε at the end of its schedule")
    epsilon_fraction: float = real(0.25, 1e-6, 1.0, "of the run", "part of the run over which ε falls")
    epsilon_schedule: str = choice("linear", SCHEDULES, "how ε falls")
    trace_cutoff: float = real(1e-8, 0.0, 1.0, "", "trace entries at or below this magnitude are dropped, 0 keeps all")
    buffer: bool = flag(True, "update buffer of depth 1: act first, learn while the action runs (paper II-D)")

    @property
    def beta(self) -> float:
        """Secondary step size β = αη."""
        return self.alpha * self.eta

    def _check(self) -> None:
        exploring = self.epsilon if self.epsilon_schedule == "constant" else max(self.epsilon, self.epsilon_final)
        if self.gamma * self.lam >= 1.0 - exploring:
            raise ValueError(
                f"LearnerConfig: gamma * lam = {self.gamma * self.lam:g} with epsilon = {exploring:g} lets the trace grow "
                f"without bound on greedy steps (ρ up to 1/(1 - ε)); expected gamma * lam < {1 - exploring:g}: "
                "lower gamma, lam or epsilon"
            )
        if self.epsilon_schedule == "exponential" and min(self.epsilon, self.epsilon_final) <= 0.0:
            raise ValueError(
                f"LearnerConfig.epsilon_final = {self.epsilon_final!r} and epsilon = {self.epsilon!r}; an exponential "
                "schedule never reaches 0: expected both above 0, or epsilon_schedule='linear'"
            )
