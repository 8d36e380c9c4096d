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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Trace = tuple[Ints, Floats, Ints]  # index, value, slot


def new_trace(features: int) -> Trace:
    """Return the arrays of an empty trace over a number of features: index, value, slot, each
    (features,).
    """
    return np.zeros(features, np.int32), np.zeros(features), np.full(features, -1, np.int32)


@compiled
def clear_trace(index: Any, slot: Any, n: int) -> int:
    """Empty a trace of n entries and return its new length, 0."""
    for k in range(n):
        slot[index[k]] = -1
    return 0


@compiled
def decay_trace(index: Any, value: Any, slot: Any, n: int, factor: float, cutoff: float) -> int:
    """Multiply a trace of n entries by a factor, drop what becomes too small, and return its new
    length.
    """
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
def add_to_trace(
    index: Any, value: Any, slot: Any, n: int, phi: Any, phi_value: Any, factor: float
) -> int:
    """Add factor times a feature vector to a trace of n entries and return its new length."""
    for k in range(phi.size):
        place = slot[phi[k]]
        if place < 0:
            index[n] = phi[k]
            value[n] = factor * phi_value[k]
            slot[phi[k]] = n
            n += 1
        else:
            value[place] += factor * phi_value[k]
    return n


@compiled
def gq_update(
    theta: Any,
    w: Any,
    index: Any,
    value: Any,
    slot: Any,
    n: int,
    phi: Any,
    phi_value: Any,
    bar: Any,
    bar_value: Any,
    reward: float,
    outcome: float,
    interest: float,
    rho: float,
    decay: float,
    gamma_tp1: float,
    lam_tp1: float,
    alpha: float,
    beta: float,
    cutoff: float,
    kappa: float = 0.0,
) -> tuple[int, float, float]:
    """Learn one transition in place.

    Args:
        theta, w: (features,) main and secondary weights.
        index, value, slot, n: the sparse trace, see ``new_trace``.
        phi, phi_value: active features of (S_t, A_t) and their values.
        bar, bar_value: the same for φ̄_{t+1}; empty at a terminal.
        reward, outcome, interest: R_{t+1}, z_{t+1}, I_t.
        rho: importance ratio π/b of A_t, fixed at the moment of choice.
        decay: γ_t λ_t of S_t, that is the previous transition's γ' λ'.
        gamma_tp1, lam_tp1: γ' and λ' of S_{t+1}.
        alpha, beta: main and secondary step size.
        cutoff: magnitude at or below which trace entries are dropped.
        kappa: regularisation κ of w: 0 for GQ(λ), 1 for QRC(λ).

    Returns:
        (n, δ_t, w·e_t): the trace's new length, the temporal-difference error and the correction's
        factor.
    """
    # δ_t and w·φ, with the weights of this moment
    delta = reward + (1.0 - gamma_tp1) * outcome
    for k in range(bar.size):
        delta += gamma_tp1 * theta[bar[k]] * bar_value[k]
    w_phi = 0.0
    for k in range(phi.size):
        delta -= theta[phi[k]] * phi_value[k]
        w_phi += w[phi[k]] * phi_value[k]

    # e_t = ρ γ λ e_{t-1} + I φ
    n = decay_trace(index, value, slot, n, rho * decay, cutoff)
    n = add_to_trace(index, value, slot, n, phi, phi_value, interest)

    # w·e, before w moves: the correction below is with the old w
    w_e = 0.0
    for k in range(n):
        w_e += w[index[k]] * value[k]
    # the regularisation of QRC(λ), over all of w
    if kappa > 0.0:
        shrink = 1.0 - beta * kappa
        for k in range(w.size):
            w[k] *= shrink
    # both weights follow the trace
    for k in range(n):
        theta[index[k]] += alpha * delta * value[k]
        w[index[k]] += beta * delta * value[k]
    # gradient correction of θ along φ̄, and of w along φ
    correction = alpha * gamma_tp1 * (1.0 - lam_tp1) * w_e
    for k in range(bar.size):
        theta[bar[k]] -= correction * bar_value[k]
    for k in range(phi.size):
        w[phi[k]] -= beta * w_phi * phi_value[k]
    return n, delta, w_e
