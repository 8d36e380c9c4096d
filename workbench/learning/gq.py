"""GQ(λ) and Greedy-GQ(λ) as objects: weights, trace and step sizes around the kernel.

``GQ`` learns with any sparse features and a target policy that the caller knows. ``GreedyGQ`` is
the control algorithm of the paper: one feature per (state, action) pair, greedy target policy,
ε-greedy behaviour.

>>> learner = GreedyGQ(states=2, actions=2, alpha=0.5, beta=0.01, gamma=0.9, lam=0.0)
>>> learner.begin_episode()
>>> learner.update(0, 1, -1.0, None, rho=1.0)
>>> learner.theta.tolist()
[[0.0, -0.5], [0.0, 0.0]]

Contract: ``theta`` and ``w`` are the live weights, views and not copies; ``trace`` and ``state``
return copies. An object is used by one thread at a time.
"""

import math
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.compiled import compiled
from workbench.learning.behaviour import choose_action, greedy_action
from workbench.learning.kernel import (
    Features,
    Learner,
    Signal,
    StepSizes,
    clear_trace,
    gq_update,
    new_trace,
)

SCHEMA = 2
State = dict[str, NDArray[np.float64] | NDArray[np.int32] | float | int | str]


@compiled
def _all_below(index: Any, most: int) -> bool:
    """Return whether all indices are from 0 and below ``most``."""
    for one in index:
        if not 0 <= one < most:
            return False
    return True


