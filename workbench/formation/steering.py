"""Classical steering laws, compiled: what a follower does when it is driven by a formula and not by
a table.

Each law gets distance d and bearing φ of the predecessor and, where it needs more, what
``formation.laws`` declares. Unicycle: v = (v_L + v_R) / 2, ω = (v_R - v_L) / b. The law's (v,
ω) becomes two wheel speeds within the learner's own range, in whole steps/s; where a wheel would
leave the range both are shifted, so that the turn is kept as long as possible.

    CARROT        v = k_d e_d + k_i ∫e_d, ω = k_φ φ
    LEADER_FRAME  input-output linearisation of (d, φ), with β = θ1 - θ2 - φ:
                  v = (k_d e_d + v1 cos β) / cos φ, ω = k_φ φ + (v sin φ + v1 sin β) / d
    L_PSI         separation-bearing control of a point ``ahead`` of the axle (Desai et al. 2001,
                  Das et al. 2002)
    PURSUIT       pure pursuit of the predecessor's breadcrumbs at a look-ahead L:
                  ω = v 2 sin α / L; v as CARROT
    OWN           a function of the user's own, ``formation.functions``
    OUTSIDE       nothing: commands come from outside, after everybody has sensed
                  (``Convoy.command_all``)
    PATH          path reconstruction (after Klančar, Matko, Blažič 2009): a parabola in time,
                  fitted by least squares to the breadcrumbs around the point d* behind the
                  predecessor, gives reference, feed-forward and curvature; state
                  feedback of the longitudinal, lateral and heading error

Breadcrumbs are places of the predecessor in the follower's own odometry (its commanded, quantised
wheel speeds), one per control period, the last 25.6 s of them. While they do not reach back far
enough (a young episode, a very slow predecessor), PURSUIT steers at the predecessor and PATH as
CARROT does.

Contract: a law writes only its memory in the follower's record; every episode begins with an empty
memory. Nothing is allocated.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import call_at, compiled
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.motors import wheel_speed

CARROT, LEADER_FRAME, L_PSI, PURSUIT, PATH, OWN, OUTSIDE = range(1, 8)  # 0: no law, a table decides
CRUMBS = 256  # breadcrumbs kept: 25.6 s of the predecessor's way

LAW = np.dtype(
    [
        (
            "ahead_heading",
            "f8",
        ),  # what is known of the predecessor: rad relative to own, m/s, rad/s
        ("ahead_speed", "f8"),
        ("ahead_turn", "f8"),
        ("left", "i8"),  # the last command, steps/s
        ("right", "i8"),
        ("integral", "f8"),
        ("x", "f8"),  # own odometry
        ("y", "f8"),
        ("heading", "f8"),
        ("crumbs", "i8"),
        ("trail", "f8", (CRUMBS, 2)),
    ]
)
LAW_TASK = (
    np.dtype(  # steps/s of a wheel; addresses of the user's functions, see formation.functions
        [
            ("number", "i8"),
            ("gain", "f8", (8,)),
            ("slowest", "f8"),
            ("fastest", "f8"),
            ("speed_function", "i8"),
            ("turn_function", "i8"),
        ]
    )
)


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[int, int]:
    """Return a law's wheel commands in whole steps/s.

    Args:
        task: TASK record: ``law``, ``gain`` (8,), ``middle`` (d*, m), ``slowest`` and ``fastest``
            (steps/s of a wheel).
        follower: ROBOT record; its ``choice.state`` is -1 where an episode begins.
        distance, bearing: of the predecessor, m and rad.
    """
    law = task.law.number
    gain = task.law.gain
    if law == OUTSIDE:
        return 0, 0
    if follower.choice.state < 0:
        follower.law.integral = 0.0
        follower.law.crumbs = 0
        follower.law.x = follower.law.y = follower.law.heading = 0.0
    error = distance - task.bounds.middle
    if law == OWN:
        v, omega = (
            call_at(task.law.speed_function, distance, bearing),
            call_at(task.law.turn_function, distance, bearing),
        )
        if not (math.isfinite(v) and math.isfinite(omega)):
            follower.failure.any = 1
            follower.failure.at[0] = distance
            follower.failure.at[1] = bearing
            v = omega = 0.0
    elif law == LEADER_FRAME:
        v, omega = leader_frame(
            distance,
            bearing,
            follower.law.ahead_heading,
            follower.law.ahead_speed,
            error,
            gain[0],
            gain[1],
        )
    elif law == L_PSI:
        v, omega = l_psi(
            distance,
            bearing,
            follower.law.ahead_heading,
            follower.law.ahead_speed,
            follower.law.ahead_turn,
            task.bounds.middle - gain[2],
            math.pi,
            gain[2],
            gain[0],
            gain[1],
        )
    else:
        if law != CARROT:
            _drop_crumb(task, follower, distance, bearing)
        found = False
        v, omega = _pace(task, follower, error), gain[2] * bearing
        if law == PURSUIT:
            omega = _pursue(follower, distance, bearing, gain[3] * task.bounds.middle, v)
        elif law == PATH:
            found, v_path, omega_path = _follow_path(follower, task.bounds.middle, gain)
            if found:
                v, omega = v_path, omega_path
    return _wheels(task, follower, v, omega)


@compiled
def leader_frame(
    distance: float,
    bearing: float,
    heading: float,
    v1: float,
    error: float,
    k_distance: float,
    k_bearing: float,
) -> tuple[float, float]:
    """Return (v, ω) that make d and φ decay exponentially; singular at |φ| = 90°.

    ``heading`` is θ1 - θ2.
    """
    beta = heading - bearing
    v = (k_distance * error + v1 * math.cos(beta)) / max(math.cos(bearing), 0.05)
    return v, k_bearing * bearing + (v * math.sin(bearing) + v1 * math.sin(beta)) / distance


@compiled
def l_psi(
    distance: float,
    bearing: float,
    heading: float,
    v1: float,
    omega1: float,
    l_wanted: float,
    psi_wanted: float,
    ahead: float,
    alpha1: float,
    alpha2: float,
) -> tuple[float, float]:
    """Return (v, ω) of l-ψ control: l from the leader's axle to a point ``ahead`` of the own one, ψ
    its angle seen by the leader.

    γ = θ1 + ψ - θ2; ρ = (α1 (l_d - l) + v1 cos ψ) / cos γ; ω = (cos γ / a) (α2 l (ψ_d - ψ) - v1 sin
    ψ + l ω1 + ρ sin γ); v = ρ - a ω tan γ, with a = ``ahead``.
    """
    x, y = (
        ahead - distance * math.cos(bearing),
        -distance * math.sin(bearing),
    )  # leader to point, in the follower's frame
    length = math.sqrt(x * x + y * y)
    gamma = math.atan2(y, x)
    psi = gamma - heading
    rho = (alpha1 * (l_wanted - length) + v1 * math.cos(psi)) / math.cos(gamma)
    turn = (
        alpha2 * length * wrap(psi_wanted - psi)
        - v1 * math.sin(psi)
        + length * omega1
        + rho * math.sin(gamma)
    )
    omega = math.cos(gamma) / ahead * turn
    return rho - ahead * omega * math.tan(gamma), omega


@compiled
def pursuit_turn(x: float, y: float, v: float) -> float:
    """Return ω of the arc through a target at x, y (m) in the robot's frame: v κ with κ = 2 sin α /
    L = 2 y / L².
    """
    return v * 2.0 * y / (x * x + y * y)


@compiled
def wrap(angle: float) -> float:
    """Return an angle in rad within [-π, π]."""
    return math.atan2(math.sin(angle), math.cos(angle))


@compiled
def _pace(task: Any, follower: Any, error: float) -> float:
    """Return the forward speed of a PI control of the distance, whose integral stops where the
    wheels' range ends.
    """
    v: float = task.law.gain[0] * error + task.law.gain[1] * follower.law.integral
    if (v < task.law.fastest * task.motors.step_m or error < 0.0) and (
        v > task.law.slowest * task.motors.step_m or error > 0.0
    ):
        follower.law.integral += error * CONTROL_PERIOD
    return v


@compiled
def _drop_crumb(task: Any, follower: Any, distance: float, bearing: float) -> None:
    """Move the odometry by the last command and note where the predecessor is in it."""
    if follower.law.crumbs > 0:
        left = (
            wheel_speed(follower.law.left, task.motors.most, task.motors.ticks) * task.motors.step_m
        )
        right = (
            wheel_speed(follower.law.right, task.motors.most, task.motors.ticks)
            * task.motors.step_m
        )
        v = (left + right) / 2
        turn = (right - left) / task.motors.track_m * CONTROL_PERIOD
        middle = follower.law.heading + turn / 2
        follower.law.x += v * CONTROL_PERIOD * math.cos(middle)
        follower.law.y += v * CONTROL_PERIOD * math.sin(middle)
        follower.law.heading += turn
    crumb = follower.law.trail[follower.law.crumbs % CRUMBS]
    crumb[0] = follower.law.x + distance * math.cos(follower.law.heading + bearing)
    crumb[1] = follower.law.y + distance * math.sin(follower.law.heading + bearing)
    follower.law.crumbs += 1


@compiled
def _pursue(follower: Any, distance: float, bearing: float, look_ahead: float, v: float) -> float:
    """Return ω towards the newest breadcrumb within the look-ahead, or towards the predecessor if
    there is none yet.
    """
    c, s = math.cos(follower.law.heading), math.sin(follower.law.heading)
    for k in range(follower.law.crumbs - 1, max(0, follower.law.crumbs - CRUMBS) - 1, -1):
        dx, dy = (
            follower.law.trail[k % CRUMBS, 0] - follower.law.x,
            follower.law.trail[k % CRUMBS, 1] - follower.law.y,
        )
        if dx * dx + dy * dy <= look_ahead * look_ahead:
            return pursuit_turn(c * dx + s * dy, c * dy - s * dx, v)
    return pursuit_turn(distance * math.cos(bearing), distance * math.sin(bearing), v)


@compiled
def _follow_path(follower: Any, middle: float, gain: Any) -> tuple[bool, float, float]:
    """Return (found, v, ω) from the reconstructed path; not found while the breadcrumbs do not
    reach d* back.
    """
    trail = follower.law.trail
    newest = follower.law.crumbs - 1
    oldest = max(0, follower.law.crumbs - CRUMBS)
    x, y = trail[newest % CRUMBS, 0], trail[newest % CRUMBS, 1]
    place = newest
    nearer = 0.0
    while place >= oldest:
        gap = math.hypot(trail[place % CRUMBS, 0] - x, trail[place % CRUMBS, 1] - y)
        if gap >= middle:
            break
        nearer = gap
        place -= 1
    half = int(gain[6])
    if place < oldest + 1 or newest - oldest < 2:
        return False, 0.0, 0.0
    part = (gap - middle) / (gap - nearer)  # between this breadcrumb and the next one
    first, last = max(oldest, place - half), min(newest, place + half)
    rx, vx, ax = _parabola(trail, 0, first, last, place, part)
    ry, vy, ay = _parabola(trail, 1, first, last, place, part)
    speed = math.hypot(vx, vy)
    if speed < 1e-6:
        return False, 0.0, 0.0
    c, s = math.cos(follower.law.heading), math.sin(follower.law.heading)
    dx, dy = rx - follower.law.x, ry - follower.law.y
    along = c * dx + s * dy
    across = c * dy - s * dx
    heading = wrap(math.atan2(vy, vx) - follower.law.heading)
    turn = (vx * ay - vy * ax) / (speed * speed)
    slope = math.sin(heading) / heading if abs(heading) > 1e-9 else 1.0
    v = speed * math.cos(heading) + gain[3] * along
    return True, v, turn + gain[4] * speed * slope * across + gain[5] * heading


@compiled
def _parabola(
    trail: Any, axis: int, first: int, last: int, place: int, part: float
) -> tuple[float, float, float]:
    """Return value, velocity and acceleration (per s) at place + part of a least-squares parabola
    through breadcrumbs.
    """
    n = last - first + 1
    centre = (n - 1) / 2.0  # times around the middle of the window: odd moments vanish
    s2 = s4 = b0 = b1 = b2 = 0.0
    for k in range(n):
        t = k - centre
        y = trail[(first + k) % CRUMBS, axis]
        s2 += t * t
        s4 += t * t * t * t
        b0 += y
        b1 += t * y
        b2 += t * t * y
    curve = (n * b2 - s2 * b0) / (n * s4 - s2 * s2) if n > 2 else 0.0
    slope = b1 / s2
    level = (b0 - curve * s2) / n
    t = place + part - first - centre
    value = level + slope * t + curve * t * t
    return value, (slope + 2.0 * curve * t) / CONTROL_PERIOD, 2.0 * curve / CONTROL_PERIOD**2


@compiled
def _wheels(task: Any, follower: Any, v: float, omega: float) -> tuple[int, int]:
    """Return wheel commands for (v, ω) within the range of the learner's levels, the turn kept as
    long as possible.
    """
    left, right = (
        (v - omega * task.motors.track_m / 2) / task.motors.step_m,
        (v + omega * task.motors.track_m / 2) / task.motors.step_m,
    )
    shift = min(0.0, task.law.fastest - max(left, right)) + max(
        0.0, task.law.slowest - min(left, right)
    )
    left = min(max(left + shift, task.law.slowest), task.law.fastest)
    right = min(max(right + shift, task.law.slowest), task.law.fastest)
    follower.law.left, follower.law.right = int(round(left)), int(round(right))
    return follower.law.left, follower.law.right
