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
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from workbench.compiled import compiled, uncompiled
from workbench.formation.angles import wrap
from workbench.formation.output import spent
from workbench.formation.readings import raw_scales, reading_tilings
from workbench.formation.reset import DRIVE_ON_PERIODS
from workbench.formation.senses.sense import FOLLOWERS, Draw, Sense, Values
from workbench.formation.streams import own_chance
from workbench.learning.tiles import Tiling
from workbench.robot.geometry import CONTROL_PERIOD, STEP, TRACK
from workbench.robot.infrared import (
    ADC,
    BEACON_RANGE,
    BLINDED,
    RANGE,
    RAYS,
    RING,
    SENSORS,
    SLOT,
    WARPS,
    Circles,
    calibrate,
    circles_light,
    draw_units,
    front_pair,
    headroom,
    raw_reading,
    strength_of,
    warped,
)
from workbench.robot.inversion import (
    DISTANCES,
    FLOOR,
    NODES,
    WIDEST,
    inversion_table,
    invert,
)
from workbench.robot.motors import motor_speed

NEAR = 8  # robots that one robot's sensors can be shown at once
UNSEEN = 1e6  # m
SIDEWAYS = math.radians(50)  # bearing of what a side sensor sees best
# spread of distances in m and bearings in rad while a frozen follower follows in the default arena:
# what a filter expects
NOISE_TOLD = (3e-4, math.radians(0.35))
# whole numbers of the trim of readings: parts of a logarithm and of the integral, and its shift
LOG_PARTS = 256
TRIM_BITS = 15
TRIM_SHIFT = 10
TRIM_ONE = 1 << TRIM_BITS
TRIM_UNIT = 1 << (TRIM_BITS + TRIM_SHIFT)
LARGEST_TRIM = 0.75
MOVED = 0.1  # m, more than a robot moves while the sensors are read
LOOKING = np.array([1, 1, 0, 0, 0, 0, 1, 1], np.bool_)  # sensors that a follower follows by
ALL = np.ones(SENSORS, np.bool_)

INFRARED = np.dtype(
    [
        ("gain", "f8", (SENSORS,)),  # the sensors' constants, and what calibration takes off
        ("offset", "f8", (SENSORS,)),
        ("bias", "f8", (SENSORS,)),
        ("readings", "f8", (SENSORS,)),  # calibrated counts; what ambient light leaves of them
        ("headroom", "f8", (SENSORS,)),
        ("near_x", "f8", (NEAR,)),  # robots near, m
        ("near_y", "f8", (NEAR,)),
        ("rays", "f8", (RAYS,)),  # what each ray brings back, while a sensor is read
        ("left", "f8"),  # the two front readings as they are tiled
        ("right", "f8"),
        ("blind", "i8"),
        ("sought", "f8"),  # where the predecessor was seen last, rad
    ]
)
PERCEPTION = np.dtype(
    [
        ("sees", "i8"),  # whether followers look with it
        ("all", "i8"),  # whether at all eight sensors, or at those that they follow by
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
        ("trim_gain", "i8"),  # of ``trim_readings``, in its whole numbers
        ("trim_limit", "i8"),
        ("trim_middle", "i8"),
        ("table", "f8", (2, NODES, NODES)),
    ]
)


@compiled
def sense_proximity(task: Any, robots: Any, i: int, noise: Any, used: Any) -> None:
    """Read sensors of robot i into its ``readings``, as whole calibrated counts.

    Args:
        task: record of type TASK.
        robots: (robots,) records of one formation with pose and motion of this moment.
        noise: (8,) standard normal numbers.
        used: (8,) which sensors.
    """
    robot = robots[i]
    reach = task.infrared.reach + RING + task.infrared.radius
    turned = -task.infrared.age * robot.motion.turn
    c, s = _turned(robot.pose.cos, robot.pose.sin, math.cos(turned), math.sin(turned))
    back = -SLOT * robot.motion.turn  # a small angle
    cos, sin = 1.0 - back * back / 2, back * (1.0 - back * back / 6)
    for slot in range(3, -1, -1):  # the younger the pair, the smaller the age: poses of the past
        age = task.infrared.age + (3 - slot) * SLOT
        if slot < 3:
            c, s = _turned(c, s, cos, sin)
        x, y = _earlier(robot, age)
        count = _gather(robots, i, age, x, y, reach)
        for k in (slot, slot + 4):
            if used[k]:
                _read(task, robot.infrared, k, Stand(x, y, c, s), count, noise[k])


