"""One control period of all formations, compiled: everything but the physics.

The order within a call: leader and all followers sense, and choose from the same instant; then all
learn. The physics follows, so that in simulated time they learn while their actions run; without
the update buffer a follower learns before it chooses (``follower.act``). Who follows whom is
data (``robot.ahead``): robot i the robot i - 1, or with a shape its place by the leader, robot 0.

Contract: arrays are written in place and nothing is allocated; chance comes in. Python is needed
only where a flag says so.
"""

import math
from typing import Any, NamedTuple

from workbench.arena.engine import advance
from workbench.arena.floor import floor_darkness
from workbench.arena.world import read_pose, write_command
from workbench.compiled import compiled
from workbench.formation.body import drive_body
from workbench.formation.follower import LEARNED, LOSS, Memory, act, learn, remember
from workbench.formation.graph import grade
from workbench.formation.laws.table import OUTSIDE
from workbench.formation.leader import follow_line
from workbench.formation.reset import FOLLOW
from workbench.formation.senses.table import locate, see
from workbench.formation.senses.truth import observe
from workbench.learning.behaviour import epsilon_at
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.ground import ground_reading

# bits of what control_step returns
RESTART = 1
DIVERGED = 2
FINISHED = 4


Part = tuple[Any, tuple[Any, ...]]  # a compiled function, and arguments like those that it gets


class Arrays(NamedTuple):
    """Everything that a control period reads and writes, for all formations, or for one.

    Attributes:
        task: (1,) TASK.
        qpos, ctrl: (B, nq), (B, nu) the world's; waiting: (B, nu) commands that wait for an update.
        floor: (B, rows, columns) rasters.
        formations: (B,) FORMATION.
        robots: (B, robots) ROBOT.
        weights: (B, tables, 2, pairs); trace_ids: (B, followers, 3, pairs); trace_values: (B,
            followers, 2, pairs), see ``follower.Memory``.
        chance: (B, BLOCK, robots) CHANCE.
        block: (B, BLOCK, robots) PERIOD.
        sights: (B, robots, 4) of pictures; lens: (B, 3, n, n) systematic errors of the camera.
        engines: (B,) ENGINE.
        trail: (B, crumbs, 3) of the leaders: x, y, arc length in m; see ``virtual``.
    """

    task: Any
    qpos: Any
    ctrl: Any
    waiting: Any
    floor: Any
    formations: Any
    robots: Any
    weights: Any
    trace_ids: Any
    trace_values: Any
    chance: Any
    block: Any
    sights: Any
    lens: Any
    engines: Any
    trail: Any


@compiled
def control_step(t: int, arrays: Any) -> int:
    """Do one control period, the t-th of the block, for all formations, all but the physics; return
    flags, 0 if nothing needs Python.
    """
    flags = 0
    for b in range(arrays.formations.size):
        if arrays.formations[b].done:
            continue
        flags |= _formation_step(_of_one(arrays, b, t), b)
    return flags


@compiled
def run_formation(t: int, acted: bool, b: int, arrays: Any) -> tuple[int, int]:
    """Do a formation's control periods from the t-th of the block on, physics included, up to the
    end of the block or of the run, or up to where Python is needed: return that period and flags.

    Args:
        acted: whether period t is done but for its physics.
    """
    formation = arrays.formations[b]
    engine = arrays.engines[b]
    while t < arrays.block.shape[1] and not formation.done:
        one = _of_one(arrays, b, t)
        if not acted:
            flags = _formation_step(one, b)
            if flags & ~FINISHED:
                return t, flags
        acted = False
        if not formation.done:
            advance(engine, one.robots, one.qpos, one.ctrl, one.waiting)
        t += 1
    return t, 0


@compiled
def _of_one(arrays: Any, b: int, t: int) -> Any:
    """Return what the t-th control period of one formation reads and writes."""
    return Arrays(
        arrays.task,
        arrays.qpos[b],
        arrays.ctrl[b],
        arrays.waiting[b],
        arrays.floor[b],
        arrays.formations,
        arrays.robots[b],
        arrays.weights[b],
        arrays.trace_ids[b],
        arrays.trace_values[b],
        arrays.chance[b, t],
        arrays.block[b, t],
        arrays.sights[b],
        arrays.lens[b],
        arrays.engines,
        arrays.trail[b],
    )


