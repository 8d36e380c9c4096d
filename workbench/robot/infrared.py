"""The e-puck's eight infrared proximity sensors: what they read of the light that comes back.

A sensor lights a wide lobe in front of it and measures how much returns. Per ray at an angle φ off
the axis that meets a surface at a distance d under an angle of incidence θ, Lambert's law gives a
share cos θ / d² of what the ray carries:

    light = A ρ Σ_j w(φ_j) cos θ_j / (d_j + d₀)²   w(φ) ∝ cos⁴ φ, a ray every 5° from -60° to 60°
    lit   = x / (1 + (x / S)⁴)^¼, x = gain · light  S = 3800 counts in contact, less in daylight
    raw   = offset + lit + noise, 12 bits           calibrated = max(0, raw - mean of 100 readings
                                                    in free air)

Sources and freedom. Bearings: box sweep with a real e-puck1 (github clamesc/ePuck-Box-Pushing):
17/49/90/150°. The lobe's exponent, d₀ and the ring's radius were chosen to follow that sweep
(``python -m workbench validate infrared``); A lies between published 1.5 and 5.2·10⁵ counts mm²
(GCtronic's ROS driver 2.5, Enki 2.3). S: 3751 to 3896 counts per sensor in the sweep. Noise: robust
spreads from two labs. One has 2.2 to 2.7 counts at readings of 60 to 250 and 4.2 at 250 to 400 for
a weighted mean of four sensors, which we take for three quarters of a single one's; the other, on a
moving e-puck2 (github Wii42/Robotics_Project), 6 below 200, 17 to 21 to 800 and about 220 above.
The curve is the first lab's where there is one, and passes through the second's above (8 counts at
400, 17 at 600, 30 at 800).
Sampling: gctronic/e-puck-library: sensor pairs (0,4) (1,5) (2,6) (3,7) in turn, 3.967 ms each, so
that ps7 is 11.9 ms younger than ps0. Reflectances of shell, cup and tape, the beacon and ambient
light are nobody's measurement: assumptions, see TARGETS.

>>> [round(v) for v in front_pair(0.105, 0.0, InfraredConfig())]
[53, 53]

Contract: compiled functions write nothing; lengths in m, angles in rad (left positive), readings in
counts. ps0 … ps7 run clockwise from right front to left front.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workbench.compiled import compiled
from workbench.fields import choice, configuration, flag, integer, real, reals
from workbench.robot.geometry import BODY_RADIUS

SENSORS = 8
BEARINGS = np.radians(
    [-17.0, -49.0, -90.0, -150.0, 150.0, 90.0, 49.0, 17.0]
)  # rad, ps0 … ps7: real sweep, ±2°
RING = 0.0345  # m from the axle's middle; Player 35 mm, Webots 31.6 mm
SCALE = 0.30  # counts m²: A
CLOSEST = 0.0018  # m: d₀, what a ray travels inside the sensor
CONTACT = 3800.0  # counts at most
DARK = 4000.0  # counts of the phototransistor without light; ambient light takes from it
BLINDED = 500.0  # counts of DARK that are left when a sensor counts as blind: our choice
DIFFUSE = 0.2  # share of directional light that reaches a sensor that looks away: our assumption
ADC = 4095.0
RANGE = 0.30  # m beyond which a reflection is below half a count
BEACON_RANGE = 2.0  # m, of a beacon
SLOT = 65 / 16384  # s between the sampling of two neighbouring pairs
CYCLE = 4 * SLOT  # s between two samples of one sensor: 63 Hz
CALIBRATION = 100  # readings

_ANGLES = np.radians(np.linspace(-60.0, 60.0, 25))
_RAY_C = np.cos(_ANGLES)
_RAY_S = np.sin(_ANGLES)
_RAY_W = _RAY_C**4 / np.sum(_RAY_C**4)
RAYS = len(_ANGLES)
_AXIS_C = np.cos(BEARINGS)
_AXIS_S = np.sin(BEARINGS)

# round targets of a robot's size read 0.4 to 0.55 of a wall at the same distance (public
# measurements at 19 mm). Rays that miss and slanting incidence explain 0.82; the rest, light that
# leaves upwards and downwards perhaps, is this factor
ROUND = 0.62
# what a robot in front shows to infrared light: radius in m, reflectance (white paper = 1), range
# that the assumption may lie in
TARGETS = {
    "cup": (0.037, 1.0, (0.8, 1.2)),  # white paper cup over the robot, as in the paper's Fig. 5
    "shell": (BODY_RADIUS, 0.5, (0.3, 0.8)),  # bare: translucent plastic, wheels, circuit board
    "tape": (BODY_RADIUS, 0.9, (0.6, 1.1)),  # white tape round the shell
    "beacon": (
        BODY_RADIUS,
        10.0,
        (3.0, 30.0),
    ),  # emits: strength against A; seen by the lit channel if pulsed with it
}
WARPS = ("none", "logarithmic", "offset", "saturating")


@configuration
class InfraredConfig:
    """Sensors that differ from robot to robot, and what they look at."""

    target: str = choice(
        tuple(TARGETS), "what every robot shows to the sensors behind it", default="cup"
    )
    brightness: float = real(
        0.05, 20.0, "", "factor on the target's reflectance or emission", default=1.0
    )
    gain_spread: float = real(
        0.0, 1.0, "", "standard deviation of the logarithm of each sensor's gain", default=0.15
    )
    offset_counts: tuple[float, float] = reals(
        0.0, 700.0, "counts", "range of each sensor's reading in free air", default=(70, 170)
    )
    calibrated: bool = flag(
        "whether every robot calibrates its offsets before it starts", default=True
    )
    noise: float = real(0.0, 20.0, "", "factor on the measured noise", default=1.0)
    samples: int = integer(
        1,
        64,
        "",
        "firmware samples that are averaged for one control step; 63 come in a second",
        default=6,
    )
    ambient_counts: float = real(
        0.0,
        4000.0,
        "counts",
        "what light from one side takes from a sensor that faces it",
        default=0.0,
    )
    ambient_direction_rad: float = real(
        -math.pi, math.pi, "rad", "where that light comes from, in the arena's frame", default=0.0
    )
    warp: str = choice(
        WARPS,
        "monotone distortion of the readings that ir-raw tiles and rewards; bounds and reset "
        "go by undistorted ones",
        default="none",
    )

    def _check(self) -> None:
        if self.offset_counts[0] > self.offset_counts[1]:
            raise ValueError(
                f"InfraredConfig.offset_counts = {self.offset_counts!r}; expected (low, high) "
                "with low <= high"
            )

    @property
    def age_s(self) -> float:
        """Mean age of the averaged samples of the youngest pair."""
        return (self.samples - 1) / 2 * CYCLE


@compiled
def ray_share(distance: float, incidence: float) -> float:
    """Return what one ray brings back, in 1/m², from a distance in m under a cosine of
    incidence.
    """
    length = distance + CLOSEST
    return incidence / (length * length)


class Circles(NamedTuple):
    """Upright cylinders that a sensor looks at.

    Attributes:
        x, y, number: centres in m, so many of them; the nearer one hides the farther one, ray by
            ray.
        radius, strength: of all cylinders, in m and relative to white paper (or of the emission).
        beacon: 1 where cylinders emit: one way, through the sensor's own lobe of half the exponent.
        rays: (RAYS,) room for what every ray brings back.
    """

    x: Any
    y: Any
    number: int
    radius: float
    strength: float
    beacon: int
    rays: Any


@compiled
def circles_light(k: int, x: float, y: float, c: float, s: float, circles: Any) -> float:
    """Return the light that sensor k of a robot at x, y (heading c, s) gets from cylinders (of type
    Circles), in counts.
    """
    cx = circles.x
    cy = circles.y
    count = circles.number
    radius: float = circles.radius
    strength: float = circles.strength
    ac = c * _AXIS_C[k] - s * _AXIS_S[k]
    as_ = s * _AXIS_C[k] + c * _AXIS_S[k]
    px = x + RING * (c * _AXIS_C[k] - s * _AXIS_S[k])
    py = y + RING * (s * _AXIS_C[k] + c * _AXIS_S[k])
    if circles.beacon:
        return SCALE * strength * _beacons(px, py, ac, as_, circles)
    # most often there is one in front, if any
    before = 0
    alone = 0
    for j in range(count):
        if (cx[j] - px) * ac + (cy[j] - py) * as_ > -radius:
            before += 1
            alone = j
    if before == 0:
        return 0.0
    if before == 1:
        dx, dy = cx[alone] - px, cy[alone] - py
        share = _one(dx * ac + dy * as_, dy * ac - dx * as_, radius, circles.rays)
    else:
        share = _several(px, py, ac, as_, circles)
    return SCALE * strength * share


@compiled
def _one(along: float, aside: float, radius: float, rays: Any) -> float:
    """Return the share of light that comes back from a cylinder that is so far along a sensor's
    axis, and to the left of it.
    """
    square = radius * radius
    shrink = 1.0 / radius
    # without branches, so that several rays are computed at once
    for ray in range(RAYS):
        middle = along * _RAY_C[ray] + aside * _RAY_S[ray]
        off = along * _RAY_S[ray] - aside * _RAY_C[ray]
        half = math.sqrt(max(square - off * off, 0.0))
        near = middle - half
        back = _RAY_W[ray] * ray_share(max(near, 0.0), half * shrink)
        rays[ray] = back if (middle > 0.0) & (near < RANGE) else 0.0
    total = 0.0
    for ray in range(RAYS):
        total += rays[ray]
    return total


@compiled
def _several(px: float, py: float, ac: float, as_: float, circles: Any) -> float:
    """Return the share of light that comes back from several cylinders; the nearer one hides the
    farther one, ray by ray.
    """
    total = 0.0
    radius: float = circles.radius
    for ray in range(RAYS):
        rx, ry = ac * _RAY_C[ray] - as_ * _RAY_S[ray], as_ * _RAY_C[ray] + ac * _RAY_S[ray]
        nearest = RANGE
        incidence = 0.0
        for j in range(circles.number):
            dx, dy = circles.x[j] - px, circles.y[j] - py
            middle = rx * dx + ry * dy
            off = ry * dx - rx * dy
            inside = radius * radius - off * off
            if middle <= 0.0 or inside <= 0.0:
                continue
            half = math.sqrt(inside)
            if middle - half < nearest:
                nearest = max(middle - half, 0.0)
                incidence = half / radius
        if incidence > 0.0:
            total += _RAY_W[ray] * ray_share(nearest, incidence)
    return total


@compiled
def _beacons(px: float, py: float, ac: float, as_: float, circles: Any) -> float:
    """Return the share of light that a sensor at px, py, looking along ac, as_, gets of beacons."""
    total = 0.0
    for j in range(circles.number):
        dx, dy = circles.x[j] - px, circles.y[j] - py
        length = math.sqrt(dx * dx + dy * dy)
        facing = (dx * ac + dy * as_) / max(length, 1e-9)
        if facing > 0.0:
            total += facing * facing * ray_share(max(length - circles.radius, 0.0), 1.0)
    return total


@compiled
def headroom(
    k: int, c: float, s: float, ambient: float, ambient_c: float, ambient_s: float
) -> float:
    """Return the counts that light from direction ambient_c, ambient_s leaves to sensor k of a
    robot with heading c, s.
    """
    facing = (c * _AXIS_C[k] - s * _AXIS_S[k]) * ambient_c + (
        s * _AXIS_C[k] + c * _AXIS_S[k]
    ) * ambient_s
    left: float = max(DARK - ambient * max(facing, DIFFUSE), 0.0)
    return left


@compiled
def noise_sd(lit: float) -> float:
    """Return the standard deviation of one sample in counts: 3 far off, 8 at 400, about 190 at
    2000.
    """
    growing = 4.7e-5 * lit * lit
    return math.sqrt(9.0 + growing * growing)


@compiled
def saturate(light: float, most: float) -> float:
    """Return the lit reading for light in counts, bounded by what is left to the sensor."""
    limit = min(CONTACT, most)
    if limit <= 0.0:
        return 0.0
    part = light / limit
    part *= part
    return light / math.sqrt(math.sqrt(1.0 + part * part))


@compiled
def raw_reading(
    light: float, gain: float, offset: float, left: float, z: float, spread: float
) -> float:
    """Return an averaged reading in whole counts.

    Args:
        light: counts at gain 1; left: see ``headroom``; z: a standard normal number.
        spread: noise factor over the square root of the number of samples.
    """
    lit = saturate(gain * light, left)
    whole: float = round(min(max(offset + lit + spread * noise_sd(lit) * z, 0.0), ADC))
    return whole


@compiled
def warped(reading: float, warp: int) -> float:
    """Return a calibrated reading under one of WARPS, all of them strictly rising."""
    if warp == 1:
        return 500.0 * math.log1p(reading / 20.0)
    if warp == 2:
        return reading + 200.0
    if warp == 3:
        return 4000.0 * reading / (reading + 400.0)
    return reading


def wall_rays() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angles in rad of a sensor's rays off its axis, and their weights, which sum to
    one.
    """
    return _ANGLES.copy(), _RAY_W.copy()