class GQ:
    """GQ(λ) with linear function approximation on sparse features.

    Args:
        features: length of the weight vectors.
        alpha, beta: main and secondary step size.
        cutoff: trace entries at or below this magnitude are dropped; 0 keeps all.
        theta0: initial main weight.
        kappa: regularisation of the secondary weights; 1 with beta = alpha makes it QRC(λ).

    Invariant: the sparse trace never holds a feature twice, and w starts at 0.
    """

    def __init__(
        self,
        features: int,
        alpha: float,
        *,
        beta: float = 0.0,
        cutoff: float = 0.0,
        theta0: float = 0.0,
        kappa: float = 0.0,
    ) -> None:
        if features < 1:
            raise ValueError(f"features = {features!r}; expected at least 1")
        own = (
            ("alpha", alpha, True),
            ("beta", beta, False),
            ("cutoff", cutoff, False),
            ("kappa", kappa, False),
        )
        for name, number, positive in own:
            if not np.isfinite(number) or number < 0 or (positive and number == 0):
                raise ValueError(
                    f"{name} = {number!r}; expected a finite number "
                    f"{'above' if positive else 'from'} 0"
                )
        if not np.isfinite(theta0):
            raise ValueError(f"theta0 = {theta0!r}; expected a finite number")
        self.alpha = float(alpha)
        self.beta = float(beta)
        self.cutoff = float(cutoff)
        self.kappa = float(kappa)
        self._theta = np.full(features, float(theta0))
        self._w = np.zeros(features)
        self._index, self._value, self._slot = new_trace(features)
        self._learner = Learner(self._theta, self._w, self._index, self._value, self._slot)
        self._n = 0
        self._decay = 0.0
        self.steps = 0
        self.delta = 0.0

    def begin_episode(self) -> None:
        """Clear the trace: nothing before this moment is credited for what follows."""
        self._n = int(clear_trace(self._index, self._slot, self._n))
        self._decay = 0.0

    def learn(
        self,
        phi: tuple[ArrayLike, ArrayLike],
        reward: float,
        phi_bar: tuple[ArrayLike, ArrayLike],
        *,
        gamma: float,
        lam: float,
        rho: float,
        outcome: float = 0.0,
        interest: float = 1.0,
    ) -> None:
        """Learn one transition.

        Args:
            phi: indices and values of the active features of (S_t, A_t).
            reward: R_{t+1}.
            phi_bar: the same for φ̄_{t+1}; empty lists at a terminal.
            gamma, lam: γ and λ of S_{t+1}; gamma = 0 at a terminal.
            rho: importance ratio of A_t, fixed when A_t was chosen.
            outcome, interest: z_{t+1} and I_t.

        Raises:
            ValueError: a feature index out of range, or not one value per index.
            FloatingPointError: the update is not finite; the message has step number, weight norm
                and step sizes.
        """
        self._n, self.delta, w_e = gq_update(
            self._learner,
            self._n,
            self._features("phi", phi),
            self._features("phi_bar", phi_bar),
            Signal(float(reward), float(outcome), float(interest), float(rho)),
            self._decay,
            float(gamma),
            float(lam),
            StepSizes(self.alpha, self.beta, self.cutoff, self.kappa),
        )
        self._decay = float(gamma) * float(lam)
        self.steps += 1
        finite = math.isfinite(self.delta) and math.isfinite(w_e)
        if not (finite and np.isfinite(self._theta[self._index[: self._n]]).all()):
            raise FloatingPointError(
                not_finite(self.steps, self._theta, self._w, self.alpha, self.beta)
            )

    def _features(self, name: str, pairs: tuple[ArrayLike, ArrayLike]) -> Features:
        """Return checked index and value arrays: the kernel itself checks nothing."""
        given = np.asarray(pairs[0])
        if given.size and given.dtype.kind not in "iu":
            raise ValueError(
                f"{name} has indices {given.tolist()!r} of type {given.dtype}; expected whole "
                "numbers (of a mask: np.flatnonzero(mask))"
            )
        index = given.astype(np.int64).ravel()
        value = np.asarray(pairs[1], np.float64).ravel()
        if index.size != value.size:
            raise ValueError(
                f"{name} has {index.size} indices and {value.size} values; expected one value "
                "per index"
            )
        if not _all_below(index, self._theta.size):
            raise ValueError(
                f"{name} indices are {index.tolist()}; the learner has features 0 to "
                f"{self._theta.size - 1}"
            )
        return Features(index, value)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Main weights, (features,)."""
        return self._theta

    @property
    def w(self) -> NDArray[np.float64]:
        """Secondary weights, (features,)."""
        return self._w

    def trace(self) -> NDArray[np.float64]:
        """Return a dense copy of the trace, in the shape of theta."""
        dense = np.zeros(self._theta.size)
        dense[self._index[: self._n]] = self._value[: self._n]
        return dense.reshape(self.theta.shape)

    def state(self) -> State:
        """Return everything that the next update depends on, as arrays and plain values (all
        copies).
        """
        return {
            "schema": SCHEMA,
            "kind": type(self).__name__,
            "theta": self.theta.copy(),
            "w": self.w.copy(),
            "trace_index": self._index[: self._n].copy(),
            "trace_value": self._value[: self._n].copy(),
            "decay": self._decay,
            "steps": self.steps,
            "alpha": self.alpha,
            "beta": self.beta,
            "cutoff": self.cutoff,
            "kappa": self.kappa,
        }

    def load(self, state: Mapping[str, object]) -> None:
        """Continue from a state of the same kind, shape and step sizes.

        Raises:
            ValueError: the state belongs to another kind of learner, layout or parameter; nothing
                is changed then.
        """
        own = self.state()
        missing = sorted(set(own) - set(state))
        if missing:
            raise ValueError(f"state lacks {', '.join(missing)}; expected what state() returns")
        for name in own:
            if name in ("trace_index", "trace_value", "decay", "steps"):
                continue
            given: object = state[name]
            expected: object = own[name]
            if name in ("theta", "w"):
                given = np.asarray(given).shape
                expected = np.asarray(expected).shape
            else:
                given = _plain(given)
            if given != expected:
                raise ValueError(
                    f"state[{name!r}] is {given!r}, this learner has {expected!r}; load into "
                    "an equal learner"
                )
        pairs: Any = (state["trace_index"], state["trace_value"])
        index, value = self._features("trace", pairs)
        if np.unique(index).size != index.size:
            raise ValueError(f"trace_index holds a feature twice: {index.tolist()}")
        self._theta[:] = np.asarray(state["theta"], np.float64).ravel()
        self._w[:] = np.asarray(state["w"], np.float64).ravel()
        self.begin_episode()
        self._n = index.size
        self._index[: self._n] = index
        self._value[: self._n] = value
        self._slot[index] = np.arange(self._n)
        self._decay = float(np.asarray(state["decay"]))
        self.steps = int(np.asarray(state["steps"]))


class GreedyGQ(GQ):
    """Greedy-GQ(λ) on a table of states and actions (Maei et al. 2010; paper section I-A).

    Args:
        states, actions: size of the table; one binary feature per pair.
        alpha, beta: main and secondary step size (β = αη).
        gamma, lam: discount and trace decay of every state that is not terminal.
        cutoff, theta0, kappa: see GQ.
    """

    def __init__(
        self,
        states: int,
        actions: int,
        *,
        alpha: float,
        beta: float,
        gamma: float,
        lam: float,
        cutoff: float = 0.0,
        theta0: float = 0.0,
        kappa: float = 0.0,
    ) -> None:
        check_table(states, actions, gamma, lam)
        super().__init__(
            states * actions, alpha, beta=beta, cutoff=cutoff, theta0=theta0, kappa=kappa
        )
        self.states = states
        self.actions = actions
        self.gamma = float(gamma)
        self.lam = float(lam)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Main weights, the learned action values, (states, actions)."""
        return self._theta.reshape(self.states, self.actions)

    @property
    def w(self) -> NDArray[np.float64]:
        """Secondary weights, (states, actions)."""
        return self._w.reshape(self.states, self.actions)

    def greedy(self, s: int) -> int:
        """Return the greedy action in state s, the lowest index on ties."""
        return int(greedy_action(self._theta, self._pair(s, 0), self.actions))

    def act(self, s: int, rng: np.random.Generator, *, epsilon: float) -> tuple[int, float]:
        """Return an ε-greedy action in state s and its importance ratio ρ, which belongs to this
        moment.
        """
        if not 0.0 <= epsilon <= 1.0:
            raise ValueError(f"epsilon = {epsilon!r}; expected a number from 0 to 1")
        action, rho = choose_action(
            self._theta, self._pair(s, 0), self.actions, epsilon, rng.random()
        )
        return int(action), float(rho)

    def update(self, s: int, a: int, reward: float, s_next: int | None, *, rho: float) -> None:
        """Learn the transition (s, a) → reward, s_next.

        Args:
            s, a: state and action, 0-based.
            reward: R_{t+1}.
            s_next: the next state; None at a terminal. An episode cut off by a time limit is not
                terminal: give its state.
            rho: importance ratio of a, fixed when a was chosen.

        Raises:
            ValueError: an index out of range, or a reward or rho that is not finite (rho also not
                negative).
            FloatingPointError: the update diverged.
        """
        if not math.isfinite(reward):
            raise ValueError(f"reward = {reward!r}; expected a finite number")
        if not math.isfinite(rho) or rho < 0:
            raise ValueError(
                f"rho = {rho!r}; expected a finite number from 0: 1/b(a|s) if a was greedy, else 0"
            )
        pair = self._pair(s, a)
        if s_next is None:
            self.learn(([pair], [1.0]), reward, ([], []), gamma=0.0, lam=self.lam, rho=rho)
        else:
            best = self._pair(s_next, self.greedy(s_next))
            self.learn(
                ([pair], [1.0]), reward, ([best], [1.0]), gamma=self.gamma, lam=self.lam, rho=rho
            )

    def state(self) -> State:
        """Return everything that the next update depends on, as arrays and plain values (all
        copies).
        """
        return super().state() | {"gamma": self.gamma, "lam": self.lam}

    def _pair(self, s: int, a: int) -> int:
        return _place("state", s, self.states) * self.actions + _place("action", a, self.actions)


