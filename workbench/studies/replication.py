"""The replication card: every claim of the paper on one page, with what was done, how often, the
effect, and the verdict, computed from the published tables.
"""

import re

import pandas as pd

from workbench import paths
from workbench.lab.storage import write_bytes
from workbench.studies.tables import STUDIES, decide

FILE = paths.NOTEBOOKS / "REPLICATION.md"
# claims in the order of the paper; those of no number are ours
_ORDER = "E1 L6 X2 E2 S3 N5 M3 E3 E4 E5 E6 E7 E8 E9 E10 E11".split()
_NOTEBOOKS = {  # study → where it is shown
    "recommended": "03, 12",
    "buffer": "03",
    "reset": "03",
    "pattern": "04",
    "infrared-world": "05",
    "copies": "07",
    "delays": "08",
    "transfer": "08",
    "smoothness": "09",
    "stability": "09",
    "controllers": "10",
    "rivals": "11",
    "calm": "12",
    "drives": "01",
    "shapes": "16",
    "reform": "16",
    "range-bearing": "16",
}
_BEGIN = """# Replication card

What became of the paper's claims, from the tables in `data/studies/`. *Supported*, *mostly*,
*mostly not*, *contradicted*: the claim's own main part decides on which side it falls. All of it is
simulated or emulated. What was chosen on a quantity stands beside it: step sizes, discount, traces,
initial values, ε and the leader's speed were chosen by the shares in the best block and cell
(notebook 04), the recommended tiles by errors and losses on these tracks (notebook 12), the tuned
carrot by its error on other ones (study `tuning`).

"""


def card() -> pd.DataFrame:
    """Return a row per claim that a study decides: ident, claim, study, n (seeds), effect, what
    would have made it fail, our own bars, and the verdict.
    """
    rows = []
    for name, study in STUDIES.items():
        for claim in study.verdicts:
            found = decide(name, claim)
            rows.append(
                {
                    "ident": found.ident,
                    "claim": found.claim,
                    "study": name,
                    "n": study.seeds,
                    "effect": found.because,
                    "fails": found.fails,
                    "ours": found.ours,
                    "verdict": found.ruling,
                }
            )
    table = pd.DataFrame(rows)
    return table.sort_values("ident", key=lambda idents: idents.map(_rank), kind="stable")


def _rank(ident: str) -> int:
    numbers = [_ORDER.index(one) for one in re.findall(r"\b[A-Z]\d+", ident) if one in _ORDER]
    return min(numbers, default=len(_ORDER))


def short_rows() -> list[str]:
    """Return a line of Markdown per claim, as the README has them: claim, verdict, notebook."""
    return [
        f"| {row.ident}: {row.claim} | **{row.verdict}** | {_NOTEBOOKS.get(row.study, '')} |"
        for row in card().itertuples()
    ]


def card_text() -> str:
    """Return the card as Markdown: a table of verdicts, and the evidence below it."""
    table = card()
    lines = ["| | claim | done | n | verdict |", "|---|---|---|---|---|"]
    evidence = []
    for row in table.itertuples():
        question = " ".join(STUDIES[row.study].question.split())
        done = f"`{row.study}`: {question}"
        lines.append(f"| {row.ident} | {row.claim} | {done} | {row.n} | **{row.verdict}** |")
        evidence.append(f"**{row.ident}, {row.verdict}.** {row.effect}")
        evidence.append(f"*Would have failed:* {row.fails}")
        if row.ours:
            evidence.append(f"*Our bars:* {row.ours}")
    return _BEGIN + "\n".join(lines) + "\n\n## Evidence\n\n" + "\n\n".join(evidence) + "\n"


def write_card() -> str:
    """Write the card beside the notebooks; return its name."""
    write_bytes(FILE, card_text().encode())
    return FILE.name
