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

import numpy as np

from workbench.compiled import compiled
from workbench.formation.steering import wrap
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK
from workbench.robot.infrared import (
    BLINDED,
    RING,
    SENSORS,
    SLOT,
    circles_light,
    headroom,
    raw_reading,
    warped,
)
from workbench.robot.inversion import FLOOR, NODES, invert
from workbench.robot.motors import motor_speed

NEAR = 8  # robots that one robot's sensors can be shown at once
UNSEEN = 1e6  # m
SIDEWAYS = math.radians(50)  # bearing of what a side sensor sees best

INFRARED = np.dtype(
    [
        ("gain", "f8", (SENSORS,)),  # the sensors' constants, and what calibration takes off
        ("offset", "f8", (SENSORS,)),
        ("bias", "f8", (SENSORS,)),
        ("readings", "f8", (SENSORS,)),  # calibrated counts; what ambient light leaves of them
        ("headroom", "f8", (SENSORS,)),
        ("near_x", "f8", (NEAR,)),  # robots near, m
        ("near_y", "f8", (NEAR,)),
        ("left", "f8"),  # the two front readings as they are tiled
        ("right", "f8"),
        ("blind", "i8"),
        ("sought", "f8"),  # where the predecessor was seen last, rad
    ]
)
PERCEPTION = np.dtype(
    [
        ("sees", "i8"),  # whether followers see by infrared; whether they tile raw readings
        ("raw", "i8"),
        ("radius", "f8"),  # what is looked at; sampling
        ("strength", "f8"),
        ("beacon", "i8"),
        ("reach", "f8"),
        ("spread", "f8"),
        ("age", "f8"),
        ("ambient", "f8"),  # light from one side
        ("ambient_cos", "f8"),
        ("ambient_sin", "f8"),
        ("warp", "i8"),
        ("threshold", "f8"),
        ("raw_middle", "f8"),  # scales of raw errors, see ``readings.raw_scales``
        ("raw_near", "f8"),
        ("raw_far", "f8"),
        ("raw_side", "f8"),
        ("table", "f8", (2, NODES, NODES)),
    ]
)


@compiled
def sense_proximity(task: Any, robots: Any, i: int, noise: Any) -> None:
    """Read the eight sensors of robot i into its ``readings``, as whole calibrated counts.

    Args:
        task: record of type TASK.
        robots: (robots,) records of one formation with pose and motion of this moment.
        noise: (8,) standard normal numbers.
    """
    robot = robots[i]
    reach = task.infrared.reach + RING + task.infrared.radius
    for slot in range(4):  # the younger the pair, the smaller the age: poses are extrapolated back
        age = task.infrared.age + (3 - slot) * SLOT
        turned = -age * robot.motion.turn
        cos, sin = math.cos(turned), math.sin(turned)
        c, s = (
            robot.pose.cos * cos - robot.pose.sin * sin,
            robot.pose.sin * cos + robot.pose.cos * sin,
        )
        x, y = _earlier(robot, age)
        count = 0
        for j in range(robots.size):
            if j == i or count == NEAR:
                continue
            other = robots[j]
            ox, oy = _earlier(other, age)
            if (ox - x) * (ox - x) + (oy - y) * (oy - y) < reach * reach:
                robot.infrared.near_x[count], robot.infrared.near_y[count] = ox, oy
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
                    robot.infrared.near_x,
                    robot.infrared.near_y,
                    count,
                    task.infrared.radius,
                    task.infrared.strength,
                    task.infrared.beacon,
                )
            room = headroom(
                k, c, s, task.infrared.ambient, task.infrared.ambient_cos, task.infrared.ambient_sin
            )
            raw = raw_reading(
                light,
                robot.infrared.gain[k],
                robot.infrared.offset[k],
                room,
                noise[k],
                task.infrared.spread,
            )
            robot.infrared.readings[k] = max(raw - robot.infrared.bias[k], 0.0)
            robot.infrared.headroom[k] = round(room)


@compiled
def _earlier(robot: Any, age: float) -> tuple[float, float]:
    """Return where a robot was some seconds ago, on the chord of the arc that it drives."""
    half = -age * robot.motion.turn / 2
    along = age * robot.motion.speed
    x: float = robot.pose.x - along * (
        robot.pose.cos * math.cos(half) - robot.pose.sin * math.sin(half)
    )
    y: float = robot.pose.y - along * (
        robot.pose.sin * math.cos(half) + robot.pose.cos * math.sin(half)
    )
    return x, y


@compiled
def look(task: Any, robot: Any) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the robot in front from the readings in ``prox``,
    UNSEEN if there is none.
    """
    left, right = robot.infrared.readings[7], robot.infrared.readings[0]
    robot.infrared.left, robot.infrared.right = (
        warped(left, task.infrared.warp),
        warped(right, task.infrared.warp),
    )
    robot.infrared.blind = min(robot.infrared.headroom[0], robot.infrared.headroom[7]) < BLINDED
    front = max(left, right)
    side = max(robot.infrared.readings[1], robot.infrared.readings[6])
    if robot.infrared.blind or max(front, side) < task.infrared.threshold:
        turned = (
            (motor_speed(robot.command.right) - motor_speed(robot.command.left))
            * STEP
            / TRACK
            * CONTROL_PERIOD
        )
        robot.infrared.sought = wrap(robot.infrared.sought - turned)
        return UNSEEN, robot.infrared.sought
    if front >= side:
        distance, bearing = invert(task.infrared.table, left, right)
    else:
        distance, _ = invert(
            task.infrared.table, side, 0.1 * side
        )  # as if a front sensor saw it that much to one side
        bearing = SIDEWAYS if robot.infrared.readings[6] > robot.infrared.readings[1] else -SIDEWAYS
    robot.infrared.sought = bearing
    return distance, bearing


@compiled
def raw_errors(task: Any, robot: Any) -> tuple[float, float]:
    """Return the distance-like and the bearing-like error of two readings, both in [-1, 1], for the
    reward of ir-raw.

    The mean of the logarithms counts from the wanted place to the bounds, straight ahead; their
    difference to the bound of the bearing at the wanted distance. Positive: too far; to the left.
    """
    left, right = math.log(robot.infrared.left + FLOOR), math.log(robot.infrared.right + FLOOR)
    mean = (left + right) / 2 - task.infrared.raw_middle
    u = mean / task.infrared.raw_far if mean < 0.0 else -mean / task.infrared.raw_near
    v = (left - right) / task.infrared.raw_side
    return min(max(u, -1.0), 1.0), min(max(v, -1.0), 1.0)
