"""What do targets, mismatch, light and distortion change for infrared (N4, N5, N7)?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.formation.config import SETTINGS
from workbench.formation.senses.table import INFRARED
from workbench.lab.study import Case, Study
from workbench.studies.conditions import with_infrared
from workbench.studies.infrared_trials import measure_infrared


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases: list[Case] = []
    for route in INFRARED:
        base = replace(SETTINGS["infrared"], drive="planar", followers=1, sensing=route)
        worlds = {
            "as assumed": base,
            "linear tiles": replace(base, distance_tiling="uniform", bearing_tiling="uniform"),
        }
        if route == "ir-raw":
            worlds |= {
                f"{warp} distortion": with_infrared(base, warp=warp)
                for warp in ("logarithmic", "offset", "saturating")
            }
        worlds |= {
            "matched sensors": with_infrared(base, gain_spread=0.0),
            "gain spread 30 %": with_infrared(base, gain_spread=0.3),
            "noise × 2": with_infrared(base, noise=2.0),
            "offsets not calibrated": with_infrared(base, calibrated=False),
            "bare shell, to 115 mm": with_infrared(
                replace(base, distance_m=(0.08, 0.115)), target="shell"
            ),
            "light from one side": with_infrared(base, ambient_counts=3000.0),
            "blinding light": with_infrared(base, ambient_counts=4000.0),
            "active beacon": with_infrared(base, target="beacon"),
        }
        cases += [({"route": route, "world": world}, config) for world, config in worlds.items()]
    return cases


STUDY = Study(
    "infrared-world", __doc__, cases, function=measure_infrared, steps=100_000, minutes=4.0
)
