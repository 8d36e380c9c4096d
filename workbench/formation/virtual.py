"""A leader for every place of a formation: with it, the paper's two errors drive any shape.

A follower's place t moves with the leader. Its *virtual leader* P stands where the robot in front
would stand in the paper's convoy, the wanted distance d* ahead of the place in the direction in
which the place moves:

    in the leader's frame    place r, velocity u = (v - ω r_y + ṙ_x, ω r_x + ṙ_y), u_x ≥ 1 cm/s
    direction ψ              the leader's heading and atan2(u_y, u_x)
    virtual leader           P = t + d* (cos ψ, sin ψ), with the speed |u|

e_d and o_err are the distance to P less d*, and the bearing of P: tiles, rewards, bounds, resets
and laws work on them unchanged. r = (-d*, 0) gives the leader itself, while it drives straight on.
On its place, with the place's direction, a follower has no error, in curves neither.

With frame "path" the leader's pose at a place is that of its trail, as far back as the place: a
chord over ± the window gives its direction, the two halves its curvature κ, and v (1 - κ r_y), κ v
take the place of speed and turning rate.

Places that move (``flow``) go straight to their goals, at most at the place's speed and
acceleration, slow down within a second of them, and part where they come nearer than the clearance,
always past each other on the same side. So a formation changes its shape in motion.

A place less than a window behind the leader has the direction of the path a window behind it, as
there is none yet; beside the leader such places lag in curves. A leader that goes back takes its
trail up again.

Contract: as of ``control``: records are written in place, nothing is allocated. A formation whose
trail is empty begins anew: its places are where its robots are.
"""

import math
from typing import Any

import numpy as np

from workbench.compiled import compiled
from workbench.formation.reset import FOLLOW
from workbench.formation.senses.truth import tell
from workbench.formation.shapes import TRAIL_M
from workbench.robot.geometry import CONTROL_PERIOD

CRUMB_M = 0.005  # between crumbs of a trail, at least
CRUMBS = math.ceil((TRAIL_M + 0.5) / CRUMB_M)  # and a window behind the last place
BEHIND_M = 10.0  # straight on, behind the last robot of a formation that begins

PLACE = np.dtype(  # m and m/s in the leader's frame, or along and beside its path; and what of it
    [
        ("x", "f8"),
        ("y", "f8"),
        ("speed_x", "f8"),
        ("speed_y", "f8"),
        ("goal_x", "f8"),
        ("goal_y", "f8"),
        ("ahead_x", "f8"),  # the virtual leader in the world, its direction, m/s, rad/s
        ("ahead_y", "f8"),
        ("ahead_cos", "f8"),
        ("ahead_sin", "f8"),
        ("pace", "f8"),  # of the leader itself: its speed and turning rate, averaged
        ("turn", "f8"),
        ("holder", "i8"),  # who has the place of this robot's number
        ("crumbs", "i8", (3,)),  # of the trail, where it and the ends of its window were last
    ]
)
SHAPE = np.dtype(
    [
        ("any", "i8"),
        ("path", "i8"),  # places are along the leader's path
        ("own", "i8"),  # or in the follower's own frame
        ("window", "f8"),
        ("gain", "f8"),  # of the average of the leader's speed and turning rate
        ("speed", "f8"),
        ("acceleration", "f8"),
        ("clearance", "f8"),
        ("hold", "i8"),  # control periods between random places, 0: no random places
        ("depth", "f8"),  # how far back and aside they are drawn
        ("width", "f8"),
    ]
)
_SLOWEST = 0.01  # m/s forward, of a place in the leader's frame
_SOFT = 0.035  # m of too little room that make a place give way at full speed
_PART, _PASS = 1.2, 0.5  # away from each other, and past each other
_ARRIVED = 1e-5  # m


