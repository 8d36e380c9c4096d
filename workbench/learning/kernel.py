"""The GQ(λ) update on sparse features: the one kernel behind every learner of the workbench.

Maei & Sutton 2010, in the form of White & Sutton, "GQ(λ) Quick Reference", arXiv 1705.03967, with
main weights θ, secondary weights w, trace e, main step α and secondary step β:

    δ_t = R + (1 - γ') z + γ' θ·φ̄ - θ·φ
    e_t = ρ γ λ e_{t-1} + I φ                  γ, λ of S_t; γ', λ' of S_{t+1}
    θ  += α [δ e - γ' (1 - λ') (w·e) φ̄]        with the old w
    w  += β [δ e - (w·φ) φ - κ w]

φ is the feature vector of (S_t, A_t) and φ̄ the expected feature vector of S_{t+1} under the target
policy, both as lists of indices and values. At a terminal γ' = 0 and φ̄ is empty: the discount is
data, there is no flag. ρ is an argument: it was fixed with the weights that chose A_t and must
never be derived again later.

Rival learners are settings of this kernel: β = 0 and ρ in {0, 1} is Watkins' Q(λ); β = 0 is
Expected Sarsa(λ) for any target policy; κ = 1 (β = α) is QRC(λ), Q-learning with regularised
corrections (Ghiassian et al., ICML 2020). GQ(λ) has κ = 0.

The trace is sparse. ``index[:n]`` and ``value[:n]`` are its entries, ``slot[i]`` is the place of
feature i in them or -1. Entries whose magnitude is at or below ``cutoff`` are dropped; 0 drops only
what has underflown to exactly zero. The cost is O(n), whatever the number of features; κ > 0
shrinks all of w, which costs a pass over the features.

Contract: all arrays are written in place and nothing is allocated. The caller keeps n between
calls.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


class Learner(NamedTuple):
    """Main and secondary weights, and the sparse trace: index, value, slot, each (features,)."""

    theta: Any
    w: Any
    index: Any
    value: Any
    slot: Any


class Features(NamedTuple):
    """A sparse feature vector: indices and values of what is not zero."""

    index: Any
    value: Any


class Signal(NamedTuple):
    """What a transition brings: R_{t+1}, z_{t+1}, I_t and ρ_t."""

    reward: float
    outcome: float
    interest: float
    rho: float


class StepSizes(NamedTuple):
    """Main and secondary step size, magnitude at which trace entries are dropped, κ of QRC(λ)."""

    alpha: float
    beta: float
    cutoff: float
    kappa: float


def new_trace(features: int) -> tuple[Ints, Floats, Ints]:
    """Return the arrays of an empty trace over a number of features: index, value, slot."""
    return np.zeros(features, np.int32), np.zeros(features), np.full(features, -1, np.int32)


@compiled
def clear_trace(index: Any, slot: Any, n: int) -> int:
    """Empty a trace of n entries and return its new length, 0."""
    for k in range(n):
        slot[index[k]] = -1
    return 0


@compiled
def decay_trace(learner: Any, n: int, factor: float, cutoff: float) -> int:
    """Multiply a trace of n entries by a factor, drop what becomes too small, and return its new
    length.
    """
    index = learner.index
    value = learner.value
    slot = learner.slot
    if factor == 0.0:
        return clear_trace(index, slot, n)
    k = 0
    while k < n:
        value[k] *= factor
        if abs(value[k]) > cutoff:
            k += 1
        else:  # drop it: the last entry takes its place
            n -= 1
            slot[index[k]] = -1
            if k < n:
                index[k] = index[n]
                value[k] = value[n]
                slot[index[k]] = k
    return n


@compiled
def add_to_trace(learner: Any, n: int, phi: Any, factor: float) -> int:
    """Add factor times a feature vector to a trace of n entries and return its new length."""
    index = learner.index
    value = learner.value
    slot = learner.slot
    for k in range(phi.index.size):
        feature = phi.index[k]
        place = slot[feature]
        if place < 0:
            index[n] = feature
            value[n] = factor * phi.value[k]
            slot[feature] = n
            n += 1
        else:
            value[place] += factor * phi.value[k]
    return n


@compiled
def gq_update(
    learner: Any,
    n: int,
    phi: Any,
    bar: Any,
    signal: Any,
    decay: float,
    gamma_tp1: float,
    lam_tp1: float,
    sizes: Any,
) -> tuple[int, float, float]:
    """Learn one transition in place.

    Args:
        learner: of type Learner: main and secondary weights, and the sparse trace; n: its length.
        phi: of type Features: active features of (S_t, A_t) and their values.
        bar: the same for φ̄_{t+1}; empty at a terminal.
        signal: of type Signal: R_{t+1}, z_{t+1}, I_t, and ρ of A_t, fixed at the moment of choice.
        decay: γ_t λ_t of S_t, that is the previous transition's γ' λ'.
        gamma_tp1, lam_tp1: γ' and λ' of S_{t+1}.
        sizes: of type StepSizes.

    Returns:
        (n, δ_t, w·e_t): the trace's new length, the temporal-difference error and the correction's
        factor.
    """
    theta = learner.theta
    w = learner.w
    index = learner.index
    value = learner.value
    # δ_t and w·φ, with the weights of this moment
    delta = signal.reward + (1.0 - gamma_tp1) * signal.outcome
    for k in range(bar.index.size):
        delta += gamma_tp1 * theta[bar.index[k]] * bar.value[k]
    w_phi = 0.0
    for k in range(phi.index.size):
        delta -= theta[phi.index[k]] * phi.value[k]
        w_phi += w[phi.index[k]] * phi.value[k]
    # e_t = ρ γ λ e_{t-1} + I φ
    n = decay_trace(learner, n, signal.rho * decay, sizes.cutoff)
    n = add_to_trace(learner, n, phi, signal.interest)
    # w·e, before w moves: the correction below is with the old w
    w_e = 0.0
    for k in range(n):
        w_e += w[index[k]] * value[k]
    # the regularisation of QRC(λ), over all of w
    if sizes.kappa > 0.0:
        shrink = 1.0 - sizes.beta * sizes.kappa
        for k in range(w.size):
            w[k] *= shrink
    # both weights follow the trace
    for k in range(n):
        theta[index[k]] += sizes.alpha * delta * value[k]
        w[index[k]] += sizes.beta * delta * value[k]
    # gradient correction of θ along φ̄, and of w along φ
    correction = sizes.alpha * gamma_tp1 * (1.0 - lam_tp1) * w_e
    for k in range(bar.index.size):
        theta[bar.index[k]] -= correction * bar.value[k]
    for k in range(phi.index.size):
        w[phi.index[k]] -= sizes.beta * w_phi * phi.value[k]
    return n, delta, w_e
