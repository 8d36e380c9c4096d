"""One control period of all formations, compiled: everything but the physics.

The order within a call: leader and all followers sense, and choose from the same instant; then,
while their actions run, all learn. Who is behind whom is the order of the records: robot i follows
robot i - 1, robot 0 leads.

Contract: arrays are written in place and nothing is allocated; chance comes in. Python is needed
only where a flag says so.
"""

import math
from typing import Any

import numpy as np

from workbench.arena.floor import floor_darkness
from workbench.arena.world import read_pose, write_command
from workbench.compiled import compiled
from workbench.formation.body import drive_body
from workbench.formation.follower import LEARNED, LOSS, act, learn
from workbench.formation.leader import follow_line
from workbench.formation.reset import FOLLOW
from workbench.formation.senses.camera import camera_pose, observe_tracked
from workbench.formation.senses.infrared import look, sense_proximity
from workbench.formation.senses.truth import observe
from workbench.formation.steering import OUTSIDE, wrap
from workbench.learning.behaviour import epsilon_at
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.ground import ground_reading
from workbench.robot.infrared import SENSORS

FORMATION = np.dtype(
    [
        ("updates", "i8"),
        ("budget", "i8"),
        ("periods", "i8"),
        ("last_period", "i8"),
        ("done", "i8"),
        ("restart", "i8"),
    ]
)

# bits of what control_step returns
RESTART = 1
DIVERGED = 2
FINISHED = 4


@compiled
def control_step(
    t: int,
    task: Any,
    qpos: Any,
    ctrl: Any,
    waiting: Any,
    floor: Any,
    formations: Any,
    robots: Any,
    weights: Any,
    trace_ids: Any,
    trace_values: Any,
    chance: Any,
    block: Any,
    sights: Any,
    lens: Any,
) -> int:
    """Do one control period for all formations, all but the physics; return flags, 0 if nothing
    needs Python.
    """
    flags = 0
    for b in range(formations.size):
        if formations[b].done:
            continue
        flags |= _formation_step(
            t,
            task[0],
            qpos[b],
            ctrl[b],
            waiting[b],
            floor[b],
            formations[b],
            robots[b],
            weights[b],
            trace_ids[b],
            trace_values[b],
            chance[b, t],
            block[b, t],
            sights[b],
            lens[b],
        )
    return flags


@compiled
def _formation_step(
    t: int,
    task: Any,
    qpos: Any,
    ctrl: Any,
    waiting: Any,
    floor: Any,
    formation: Any,
    robots: Any,
    weights: Any,
    trace_ids: Any,
    trace_values: Any,
    chance: Any,
    steps: Any,
    sights: Any,
    lens: Any,
) -> int:
    for i in range(robots.size):
        robot = robots[i]
        robot.x, robot.y, robot.c, robot.s = read_pose(qpos, i, task.wheels)
        steps[i].x = robot.x
        steps[i].y = robot.y
        steps[i].heading = math.atan2(robot.s, robot.c)
        if task.law or task.infrared or task.camera or task.external >= 0:
            _measure_motion(robot)
        if task.camera:
            normal = task.camera_at + 3 * i
            u = task.camera_at + 3 * robots.size + i
            shown = formation.periods % task.cam_every == 0
            camera_pose(task, robot, sights[i], lens, chance[normal : normal + 3], chance[u], shown)

    steps[0].phase = FOLLOW
    if task.external != 0:
        left, right = _lead(task, floor, robots[0], chance)
        _command(task, robots[0], ctrl, 0, left, right, chance)
        _command(task, robots[0], waiting, 0, left, right, chance)
        steps[0].left, steps[0].right = left, right

    epsilon = epsilon_at(
        task.schedule,
        task.epsilon,
        task.epsilon_final,
        task.epsilon_horizon,
        float(formation.updates),
    )
    flags = 0
    for i in range(1, robots.size):
        robot = robots[i]
        step = steps[i]
        silent = (
            task.body and robot.heard and chance[task.body_at + 2 * robots.size + i] < task.silence
        )
        robot.heard = 1
        robot.silent = silent
        # what it goes by where no new reading arrives
        distance = robot.seen_distance
        bearing = robot.seen_bearing
        if task.infrared:
            place = task.infrared_at + SENSORS * (i - 1)
            if not silent:
                sense_proximity(task, robots, i, chance[place : place + SENSORS])
            distance, bearing = look(task, robot)
        elif not silent:
            if task.camera:
                distance, bearing = observe_tracked(robot, robots[i - 1])
            else:
                distance, bearing = observe(
                    robot.x, robot.y, robot.c, robot.s, robots[i - 1].x, robots[i - 1].y
                )
            if task.noisy:
                place = task.noise_at + 2 * (i - 1)
                distance = abs(distance + task.distance_noise * chance[place])
                bearing = wrap(bearing + task.bearing_noise * chance[place + 1])
        robot.seen_distance = distance
        robot.seen_bearing = bearing
        if i == task.external:  # somebody else drives this robot
            continue
        if task.law:
            _know_ahead(robot, robots[i - 1])
        left, right, finite = act(
            task,
            robot,
            step,
            weights[robot.table],
            trace_ids[i - 1],
            trace_values[i - 1],
            distance,
            bearing,
            epsilon if robot.learns else 0.0,
            chance[2 + i],
            formation.updates < formation.budget,
        )
        if task.law == OUTSIDE and robot.phase == FOLLOW:
            continue
        if (
            task.delayed
        ):  # what has just been learned took time, in which the wheels hold the last command
            _command(task, robot, waiting, i, left, right, chance)
        if not (task.delayed and step.event & LEARNED):
            _command(task, robot, ctrl, i, left, right, chance)
        step.left, step.right = left, right
        if step.event & LEARNED:
            formation.updates += 1
        if not finite or robot.trouble:
            flags |= DIVERGED
        if task.restart and step.event & LOSS:
            flags |= RESTART
            formation.restart = 1
    for i in range(1, robots.size):
        robot = robots[i]
        if not learn(task, robot, weights[robot.table], trace_ids[i - 1], trace_values[i - 1]):
            flags |= DIVERGED
    formation.periods += 1
    if formation.updates >= formation.budget or formation.periods >= formation.last_period:
        formation.done = 1
        flags |= FINISHED
    return flags