@compiled
def locate(task: Any, one: Any, formation: Any, i: int) -> None:
    """Move all places of a formation on, and find their virtual leaders, once its leader is
    located.
    """
    if i + 1 < one.robots.size:  # everybody is where it is now
        return
    robots = one.robots
    shape = task.shape
    leader = robots[0]
    if formation.crumbs == 0:
        _begin(robots, formation, one.trail, shape.path)
        # it stands, and will drive: a place whose direction is that of the first wobble is no place
        leader.place.pace = task.leader.speed * task.motors.step_m
        leader.place.turn = leader.place.pace * _curvature(robots)
    leader.place.pace += shape.gain * (leader.motion.speed - leader.place.pace)
    leader.place.turn += shape.gain * (leader.motion.turn - leader.place.turn)
    if shape.path:
        _drop(robots[0].pose, formation, one.trail)
    if shape.hold and formation.periods % shape.hold == 0:
        _draw(shape, robots, one.chance)
    flow(shape, robots)
    for k in range(1, robots.size):
        if shape.path:
            _on_path(task, robots[0], robots[k].place, formation, one.trail)
        else:
            _lead(task, leader, robots[k].place)


@compiled
def see(task: Any, robots: Any, i: int, chance: Any) -> None:
    """Write where the virtual leader of follower i is, with noise."""
    place = robots[i].place
    x, y = place.ahead_x, place.ahead_y
    if task.shape.own:
        x, y = _set_point(task, robots[i].pose, robots[0].pose, place)
    tell(task, robots[i], x, y, chance)


@compiled
def _set_point(task: Any, pose: Any, leader: Any, place: Any) -> tuple[float, float]:
    """Return where the leader would be if a robot that has it at the place's distance and bearing,
    in its own frame, had it straight ahead at d*.
    """
    dx, dy = leader.x - pose.x, leader.y - pose.y
    far = max(math.hypot(dx, dy), 1e-9)
    wanted = max(math.hypot(place.x, place.y), 1e-9)
    c, s = -place.x / wanted, -place.y / wanted
    reach = (far - wanted + task.bounds.middle) / far
    return pose.x + reach * (c * dx + s * dy), pose.y + reach * (c * dy - s * dx)


@compiled
def _curvature(robots: Any) -> float:
    """Return how the line of a formation bends that stands behind its leader, 1/m; 0 for one
    follower, whom chance puts anywhere.
    """
    if robots.size < 3:
        return 0.0
    leader, last = robots[0].pose, robots[robots.size - 1].pose
    dx, dy = leader.x - last.x, leader.y - last.y
    turned = math.atan2(leader.sin * dx - leader.cos * dy, leader.cos * dx + leader.sin * dy)
    return 2.0 * turned / max(math.hypot(dx, dy), 1e-6)


@compiled
def _begin(robots: Any, formation: Any, trail: Any, path: int) -> None:
    """Lay a trail from the last robot to the leader, and take places where robots are."""
    along = 0.0
    last = robots[robots.size - 1].pose
    x, y = last.x - BEHIND_M * last.cos, last.y - BEHIND_M * last.sin
    _keep(formation, trail, x, y, -BEHIND_M)
    for i in range(robots.size - 1, -1, -1):
        pose = robots[i].pose
        if i < robots.size - 1:
            behind = robots[i + 1].pose
            along += math.hypot(pose.x - behind.x, pose.y - behind.y)
        robots[i].place.x = along
        _keep(formation, trail, pose.x, pose.y, along)
    leader = robots[0].pose
    robots[0].place.x = 0.0
    for i in range(1, robots.size):
        place = robots[i].place
        pose = robots[i].pose
        place.speed_x = place.speed_y = 0.0
        if path:
            place.x -= along
            place.y = 0.0
        else:
            dx, dy = pose.x - leader.x, pose.y - leader.y
            place.x = leader.cos * dx + leader.sin * dy
            place.y = leader.cos * dy - leader.sin * dx


@compiled
def _keep(formation: Any, trail: Any, x: float, y: float, along: float) -> None:
    """Write a crumb: place and arc length."""
    k = formation.crumbs % CRUMBS
    trail[k, 0] = x
    trail[k, 1] = y
    trail[k, 2] = along
    formation.crumbs += 1


