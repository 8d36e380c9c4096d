"""The follower: sense → tile → act → learn → reset. There is one implementation, this one.

A follower is one record of type ROBOT, a row of weights and a sparse trace. ``act`` turns an
observation into wheel commands, by its table or by a classical law (``formation.laws``), and
caches the finished transition; ``remember`` notes the command; ``learn`` learns what is cached.
With the update buffer (paper II-D) the loop calls ``act``, sends the command, and then ``learn``,
while the action runs: action t + 1 uses weights without transition t. Without it ``act`` learns
first. ρ is stored when an action is chosen and travels with its transition.

The fast simulation loop calls them for all followers of all formations; a loop that drives one
robot calls the same.

Contract: records, weights and traces are written in place; nothing is allocated. ``task`` is one
TASK record, which ``formation.task`` fills from a ConvoyConfig. A transition counts as a visit of
its state S_t.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from workbench.compiled import call_at, compiled
from workbench.formation.estimate import perceive
from workbench.formation.laws.table import steer
from workbench.formation.output import about, interpolate
from workbench.formation.reset import FOLLOW, LOST, SEARCH, begin_reset, manoeuvre
from workbench.formation.reward import step_reward
from workbench.formation.senses.table import errors, tiled, trimmed
from workbench.learning.behaviour import explore, greedy_of_sum
from workbench.learning.kernel import (
    Features,
    Learner,
    Signal,
    StepSizes,
    clear_trace,
)
from workbench.learning.rules import EXPECTED, GREEDY_ONLY, ON_POLICY, SAMPLED, update
from workbench.learning.tiles import MAX_TILES, MAX_TILINGS, tile_index

GRID = np.dtype(
    [
        ("distance_edges", "f8", (MAX_TILINGS, MAX_TILES + 2)),  # m, of the error; a row a tiling
        ("bearing_edges", "f8", (MAX_TILINGS, MAX_TILES + 2)),  # rad
        ("distance_tiles", "i8", (MAX_TILINGS,)),
        ("bearing_tiles", "i8", (MAX_TILINGS,)),
        ("first_row", "i8", (MAX_TILINGS,)),
        ("tilings", "i8"),
        ("actions", "i8"),
        ("right_levels", "i8"),
        ("left_steps", "i8", (MAX_TILES,)),  # steps/s of each action level
        ("right_steps", "i8", (MAX_TILES,)),
    ]
)
BOUNDS = np.dtype(  # m, m, rad, m
    [("middle", "f8"), ("half_range", "f8"), ("bearing", "f8"), ("sight", "f8")]
)
REWARD = np.dtype(  # function: the address of the user's own, see formation.own_reward
    [("preset", "i8"), ("terminal", "f8"), ("function", "i8")]
)
LEARNER = np.dtype(
    [
        ("target", "i8"),  # of ``learning.rules``
        ("ratio", "i8"),
        ("update", "i8"),
        ("alpha", "f8"),
        ("beta", "f8"),
        ("gamma", "f8"),
        ("lam", "f8"),
        ("cutoff", "f8"),
        ("kappa", "f8"),
        ("buffer", "i8"),
        ("schedule", "i8"),
        ("epsilon", "f8"),
        ("epsilon_final", "f8"),
        ("epsilon_horizon", "f8"),
    ]
)
_CELLS = ("i8", (MAX_TILINGS,))  # the first weight of the active cell of every tiling
CHOICE = np.dtype(  # the last one; state -1: none; errors in m and rad
    [
        ("state", "i8"),
        ("action", "i8"),
        ("explores", "i8"),
        ("rho", "f8"),
        ("distance_error", "f8"),
        ("bearing", "f8"),
        ("cells", *_CELLS),
    ]
)
WAITING = np.dtype(  # the transition that waits to be learned; next_state -1: a terminal
    [
        ("any", "i8"),
        ("action", "i8"),
        ("rho", "f8"),
        ("reward", "f8"),
        ("next_state", "i8"),
        ("cells", *_CELLS),
        ("next_cells", *_CELLS),
    ]
)
LEARNING = np.dtype(
    [
        ("table", "i8"),  # whose weights; whether it learns; whether the run has room for an update
        ("learns", "i8"),
        ("room", "i8"),
        ("trace", "i8"),  # entries of the trace; γ λ of the last transition
        ("decay", "f8"),
        ("epsilon", "f8"),  # of this moment, and a uniform number in [0, 1) to explore by
        ("chance", "f8"),
        ("cells", *_CELLS),  # now
        ("features", *_CELLS),  # the kernel's list of φ
        ("place", "f8", (2,)),  # what is tiled
        ("delta", "f8"),  # last temporal-difference error; true online Sarsa's memory
        ("previous_value", "f8"),
    ]
)
# whether a function of the user's own failed, and for which arguments
FAILURE = np.dtype([("any", "i8"), ("at", "f8", (2,))])

# bits of PERIOD.event; EXPLORED: of the command; BLINDED: ambient light leaves the front sensors
# nothing to read with
LOSS = 1
RECOVERED = 2
TIMED_OUT = 4
GAVE_UP = 8
LEARNED = 16
EXPLORED = 32
BLINDED = 64

_ONES = np.ones(MAX_TILINGS)


class Memory(NamedTuple):
    """What one follower learns with: weights (2, pairs), main and secondary; trace_ids (3, pairs),
    index and slot of the sparse trace, and room for the features of φ̄; trace_values (2, pairs),
    those of the trace, and room for those of φ̄.
    """

    weights: Any
    trace_ids: Any
    trace_values: Any


@compiled
def begin_episode(follower: Any, trace_ids: Any) -> None:
    """Forget the last action and clear the trace."""
    follower.learning.trace = clear_trace(trace_ids[0], trace_ids[1], follower.learning.trace)
    follower.learning.decay = follower.learning.previous_value = 0.0
    follower.choice.state = -1


@compiled
def learn(task: Any, follower: Any, memory: Any) -> bool:
    """Learn the cached transition, if there is one; return whether the numbers stayed finite.

    Args:
        task, follower: records of type TASK and ROBOT.
        memory: of type Memory.
    """
    waiting = follower.waiting
    if waiting.any == 0:
        return True
    waiting.any = 0
    learning = follower.learning
    theta = memory.weights[0]
    for k in range(task.grid.tilings):
        learning.features[k] = waiting.cells[k] + waiting.action
    gamma = 0.0
    count = 0
    if waiting.next_state >= 0:
        gamma = task.learner.gamma
        count = _expect(task, follower, memory)
    finite = _update(task, follower, memory, gamma, count)
    learning.decay = gamma * task.learner.lam
    if waiting.next_state < 0:
        begin_episode(follower, memory.trace_ids)
    return finite and math.isfinite(theta[learning.features[0]])


@compiled
def learn_at_once(task: Any, follower: Any, memory: Any) -> bool:
    """Learn from the transition that has just ended, without the update buffer; return as ``learn``
    does.
    """
    return learn(task, follower, memory) if not task.learner.buffer else True


@compiled
def _update(task: Any, follower: Any, memory: Any, gamma: float, count: int) -> bool:
    """Call the rule's update with φ̄ of ``count`` entries; return whether it stayed finite."""
    learning = follower.learning
    weights = memory.weights
    ids = memory.trace_ids
    values = memory.trace_values
    m = task.grid.tilings
    learner = Learner(weights[0], weights[1], ids[0], values[0], ids[1])
    phi = Features(learning.features[:m], _ONES[:m])
    bar = Features(ids[2, :count], values[1, :count])
    sizes = StepSizes(
        task.learner.alpha, task.learner.beta, task.learner.cutoff, task.learner.kappa
    )
    learning.trace, learning.delta, learning.previous_value, w_e = update(
        task.learner.update,
        learner,
        learning.trace,
        phi,
        bar,
        Signal(follower.waiting.reward, 0.0, 1.0, follower.waiting.rho),
        learning.decay,
        gamma,
        task.learner.lam,
        learning.previous_value,
        sizes,
    )
    return math.isfinite(learning.delta) and math.isfinite(w_e)


