"""True online Sarsa(λ): the on-policy rival that is not a setting of the GQ(λ) kernel.

van Seijen et al. 2016, in the form of Sutton & Barto, 2nd ed., section 12.8, with x the features of
(S_t, A_t) and x' those of (S_{t+1}, A_{t+1}), the action that will really be taken:

    q = θ·x,  q' = θ·x',  δ = R + γ' q' - q
    e ← γ λ e + (1 - α γ λ e·x) x                    the dutch trace; γ, λ of S_t
    θ += α (δ + q - q_old) e - α (q - q_old) x       q_old: the previous call's q'

Its weights are, at every step, exactly those of the online λ-return algorithm, which looks ahead
(same book, equation 12.19).

>>> learner = TrueOnlineSarsa(states=2, actions=2, alpha=0.5, gamma=0.9, lam=0.8)
>>> learner.begin_episode()
>>> learner.update(0, 1, -1.0, 1, 0); learner.update(1, 0, -1.0, None, None)
>>> learner.theta.round(3).tolist()
[[0.0, -0.86], [-0.5, 0.0]]

Contract: as in ``workbench.learning.kernel``: arrays are written in place, the trace is sparse, the
caller keeps n and q_old.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled
from workbench.learning.behaviour import choose_action
from workbench.learning.gq import check_table, not_finite
from workbench.learning.kernel import add_to_trace, clear_trace, decay_trace, new_trace


@compiled
def sarsa_update(
    theta: Any,
    index: Any,
    value: Any,
    slot: Any,
    n: int,
    phi: Any,
    phi_value: Any,
    following: Any,
    following_value: Any,
    reward: float,
    decay: float,
    gamma_tp1: float,
    alpha: float,
    q_old: float,
    cutoff: float,
) -> tuple[int, float, float]:
    """Learn one transition in place.

    Args:
        theta: (features,) weights.
        index, value, slot, n: the sparse dutch trace, see ``workbench.learning.kernel.new_trace``.
        phi, phi_value: active features of (S_t, A_t) and their values.
        following, following_value: the same for (S_{t+1}, A_{t+1}); empty at a terminal.
        reward: R_{t+1}.
        decay: γ_t λ_t of S_t, that is the previous transition's γ' λ'.
        gamma_tp1: γ'; 0 at a terminal.
        alpha: step size.
        q_old: θ·x' of the previous call, with the weights of that call; 0 at the start of an
            episode.
        cutoff: magnitude at or below which trace entries are dropped.

    Returns:
        (n, δ_t, q'): the trace's new length, the temporal-difference error, and the next call's
        q_old.
    """
    # q, q' and e·φ, with the weights and the trace of this moment
    q = q_next = e_phi = 0.0
    for k in range(phi.size):
        q += theta[phi[k]] * phi_value[k]
        if slot[phi[k]] >= 0:
            e_phi += value[slot[phi[k]]] * phi_value[k]
    for k in range(following.size):
        q_next += theta[following[k]] * following_value[k]
    delta = reward + gamma_tp1 * q_next - q
    # e ← γ λ e + (1 - α γ λ e·φ) φ
    n = decay_trace(index, value, slot, n, decay, cutoff)
    n = add_to_trace(index, value, slot, n, phi, phi_value, 1.0 - alpha * decay * e_phi)
    # θ follows the trace, less what the previous call looked ahead to
    for k in range(n):
        theta[index[k]] += alpha * (delta + q - q_old) * value[k]
    for k in range(phi.size):
        theta[phi[k]] -= alpha * (q - q_old) * phi_value[k]
    return n, delta, q_next


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

    def act(self, s: int, rng: np.random.Generator, *, epsilon: float) -> int:
        """Return an ε-greedy action in state s."""
        if not 0.0 <= epsilon <= 1.0:
            raise ValueError(f"epsilon = {epsilon!r}; expected a number from 0 to 1")
        return int(
            choose_action(self._theta, self._pair(s, 0), self.actions, epsilon, rng.random())[0]
        )

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
        self._n, self.delta, self._q_old = sarsa_update(
            self._theta,
            self._index,
            self._value,
            self._slot,
            self._n,
            np.array([self._pair(s, a)]),
            np.ones(1),
            np.array(pairs, np.int64),
            np.ones(len(pairs)),
            float(reward),
            self._decay,
            gamma,
            self.alpha,
            self._q_old,
            self.cutoff,
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
