"""What a follower senses with its own infrared, and what it makes of it: distance and bearing of
the robot in front.

Both routes of the paper's section III-B look at the same two readings, of the left and the right
front sensor (ps7, ps0):

    ir-metric   inverts them to a distance in m and a bearing in rad (``robot.inversion``), which
                are then tiled;
    ir-raw      tiles the readings themselves; reward and state know nothing of metres. Only the
                terminal bounds and the reset manoeuvre use the inversion, as a firmware would hold
                them as thresholds on counts.

Nothing is seen below a threshold of counts. Where a side sensor (ps1, ps6) reads more than the
front ones, the robot in front is about 50° to that side. What was seen last is remembered, and
turned along with the robot's own commands.

Contract: compiled; writes the follower's record, allocates nothing. A robot in sight has a finite
distance; UNSEEN otherwise.
"""

import math
from typing import Any

from workbench.compiled import compiled
from workbench.formation.steering import wrap
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK
from workbench.robot.infrared import (
    BLINDED,
    RING,
    SLOT,
    circles_light,
    headroom,
    raw_reading,
    warped,
)
from workbench.robot.inversion import FLOOR, invert
from workbench.robot.motors import motor_speed

NEAR = 8  # robots that one robot's sensors can be shown at once
UNSEEN = 1e6  # m
SIDEWAYS = math.radians(50)  # bearing of what a side sensor sees best


@compiled
def sense_proximity(task: Any, robots: Any, i: int, noise: Any) -> None:
    """Read the eight sensors of robot i into its ``prox``, as whole calibrated counts.

    Args:
        task: record of type TASK.
        robots: (robots,) records of one formation with pose and motion of this moment.
        noise: (8,) standard normal numbers.
    """
    robot = robots[i]
    reach = task.ir_reach + RING + task.ir_radius
    for slot in range(4):  # the younger the pair, the smaller the age: poses are extrapolated back
        age = task.ir_age + (3 - slot) * SLOT
        turned = -age * robot.turn
        cos, sin = math.cos(turned), math.sin(turned)
        c, s = robot.c * cos - robot.s * sin, robot.s * cos + robot.c * sin
        x, y = _earlier(robot, age)
        count = 0
        for j in range(robots.size):
            if j == i or count == NEAR:
                continue
            other = robots[j]
            ox, oy = _earlier(other, age)
            if (ox - x) * (ox - x) + (oy - y) * (oy - y) < reach * reach:
                robot.near_x[count], robot.near_y[count] = ox, oy
                count += 1
        for k in (slot, slot + 4):
            light = 0.0
            if count:
                light = circles_light(
                    k,
                    x,
                    y,
                    c,
                    s,
                    robot.near_x,
                    robot.near_y,
                    count,
                    task.ir_radius,
                    task.ir_strength,
                    task.ir_beacon,
                )
            room = headroom(k, c, s, task.ambient, task.ambient_c, task.ambient_s)
            raw = raw_reading(light, robot.gain[k], robot.offset[k], room, noise[k], task.ir_spread)
            robot.prox[k] = max(raw - robot.bias[k], 0.0)
            robot.headroom[k] = round(room)


@compiled
def _earlier(robot: Any, age: float) -> tuple[float, float]:
    """Return where a robot was some seconds ago, on the chord of the arc that it drives."""
    half = -age * robot.turn / 2
    along = age * robot.speed
    x: float = robot.x - along * (robot.c * math.cos(half) - robot.s * math.sin(half))
    y: float = robot.y - along * (robot.s * math.cos(half) + robot.c * math.sin(half))
    return x, y


@compiled
def look(task: Any, robot: Any) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the robot in front from the readings in ``prox``,
    UNSEEN if there is none.
    """
    left, right = robot.prox[7], robot.prox[0]
    robot.left_reading, robot.right_reading = warped(left, task.warp), warped(right, task.warp)
    robot.blind = min(robot.headroom[0], robot.headroom[7]) < BLINDED
    front = max(left, right)
    side = max(robot.prox[1], robot.prox[6])
    if robot.blind or max(front, side) < task.threshold:
        turned = (
            (motor_speed(robot.ran_right) - motor_speed(robot.ran_left))
            * STEP
            / TRACK
            * CONTROL_PERIOD
        )
        robot.sought = wrap(robot.sought - turned)
        return UNSEEN, robot.sought
    if front >= side:
        distance, bearing = invert(task.ir_table, left, right)
    else:
        distance, _ = invert(
            task.ir_table, side, 0.1 * side
        )  # as if a front sensor saw it that much to one side
        bearing = SIDEWAYS if robot.prox[6] > robot.prox[1] else -SIDEWAYS
    robot.sought = bearing
    return distance, bearing


@compiled
def raw_errors(task: Any, robot: Any) -> tuple[float, float]:
    """Return the distance-like and the bearing-like error of two readings, both in [-1, 1], for the
    reward of ir-raw.

    The mean of the logarithms counts from the wanted place to the bounds, straight ahead; their
    difference to the bound of the bearing at the wanted distance. Positive: too far; to the left.
    """
    left, right = math.log(robot.left_reading + FLOOR), math.log(robot.right_reading + FLOOR)
    mean = (left + right) / 2 - task.raw_middle
    u = mean / task.raw_far if mean < 0.0 else -mean / task.raw_near
    v = (left - right) / task.raw_side
    return min(max(u, -1.0), 1.0), min(max(v, -1.0), 1.0)