@compiled
def _expect(task: Any, follower: Any, memory: Any) -> int:
    """Write φ̄_{t+1} under the rule's target policy as features and values; return their number."""
    cells = follower.waiting.next_cells
    bar = memory.trace_ids[2]
    bar_value = memory.trace_values[1]
    m = int(task.grid.tilings)
    actions = int(task.grid.actions)
    if task.learner.target == SAMPLED:  # the action that is running now
        best = follower.choice.action
    else:
        best = greedy_of_sum(memory.weights[0], cells, m, actions)
    if task.learner.target != EXPECTED:
        for k in range(m):
            bar[k] = cells[k] + best
            bar_value[k] = 1.0
        return m
    epsilon = follower.learning.epsilon
    share = epsilon / actions
    for k in range(m):
        for action in range(actions):
            place = k * actions + action
            bar[place] = cells[k] + action
            bar_value[place] = share + (1.0 - epsilon if action == best else 0.0)
    return m * actions


@compiled
def sense_cells(task: Any, follower: Any, e_d: float, o_err: float) -> int:
    """Find the cell of every tiling, as the place of its first weight; return the state, -1 outside
    the bounds.
    """
    inside, first, second = tiled(task.sense.tiled, task, follower, e_d, o_err)
    if not inside:
        return -1
    return _cells_at(task, follower, first, second)


