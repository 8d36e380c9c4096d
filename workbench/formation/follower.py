"""The follower: sense → tile → act → learn → reset. There is one implementation, this one.

A follower is one record of type FOLLOWER, a row of weights and a sparse trace. ``act`` turns an
observation into wheel commands, by its table or by a classical law (``formation.steering``), and
caches the finished transition; ``learn`` learns what is cached. With the update buffer (paper II-D)
the loop calls ``act``, sends the command, and then ``learn``, while the action runs: action t + 1
uses weights without transition t. Without it ``act`` learns first. ρ is stored when an action is
chosen and travels with its transition.

The fast simulation loop calls both for all followers of all formations; a loop that drives one
robot calls the same two.

Contract: records, weights and traces are written in place; nothing is allocated. ``task`` is one
TASK record, which ``formation.task`` fills from a ConvoyConfig. A transition counts as a visit of
its state S_t.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import call_at, compiled
from workbench.formation.body import LONGEST_DELAY
from workbench.formation.config import MAX_TILINGS
from workbench.formation.reset import FOLLOW, LOST, SEARCH, begin_reset, manoeuvre
from workbench.formation.reward import step_reward
from workbench.formation.senses.infrared import NEAR, raw_errors
from workbench.formation.steering import CRUMBS, steer
from workbench.learning.behaviour import explore, greedy_of_sum
from workbench.learning.config import RULES
from workbench.learning.kernel import clear_trace, gq_update
from workbench.learning.sarsa import sarsa_update
from workbench.learning.tiles import tile_index
from workbench.robot.infrared import SENSORS
from workbench.robot.inversion import NODES

MAX_TILES = 64  # per dimension, of states and of actions

TASK = np.dtype(
    [
        (
            "distance_edges",
            "f8",
            (MAX_TILINGS, MAX_TILES + 2),
        ),  # m, of the error; one row per offset tiling
        ("bearing_edges", "f8", (MAX_TILINGS, MAX_TILES + 2)),  # rad
        ("distance_tiles", "i8", (MAX_TILINGS,)),
        ("bearing_tiles", "i8", (MAX_TILINGS,)),
        ("first_row", "i8", (MAX_TILINGS,)),
        ("tilings", "i8"),
        ("actions", "i8"),
        ("right_levels", "i8"),
        ("left_steps", "i8", (MAX_TILES,)),
        ("right_steps", "i8", (MAX_TILES,)),  # steps/s of each action level
        ("middle", "f8"),
        ("half_range", "f8"),
        ("limit", "f8"),
        ("sight", "f8"),  # m, m, rad, m
        ("preset", "i8"),
        ("terminal_reward", "f8"),
        ("own_reward", "i8"),
        ("own_speed", "i8"),
        ("own_turn", "i8"),  # addresses of the user's functions, see formation.own
        ("rule", "i8"),
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
        ("leader_steps", "f8"),
        ("column0", "i8"),
        ("row0", "i8"),
        ("wheels", "i8"),
        ("restart", "i8"),
        ("delayed", "i8"),  # whether commands wait for the update
        ("distance_noise", "f8"),
        ("bearing_noise", "f8"),
        ("noisy", "i8"),  # m, rad: standard deviations; whether there is any
        ("law", "i8"),
        ("gain", "f8", (8,)),
        ("slowest", "f8"),
        ("fastest", "f8"),  # of a classical follower; steps/s of a wheel
        # infrared, see formation.senses.infrared: modes; what is looked at; sampling; ambient
        # light; thresholds; the inverse
        ("infrared", "i8"),
        ("raw", "i8"),
        ("external", "i8"),
        ("noise_at", "i8"),
        ("infrared_at", "i8"),
        ("ir_radius", "f8"),
        ("ir_strength", "f8"),
        ("ir_beacon", "i8"),
        ("ir_reach", "f8"),
        ("ir_spread", "f8"),
        ("ir_age", "f8"),
        ("ambient", "f8"),
        ("ambient_c", "f8"),
        ("ambient_s", "f8"),
        ("warp", "i8"),
        ("threshold", "f8"),
        # camera, see formation.senses.camera: mode, seconds, control periods, share, spreads,
        # rectangle seen
        ("camera", "i8"),
        ("cam_latency", "f8"),
        ("cam_every", "i8"),
        ("cam_missed", "f8"),
        ("cam_noise", "f8", (4,)),
        ("cam_view", "f8", (4,)),
        ("camera_at", "i8"),
        ("raw_middle", "f8"),
        ("raw_near", "f8"),
        ("raw_far", "f8"),
        ("raw_side", "f8"),
        ("ir_table", "f8", (2, NODES, NODES)),
        # bodies and link, see formation.body: whether there is anything; share of speed; periods;
        # share; columns of chance the robot, see arena.world and formation.reset: rad or m per
        # step; steps/s; ticks; m per step and between wheels; speed against an e-puck's; searching;
        # ground sensors
        ("per_step", "f8"),
        ("most", "i8"),
        ("ticks", "i8"),
        ("step_m", "f8"),
        ("track_m", "f8"),
        ("vigour", "f8"),
        ("search_speed", "i8"),
        ("search_periods", "i8"),
        ("deadbeat", "f8"),
        ("ground_x", "f8"),
        ("ground_y", "f8", (3,)),
        ("body", "i8"),
        ("slip", "f8"),
        ("command_delay", "i8"),
        ("silence", "f8"),
        ("body_at", "i8"),
        ("haste", "f8"),
    ],
    align=True,
)

FOLLOWER = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("c", "f8"),
        ("s", "f8"),  # pose: m, cosine and sine of the heading
        ("phase", "i8"),
        ("timer", "i8"),
        ("memory", "f8"),
        ("table", "i8"),
        ("learns", "i8"),
        ("trace", "i8"),
        ("decay", "f8"),
        ("state", "i8"),
        ("action", "i8"),
        ("rho", "f8"),
        ("e_d", "f8"),
        ("o_err", "f8"),  # at the last choice; -1: none
        ("waiting", "i8"),
        ("w_state", "i8"),
        ("w_action", "i8"),
        ("w_rho", "f8"),
        ("w_reward", "f8"),
        ("w_next", "i8"),
        # first weight of the active cell of every tiling: at the last choice, now, and of the
        # waiting transition's two ends
        ("cells", "i8", (MAX_TILINGS,)),
        ("now", "i8", (MAX_TILINGS,)),
        ("w_cells", "i8", (MAX_TILINGS,)),
        ("w_next_cells", "i8", (MAX_TILINGS,)),
        ("phi", "i8", (MAX_TILINGS,)),
        ("delta", "f8"),  # the kernel's list of φ; last TD error
        ("epsilon", "f8"),
        ("q_old", "f8"),  # ε of this moment; true online Sarsa's memory
        # for classical laws: own motion in the last period and the pose before it; what is known of
        # the predecessor; memory
        ("speed", "f8"),
        ("turn", "f8"),
        ("px", "f8"),
        ("py", "f8"),
        ("pc", "f8"),
        ("ps", "f8"),
        ("ahead_heading", "f8"),
        ("ahead_speed", "f8"),
        ("ahead_turn", "f8"),  # rad relative to own, m/s, rad/s
        ("left", "i8"),
        ("right", "i8"),
        ("integral", "f8"),
        ("ox", "f8"),
        ("oy", "f8"),
        ("oh", "f8"),
        ("crumbs", "i8"),
        ("trail", "f8", (CRUMBS, 2)),
        # ground sensors: readings on white and black, and what the robot takes them for
        ("white", "f8", (3,)),
        ("black", "f8", (3,)),
        ("knows_white", "f8", (3,)),
        ("knows_black", "f8", (3,)),
        # infrared: the sensors' constants, readings in counts, what ambient light leaves, robots
        # near; last seen; last commands
        ("gain", "f8", (SENSORS,)),
        ("offset", "f8", (SENSORS,)),
        ("bias", "f8", (SENSORS,)),
        ("prox", "f8", (SENSORS,)),
        ("headroom", "f8", (SENSORS,)),
        ("near_x", "f8", (NEAR,)),
        ("near_y", "f8", (NEAR,)),
        ("left_reading", "f8"),
        ("right_reading", "f8"),
        ("blind", "i8"),
        ("sought", "f8"),
        ("ran_left", "i8"),
        ("ran_right", "i8"),
        ("seen_distance", "f8"),
        ("seen_bearing", "f8"),
        # camera: tracked pose and motion, pose when last found, periods since, whether there is one
        ("mx", "f8"),
        ("my", "f8"),
        ("mc", "f8"),
        ("ms", "f8"),
        ("mv", "f8"),
        ("mw", "f8"),
        ("sx", "f8"),
        ("sy", "f8"),
        ("sc", "f8"),
        ("ss", "f8"),
        ("missed", "i8"),
        ("tracked", "i8"),
        # body: wheel radius and axle relative to the nominal ones; commands on their way, steps/s,
        # the newest first
        ("wheel", "f8"),
        ("axle", "f8"),
        ("queue", "i8", (LONGEST_DELAY, 2)),
        ("trouble", "i8"),
        (
            "trouble_at",
            "f8",
            (2,),
        ),  # whether a function of the user's own failed, and for which arguments
        ("heard", "i8"),
        ("silent", "i8"),  # whether a reading has arrived since the start; whether none arrives now
    ],
    align=True,
)

STEP = np.dtype(  # no padding: equal records are equal bytes
    [
        ("x", "f4"),
        ("y", "f4"),
        ("heading", "f4"),
        ("distance_error", "f4"),
        ("bearing", "f4"),
        ("reward", "f4"),  # at S_t, m and rad; R_{t+1}
        ("state", "i2"),
        ("action", "i2"),  # S_t, A_t of a transition that finished now, or -1
        ("left", "i2"),
        ("right", "i2"),  # command in steps/s
        ("phase", "i2"),
        ("event", "i2"),
    ]
)

# bits of STEP.event; EXPLORED: of the command; BLINDED: ambient light leaves the front sensors
# nothing to read with
LOSS = 1
RECOVERED = 2
TIMED_OUT = 4
GAVE_UP = 8
LEARNED = 16
EXPLORED = 32
BLINDED = 64

_ONES = np.ones(MAX_TILINGS)
_WATKINS, _EXPECTED, _SARSA = (
    RULES.index(name) for name in ("watkins-q", "expected-sarsa", "true-online-sarsa")
)


@compiled
def begin_episode(follower: Any, trace_ids: Any) -> None:
    """Forget the last action and clear the trace."""
    follower.trace = clear_trace(trace_ids[0], trace_ids[1], follower.trace)
    follower.decay = follower.q_old = 0.0
    follower.state = -1


@compiled
def learn(task: Any, follower: Any, weights: Any, trace_ids: Any, trace_values: Any) -> bool:
    """Learn the cached transition, if there is one; return whether the numbers stayed finite.

    Args:
        task, follower: records of type TASK and FOLLOWER.
        weights: (2, pairs) main and secondary weights.
        trace_ids: (3, pairs) index and slot of the sparse trace, and room for the features of φ̄.
        trace_values: (2, pairs) values of the trace, and room for those of φ̄.
    """
    if follower.waiting == 0:
        return True
    follower.waiting = 0
    phi = follower.phi
    m = task.tilings
    for k in range(m):
        phi[k] = follower.w_cells[k] + follower.w_action
    gamma = 0.0
    count = 0
    w_e = 0.0
    if follower.w_next >= 0:
        gamma = task.gamma
        count = _expect(task, follower, weights[0], trace_ids[2], trace_values[1])
    bar = trace_ids[2, :count]
    bar_value = trace_values[1, :count]
    if task.rule == _SARSA:
        follower.trace, follower.delta, follower.q_old = sarsa_update(
            weights[0],
            trace_ids[0],
            trace_values[0],
            trace_ids[1],
            follower.trace,
            phi[:m],
            _ONES,
            bar,
            bar_value,
            follower.w_reward,
            follower.decay,
            gamma,
            task.alpha,
            follower.q_old,
            task.cutoff,
        )
    else:
        follower.trace, follower.delta, w_e = gq_update(
            weights[0],
            weights[1],
            trace_ids[0],
            trace_values[0],
            trace_ids[1],
            follower.trace,
            phi[:m],
            _ONES,
            bar,
            bar_value,
            follower.w_reward,
            0.0,
            1.0,
            follower.w_rho,
            follower.decay,
            gamma,
            task.lam,
            task.alpha,
            task.beta,
            task.cutoff,
            task.kappa,
        )
    follower.decay = gamma * task.lam
    finite = (
        math.isfinite(follower.delta) and math.isfinite(w_e) and math.isfinite(weights[0, phi[0]])
    )
    if follower.w_next < 0:
        begin_episode(follower, trace_ids)
    return finite


@compiled
def _expect(task: Any, follower: Any, theta: Any, bar: Any, bar_value: Any) -> int:
    """Write φ̄_{t+1} under the rule's target policy as lists of features and values; return their
    length.
    """
    cells = follower.w_next_cells
    m = int(task.tilings)
    actions = int(task.actions)
    if task.rule == _SARSA:  # the action that is running now
        best = follower.action
    else:
        best = greedy_of_sum(theta, cells, m, actions)
    if task.rule != _EXPECTED:
        for k in range(m):
            bar[k] = cells[k] + best
            bar_value[k] = 1.0
        return m
    share = follower.epsilon / actions
    for k in range(m):
        for action in range(actions):
            place = k * actions + action
            bar[place] = cells[k] + action
            bar_value[place] = share + (1.0 - follower.epsilon if action == best else 0.0)
    return m * actions


@compiled
def sense_cells(task: Any, follower: Any, e_d: float, o_err: float) -> int:
    """Find the cell of every tiling, as the place of its first weight; return the state, -1 outside
    the bounds.
    """
    state = -1
    first = e_d
    second = o_err
    if task.raw:
        if not (abs(e_d) < task.half_range and abs(o_err) < task.limit):
            return -1
        first = follower.left_reading
        second = follower.right_reading
    for k in range(task.tilings):
        row = tile_index(task.distance_edges[k], task.distance_tiles[k], first)
        column = tile_index(task.bearing_edges[k], task.bearing_tiles[k], second)
        if row < 0 or column < 0:
            return -1
        cell = row * task.bearing_tiles[k] + column
        if k == 0:
            state = cell
        follower.now[k] = (task.first_row[k] + cell) * task.actions
    return state


@compiled
def reward_at(task: Any, follower: Any, e_d: float, o_err: float) -> float:
    """Return the reward of a step that ends inside the bounds, at errors in m and rad or at the
    readings in the record.
    """
    if task.raw:
        u, v = raw_errors(task, follower)
    else:
        u, v = e_d / task.half_range, o_err / task.limit
    if task.own_reward:
        own: float = call_at(task.own_reward, u, v)
        if not math.isfinite(own):
            follower.trouble = 1
            follower.trouble_at[0] = u
            follower.trouble_at[1] = v
        return own
    return step_reward(task.preset, u, v)


@compiled
def _finish(
    task: Any, follower: Any, step: Any, reward: float, next_state: int, room: bool
) -> None:
    """Cache the transition that ends now and record it as a visit of its state, unless the run's
    budget is used up.
    """
    if follower.learns and not room:
        return
    follower.waiting = follower.learns
    follower.w_state = follower.state
    follower.w_action = follower.action
    follower.w_rho = follower.rho
    follower.w_reward = reward
    follower.w_next = next_state
    for k in range(task.tilings):
        follower.w_cells[k] = follower.cells[k]
        follower.w_next_cells[k] = follower.now[k]
    step.state = follower.state
    step.action = follower.action
    step.reward = reward
    step.distance_error = follower.e_d
    step.bearing = follower.o_err
    if follower.learns:
        step.event |= LEARNED


@compiled
def act(
    task: Any,
    follower: Any,
    step: Any,
    weights: Any,
    trace_ids: Any,
    trace_values: Any,
    distance: float,
    bearing: float,
    epsilon: float,
    u: float,
    room: bool,
) -> tuple[int, int, bool]:
    """Observe, finish the running transition and choose wheel commands, which are remembered.

    Args:
        task, follower, step: records of type TASK, FOLLOWER and STEP (written: what happened).
        weights, trace_ids, trace_values: see ``learn``.
        distance, bearing: of the predecessor, m and rad.
        epsilon, u: exploration rate and one uniform number in [0, 1).
        room: whether the run has room for one more learning update.

    Returns:
        (left, right, finite): commands in whole steps/s; False where learning diverged.
    """
    left, right, finite = _choose(
        task, follower, step, weights, trace_ids, trace_values, distance, bearing, epsilon, u, room
    )
    follower.ran_left, follower.ran_right = left, right
    if follower.blind:
        step.event |= BLINDED
    return left, right, finite


@compiled
def _choose(
    task: Any,
    follower: Any,
    step: Any,
    weights: Any,
    trace_ids: Any,
    trace_values: Any,
    distance: float,
    bearing: float,
    epsilon: float,
    u: float,
    room: bool,
) -> tuple[int, int, bool]:
    step.state = -1
    step.action = -1
    step.event = 0
    step.distance_error = 0.0
    step.bearing = 0.0
    step.reward = 0.0
    follower.epsilon = epsilon
    finite = True
    e_d = distance - task.middle
    if follower.phase != FOLLOW:
        before = follower.phase
        left, right = manoeuvre(task, follower, distance, bearing)
        if follower.phase != FOLLOW:
            if follower.phase == SEARCH and before != SEARCH:
                step.event |= TIMED_OUT
            if follower.phase == LOST and before != LOST:
                step.event |= GAVE_UP
            step.phase = follower.phase
            return left, right, finite
        step.event |= RECOVERED
    state = sense_cells(task, follower, e_d, bearing)
    lost = state < 0
    if follower.state >= 0:
        reward = task.terminal_reward if lost else reward_at(task, follower, e_d, bearing)
        _finish(task, follower, step, reward, state, room)
        if not task.buffer:
            finite = learn(task, follower, weights, trace_ids, trace_values)
    if lost:
        step.event |= LOSS
        follower.state = -1
        begin_reset(follower, distance, task.middle - task.half_range)
        step.phase = follower.phase
        left, right = manoeuvre(task, follower, distance, bearing)
        return left, right, finite
    step.phase = FOLLOW
    if task.law:
        left, right = steer(task, follower, distance, bearing)
        follower.state = state
        follower.action = -1
        follower.e_d = e_d
        follower.o_err = bearing
        return left, right, finite
    best = greedy_of_sum(weights[0], follower.now, task.tilings, task.actions)
    action, rho = explore(best, task.actions, epsilon, u)
    if action != best:
        step.event |= EXPLORED
    if task.rule == _WATKINS:
        rho = 1.0 if action == best else 0.0
    elif task.rule == _EXPECTED:
        rho = 1.0  # on-policy
    for k in range(task.tilings):
        follower.cells[k] = follower.now[k]
    follower.state = state
    follower.action = action
    follower.rho = rho
    follower.e_d = e_d
    follower.o_err = bearing
    return (
        task.left_steps[action // task.right_levels],
        task.right_steps[action % task.right_levels],
        finite,
    )