@compiled
def _drop(pose: Any, formation: Any, trail: Any) -> None:
    """Leave a crumb where the leader is, once it has come far enough."""
    last = (formation.crumbs - 1) % CRUMBS
    dx, dy = pose.x - trail[last, 0], pose.y - trail[last, 1]
    far = math.hypot(dx, dy)
    if far >= CRUMB_M and pose.cos * dx + pose.sin * dy > 0.0:
        _keep(formation, trail, pose.x, pose.y, trail[last, 2] + far)


@compiled
def _at(formation: Any, trail: Any, along: float, crumbs: Any, mine: int) -> tuple[float, float]:
    """Return the place on a trail at an arc length, at its ends where it is shorter.

    Args:
        crumbs: numbers of crumbs to look from, ``mine`` of which is written: the last one before.
    """
    low = max(formation.crumbs - CRUMBS, 0)
    high = formation.crumbs - 1
    if along <= trail[low % CRUMBS, 2]:
        return trail[low % CRUMBS, 0], trail[low % CRUMBS, 1]
    if along >= trail[high % CRUMBS, 2]:
        return trail[high % CRUMBS, 0], trail[high % CRUMBS, 1]
    k = min(max(crumbs[mine], low), high - 1)
    while trail[(k + 1) % CRUMBS, 2] <= along:
        k += 1
    while trail[k % CRUMBS, 2] > along:
        k -= 1
    crumbs[mine] = k
    a, b = k % CRUMBS, (k + 1) % CRUMBS
    part = (along - trail[a, 2]) / (trail[b, 2] - trail[a, 2])
    return (
        trail[a, 0] + part * (trail[b, 0] - trail[a, 0]),
        trail[a, 1] + part * (trail[b, 1] - trail[a, 1]),
    )


@compiled
def _on_path(task: Any, leader: Any, place: Any, formation: Any, trail: Any) -> None:
    """Find the virtual leader of a place along the leader's path."""
    window = task.shape.window
    last = (formation.crumbs - 1) % CRUMBS
    pose = leader.pose
    # in front of the last crumb, or behind it where the leader has gone back
    beyond = pose.cos * (pose.x - trail[last, 0]) + pose.sin * (pose.y - trail[last, 1])
    end = trail[last, 2] + beyond
    s = end + place.x
    x, y = _at(formation, trail, s, place.crumbs, 0)
    if s > trail[last, 2] and beyond > 0.0:  # between the last crumb and the leader
        part = (s - trail[last, 2]) / beyond
        x += part * (pose.x - x)
        y += part * (pose.y - y)
    # beside the leader the chord ends where the path does
    middle = min(s, end - window)
    mx, my = x, y
    if middle != s:
        mx, my = _at(formation, trail, middle, place.crumbs, 0)
    ax, ay = _at(formation, trail, middle - window, place.crumbs, 1)
    bx, by = _at(formation, trail, middle + window, place.crumbs, 2)
    ux, uy, vx, vy = mx - ax, my - ay, bx - mx, by - my  # its two halves
    dx, dy = ux + vx, uy + vy
    short = 1.0 / max(math.sqrt(dx * dx + dy * dy), 1e-9)
    c, sine = dx * short, dy * short
    bend = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy) / window
    speed = leader.place.pace
    _stand(task, place, x, y, c, sine, speed * (1.0 - bend * place.y), 0.0, bend * speed)


@compiled
def _lead(task: Any, leader: Any, place: Any) -> None:
    """Find the virtual leader of a place in the leader's own frame."""
    pose, speed, turn = leader.pose, leader.place.pace, leader.place.turn
    x = pose.x + pose.cos * place.x
    y = pose.y + pose.sin * place.x
    ahead = speed - turn * place.y
    aside = turn * place.x
    _stand(task, place, x, y, pose.cos, pose.sin, ahead, aside, turn)


