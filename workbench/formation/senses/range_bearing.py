"""Range and bearing: a ring of infrared receivers and emitters tells a follower how far and where
the robot in front (or the leader of its shape) is, and a message from there how it sees me.

Of both together comes what neither tells: the sender's heading relative to mine,

    θ = φ - α + π        φ: the sender's bearing, seen by me; α: mine, seen by the sender

without which a place beside a leader cannot be kept. Speed and turning rate of the sender come in
the message. Noisy readings are filtered: the sender's place and heading in my own frame are moved
on by my odometry, which is wrong by a share, and by the message, and corrected by a gain.

The board that e-pucks have: 12 receivers, 30° apart, up to about 0.8 m. Its published errors could
not be read here: noise is a parameter, no datum.

Robots of the API hear the same way (``logs.listener``), over a real wire as well.

Contract: as of ``sense``; without a message the last estimate is moved on.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.fields import configuration, integer, real
from workbench.formation import virtual
from workbench.formation.angles import wrap
from workbench.formation.senses.sense import FOLLOWERS, Draw, Sense, Values
from workbench.formation.streams import own_chance
from workbench.robot.geometry import CONTROL_PERIOD

SECTORS = 12

BOARD = np.dtype(  # of the sender in the robot's own frame: m, rad; what is wrong with the robot's
    [
        ("any", "i8"),
        ("count", "i8"),  # control periods
        ("x", "f8"),
        ("y", "f8"),
        ("heading", "f8"),
        ("speed", "f8"),  # of the sender, and averaged, as the last message had them: m/s, rad/s
        ("turn", "f8"),
        ("pace", "f8"),
        ("bend", "f8"),
        ("bias", "f8", (SECTORS,)),  # rad, of every receiver
        ("odometry", "f8", (2,)),  # factors on its own speed and turning rate
    ]
)
BOARD_TASK = np.dtype(
    [
        ("range", "f8"),
        ("noise_range", "f8"),
        ("noise_bearing", "f8"),
        ("loss", "f8"),
        ("every", "i8"),
        ("gain", "f8"),
    ]
)


@configuration
class RangeBearingConfig:
    """What a ring of infrared receivers tells."""

    range_m: float = real(0.05, 20.0, "m", "beyond it nothing is heard", default=0.8)
    noise_range_m: float = real(0.0, 1.0, "m", "standard deviation of a range", default=0.01)
    noise_bearing_rad: float = real(
        0.0, 1.0, "rad", "standard deviation of a bearing", default=math.radians(5)
    )
    sector_bias_rad: float = real(
        0.0,
        0.5,
        "rad",
        "standard deviation of what each of the twelve receivers is off by, for good",
        default=math.radians(1),
    )
    message_loss: float = real(0.0, 0.95, "", "share of messages that do not arrive", default=0.0)
    period: int = integer(1, 100, "control periods", "between messages", default=1)
    odometry_error: float = real(
        0.0, 0.3, "", "standard deviation of the relative error of own odometry", default=0.02
    )
    gain: float = real(
        0.01, 1.0, "", "how far an estimate goes towards a reading; 1: no filter", default=0.1
    )


@compiled
def see(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write where the robot in front, or the virtual leader of a place, is by range and bearing."""
    robot = robots[i]
    sender = robots[robot.ahead]
    board = robot.board
    dx, dy = sender.pose.x - robot.pose.x, sender.pose.y - robot.pose.y
    distance = math.sqrt(dx * dx + dy * dy)
    heard = distance <= task.board.range and chance.message >= task.board.loss
    heard = heard and robot.seen.silent == 0
    went = robot.motion.speed * board.odometry[0] * CONTROL_PERIOD
    turned = robot.motion.turn * board.odometry[1] * CONTROL_PERIOD
    move_on(board, went, turned)
    board.count += 1
    if heard and (board.any == 0 or board.count % task.board.every == 0):
        range_m, mine, its = measure(task, robot, sender, chance.board)
        board.speed, board.turn = sender.motion.speed, sender.motion.turn
        board.pace, board.bend = sender.place.pace, sender.place.turn
        correct(board, task.board.gain, range_m, mine, its)
    if board.any == 0:
        robot.seen.distance = 2.0 * task.bounds.sight  # nobody has been heard yet
        robot.seen.bearing = 0.0
        return
    c, s = math.cos(board.heading), math.sin(board.heading)
    x, y = board.x, board.y
    if task.shape.any:
        x, y = virtual.ahead_of(task, robot.place, board.pace, board.bend, x, y, c, s)
    robot.seen.distance = math.sqrt(x * x + y * y)
    robot.seen.bearing = math.atan2(y, x)