@compiled
def _cells_at(task: Any, follower: Any, first: float, second: float) -> int:
    """Find the cell of every tiling at a place; return the state, -1 outside."""
    grid = task.grid
    state = -1
    follower.learning.place[0] = first
    follower.learning.place[1] = second
    for k in range(grid.tilings):
        row = tile_index(grid.distance_edges[k], grid.distance_tiles[k], first)
        column = tile_index(grid.bearing_edges[k], grid.bearing_tiles[k], second)
        if row < 0 or column < 0:
            return -1
        cell = row * grid.bearing_tiles[k] + column
        if k == 0:
            state = cell
        follower.learning.cells[k] = (grid.first_row[k] + cell) * grid.actions
    return state


@compiled
def reward_at(task: Any, follower: Any, e_d: float, o_err: float) -> float:
    """Return the reward of a step that ends inside the bounds, at errors in m and rad or at the
    readings in the record.
    """
    if task.graph.count:
        distances: float = follower.graph_reward
        return distances
    u, v = errors(task.sense.errors, task, follower, e_d, o_err)
    if task.reward.function:
        own: float = call_at(task.reward.function, u, v)
        if not math.isfinite(own):
            follower.failure.any = 1
            follower.failure.at[0] = u
            follower.failure.at[1] = v
        return own
    return step_reward(task.reward.preset, u, v)


@compiled
def _finish(task: Any, follower: Any, period: Any, reward: float, next_state: int) -> None:
    """Cache the transition that ends now and record it as a visit of its state, unless the run's
    budget is used up.
    """
    learning = follower.learning
    choice = follower.choice
    if learning.learns and not learning.room:
        return
    waiting = follower.waiting
    waiting.any = learning.learns
    waiting.action = choice.action
    waiting.rho = choice.rho
    waiting.reward = reward
    waiting.next_state = next_state
    for k in range(task.grid.tilings):
        waiting.cells[k] = choice.cells[k]
        waiting.next_cells[k] = learning.cells[k]
    period.state = choice.state
    period.action = choice.action
    period.reward = reward
    period.distance_error = choice.distance_error
    period.bearing = choice.bearing
    if learning.learns:
        period.event |= LEARNED


@compiled
def _begin(follower: Any, period: Any) -> None:
    """Let nothing have happened yet in a control period."""
    period.state = -1
    period.action = -1
    period.event = BLINDED if follower.infrared.blind else 0
    period.distance_error = 0.0
    period.bearing = 0.0
    period.reward = 0.0


