"""The overhead camera in numbers; without cv2, so that a configuration can name it.

What the paper says of its camera is that it tracks ArUco markers; all numbers are our choice: a
common 1.2 megapixel camera two metres above the floor, hand calibrated. ``CONDITIONS`` are exposure
(factor), blur (standard deviation in pixels) and noise (standard deviation in grey levels).
"""

from workbench.fields import choice, configuration, integer, real

CONDITIONS = {"clear": (1.0, 0.6, 2.0), "bad": (0.6, 1.6, 12.0)}

# random errors of the pixel pipeline, fitted by ``validate camera`` at the default geometry:
# standard deviation of x and y in m, its growth per m² from the middle, the same of the heading in
# rad and rad/m², and the share of markers that are not found (0: all that lay wholly in the picture
# were)
NOISE = {"clear": (5.1e-5, 1.3e-5, 4.0e-3, 2e-4, 0.0), "bad": (1.1e-4, 1.3e-5, 7.0e-3, 4e-4, 0.0)}
TABLE = 33  # nodes of a table of systematic errors along each axis


@configuration
class CameraConfig:
    """The overhead camera that tracks the robots' markers."""

    width_px: int = integer(160, 4096, "pixels", "width of the picture", default=1280)
    height_px: int = integer(120, 4096, "pixels", "height of the picture", default=960)
    span_m: float = real(0.2, 20.0, "m", "width of floor that is seen", default=1.8)
    height_m: float = real(0.3, 20.0, "m", "height of the camera", default=2.0)
    tilt_deg: float = real(
        -20.0, 20.0, "degrees", "how far from straight down it looks", default=2.0
    )
    k1: float = real(
        -0.4, 0.4, "", "radial distortion; the second coefficient is -k1/5", default=-0.10
    )
    marker_m: float = real(0.01, 0.07, "m", "edge of a robot's marker", default=0.048)
    conditions: str = choice(
        tuple(CONDITIONS), "exposure, blur and noise of the pictures", default="clear"
    )
    focal_error: float = real(
        0.0, 0.1, "", "standard deviation of the calibrated focal length, relative", default=0.002
    )
    distortion_error: float = real(
        0.0, 1.0, "", "standard deviation of the calibrated distortion, relative", default=0.03
    )
    floor_error_m: float = real(
        0.0, 0.05, "m", "standard deviation of the floor points of the calibration", default=0.001
    )
    latency_s: float = real(0.0, 0.1, "s", "age of a picture when it is used", default=0.03)
    every: int = integer(1, 10, "control periods", "between two pictures", default=1)
    dropout: float = real(
        0.0,
        1.0,
        "",
        "share of markers that are hidden in a picture, on top of those not found",
        default=0.0,
    )
