"""The loop with nothing in it but what a plain configuration needs, which compiles in half the
time: what most people run first begins sooner.

Plain is: no law drives, poses are the simulator's and taken as they are, robots are as they should
be, and the learner is one of the kernel's. There is one such loop for followers of the robot in
front and one for places of a shape. What such a run does is the same to the last bit with the whole
loop.

Contract: which of them runs is nobody's to know but the convoy's.
"""

import functools
from typing import Any

from workbench.compiled import chosen, compiled, exchanged
from workbench.formation import body, control, estimate, follower, graph, virtual
from workbench.formation.config import ConvoyConfig
from workbench.formation.laws import table as laws
from workbench.formation.laws.law import ControlLaw
from workbench.formation.senses import table as senses
from workbench.formation.senses.table import SENSES
from workbench.learning import rules
from workbench.learning.rules import RULES

_TRUTH = SENSES["truth"]
_PARTS = ("locate", "see", "tiled", "errors", "trimmed")


@compiled
def _no_law(task: Any, follower: Any, distance: float, bearing: float) -> tuple[int, int]:
    """Stand still, in the place of ``laws.table.steer``."""
    return 0, 0


@compiled
def _no_body(
    task: Any, robot: Any, ctrl: Any, i: int, left: int, right: int, z_left: float, z_right: float
) -> None:
    """Do nothing, in the place of ``body.drive_body``."""


@compiled
def _as_seen(task: Any, follower: Any) -> tuple[float, float]:
    """Return what has been read, in the place of ``estimate.perceive``."""
    return follower.seen.distance, follower.seen.bearing


@compiled
def _no_predecessor(task: Any, robot: Any, ahead: Any) -> None:
    """Do nothing, in the place of ``control.know_ahead``: only laws ask."""


@compiled
def _no_grade(task: Any, robots: Any) -> None:
    """Do nothing, in the place of ``graph.grade``: only shapes have places."""


@compiled
def _no_learning(task: Any, follower: Any, memory: Any) -> bool:
    """Do nothing, in the place of ``follower.learn_at_once``: with the buffer all learn later."""
    return True


def is_plain(config: ConvoyConfig, law: ControlLaw | None) -> bool:
    """Return whether a convoy needs nothing but the lean loop."""
    sense = SENSES[config.sensing]
    return (
        law is None
        and (not config.formation.shaped or sense.see_place is virtual.see)
        and not config.estimates
        and config.body.nominal
        and config.learner.buffer
        and all(getattr(sense, part) is getattr(_TRUTH, part) for part in _PARTS)
        and RULES[config.learner.rule].update is rules.gq_step
    )


_OTHERS = {
    **{getattr(senses, part): chosen([getattr(_TRUTH, part)]) for part in _PARTS},
    laws.steer: _no_law,
    follower.learn_at_once: _no_learning,
    control.know_ahead: _no_predecessor,
    body.drive_body: _no_body,
    estimate.perceive: _as_seen,
    rules.update: chosen([rules.gq_step]),
}


_LINE = {graph.grade: _no_grade}
_PLACES = {senses.locate: chosen([virtual.locate]), senses.see: chosen([virtual.see])}


@functools.cache
def lean(function: Any, *, shaped: bool) -> Any:
    """Return a function of ``formation.control`` without what a plain configuration never calls."""
    if shaped:
        return exchanged(function, _OTHERS | _PLACES, __name__, "-shaped")
    return exchanged(function, _OTHERS | _LINE, __name__)