@compiled
def _formation_step(one: Any, b: int) -> int:
    task = one.task[0]
    formation = one.formations[b]
    robots = one.robots
    periods = one.block
    # where everybody is, as the world and a camera have it
    for i in range(robots.size):
        _locate(task, one, formation, i)
    if task.graph.count:
        grade(task, robots)
    # the leader follows its line
    periods[0].phase = FOLLOW
    if task.run.external != 0:
        left, right = _lead(task, one.floor, robots[0], one.chance[0])
        _command(task, robots[0], one.ctrl, 0, left, right, one.chance[0].slip)
        _command(task, robots[0], one.waiting, 0, left, right, one.chance[0].slip)
        periods[0].left = left
        periods[0].right = right
    # followers sense, and choose from the same instant
    learner = task.learner
    epsilon = epsilon_at(
        learner.schedule,
        learner.epsilon,
        learner.epsilon_final,
        learner.epsilon_horizon,
        float(formation.updates),
    )
    flags = 0
    for i in range(1, robots.size):
        robot = robots[i]
        _sense(task, robots, i, one.chance[i])
        if i == task.run.external:  # somebody else drives this robot
            continue
        if task.law.number:
            know_ahead(task, robot, robots[robot.ahead])
        robot.learning.epsilon = epsilon if robot.learning.learns else 0.0
        robot.learning.chance = one.chance[i].explore
        robot.learning.room = formation.updates < formation.budget
        left, right, finite = act(task, robot, periods[i], _memory(one, i))
        flags |= _settle(task, one, formation, i, left, right, finite)
    # then all learn; the physics of this period is still to come
    for i in range(1, robots.size):
        if not learn(task, robots[i], _memory(one, i)):
            flags |= DIVERGED
    formation.periods += 1
    if formation.updates >= formation.budget or formation.periods >= formation.last_period:
        formation.done = 1
        flags |= FINISHED
    return flags


def halves(arrays: Arrays, *, lean: bool) -> tuple[list[Part], list[Part]]:
    """Return functions that a block consists of, with arguments like theirs, in two halves that
    take about as long to compile: two processes can share the work.

    Args:
        lean: whether acting is without learning, which the whole loop may do at once.
    """
    one = _of_one.py_func(arrays, 0, 0)
    task, leader, robot, period = one.task[0], one.robots[0], one.robots[1], one.block[1]
    formation = one.formations[0]
    memory = Memory(one.weights[0], one.trace_ids[0], one.trace_values[0])
    rest: list[Part] = [
        (_sense, (task, one.robots, 1, one.chance[1])),
        (_locate, (task, one, formation, 1)),
        (advance, (one.engines[0], one.robots, one.qpos, one.ctrl, one.waiting)),
        (_lead, (task, one.floor, leader, one.chance[0])),
    ]
    if lean:
        rest.append((learn, (task, robot, memory)))
    return rest, [(act, (task, robot, period, memory))]


@compiled
def _memory(one: Any, i: int) -> Any:
    """Return what follower i learns with."""
    table = one.robots[i].learning.table
    return Memory(one.weights[table], one.trace_ids[i - 1], one.trace_values[i - 1])


@compiled
def _locate(task: Any, one: Any, formation: Any, i: int) -> None:
    """Note the pose of robot i, its motion where it is needed, and what a camera makes of it."""
    robot = one.robots[i]
    pose = robot.pose
    pose.x, pose.y, pose.cos, pose.sin = read_pose(one.qpos, i, task.motors.drive)
    period = one.block[i]
    period.x = pose.x
    period.y = pose.y
    period.heading = math.atan2(pose.sin, pose.cos)
    if i < task.run.moving:
        _measure_motion(robot)
    locate(task.sense.locate, task, one, formation, i)


