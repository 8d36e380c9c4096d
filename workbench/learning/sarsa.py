"""True online Sarsa(λ): the on-policy rival that is not a setting of the GQ(λ) kernel.

van Seijen et al. 2016, in the form of Sutton & Barto, 2nd ed., section 12.8, with x the features of
(S_t, A_t) and x' those of (S_{t+1}, A_{t+1}), the action that will really be taken:

    q = θ·x,  q' = θ·x',  δ = R + γ' q' - q
    e ← γ λ e + (1 - α γ λ e·x) x                    the dutch trace; γ, λ of S_t
    θ += α (δ + q - q_old) e - α (q - q_old) x       q_old: the previous call's q'

Its weights are, at every step, exactly those of the online λ-return algorithm, which looks ahead
(same book, equation 12.19).

Contract: as in ``workbench.learning.kernel``: arrays are written in place, the trace is sparse, the
caller keeps n and q_old.
"""

from typing import Any

from workbench.compiled import compiled
from workbench.learning.kernel import add_to_trace, decay_trace


@compiled
def sarsa_update(
    learner: Any,
    n: int,
    phi: Any,
    following: Any,
    reward: float,
    decay: float,
    gamma_tp1: float,
    q_old: float,
    sizes: Any,
) -> tuple[int, float, float]:
    """Learn one transition in place.

    Args:
        learner: of type ``kernel.Learner``: weights and the sparse dutch trace; n: its length.
        phi: of type ``kernel.Features``: active features of (S_t, A_t) and their values.
        following: the same for (S_{t+1}, A_{t+1}); empty at a terminal.
        reward: R_{t+1}.
        decay: γ_t λ_t of S_t, that is the previous transition's γ' λ'.
        gamma_tp1: γ'; 0 at a terminal.
        q_old: θ·x' of the previous call, with its weights; 0 at the start of an episode.
        sizes: of type ``kernel.StepSizes``; α and the cutoff are used.

    Returns:
        (n, δ_t, q'): the trace's new length, the temporal-difference error, and the next call's
        q_old.
    """
    theta = learner.theta
    # q, q' and e·φ, with the weights and the trace of this moment
    q = q_next = e_phi = 0.0
    for k in range(phi.index.size):
        q += theta[phi.index[k]] * phi.value[k]
        place = learner.slot[phi.index[k]]
        if place >= 0:
            e_phi += learner.value[place] * phi.value[k]
    for k in range(following.index.size):
        q_next += theta[following.index[k]] * following.value[k]
    delta = reward + gamma_tp1 * q_next - q
    # e ← γ λ e + (1 - α γ λ e·φ) φ
    n = decay_trace(learner, n, decay, sizes.cutoff)
    n = add_to_trace(learner, n, phi, 1.0 - sizes.alpha * decay * e_phi)
    # θ follows the trace, less what the previous call looked ahead to
    for k in range(n):
        theta[learner.index[k]] += sizes.alpha * (delta + q - q_old) * learner.value[k]
    for k in range(phi.index.size):
        theta[phi.index[k]] -= sizes.alpha * (q - q_old) * phi.value[k]
    return n, delta, q_next
