"""What a follower makes of what it sees: filtered, and foreseen to the moment when its command
arrives.

Every follower can keep an estimate of its predecessor in its own frame: place p and velocity u, the
latter over the ground. In a control period it moves itself by its own commands; the estimate moves
and turns against that, and a new reading corrects it (an alpha-beta filter):

    p ← R(-Δφ) (p + u T - Δq)        p ← p + α (z - p)
    u ← R(-Δφ) u                     u ← u + β (z - p) / T

α and β are those of the steady Kalman filter for noise σ along an axis and accelerations of the
predecessor (``gains``; Kalata, IEEE T-AES 20(2), 1984, has them in closed form). Without
``filter`` the place is what was read (α = 1), and only the velocity is estimated.

``prediction`` looks ahead over the delay, from when what is seen was true until the command moves
the wheels (a Smith predictor): "own" moves the robot by its commands that are on their way, "both"
its predecessor, too, straight on. What is tiled, rewarded and lost is then the place at which the
command arrives.

What no mode but "truth" knows, the predecessor's turning rate, is not needed: in 0.4 s of a circle
of 0.5 m radius a robot leaves its tangent by half a millimetre.

Contract: compiled; nothing but distance, bearing and own commands goes in, so that any sensing mode
and any robot can do it.
"""

import functools
import math
from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.fields import configuration, real
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.motors import wheel_speed

PREDICTIONS = ("none", "own", "both")
FILTERS = ("none", "alpha-beta")
LONGEST_S = 0.5  # of a link
_SENT = round(LONGEST_S / CONTROL_PERIOD) + 2

ESTIMATE = np.dtype(
    [
        ("any", "i8"),  # whether there is one
        ("put", "i8"),  # whether the robot has been put somewhere: its last command did not run
        ("x", "f8"),  # the predecessor in the robot's frame, m and m/s over the ground
        ("y", "f8"),
        ("u", "f8"),
        ("v", "f8"),
        ("pace", "f8"),  # m/s, away along the line of sight
        ("sent", "i8", (_SENT, 2)),  # own commands, steps/s, the newest first
    ]
)
ESTIMATE_TASK = np.dtype(
    [
        ("any", "i8"),
        ("own", "i8"),  # who is moved ahead
        ("both", "i8"),
        ("delay", "f8"),  # control periods
        ("alpha", "f8", (2,)),  # along and across the robot
        ("beta", "f8", (2,)),
    ]
)


@configuration
class EstimateConfig:
    """What a follower assumes when it filters and predicts."""

    noise_distance_m: float = real(
        0.0,
        1.0,
        "m",
        "noise that it expects on distances; 0 takes what the sensing mode has",
        default=0.0,
    )
    noise_bearing_rad: float = real(
        0.0,
        1.0,
        "rad",
        "noise that it expects on bearings; 0 takes what the sensing mode has",
        default=0.0,
    )
    acceleration_mps2: float = real(
        0.001, 10.0, "m/s²", "how much it expects its predecessor to accelerate", default=0.01
    )
    delay_s: float = real(
        0.0,
        LONGEST_S,
        "s",
        "from when what is seen was true until a command moves the wheels; 0 takes body.delay and "
        "the age of what is sensed",
        default=0.0,
    )


@functools.cache
def gains(noise_m: float, acceleration_mps2: float) -> tuple[float, float]:
    """Return α and β of the steady Kalman filter of a place that is read every control period with
    noise, and a velocity that changes by accelerations, constant within a period, with this spread.
    """
    from scipy import linalg

    t = CONTROL_PERIOD
    move = np.array([[1.0, t], [0.0, 1.0]])
    push = acceleration_mps2 * np.array([t * t / 2, t])
    read = np.array([[1.0, 0.0]])
    spread = linalg.solve_discrete_are(move.T, read.T, np.outer(push, push), [[noise_m**2]])
    gain = spread @ read.T / (spread[0, 0] + noise_m**2)
    return float(gain[0, 0]), float(gain[1, 0] * t)


