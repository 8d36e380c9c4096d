"""What an e-puck is: lengths, masses and places of its parts. SI units; x forward, y left, z up,
origin on the axle.

Sources: [1] e-puck.org mechanics and electronics pages; [2] Webots E-puck.proto and
E-puckGroundSensors.proto (cyberbotics/webots); [3] FARSA e-puck model; [4] gctronic/e-puck-library,
e_motors.c. Where sources disagree, the value measured on real robots is taken and the others are
named.
"""

import math

BODY_RADIUS = 0.035  # m [1]; Webots and Enki use 0.037 as a bounding radius
BODY_HEIGHT = 0.050  # m [2]; the documentation's 50 mm, Enki 47 mm
BODY_MASS = 0.150  # kg, wheels included [2]; Enki 0.152, FARSA 0.140
INERTIA = (9.786e-5, 8.643e-5, 8.749e-5)  # kg m², principal moments of a body of 0.15 kg [2]

WHEEL_RADIUS = 0.0205  # m: diameter about 41 mm [1, 3]; Webots 40 mm, V-REP 42.3 mm
WHEEL_MASS = 0.010  # kg each [2, 3]
TRACK = 0.053  # m between the wheels [1, 3]; other sources 51 to 56.9 mm
STEPS_PER_TURN = 1000  # motor steps per wheel turn: 20 steps x 50:1 gear [1]
MAX_STEPS = 1000  # steps/s, the firmware's clamp [4]
MAX_STEPS_EPUCK2 = 1100  # steps/s, the e-puck2's
TICKS = 10_000  # ticks per second of the timer that makes steps [4]
STEP = 2 * math.pi * WHEEL_RADIUS / STEPS_PER_TURN  # m of rim travel per motor step: 0.1288 mm

SLIDER_RADIUS = 0.005  # m, passive support spheres in front and behind [3]
SLIDER_X = 0.0225  # m, their distance from the axle [3]

GROUND_SENSOR_X = 0.030  # m in front of the axle [2]
GROUND_SENSOR_Y = (
    0.010,
    0.0,
    -0.010,
)  # m, left, centre, right [2]; FARSA's ±21.5 mm do not fit real crossings

CONTROL_PERIOD = (
    0.1  # s between two commands of the control program: our choice, the paper gives none
)
