"""Verdict boxes: what the evidence says of a claim of the paper, with effect size, interval and n.

>>> because = "70 mm wide in every direction, n = 1 robot"
>>> fails = "a width that depends on the direction by more than 1 mm"
>>> box = Verdict("E0", "Robots are round.", "supported", because, fails)
>>> print(box)
E0 · supported
claim: Robots are round.
because: 70 mm wide in every direction, n = 1 robot
would have failed: a width that depends on the direction by more than 1 mm

In a notebook the last expression of a cell is shown as a framed box. ``ruling`` derives the word
from tests of the evidence, so that it changes when the numbers do; the claim's own main part
decides on which side it falls. Bars of ours that are harder than what the paper says stand apart
and decide nothing.
"""

import html
from dataclasses import dataclass

import numpy as np

RULINGS = ("supported", "mostly", "mostly not", "contradicted")
_MARK = dict(zip(RULINGS, "✔◕◔✘", strict=True))
_COLOUR = dict(zip(RULINGS, ("#009E73", "#56B4E9", "#E69F00", "#D55E00"), strict=True))
# what counts as similar, set before any data: the far end of an interval of a difference, or of a
# ratio, lies within
SIMILAR_MM = 0.5
SIMILAR_DEG = 0.25
SIMILAR_TURNING = 1.25


def ruling(main: bool, *others: bool) -> str:
    """Return "supported" if a claim's main part and all others hold, "mostly" if the main part does
    but not all others, "mostly not" if the main part fails and something else holds, and
    "contradicted" if nothing does.
    """
    parts = (main, *others)
    if not all(isinstance(part, (bool, np.bool_)) for part in parts):
        raise ValueError(
            f"parts = {parts!r}; a ruling needs True or False for the main part of the claim, and "
            "for every other that was tested"
        )
    if main:
        return RULINGS[0] if all(others) else RULINGS[1]
    return RULINGS[2] if any(others) else RULINGS[3]


def similar(low: float, high: float, margin: float) -> bool:
    """Return whether an interval of a difference lies within a margin on both sides."""
    return bool(-margin <= low and high <= margin)


def no_worse(high: float, margin: float) -> bool:
    """Return whether the far end of an interval of a difference (or of a ratio) is within a margin:
    errors, of which less is better, are not inferior.
    """
    return bool(high <= margin)


@dataclass(frozen=True)
class Verdict:
    """One claim and what became of it.

    Attributes:
        ident: the claim's number in the list of claims, e.g. "E6".
        claim: the claim, in the paper's words where possible.
        ruling: one of RULINGS.
        because: effect size, interval and n, in words.
        fails: what would have made it fail.
        ours: bars of ours that are harder than the claim, and what became of them.
    """

    ident: str
    claim: str
    ruling: str
    because: str
    fails: str
    ours: str = ""

    def __post_init__(self) -> None:
        if self.ruling not in RULINGS:
            raise ValueError(
                f"ruling = {self.ruling!r}; expected one of {', '.join(map(repr, RULINGS))}"
            )

    def _lines(self) -> dict[str, str]:
        told = {"because": self.because, "would have failed": self.fails, "our bars": self.ours}
        return {name: words for name, words in told.items() if words}

    def __str__(self) -> str:
        lines = [f"{self.ident} · {self.ruling}", f"claim: {self.claim}"]
        return "\n".join([*lines, *(f"{name}: {words}" for name, words in self._lines().items())])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        colour = _COLOUR[self.ruling]
        told = "".join(
            f"<br><b>{name}:</b> {html.escape(words)}" for name, words in self._lines().items()
        )
        return (
            f'<div style="border:2px solid {colour}; border-left-width:10px; padding:0.6em '
            '1em; max-width:52em">'
            f"<b>{_MARK[self.ruling]} {html.escape(self.ident)} · {self.ruling}</b>"
            f"<br><i>{html.escape(self.claim)}</i>{told}</div>"
        )
