"""True online Sarsa(λ) on a table, one call a step: the twin of followers with this rule."""

import numpy as np
from numpy.typing import NDArray

from workbench.learning.gq import check_table, not_finite
from workbench.learning.kernel import Features, Learner, StepSizes, clear_trace, new_trace
from workbench.learning.sarsa import sarsa_update


class TrueOnlineSarsa:
    """True online Sarsa(λ) on a table of states and actions, one binary feature per pair.

    Args:
        states, actions: size of the table.
        alpha: step size.
        gamma, lam: discount and trace decay of every state that is not terminal.
        cutoff: trace entries at or below this magnitude are dropped; 0 keeps all.
        theta0: initial action value.
    """

    def __init__(
        self,
        states: int,
        actions: int,
        *,
        alpha: float,
        gamma: float,
        lam: float,
        cutoff: float = 0.0,
        theta0: float = 0.0,
    ) -> None:
        check_table(states, actions, gamma, lam)
        for name, number, least in (
            ("alpha", alpha, 0.0),
            ("cutoff", cutoff, 0.0),
            ("theta0", theta0, -np.inf),
        ):
            if not np.isfinite(number) or number < least or (name == "alpha" and number == 0):
                raise ValueError(
                    f"{name} = {number!r}; expected a finite number "
                    f"{'above' if name == 'alpha' else 'from'} {least:g}"
                )
        self.states = states
        self.actions = actions
        self.alpha = float(alpha)
        self.gamma = float(gamma)
        self.lam = float(lam)
        self.cutoff = float(cutoff)
        self._theta = np.full(states * actions, float(theta0))
        self._index, self._value, self._slot = new_trace(states * actions)
        self._n = 0
        self._decay = 0.0
        self._q_old = 0.0
        self.steps = 0
        self.delta = 0.0

    @property
    def theta(self) -> NDArray[np.float64]:
        """Action values, (states, actions): the live weights."""
        return self._theta.reshape(self.states, self.actions)

    def begin_episode(self) -> None:
        """Clear the trace and what the last call looked ahead to."""
        self._n = int(clear_trace(self._index, self._slot, self._n))
        self._decay = self._q_old = 0.0

    def trace(self) -> NDArray[np.float64]:
        """Return a dense copy of the trace, in the shape of theta."""
        dense = np.zeros(self._theta.size)
        dense[self._index[: self._n]] = self._value[: self._n]
        return dense.reshape(self.theta.shape)

    def update(self, s: int, a: int, reward: float, s_next: int | None, a_next: int | None) -> None:
        """Learn the transition (s, a) → reward, s_next, where a_next will be taken; both None at a
        terminal.

        Raises:
            ValueError: an index out of range, a reward that is not finite, or only one of s_next
                and a_next.
            FloatingPointError: the update diverged.
        """
        if not np.isfinite(reward):
            raise ValueError(f"reward = {reward!r}; expected a finite number")
        if (s_next is None) != (a_next is None):
            raise ValueError(
                f"s_next = {s_next!r}, a_next = {a_next!r}; give both, or None for both at a "
                "terminal"
            )
        pairs = [] if s_next is None or a_next is None else [self._pair(s_next, a_next)]
        gamma = self.gamma if pairs else 0.0
        ahead = np.array(pairs, np.int64)
        self._n, self.delta, self._q_old = sarsa_update(
            Learner(self._theta, self._theta, self._index, self._value, self._slot),
            self._n,
            Features(np.array([self._pair(s, a)]), np.ones(1)),
            Features(ahead, np.ones(len(ahead))),
            float(reward),
            self._decay,
            gamma,
            self._q_old,
            StepSizes(self.alpha, 0.0, self.cutoff, 0.0),
        )
        self._decay = gamma * self.lam
        self.steps += 1
        if not np.isfinite(self.delta) or not np.all(
            np.isfinite(self._theta[self._index[: self._n]])
        ):
            raise FloatingPointError(
                not_finite(self.steps, self._theta, np.zeros(1), self.alpha, 0.0)
            )

    def _pair(self, s: int, a: int) -> int:
        if not 0 <= s < self.states or not 0 <= a < self.actions:
            raise ValueError(
                f"state {s!r}, action {a!r}; expected states from 0 to {self.states - 1}, "
                f"actions to {self.actions - 1}"
            )
        return int(s) * self.actions + int(a)
