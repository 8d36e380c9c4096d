"""The records of the compiled loop, put together from the parts that each concern declares itself.

    ROBOT   one robot: pose, motion, what it has seen, and the parts of reset, learning, infrared,
            camera, body, law and ground sensors
    TASK    what all robots of a convoy have in common: tiles, bounds, reward, learner, motors …
    CHANCE  one robot's random numbers of one control period, drawn in advance
    PERIOD  what one robot did in one control period: what a run is reduced from

Fields are words: ``robot.camera.x``, ``robot.waiting.reward``, ``chance.slip``. A part is read and
written by the module that declares it.

>>> ROBOT["reset"].names, CHANCE["slip"].shape
(('phase', 'timer'), (2,))

Contract: equal records are equal bytes; a PERIOD has no padding. Units are SI, commands in steps/s.
"""

import numpy as np

from workbench.arena.world import MOTORS
from workbench.formation.body import BODY, BODY_TASK
from workbench.formation.estimate import ESTIMATE, ESTIMATE_TASK
from workbench.formation.follower import (
    BOUNDS,
    CHOICE,
    FAILURE,
    GRID,
    LEARNER,
    LEARNING,
    REWARD,
    WAITING,
)
from workbench.formation.graph import EDGES
from workbench.formation.laws.law import LAW, LAW_TASK
from workbench.formation.leader import GROUND, LEADER
from workbench.formation.output import OUTPUT, OUTPUT_TASK
from workbench.formation.reset import RESET, SEARCHING
from workbench.formation.senses.table import DRAWS, ROBOT_PARTS, SENSE_FIELDS, TASK_PARTS
from workbench.formation.virtual import PLACE, SHAPE

POSE = np.dtype([("x", "f8"), ("y", "f8"), ("cos", "f8"), ("sin", "f8")])  # m; of the heading
MOTION = np.dtype(  # over the last control period, along the heading: m/s, rad/s; and from where
    [
        ("speed", "f8"),
        ("turn", "f8"),
        ("from_x", "f8"),
        ("from_y", "f8"),
        ("from_cos", "f8"),
        ("from_sin", "f8"),
    ]
)
SEEN = np.dtype(  # the robot in front, m and rad, as read, and as filtered and predicted; a
    # reading since the start; none arrives now
    [
        ("distance", "f8"),
        ("bearing", "f8"),
        ("perceived_distance", "f8"),
        ("perceived_bearing", "f8"),
        ("heard", "i8"),
        ("silent", "i8"),
    ]
)
COMMAND = np.dtype([("left", "i8"), ("right", "i8")])  # the last one, whole steps/s

ROBOT = np.dtype(
    [
        ("pose", POSE),
        ("motion", MOTION),
        ("ahead", "i8"),  # who is followed, -1: nobody
        ("seen", SEEN),
        ("place", PLACE),
        ("graph_reward", "f8"),  # of this moment, see ``graph``
        ("estimate", ESTIMATE),
        ("command", COMMAND),
        ("reset", RESET),
        ("choice", CHOICE),
        ("waiting", WAITING),
        ("learning", LEARNING),
        ("output", OUTPUT),
        ("law", LAW),
        ("ground", GROUND),
        *ROBOT_PARTS,
        ("body", BODY),
        ("failure", FAILURE),
    ],
    align=True,
)

NOISE = np.dtype([("any", "i8"), ("distance", "f8"), ("bearing", "f8")])  # spreads in m, rad
RUN = np.dtype(
    [
        ("restart", "i8"),  # whether a loss restarts; whether commands wait for an update
        ("delayed", "i8"),
        ("external", "i8"),  # who is driven from outside
        ("moving", "i8"),  # of how many robots somebody needs the motion, from the leader on
    ]
)

TASK = np.dtype(
    [
        ("grid", GRID),
        ("bounds", BOUNDS),
        ("reward", REWARD),
        ("learner", LEARNER),
        ("motors", MOTORS),
        ("leader", LEADER),
        ("search", SEARCHING),
        ("noise", NOISE),
        ("law", LAW_TASK),
        ("estimate", ESTIMATE_TASK),
        ("output", OUTPUT_TASK),
        ("sense", SENSE_FIELDS),
        *TASK_PARTS,
        ("body", BODY_TASK),
        ("shape", SHAPE),
        ("graph", EDGES),
        ("run", RUN),
    ],
    align=True,
)

CHANCE = np.dtype(  # normal numbers, but for those in [0, 1): explore, hidden, silence, place
    [
        ("ground", "f8", (3,)),
        ("explore", "f8"),
        ("noise", "f8", (2,)),
        *[(draw.field, "f8", draw.shape) for draw in DRAWS],
        ("slip", "f8", (2,)),
        ("silence", "f8"),
        ("place", "f8", (2,)),
    ]
)

PERIOD = np.dtype(
    [
        ("x", "f4"),
        ("y", "f4"),
        ("heading", "f4"),
        ("distance_error", "f4"),  # at S_t, m and rad; R_{t+1}
        ("bearing", "f4"),
        ("reward", "f4"),
        ("state", "i2"),  # S_t, A_t of a transition that finished now, or -1
        ("action", "i2"),
        ("left", "i2"),  # command in steps/s
        ("right", "i2"),
        ("phase", "i2"),
        ("event", "i2"),
    ]
)

FORMATION = np.dtype(  # one formation's counters
    [
        ("updates", "i8"),
        ("budget", "i8"),
        ("periods", "i8"),
        ("last_period", "i8"),
        ("done", "i8"),
        ("restart", "i8"),
        ("crumbs", "i8"),  # of the leader's trail, 0: the formation begins anew
        ("padding", "i8", (9,)),  # keeps what two threads count on different cache lines
    ]
)
