"""What do several offset tilings do that the paper's single one does not?"""

from collections.abc import Sequence
from dataclasses import replace

from workbench.lab.study import Case, Study
from workbench.studies.conditions import BASE


def cases() -> Sequence[Case]:
    """Return the conditions."""
    return [
        ({"tiles": f"{n}×{n}", "tilings": m}, replace(BASE, state_tiles=(n, n), tilings=m))
        for n in (3, 5, 7, 9)
        for m in (1, 2, 4, 8)
    ]


STUDY = Study("offsets", __doc__, cases)