@compiled
def _sense(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write what follower i sees of its predecessor; without a new reading the last one stays."""
    seen = robots[i].seen
    silent = task.body.any and seen.heard and chance.silence < task.body.silence
    seen.heard = 1
    seen.silent = silent
    see(task.sense.see, task, robots, i, chance)


@compiled
def _settle(
    task: Any, one: Any, formation: Any, i: int, left: int, right: int, finite: bool
) -> int:
    """Let follower i carry out what it has chosen, and remember it; return flags."""
    robot = one.robots[i]
    period = one.block[i]
    slip = one.chance[i].slip
    remember(robot, left, right)
    if task.law.number == OUTSIDE and robot.reset.phase == FOLLOW:
        return 0
    learned = period.event & LEARNED
    # what has just been learned took time, in which the wheels hold the last command
    if task.run.delayed:
        _command(task, robot, one.waiting, i, left, right, slip)
    if not (task.run.delayed and learned):
        _command(task, robot, one.ctrl, i, left, right, slip)
    period.left = left
    period.right = right
    if learned:
        formation.updates += 1
    flags = 0
    if not finite or robot.failure.any:
        flags |= DIVERGED
    if task.run.restart and period.event & LOSS:
        flags |= RESTART
        formation.restart = 1
    return flags


@compiled
def _command(task: Any, robot: Any, ctrl: Any, i: int, left: int, right: int, slip: Any) -> None:
    if task.body.any:
        drive_body(task, robot, ctrl, i, left, right, slip[0], slip[1])
    else:
        write_command(ctrl, task.motors, i, left, right)


@compiled
def carry_out(
    task: Any, robots: Any, ctrl: Any, i: int, left: int, right: int, chance: Any
) -> None:
    """Write the command of a robot that somebody else drives into its formation's ctrl row."""
    _command(task[0], robots[i], ctrl, i, left, right, chance[i].slip)


@compiled
def carry_out_all(
    task: Any, formations: Any, robots: Any, ctrl: Any, left: Any, right: Any, chance: Any
) -> None:
    """Write the commands (B, followers) from outside of all followers that follow, in formations
    that are not done.
    """
    for b in range(formations.size):
        if formations[b].done:
            continue
        for i in range(1, robots.shape[1]):
            robot = robots[b, i]
            if robot.reset.phase == FOLLOW:
                robot.law.left = left[b, i - 1]
                robot.law.right = right[b, i - 1]
                robot.command.left = robot.law.left
                robot.command.right = robot.law.right
                slip = chance[b, i].slip
                _command(task[0], robot, ctrl[b], i, robot.law.left, robot.law.right, slip)


@compiled
def _measure_motion(robot: Any) -> None:
    """Note a robot's mean speed (m/s, along its heading) and turning rate (rad/s) over the last
    control period.
    """
    pose = robot.pose
    motion = robot.motion
    if motion.from_cos != 0.0 or motion.from_sin != 0.0:
        dx, dy = pose.x - motion.from_x, pose.y - motion.from_y
        motion.speed = (dx * pose.cos + dy * pose.sin) / CONTROL_PERIOD
        turned = math.atan2(
            pose.sin * motion.from_cos - pose.cos * motion.from_sin,
            pose.cos * motion.from_cos + pose.sin * motion.from_sin,
        )
        motion.turn = turned / CONTROL_PERIOD
    else:
        motion.speed = motion.turn = 0.0
    motion.from_x = pose.x
    motion.from_y = pose.y
    motion.from_cos = pose.cos
    motion.from_sin = pose.sin


@compiled
def know_ahead(task: Any, robot: Any, ahead: Any) -> None:
    """Tell a follower its predecessor's relative heading, speed and turning rate, or those of its
    place.
    """
    mine = robot.pose
    c, s = ahead.pose.cos, ahead.pose.sin
    robot.law.ahead_speed = ahead.motion.speed
    robot.law.ahead_turn = ahead.motion.turn
    if task.shape.any:
        _know_leader(robot, ahead)
        c, s = robot.place.ahead_cos, robot.place.ahead_sin
        robot.law.ahead_speed = robot.place.pace
        robot.law.ahead_turn = robot.place.turn
    robot.law.ahead_heading = math.atan2(s * mine.cos - c * mine.sin, c * mine.cos + s * mine.sin)


@compiled
def _know_leader(robot: Any, leader: Any) -> None:
    """Tell a follower that has a place where its leader itself is, and how that moves."""
    mine, its = robot.pose, leader.pose
    told = robot.law.leader
    told.distance, told.bearing = observe(mine.x, mine.y, mine.cos, mine.sin, its.x, its.y)
    told.heading = math.atan2(
        its.sin * mine.cos - its.cos * mine.sin, its.cos * mine.cos + its.sin * mine.sin
    )
    told.speed = leader.place.pace
    told.turn = leader.place.turn


@compiled
def _lead(task: Any, floor: Any, leader: Any, chance: Any) -> tuple[int, int]:
    """Read the three ground sensors under the leader and follow the line with them."""
    noise = chance.ground
    left = read_ground(task, floor, leader, 0, noise[0])
    centre = read_ground(task, floor, leader, 1, noise[1])
    right = read_ground(task, floor, leader, 2, noise[2])
    return follow_line(leader, left, centre, right, task.leader.speed, task.leader.vigour)


@compiled
def read_ground(task: Any, floor: Any, robot: Any, k: int, noise: float) -> float:
    """Return ground sensor k of a robot in counts: 0 left, 1 centre, 2 right; noise is a standard
    normal number.
    """
    pose = robot.pose
    ahead = task.leader.ground_x
    aside = task.leader.ground_y[k]
    x = pose.x + pose.cos * ahead - pose.sin * aside
    y = pose.y + pose.sin * ahead + pose.cos * aside
    dark = floor_darkness(floor, task.leader.column0, task.leader.row0, x, y)
    return ground_reading(dark, robot.ground.white[k], robot.ground.black[k], noise)