def strength_of(config: InfraredConfig) -> tuple[float, float, int]:
    """Return radius in m, strength relative to white paper, and whether it emits (1), of what is
    looked at.
    """
    radius, strength, _ = TARGETS[config.target]
    beacon = config.target == "beacon"
    return radius, strength * config.brightness * (1.0 if beacon else ROUND), int(beacon)


def mean_light(
    distance_m: float, bearing_rad: float, config: InfraredConfig
) -> NDArray[np.float64]:
    """Return the light at all eight sensors, (8,) in counts, of one target at a distance between
    centres and a bearing.
    """
    radius, strength, beacon = strength_of(config)
    cx = np.array([distance_m * math.cos(bearing_rad)])
    cy = np.array([distance_m * math.sin(bearing_rad)])
    target = Circles(cx, cy, 1, radius, strength, beacon, np.zeros(RAYS))
    return np.array([circles_light(k, 0.0, 0.0, 1.0, 0.0, target) for k in range(SENSORS)])


def front_pair(
    distance_m: float, bearing_rad: float, config: InfraredConfig
) -> tuple[float, float]:
    """Return what the left and the right front sensor (ps7, ps0) of a matched, calibrated robot
    read on average, in counts.
    """
    light = mean_light(distance_m, bearing_rad, config)
    return saturate(light[7], DARK), saturate(light[0], DARK)


def draw_units(
    rng: np.random.Generator, config: InfraredConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw one robot's sensors: gains (8,) and free-air offsets (8,) in counts."""
    gains = np.exp(config.gain_spread * rng.standard_normal(SENSORS))
    return gains, np.round(rng.uniform(*config.offset_counts, SENSORS))


def calibrate(
    rng: np.random.Generator, config: InfraredConfig, offsets: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (8,) the mean of 100 single readings in free air, rounded to counts, as ``K`` of the
    firmware stores it.
    """
    noise = rng.standard_normal((CALIBRATION, SENSORS)) * config.noise * float(noise_sd(0.0))
    mean: NDArray[np.float64] = np.round(np.clip(np.round(offsets + noise), 0, ADC).mean(axis=0))
    return mean