def _place(name: str, index: int, count: int) -> int:
    """Return an index that must be a whole number from 0 to count - 1."""
    try:
        place = operator.index(index)
    except TypeError:
        place = -1
    if not 0 <= place < count:
        raise ValueError(f"{name} {index!r}; the learner has {name}s 0 to {count - 1}")
    return place


def check_table(states: int, actions: int, gamma: float, lam: float) -> None:
    """Raise ValueError unless a table has states and actions, and γ and λ lie in [0, 1]."""
    if states < 1 or actions < 1:
        raise ValueError(f"states = {states!r}, actions = {actions!r}; expected at least 1 of each")
    for name, number in (("gamma", gamma), ("lam", lam)):
        if not 0.0 <= number <= 1.0:
            raise ValueError(f"{name} = {number!r}; expected a number from 0 to 1")


def not_finite(
    step: int, theta: NDArray[np.float64], w: NDArray[np.float64], alpha: float, beta: float
) -> str:
    """Return the message for weights that are no longer numbers: step, norms and step sizes."""
    with np.errstate(all="ignore"):
        norm = float(np.linalg.norm(theta.ravel()))
        w_norm = float(np.linalg.norm(w.ravel()))
    return (
        f"learning diverged at update {step}: |theta| = {norm:g}, |w| = {w_norm:g} with alpha "
        f"= {alpha:g}, "
        f"beta = {beta:g}; lower the step sizes, or gamma * lam"
    )


def _plain(value: object) -> object:
    return value.item() if isinstance(value, (np.ndarray, np.generic)) else value