@compiled
def _command(task: Any, robot: Any, ctrl: Any, i: int, left: int, right: int, chance: Any) -> None:
    if task.body:
        drive_body(
            task,
            robot,
            ctrl,
            i,
            left,
            right,
            chance[task.body_at + 2 * i],
            chance[task.body_at + 2 * i + 1],
        )
    else:
        write_command(ctrl, task, i, left, right)


@compiled
def carry_out(
    task: Any, robots: Any, ctrl: Any, i: int, left: int, right: int, chance: Any
) -> None:
    """Write the command of a robot that somebody else drives into its formation's ctrl row."""
    _command(task[0], robots[i], ctrl, i, left, right, chance)


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
            if robot.phase == FOLLOW:
                robot.left, robot.right = left[b, i - 1], right[b, i - 1]
                robot.ran_left, robot.ran_right = robot.left, robot.right
                _command(task[0], robot, ctrl[b], i, robot.left, robot.right, chance[b])


@compiled
def _measure_motion(robot: Any) -> None:
    """Note a robot's mean speed (m/s, along its heading) and turning rate (rad/s) over the last
    control period.
    """
    if robot.pc != 0.0 or robot.ps != 0.0:
        robot.speed = (
            (robot.x - robot.px) * robot.c + (robot.y - robot.py) * robot.s
        ) / CONTROL_PERIOD
        turned = math.atan2(
            robot.s * robot.pc - robot.c * robot.ps, robot.c * robot.pc + robot.s * robot.ps
        )
        robot.turn = turned / CONTROL_PERIOD
    else:
        robot.speed = robot.turn = 0.0
    robot.px = robot.x
    robot.py = robot.y
    robot.pc = robot.c
    robot.ps = robot.s


@compiled
def _know_ahead(robot: Any, ahead: Any) -> None:
    """Tell a follower its predecessor's relative heading, speed and turning rate."""
    robot.ahead_heading = math.atan2(
        ahead.s * robot.c - ahead.c * robot.s, ahead.c * robot.c + ahead.s * robot.s
    )
    robot.ahead_speed = ahead.speed
    robot.ahead_turn = ahead.turn


@compiled
def _lead(task: Any, floor: Any, leader: Any, noise: Any) -> tuple[int, int]:
    """Read the three ground sensors under the leader and follow the line with them."""
    left = read_ground(task, floor, leader, 0, noise[0])
    centre = read_ground(task, floor, leader, 1, noise[1])
    right = read_ground(task, floor, leader, 2, noise[2])
    return follow_line(leader, left, centre, right, task.leader_steps, task.vigour)


@compiled
def read_ground(task: Any, floor: Any, robot: Any, k: int, noise: float) -> float:
    """Return ground sensor k of a robot in counts: 0 left, 1 centre, 2 right; noise is a standard
    normal number.
    """
    x = robot.x + robot.c * task.ground_x - robot.s * task.ground_y[k]
    y = robot.y + robot.s * task.ground_x + robot.c * task.ground_y[k]
    return ground_reading(
        floor_darkness(floor, task.column0, task.row0, x, y), robot.white[k], robot.black[k], noise
    )