@compiled
def _turned(c: float, s: float, cos: float, sin: float) -> tuple[float, float]:
    """Return the direction c, s turned by an angle with a cosine and a sine."""
    return c * cos - s * sin, s * cos + c * sin


class Stand(NamedTuple):
    """Where a robot stands: x, y in m, cosine and sine of its heading."""

    x: float
    y: float
    c: float
    s: float


@compiled
def _gather(robots: Any, i: int, age: float, x: float, y: float, reach: float) -> int:
    """Note the places of the robots within reach (m) of robot i at x, y; return their number."""
    infrared = robots[i].infrared
    count = 0
    # where there is no room for all, those about its place in line
    first = max(0, min(i - NEAR // 2, robots.size - NEAR - 1))
    for j in range(first, min(first + NEAR + 1, robots.size)):
        if j == i:
            continue
        other = robots[j]
        dx, dy = other.pose.x - x, other.pose.y - y
        if dx * dx + dy * dy > (reach + MOVED) * (reach + MOVED):
            continue
        ox, oy = _earlier(other, age)
        if (ox - x) * (ox - x) + (oy - y) * (oy - y) < reach * reach:
            infrared.near_x[count] = ox
            infrared.near_y[count] = oy
            count += 1
    return count


@compiled
def _read(task: Any, infrared: Any, k: int, at: Any, count: int, noise: float) -> None:
    """Read sensor k of a robot that stands ``at`` a place, with ``count`` robots near."""
    world = task.infrared
    light = 0.0
    if count:
        near = Circles(
            infrared.near_x,
            infrared.near_y,
            count,
            world.radius,
            world.strength,
            world.beacon,
            infrared.rays,
        )
        light = circles_light(k, at.x, at.y, at.c, at.s, near)
    room = headroom(k, at.c, at.s, world.ambient, world.ambient_cos, world.ambient_sin)
    raw = raw_reading(light, infrared.gain[k], infrared.offset[k], room, noise, world.spread)
    infrared.readings[k] = max(raw - infrared.bias[k], 0.0)
    infrared.headroom[k] = round(room)


@compiled
def _earlier(robot: Any, age: float) -> tuple[float, float]:
    """Return where a robot was some seconds ago, on the chord of the arc that it drives."""
    half = -age * robot.motion.turn / 2
    sin = half * (1.0 - half * half / 6)  # right to 0.1 mm at the oldest age, 1 µm at the usual
    cos = 1.0 - half * half / 2 * (1.0 - half * half / 12)
    along = age * robot.motion.speed
    x: float = robot.pose.x - along * (robot.pose.cos * cos - robot.pose.sin * sin)
    y: float = robot.pose.y - along * (robot.pose.sin * cos + robot.pose.cos * sin)
    return x, y


@compiled
def look(task: Any, robot: Any) -> tuple[float, float]:
    """Return distance in m and bearing in rad of the robot in front from the readings, UNSEEN if
    there is none.
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
def raw_errors(task: Any, robot: Any, e_d: float, o_err: float) -> tuple[float, float]:
    """Return the distance-like and the bearing-like error of two readings, both in [-1, 1], for the
    reward of ir-raw.

    The mean of the logarithms counts from the wanted place to the bounds, straight ahead; their
    difference to the bound of the bearing at the wanted distance. Positive: too far; to the left.
    """
    left = math.log(robot.infrared.left + FLOOR)
    right = math.log(robot.infrared.right + FLOOR)
    mean = (left + right) / 2 - task.infrared.raw_middle
    u = mean / task.infrared.raw_far if mean < 0.0 else -mean / task.infrared.raw_near
    v = (left - right) / task.infrared.raw_side
    return min(max(u, -1.0), 1.0), min(max(v, -1.0), 1.0)


@compiled
def see(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write where the predecessor of follower i is by its own readings."""
    robot = robots[i]
    if not robot.seen.silent:
        used = ALL if task.infrared.all else LOOKING
        sense_proximity(task, robots, i, chance.infrared, used)
    robot.seen.distance, robot.seen.bearing = look(task, robot)


@compiled
def tile_readings(task: Any, follower: Any, e_d: float, o_err: float) -> tuple[bool, float, float]:
    """Return whether the errors are inside the bounds, and the two front readings in counts."""
    inside = abs(e_d) < task.bounds.half_range and abs(o_err) < task.bounds.bearing
    return inside, follower.infrared.left, follower.infrared.right


@compiled
def log_counts(reading: int) -> int:
    """Return the natural logarithm of a reading with the floor, in parts of LOG_PARTS."""
    return int(math.floor(LOG_PARTS * math.log(reading + FLOOR) + 0.5))


@compiled
def trim_readings(task: Any, follower: Any, e_d: float, first: float, second: float) -> Any:
    """Return the readings that are tiled once the integral of their distance-like error has gone
    on: both times 1 - I, in whole numbers, as a firmware has it.
    """
    left, right = int(first), int(second)
    error = task.infrared.trim_middle - log_counts(left) - log_counts(right)
    output = follower.output
    if not spent(task, follower, float(error)):
        limit = task.infrared.trim_limit
        moved = int(output.trim) + task.infrared.trim_gain * error
        output.trim = float(min(max(moved, -limit), limit))
    factor = TRIM_ONE + TRIM_ONE - ((int(output.trim) + TRIM_UNIT) >> TRIM_SHIFT)
    return (
        float(min((left * factor) >> TRIM_BITS, int(ADC))),
        float(min((right * factor) >> TRIM_BITS, int(ADC))),
    )


def trim_numbers(
    trim: float, limit_m: float, half_range_m: float, middle: float, far: float
) -> tuple[int, int, int]:
    """Return gain, limit and middle of ``trim_readings``: the error that it integrates counts in
    logarithms, ``far`` of which are half the range in m.
    """
    gain = round(trim * TRIM_UNIT / (2 * LOG_PARTS))
    limit = min(limit_m / half_range_m * far, LARGEST_TRIM)
    return gain, round(limit * TRIM_UNIT), round(2 * LOG_PARTS * middle)


def check(config: Any) -> None:
    """Refuse bounds at which nothing is seen, and noise beside the readings' own."""
    if config.noise_distance_m or config.noise_bearing_rad:
        raise ValueError(
            f"ConvoyConfig.noise_distance_m = {config.noise_distance_m!r}, "
            f"noise_bearing_rad = {config.noise_bearing_rad!r} with "
            f"sensing = {config.sensing!r}; readings have noise of their own: use infrared.noise"
        )
    far, _ = uncompiled(front_pair)(config.distance_m[1], 0.0, config.infrared)
    if far < config.threshold_counts:
        raise ValueError(
            f"ConvoyConfig.distance_m = {config.distance_m!r} with sensing = "
            f"{config.sensing!r}; at {config.distance_m[1]:g} m a "
            f"{config.infrared.target} reads {far:.1f} counts, below threshold_counts = "
            f"{config.threshold_counts:g}: expected a "
            "far bound at which the robot in front is still seen (0.13 for a cup)"
        )
    if config.distance_m[1] > DISTANCES[1]:
        raise ValueError(
            f"ConvoyConfig.distance_m = {config.distance_m!r} with sensing = "
            f"{config.sensing!r}; two readings are inverted up to "
            f"{DISTANCES[1]:g} m: expected a far bound of at most that"
        )
    if config.bearing_limit_rad > WIDEST:
        raise ValueError(
            f"ConvoyConfig.bearing_limit_rad = {config.bearing_limit_rad!r} with sensing = "
            f"{config.sensing!r}; two readings tell "
            f"a bearing up to {WIDEST:.2f} rad: expected at most that (0.436 is 25°)"
        )


def sensor_fields(config: Any) -> dict[str, Any]:
    """Return the fields of infrared sensors and of what they look at."""
    infrared = config.infrared
    radius, strength, beacon = strength_of(infrared)
    return {
        "radius": radius,
        "strength": strength,
        "beacon": beacon,
        "reach": BEACON_RANGE if beacon else RANGE,
        "spread": infrared.noise / math.sqrt(infrared.samples),
        "age": infrared.age_s,
        "ambient": infrared.ambient_counts,
        "ambient_cos": math.cos(infrared.ambient_direction_rad),
        "ambient_sin": math.sin(infrared.ambient_direction_rad),
        "warp": WARPS.index(infrared.warp),
    }


def fill(config: Any) -> Values:
    """Return the fields of a follower that sees with nothing but its infrared."""
    middle, near, far, side = raw_scales(
        config.infrared, config.distance_m, config.bearing_limit_rad, FLOOR
    )
    gain, limit, twice = trim_numbers(
        config.trim, config.trim_limit_m, config.half_range_m, float(middle), float(far)
    )
    fields = {
        "sees": 1,
        "threshold": config.threshold_counts,
        "table": inversion_table(config.infrared),
        "raw_middle": middle,
        "raw_near": near,
        "raw_far": far,
        "raw_side": side,
        "trim_gain": gain,
        "trim_limit": limit,
        "trim_middle": twice,
    }
    return {"infrared": fields, "search": {"short_sighted": 1, "periods": DRIVE_ON_PERIODS}}


def tilings(config: Any) -> tuple[Tiling, Tiling]:
    """Return the tilings of the two front readings."""
    kinds = (config.distance_tiling, config.bearing_tiling)
    return reading_tilings(config.infrared, config.distance_m, config.state_tiles, kinds)


def equip(convoy: Any) -> None:
    """Give every robot of a convoy infrared sensors of its own, and let it calibrate them; once,
    where nothing has done so.
    """
    convoy.has_sensors = True
    infrared = convoy.config.infrared
    for robots, rng, seed in zip(convoy.robots, convoy.rngs, convoy.seeds, strict=True):
        for number, robot in enumerate(robots):
            record = robot["infrared"]
            record["gain"], record["offset"] = draw_units(rng["units"], infrared)
            if infrared.calibrated:
                chance = own_chance(convoy.config.fleet or seed, number, "bias")
                record["bias"] = calibrate(chance, infrared, record["offset"])


_METRIC = Sense(
    "ir-metric",
    "inverts two infrared readings",
    ("distance", "bearing", "odometry"),
    see,
    moving=True,
    epuck=True,
    draws=(Draw("infrared", (SENSORS,), "infrared", FOLLOWERS),),
    robot=(("infrared", INFRARED),),
    task=(("infrared", PERCEPTION),),
    fill=fill,
    check=check,
    equip=equip,
    needs="proximity",
    noise=lambda _: NOISE_TOLD,
    age=lambda config: config.infrared.age_s,
)
MODES = (
    _METRIC,
    replace(
        _METRIC,
        name="ir-raw",
        tells="tiles the readings themselves",
        gives=("readings", "odometry"),
        tiled=tile_readings,
        errors=raw_errors,
        trimmed=trim_readings,
        metric=False,
        units=("counts", "counts"),
        tilings=tilings,
    ),
)
