"""The three ground sensors: infrared reflexes from the floor, about 950 counts on white and 250 to
490 on black.

Values from real e-puck2 ground modules over bars: white 930 to 965; the lowest reading of each
sensor, left/centre/right, is 338/287/367 (a), 485/353/412 (b) and 247/271/299 (c); noise about 1.5
counts (standard deviation). ``validate infrared`` finds module b in three recordings (github
Wii42/Robotics_Project); no recording at hand shows a or c. The response between white and black is
taken as linear in the dark share of the sensor's spot: our assumption. The spot is as wide as real
edges of a line are: from 10 to 90 % within 1.0 to 1.6 mm. Places: see ``robot.geometry``, 10 mm
apart.

>>> float(round(ground_reading(1.0, 948.0, 338.0, 0.0)))
338.0
>>> darkness(338.0, 948.0, 338.0)
1.0
"""

from workbench.compiled import compiled

WHITE = (948.0, 948.0, 948.0)  # counts, left, centre, right
MODULES = {
    "a": (338.0, 287.0, 367.0),
    "b": (485.0, 353.0, 412.0),
    "c": (247.0, 271.0, 299.0),
}  # counts on black
NOISE = 1.5  # counts, standard deviation per reading
SPOT = 0.0008  # m, radius of the floor spot that a sensor sees: edges of 1.3 mm (10 to 90 %)


@compiled
def ground_reading(dark: float, white: float, black: float, noise: float) -> float:
    """Return a reading in whole counts for a dark share of the spot in [0, 1].

    Args:
        dark: share of the spot that is black.
        white, black: the sensor's readings on white and on black.
        noise: a standard normal number.
    """
    counts = white + (black - white) * dark + NOISE * noise
    whole: float = round(min(max(counts, 0.0), 1023.0))
    return whole


@compiled
def darkness(counts: float, white: float, black: float) -> float:
    """Return the calibrated darkness of a reading: 0 on white, 1 on black, clipped to [0, 1]."""
    share: float = (white - counts) / (white - black)
    return min(max(share, 0.0), 1.0)