@compiled
def perceive(task: Any, follower: Any) -> tuple[float, float]:
    """Return the distance in m and the bearing in rad of the predecessor that a follower acts on.

    Args:
        task, follower: records of type TASK and ROBOT: ``follower.seen`` is what has been read,
            ``follower.command`` what was commanded last.
    """
    seen = follower.seen
    if task.estimate.any == 0:
        return seen.distance, seen.bearing
    estimate = follower.estimate
    sent = estimate.sent
    for k in range(_SENT - 1, 0, -1):
        sent[k, 0] = sent[k - 1, 0]
        sent[k, 1] = sent[k - 1, 1]
    sent[0, 0] = 0 if estimate.put else follower.command.left
    sent[0, 1] = 0 if estimate.put else follower.command.right
    estimate.put = 0
    if seen.distance > task.bounds.sight:
        estimate.any = 0
        estimate.pace = 0.0
        return seen.distance, seen.bearing
    # how far the robot has come: by the command that was late until now
    late = int(task.estimate.delay)
    part = task.estimate.delay - late
    left, right = _mean(sent, late, part)
    _move(task, estimate, left, right, 1.0, True)
    if seen.silent == 0:
        _correct(task, estimate, seen, (left + right) / 2 * task.motors.step_m)
    distance = math.sqrt(estimate.x * estimate.x + estimate.y * estimate.y)
    estimate.pace = (estimate.u * estimate.x + estimate.v * estimate.y) / max(distance, 1e-6)
    if task.estimate.own == 0:
        return distance, math.atan2(estimate.y, estimate.x)
    return _foresee(task, estimate, late, part)


@compiled
def _correct(task: Any, estimate: Any, seen: Any, speed: float) -> None:
    """Correct an estimate by a reading, or begin one, at the robot's own speed in m/s."""
    x = seen.distance * math.cos(seen.bearing)
    y = seen.distance * math.sin(seen.bearing)
    if estimate.any == 0:
        estimate.any = 1
        estimate.x = x
        estimate.y = y
        estimate.u = speed
        estimate.v = 0.0
        return
    dx = x - estimate.x
    dy = y - estimate.y
    estimate.x += task.estimate.alpha[0] * dx
    estimate.y += task.estimate.alpha[1] * dy
    estimate.u += task.estimate.beta[0] * dx / CONTROL_PERIOD
    estimate.v += task.estimate.beta[1] * dy / CONTROL_PERIOD


@compiled
def _mean(sent: Any, late: int, part: float) -> tuple[float, float]:
    """Return the mean command of a period that began ``late`` and a part of periods ago."""
    left: float = sent[late, 0]
    right: float = sent[late, 1]
    if part > 0.0:
        left += part * (sent[late + 1, 0] - left)
        right += part * (sent[late + 1, 1] - right)
    return left, right


@compiled
def _move(
    task: Any, estimate: Any, left: float, right: float, periods: float, ahead_moves: bool
) -> None:
    """Let a robot drive for some periods at wheel speeds in steps/s: the estimate moves against
    it.
    """
    motors = task.motors
    left = wheel_speed(int(round(left)), motors.most, motors.ticks) * motors.step_m
    right = wheel_speed(int(round(right)), motors.most, motors.ticks) * motors.step_m
    seconds = periods * CONTROL_PERIOD
    along = (left + right) / 2 * seconds
    turned = (right - left) / motors.track_m * seconds
    x = estimate.x - along * math.cos(turned / 2)
    y = estimate.y - along * math.sin(turned / 2)
    if ahead_moves:
        x += estimate.u * seconds
        y += estimate.v * seconds
    c, s = math.cos(turned), math.sin(turned)
    estimate.x = x * c + y * s
    estimate.y = y * c - x * s
    estimate.u, estimate.v = estimate.u * c + estimate.v * s, estimate.v * c - estimate.u * s


@compiled
def _foresee(task: Any, estimate: Any, late: int, part: float) -> tuple[float, float]:
    """Return distance and bearing once all commands on their way have been carried out."""
    x, y, u, v = estimate.x, estimate.y, estimate.u, estimate.v
    both = task.estimate.both != 0
    sent = estimate.sent
    if part > 0.0:
        _move(task, estimate, sent[late, 0], sent[late, 1], part, both)
    for k in range(late - 1, -1, -1):
        _move(task, estimate, sent[k, 0], sent[k, 1], 1.0, both)
    distance = math.sqrt(estimate.x * estimate.x + estimate.y * estimate.y)
    bearing = math.atan2(estimate.y, estimate.x)
    estimate.x = x
    estimate.y = y
    estimate.u = u
    estimate.v = v
    return distance, bearing