@compiled
def act(task: Any, follower: Any, period: Any, memory: Any) -> tuple[int, int, bool]:
    """Observe, finish the running transition (without the update buffer: learn it) and choose wheel
    commands.

    What is observed stands in ``follower.seen``: distance and bearing of the predecessor, m and
    rad. ``follower.learning`` has ε and one uniform number in [0, 1) to explore by, and whether the
    run has room for one more learning update.

    Args:
        task, follower, period: records of type TASK, ROBOT and PERIOD (written: what happened).
        memory: of type Memory.

    Returns:
        (left, right, finite): commands in whole steps/s; False where learning diverged.
    """
    _begin(follower, period)
    distance, bearing = perceive(task, follower)
    follower.seen.perceived_distance = distance
    follower.seen.perceived_bearing = bearing
    finite = True
    e_d = distance - task.bounds.middle
    # a reset goes on, or ends here
    if follower.reset.phase != FOLLOW:
        left, right = _go_back(task, follower, period, distance, bearing)
        if follower.reset.phase != FOLLOW:
            return left, right, finite
    # the running transition ends where the predecessor is seen now
    state = sense_cells(task, follower, e_d, bearing)
    lost = state < 0
    frozen = task.law.number == 0 and follower.learning.learns == 0
    if frozen and task.output.trim > 0.0 and not lost:
        _trim(task, follower, e_d)  # a visit counts where the robot is, not where it is told it is
    if follower.choice.state >= 0:
        reward = task.reward.terminal if lost else reward_at(task, follower, e_d, bearing)
        _finish(task, follower, period, reward, state)
        finite = learn_at_once(task, follower, memory)
    if lost:
        period.event |= LOSS
        follower.choice.state = -1
        begin_reset(follower, distance, task.bounds.middle - task.bounds.half_range)
        period.phase = follower.reset.phase
        left, right = manoeuvre(task, follower, distance, bearing)
        return left, right, finite
    # the next action, by a law or by the table
    period.phase = FOLLOW
    choice = follower.choice
    action = -1
    if task.law.number:
        left, right = steer(task, follower, distance, bearing)
    else:
        action = _explore(task, follower, period, memory.weights[0])
        left, right = _commands(task, follower, memory.weights[0], action)
    choice.state = state
    choice.action = action
    choice.distance_error = follower.seen.distance - task.bounds.middle
    choice.bearing = follower.seen.bearing
    return left, right, finite


@compiled
def remember(follower: Any, left: int, right: int) -> None:
    """Note the command of a follower that has acted."""
    follower.command.left = left
    follower.command.right = right


@compiled
def _trim(task: Any, follower: Any, e_d: float) -> None:
    """Tile the place with the integral of the distance error."""
    if follower.choice.state < 0:  # an episode begins
        follower.output.trim = 0.0
        return
    first, second = trimmed(
        task.sense.trimmed,
        task,
        follower,
        e_d,
        follower.learning.place[0],
        follower.learning.place[1],
    )
    _cells_at(task, follower, first, second)


@compiled
def _commands(task: Any, follower: Any, theta: Any, action: int) -> tuple[int, int]:
    """Return what the output makes of an action, in steps/s."""
    grid = task.grid
    output = follower.output
    output.left = grid.left_steps[action // grid.right_levels]
    output.right = grid.right_steps[action % grid.right_levels]
    # an action that explores is carried out as it is
    calm = task.output.interpolated and (task.output.learning or follower.learning.learns == 0)
    if calm and follower.choice.explores == 0:
        output.left, output.right = interpolate(task, follower, theta)
    if task.output.relative:
        pace, turn = follower.estimate.pace, 0.0
        if task.shape.any:
            pace, turn = follower.place.pace, follower.place.turn
        return about(task, pace, turn, output.left, output.right)
    return output.left, output.right


@compiled
def _go_back(
    task: Any, follower: Any, period: Any, distance: float, bearing: float
) -> tuple[int, int]:
    """Advance the reset manoeuvre and record what became of it."""
    before = follower.reset.phase
    left, right = manoeuvre(task, follower, distance, bearing)
    phase = follower.reset.phase
    if phase == FOLLOW:
        period.event |= RECOVERED
    else:
        period.phase = phase
    if phase == SEARCH and before != SEARCH:
        period.event |= TIMED_OUT
    if phase == LOST and before != LOST:
        period.event |= GAVE_UP
    return left, right


@compiled
def _explore(task: Any, follower: Any, period: Any, theta: Any) -> int:
    """Return an ε-greedy action; fix its ratio ρ and the cells that it was chosen in."""
    learning = follower.learning
    choice = follower.choice
    best = greedy_of_sum(theta, learning.cells, task.grid.tilings, task.grid.actions)
    action, rho = explore(best, task.grid.actions, learning.epsilon, learning.chance)
    choice.explores = action != best
    if action != best:
        period.event |= EXPLORED
    if task.learner.ratio == GREEDY_ONLY:
        rho = 1.0 if action == best else 0.0
    elif task.learner.ratio == ON_POLICY:
        rho = 1.0
    for k in range(task.grid.tilings):
        choice.cells[k] = learning.cells[k]
    choice.rho = rho
    return action
