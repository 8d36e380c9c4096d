"""Verdict boxes: what the evidence says of a claim of the paper, with effect size, interval and n.

>>> because = "70 mm wide in every direction, n = 1 robot"
>>> box = Verdict("E0", "Robots are round.", "supported", because)
>>> print(box)
E0 · supported
claim: Robots are round.
because: 70 mm wide in every direction, n = 1 robot

In a notebook the last expression of a cell is shown as a framed box. ``ruling`` derives the word
from tests of the evidence, so that it changes when the numbers do.
"""

import html
from dataclasses import dataclass

import numpy as np

RULINGS = ("supported", "supported under conditions", "not supported")
_MARK = {"supported": "✔", "supported under conditions": "◐", "not supported": "✘"}
_COLOUR = {
    "supported": "#009E73",
    "supported under conditions": "#E69F00",
    "not supported": "#D55E00",
}


def ruling(*parts: bool) -> str:
    """Return "supported" if all parts of a claim hold, "not supported" if none does, else
    "supported under conditions".
    """
    if not parts or not all(isinstance(part, (bool, np.bool_)) for part in parts):
        raise ValueError(
            f"parts = {parts!r}; a ruling needs True or False for at least one part of the "
            "claim that was tested"
        )
    if all(parts):
        return RULINGS[0]
    return RULINGS[1] if any(parts) else RULINGS[2]


@dataclass(frozen=True)
class Verdict:
    """One claim and what became of it.

    Attributes:
        ident: the claim's number in the list of claims, e.g. "E6".
        claim: the claim, in the paper's words where possible.
        ruling: one of RULINGS.
        because: effect size, interval and n, in words.
    """

    ident: str
    claim: str
    ruling: str
    because: str

    def __post_init__(self) -> None:
        if self.ruling not in RULINGS:
            raise ValueError(
                f"ruling = {self.ruling!r}; expected one of {', '.join(map(repr, RULINGS))}"
            )

    def __str__(self) -> str:
        return f"{self.ident} · {self.ruling}\nclaim: {self.claim}\nbecause: {self.because}"

    __repr__ = __str__

    def _repr_html_(self) -> str:
        colour = _COLOUR[self.ruling]
        mark = _MARK[self.ruling]
        claim = html.escape(self.claim)
        because = html.escape(self.because)
        return (
            f'<div style="border:2px solid {colour}; border-left-width:10px; padding:0.6em '
            '1em; max-width:52em">'
            f"<b>{mark} {html.escape(self.ident)} · "
            f"{self.ruling}</b><br><i>{claim}</i><br>{because}</div>"
        )