@compiled
def _stand(
    task: Any,
    place: Any,
    x: float,
    y: float,
    c: float,
    s: float,
    ahead: float,
    aside: float,
    turn: float,
) -> None:
    """Write the virtual leader of a place beside x, y, in a frame of direction c, s that moves with
    these speeds there.
    """
    x -= s * place.y
    y += c * place.y
    ahead = max(ahead + place.speed_x, _SLOWEST)
    aside += place.speed_y
    pace = math.sqrt(ahead * ahead + aside * aside)
    slow = 1.0 / pace
    c, s = (c * ahead - s * aside) * slow, (s * ahead + c * aside) * slow
    place.pace = pace
    place.turn = turn
    place.ahead_cos = c
    place.ahead_sin = s
    place.ahead_x = x + task.bounds.middle * c
    place.ahead_y = y + task.bounds.middle * s


@compiled
def ahead_of(
    task: Any, place: Any, pace: float, turn: float, x: float, y: float, c: float, s: float
) -> tuple[float, float]:
    """Return where the virtual leader of a place is, seen by a robot that sees the leader at x, y
    with a relative heading of cosine c and sine s.

    Args:
        pace, turn: the leader's averaged speed and turning rate.
    """
    ahead = max(pace - turn * place.y + place.speed_x, _SLOWEST)
    aside = turn * place.x + place.speed_y
    reach = task.bounds.middle / math.sqrt(ahead * ahead + aside * aside)
    u, v = place.x + reach * ahead, place.y + reach * aside
    return x + c * u - s * v, y + s * u + c * v


@compiled
def flow(shape: Any, robots: Any) -> None:
    """Move the places of a formation for one control period."""
    moving = False
    for i in range(1, robots.size):
        place = robots[i].place
        moving |= (
            abs(place.goal_x - place.x) + abs(place.goal_y - place.y) > _ARRIVED
            or place.speed_x != 0.0
            or place.speed_y != 0.0
        )
    if not moving:
        return
    for i in range(1, robots.size):
        _want(shape, robots, i)
    for i in range(1, robots.size):
        place = robots[i].place
        place.x += place.speed_x * CONTROL_PERIOD
        place.y += place.speed_y * CONTROL_PERIOD
        near = math.hypot(place.goal_x - place.x, place.goal_y - place.y)
        if near < _ARRIVED:
            place.x, place.y = place.goal_x, place.goal_y
            place.speed_x = place.speed_y = 0.0


@compiled
def _want(shape: Any, robots: Any, i: int) -> None:
    """Turn the speed of place i to its goal, and away from places that are too near."""
    place = robots[i].place
    dx, dy = place.goal_x - place.x, place.goal_y - place.y
    far = math.hypot(dx, dy)
    pull = min(shape.speed / far, 1.0) if far > 0.0 else 0.0
    u, v = pull * dx, pull * dy
    for j in range(robots.size):
        if j == i:
            continue
        nx, ny = place.x, place.y  # from the leader
        if j:
            nx -= robots[j].place.x
            ny -= robots[j].place.y
        r = math.hypot(nx, ny)
        if r < shape.clearance:
            r = max(r, 1e-6)
            push = shape.speed * (shape.clearance - r) / _SOFT / r
            u += push * (_PART * nx - _PASS * ny)
            v += push * (_PART * ny + _PASS * nx)
    fast = math.hypot(u, v)
    if fast > shape.speed:
        u, v = u * shape.speed / fast, v * shape.speed / fast
    du, dv = u - place.speed_x, v - place.speed_y
    most = shape.acceleration * CONTROL_PERIOD
    change = math.hypot(du, dv)
    if change > most:
        du, dv = du * most / change, dv * most / change
    place.speed_x += du
    place.speed_y += dv


@compiled
def _draw(shape: Any, robots: Any, chance: Any) -> None:
    """Draw goals at random, where there is room beside the others'."""
    for i in range(1, robots.size):
        if robots[i].reset.phase != FOLLOW:
            continue
        x = -shape.depth * chance[i].place[0]
        y = shape.width * (2.0 * chance[i].place[1] - 1.0)
        free = math.hypot(x, y) >= shape.clearance
        for j in range(1, robots.size):
            other = robots[j].place
            if j != i and math.hypot(x - other.goal_x, y - other.goal_y) < shape.clearance:
                free = False
        if free:
            robots[i].place.goal_x = x
            robots[i].place.goal_y = y
