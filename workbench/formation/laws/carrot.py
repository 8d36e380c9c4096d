"""The carrot law: v = k_d e_d + k_i ∫e_d, ω = k_φ φ."""

from typing import Any, ClassVar

from workbench.compiled import compiled
from workbench.fields import configuration, real
from workbench.formation.laws.law import ControlLaw, pace


@compiled
def steer(task: Any, follower: Any, distance: float, bearing: float) -> tuple[float, float]:
    """Return (v, ω): v = k_d e_d + k_i ∫e_d, ω = k_φ φ."""
    v = pace(task, follower, distance - task.bounds.middle)
    return v, task.law.gain[2] * bearing


@configuration
class CarrotPI(ControlLaw):
    """Drive at the predecessor as at a carrot: PI control of the distance, P control of the
    bearing.
    """

    name: ClassVar[str] = "carrot"
    needs: ClassVar[tuple[str, ...]] = ("distance", "bearing")
    steer: ClassVar[Any] = staticmethod(steer)

    k_distance: float = real(0.0, 20.0, "1/s", "speed per distance error", default=2.0)
    k_integral: float = real(
        0.0, 20.0, "1/s²", "speed per integral of the distance error", default=0.5
    )
    k_bearing: float = real(0.0, 20.0, "1/s", "turning rate per bearing", default=4.0)
