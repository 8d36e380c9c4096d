"""From which compute time on does the update buffer matter?"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from matplotlib.figure import Figure

from workbench.lab.statistics import paired
from workbench.lab.study import Case, Study
from workbench.measures.comparisons import said
from workbench.measures.verdicts import Verdict, ruling
from workbench.plots.comparisons import curves
from workbench.studies.conditions import BASE, COMPUTE_TIMES_S, ROBOT, with_learner


def cases() -> Sequence[Case]:
    """Return the conditions."""
    cases = []
    for table, config in (("9×9 states, 7×7 actions", BASE), ("5×5 states, 3×3 actions", ROBOT)):
        cases.append(
            ({"table": table, "buffer": "on", "compute_time_s": 0.0}, config)
        )  # the same at every compute time
        for seconds in COMPUTE_TIMES_S:
            timed = replace(with_learner(config, buffer=False), compute_time_s=seconds)
            cases.append(({"table": table, "buffer": "off", "compute_time_s": seconds}, timed))
    return cases


def losses_saved(table: pd.DataFrame) -> pd.DataFrame:
    """Return losses without minus with the buffer, paired by seed, by table and compute time."""
    lines = []
    off = table[table["buffer"] == "off"]
    for (name, seconds), part in off.groupby(["table", "compute_time_s"], sort=False):
        on = table[(table["buffer"] == "on") & (table["table"] == name)]
        effect = paired(part["losses"], on["losses"])
        lines.append((name, round(1000 * seconds), *effect, len(part)))
    columns = ["table", "compute_time_ms", "value", "low", "high", "seeds"]
    return pd.DataFrame(lines, columns=columns)


def plot(table: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Draw losses saved by the buffer against the time that an update takes."""
    effect = losses_saved(table)
    fig = Figure(figsize=(5.4, 3.6), layout="constrained")
    ax = fig.add_subplot()
    label, words = "time that one update takes in ms", "losses without − with buffer"
    curves(effect, "compute_time_ms", by="table", xlabel=label, ylabel=words, ax=ax)
    ax.axhline(0, color="#777777", linewidth=0.8, linestyle=":")
    ax.set_ylim(effect["low"].min() * 1.1, None)
    return fig, effect


def verdict(table: pd.DataFrame) -> Verdict:
    """Decide L6: losses saved at the longest compute time with both tables, no cost at the
    shortest.
    """
    effect = losses_saved(table).set_index(["table", "compute_time_ms"])
    names = list(table["table"].unique())
    longest = max(effect.index.get_level_values(1))
    late = [effect.loc[(name, longest)] for name in names]
    free = [effect.loc[(name, 0)] for name in names]
    clear = []
    for name in names:
        times = [f"{ms} ms" for ms, line in effect.loc[name].iterrows() if line["low"] > 0]
        clear.append(f"{name} {', '.join(times) or 'nowhere'}")
    because = (
        f"losses saved at {longest} ms: "
        + "; ".join(f"{name} {said(line)}" for name, line in zip(names, late, strict=True))
        + ". At 0 ms: "
        + "; ".join(said(line) for line in free)
        + f". Clearly saved: {'; '.join(clear)}"
    )
    fails = (
        f"no clear saving with either table when an update takes {longest} ms; then none with one "
        "of them, or a clear cost where updates take no time"
    )
    claim = "The update buffer greatly improves learning efficiency: there is no blind time."
    saved = [bool(line["low"] > 0) for line in late]
    parts = (any(saved), all(saved), *(bool(line["high"] >= 0) for line in free))
    return Verdict("L6", claim, ruling(*parts), because, fails)


STUDY = Study("buffer", __doc__, cases, plots={"buffer_effect": plot}, verdicts={"L6": verdict})
