"""Other simulators of small robots, for ``bench --peers``: five robots, 0.1 s a step, in one
process with ours. None learns. They are no dependencies; what cannot be imported is left out.

    Enki        Debian's package python3-enki2, or from its sources (github enki-community/enki);
                the directory of ``pyenki`` on PYTHONPATH
    navground   the package of this name, from the same registry as our own
    pymunk      likewise

Enki: a Python controller that steers by the front proximity sensors. navground: its loop and
behaviour in C++, kinematics only. pymunk: discs, with wheels' speeds set and two rays a follower
from Python.
"""

import math
from collections.abc import Callable
from typing import Any

from workbench.robot.geometry import BODY_RADIUS, CONTROL_PERIOD, TRACK

ROBOTS = 5
RADIUS = 0.5  # m, of the circle on which they stand in line
GAP = 0.15  # m
SPEED = 0.06  # m/s

Step = Callable[[int], None]  # does a number of control periods


def peers() -> dict[str, Step]:
    """Return what is installed: name → steps."""
    found = {}
    for name, make in (("enki", _enki), ("navground", _navground), ("pymunk", _pymunk)):
        try:
            found[name] = make()
        except Exception:  # another package of that name, another version, a broken installation
            continue
    return found


def _places() -> list[tuple[float, float, float]]:
    """Return x, y in m and heading in rad of robots in line, the leader first."""
    angles = [-k * GAP / RADIUS for k in range(ROBOTS)]
    return [(RADIUS * math.cos(a), RADIUS * math.sin(a), a + math.pi / 2) for a in angles]


def _enki() -> Step:
    import pyenki

    class Follower(pyenki.EPuck):
        def controlStep(self, dt: float) -> None:  # noqa: N802
            seen = self.proximitySensorValues
            turn = 0.002 * (seen[7] - seen[0])
            self.leftSpeed = 100 * SPEED - turn
            self.rightSpeed = 100 * SPEED + turn

    world = pyenki.World()
    robots = [Follower() for _ in range(ROBOTS)]
    for robot, (x, y, heading) in zip(robots, _places(), strict=True):
        robot.pos = (100 * x, 100 * y)  # cm
        robot.angle = heading
        world.addObject(robot)

    def step(periods: int) -> None:
        for _ in range(periods):
            world.step(CONTROL_PERIOD)

    return step


def _navground() -> Step:
    from navground import core, sim

    world = sim.World()
    round_trip = [
        (RADIUS * math.cos(a), RADIUS * math.sin(a)) for a in (k * math.pi / 8 for k in range(16))
    ]
    for k, (x, y, heading) in enumerate(_places()):
        wheels = core.kinematics.TwoWheelsDifferentialDriveKinematics(0.12, TRACK)
        agent = sim.Agent(
            BODY_RADIUS,
            core.behaviors.HLBehavior(wheels, BODY_RADIUS),
            wheels,
            sim.tasks.WaypointsTask(round_trip[k:] + round_trip[:k], True, 0.05),
            [sim.state_estimations.BoundedStateEstimation(0.3)],
        )
        agent.behavior.optimal_speed = SPEED
        agent.pose = core.Pose2((x, y), heading)
        world.add_agent(agent)

    def step(periods: int) -> None:
        world.run(periods, CONTROL_PERIOD)

    return step


def _pymunk() -> Step:
    import pymunk

    space = pymunk.Space()
    bodies = []
    for x, y, heading in _places():
        body = pymunk.Body(0.15, 1e-4)
        body.position = x, y
        body.angle = heading
        shape = pymunk.Circle(body, BODY_RADIUS)
        space.add(body, shape)
        bodies.append(body)

    def light(body: Any, side: float) -> float:
        axis = body.angle + side
        ahead = pymunk.Vec2d(math.cos(axis), math.sin(axis))
        start = body.position + (BODY_RADIUS + 0.001) * ahead
        hit = space.segment_query_first(start, start + 0.15 * ahead, 0.001, pymunk.ShapeFilter())
        return 1.0 - hit.alpha if hit else 0.0

    def step(periods: int) -> None:
        for _ in range(periods):
            for k, body in enumerate(bodies):
                turn = 0.1 if k == 0 else light(body, 0.3) - light(body, -0.3)
                body.velocity = SPEED * math.cos(body.angle), SPEED * math.sin(body.angle)
                body.angular_velocity = turn
            space.step(CONTROL_PERIOD)

    return step
