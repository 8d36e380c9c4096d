"""The three ground sensors: infrared reflexes from the floor, about 950 counts on white and 250 to 490 on black.

Values from real e-pucks (recordings of an e-puck2's ground sensors over bars): white 930 to 965, black per sensor
338/287/367 on the robot that is modelled here, noise about 1.5 counts (standard deviation). The response between white
and black is taken as linear in the dark share of the sensor's spot: our assumption.

>>> float(round(ground_reading(1.0, 0, 0.0)))
338.0
"""

from workbench.compiled import compiled

WHITE = (948.0, 948.0, 948.0)  # counts, left, centre, right
BLACK = (338.0, 287.0, 367.0)  # counts
NOISE = 1.5  # counts, standard deviation per reading
SPOT = 0.003  # m, radius of the floor spot that a sensor sees: our assumption


@compiled
def ground_reading(dark: float, sensor: int, noise: float) -> float:
    """Return a reading in whole counts for a dark share of the spot in [0, 1].

    Args:
        dark: share of the spot that is black.
        sensor: 0 left, 1 centre, 2 right.
        noise: a standard normal number.
    """
    counts = WHITE[sensor] + (BLACK[sensor] - WHITE[sensor]) * dark + NOISE * noise
    whole: float = round(min(max(counts, 0.0), 1023.0))
    return whole


@compiled
def darkness(counts: float, sensor: int) -> float:
    """Return the calibrated darkness of a reading: 0 on white, 1 on black, clipped to [0, 1]."""
    share: float = (WHITE[sensor] - counts) / (WHITE[sensor] - BLACK[sensor])
    return min(max(share, 0.0), 1.0)
