"""How much more noise than they learned with do policies bear (E9)?"""

import math
from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.studies.conditions import (
    BASE,
    routes,
)
from workbench.studies.transfer_trials import (
    Transfer,
    measure_gap,
)


def cases() -> Sequence[Case]:
    """Return the conditions."""
    noisy = replace(BASE, noise_distance_m=0.001, noise_bearing_rad=math.radians(1))
    noisy_routes = {"absolute, 1 mm and 1°": (noisy, 200_000)} | {
        route: case for route, case in routes().items() if route != "camera"
    }
    return [
        (
            {"route": route, "training": training},
            Transfer(config=config, steps=steps, minutes=10.0, training=training),
        )
        for route, (config, steps) in noisy_routes.items()
        for training in ("nominal", "randomised")
    ]


STUDY = Study("gap", __doc__, cases, function=measure_gap)