@compiled
def move_on(board: Any, went: float, turned: float) -> None:
    """Move the estimate of the sender on by a control period, in which the robot went so far (m)
    and turned by so much (rad).
    """
    if board.any == 0:
        return
    its = board.speed * CONTROL_PERIOD
    x = board.x + its * math.cos(board.heading) - went
    y = board.y + its * math.sin(board.heading)
    c, s = math.cos(turned), math.sin(turned)
    board.x = c * x + s * y
    board.y = c * y - s * x
    board.heading = wrap(board.heading + board.turn * CONTROL_PERIOD - turned)


@compiled
def measure(task: Any, robot: Any, sender: Any, normal: Any) -> tuple[float, float, float]:
    """Return a sender's range (m) and bearing (rad), and the robot's bearing as the sender has it,
    with noise of three normal numbers.
    """
    dx, dy = sender.pose.x - robot.pose.x, sender.pose.y - robot.pose.y
    range_m = abs(math.sqrt(dx * dx + dy * dy) + task.board.noise_range * normal[0])
    mine = _bearing(task, robot, sender, normal[1])
    its = _bearing(task, sender, robot, normal[2])
    return range_m, mine, its


@compiled
def correct(board: Any, gain: float, range_m: float, mine: float, its: float) -> None:
    """Correct the estimate by a range and both bearings, or begin it."""
    x, y = range_m * math.cos(mine), range_m * math.sin(mine)
    heading = wrap(mine - its + math.pi)
    if board.any == 0:
        board.any = 1
        board.x, board.y, board.heading = x, y, heading
        return
    board.x += gain * (x - board.x)
    board.y += gain * (y - board.y)
    board.heading = wrap(board.heading + gain * wrap(heading - board.heading))


@compiled
def _bearing(task: Any, robot: Any, other: Any, normal: float) -> float:
    """Return the bearing of another robot as a robot's receivers have it."""
    pose = robot.pose
    dx, dy = other.pose.x - pose.x, other.pose.y - pose.y
    true = math.atan2(pose.cos * dy - pose.sin * dx, pose.cos * dx + pose.sin * dy)
    sector = int(math.floor(true / (2 * math.pi / SECTORS) + 0.5)) % SECTORS
    return float(true + robot.board.bias[sector] + task.board.noise_bearing * normal)


def fill(config: Any) -> Values:
    """Return the fields of TASK."""
    told = config.range_bearing
    return {
        "board": {
            "range": told.range_m,
            "noise_range": told.noise_range_m,
            "noise_bearing": told.noise_bearing_rad,
            "loss": told.message_loss,
            "every": told.period,
            "gain": told.gain,
        }
    }


def check(config: Any) -> None:
    """Refuse noise beside the board's own, and places along a path that nobody remembers."""
    if config.noisy:
        raise ValueError(
            f"ConvoyConfig.noise_distance_m = {config.noise_distance_m!r}, noise_bearing_rad = "
            f"{config.noise_bearing_rad!r} with sensing = {config.sensing!r}; range and bearing "
            "have noise of their own: see range_bearing"
        )
    frame = config.formation.relative_to
    if frame not in ("predecessor", "heading"):
        raise ValueError(
            f"ConvoyConfig.sensing = {config.sensing!r} with formation.frame = {frame!r}; "
            "followers hear the leader's heading, and keep no trail of its: expected 'heading'"
        )
    reach = float(np.linalg.norm(config.places, axis=1).max())
    if config.formation.shaped and reach > config.range_bearing.range_m:
        raise ValueError(
            f"RangeBearingConfig.range_m = {config.range_bearing.range_m!r} with a place "
            f"{reach:.3g} m from the leader; expected more than that, or a smaller shape"
        )


def equip(convoy: Any) -> None:
    """Draw what every robot's receivers and odometry are off by."""
    told = convoy.config.range_bearing
    for b, seed in enumerate(convoy.seeds):
        for i in range(convoy.config.followers + 1):
            chance = own_chance(convoy.config.fleet or seed, i, "board")
            board = convoy.robots["board"][b, i]
            board["bias"] = told.sector_bias_rad * chance.standard_normal(SECTORS)
            board["odometry"] = 1.0 + told.odometry_error * chance.standard_normal(2)


def _spread(config: Any) -> tuple[float, float]:
    told = config.range_bearing
    return told.noise_range_m, told.noise_bearing_rad


MODE = Sense(
    "range-and-bearing",
    "hears range, bearing and the sender's view by a ring of infrared receivers",
    ("distance", "bearing", "odometry", "heading", "speed", "turning rate"),
    see,
    moving=True,
    noise=_spread,
    draws=(
        Draw("board", (3,), "board", FOLLOWERS),
        Draw("message", (), "messages", FOLLOWERS, uniform=True),
    ),
    robot=(("board", BOARD),),
    task=(("board", BOARD_TASK),),
    fill=fill,
    check=check,
    equip=equip,
    see_place=see,
    needs="range_bearing",
)
