"""Does the full run keep its quality through a camera (N1)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.arena.camera.config import CameraConfig
from workbench.formation.config import ConvoyConfig
from workbench.lab.study import Case, Rows, Study
from workbench.studies.camera_trials import measure_camera


def cases() -> Sequence[Case]:
    """Return the conditions."""
    bad = CameraConfig(conditions="bad", latency_s=0.1, dropout=0.1)
    base = ConvoyConfig(drive="rolling", sensing="camera")
    return [
        ({"sensing": "truth"}, replace(base, sensing="truth")),
        ({"sensing": "camera"}, base),
        ({"sensing": "bad camera"}, replace(base, camera=bad)),
    ]


# five minutes with the fast model, and with every picture drawn and searched
ROWS = Rows(("seen",), {("camera",): "camera_{}", ("pixels",): "pixels_{}"}, prefix="drive_")
STUDY = Study(
    "camera",
    __doc__,
    cases,
    function=measure_camera,
    steps=1_300_000,
    minutes=30.0,
    rows=ROWS,
)
