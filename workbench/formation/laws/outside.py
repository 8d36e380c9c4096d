"""Commands from outside, period by period: for environments and whoever else drives followers."""

from typing import ClassVar

from workbench.fields import configuration
from workbench.formation.laws.law import ControlLaw


@configuration
class Outside(ControlLaw):
    """No law: followers do what they are told after everybody has sensed
    (``Convoy.command_all``).
    """

    name: ClassVar[str] = "outside"
    needs: ClassVar[tuple[str, ...]] = ()
