"""A study: a question, the conditions that answer it, the function that measures a trial, and what
is made of the table: plots and verdicts.

A study is one file of ``workbench/studies``, found by scanning: its docstring is the question, and
it binds ``STUDY``. All conditions differ from the defaults of ConvoyConfig in what their label says
and in nothing else.

>>> study = Study("one", "Does it follow?", lambda: [({"speed": 1}, ConvoyConfig())], minutes=1.0)
>>> labels, trials = study.trials([1, 2])
>>> labels, [trial.config.seed for trial in trials]
([{'speed': 1, 'seed': 1}, {'speed': 1, 'seed': 2}], [1, 2])

What a trial has several times, once per robot for example, stands in rows of its own:

>>> per_robot = Rows(("robot",), {(1,): "{}_1", (2,): "{}_2"})
>>> for row in per_robot.of({"losses": 5, "losses_1": 2, "losses_2": 3}):
...     print(row)
{'robot': None, 'losses': 5}
{'robot': 1, 'losses': 2}
{'robot': 2, 'losses': 3}
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from workbench.formation.config import ConvoyConfig
from workbench.lab.trial import Trial, measure

Labels = dict[str, Any]
# a configuration takes the study's own steps and minutes
Case = tuple[Mapping[str, Any], ConvoyConfig | Trial]
# from a study's table to a figure and the numbers in it
Plot = Callable[[pd.DataFrame], tuple[Figure, pd.DataFrame]]


@dataclass(frozen=True)
class Rows:
    """Which of a trial's numbers stand in rows of their own.

    Attributes:
        columns: what tells the rows of a trial apart, e.g. ("robot",).
        names: values of these columns → how the numbers of that row are called by the function that
            measures, ``{}`` for the name that they have in the table.
        prefix: begins their names in the table.

    Numbers that belong to no row stand in a first one, in which the columns are empty; a row of
    which a trial has nothing is left out.
    """

    columns: tuple[str, ...] = ()
    names: Mapping[tuple[Any, ...], str] = field(default_factory=dict)
    prefix: str = ""

    def of(self, numbers: Mapping[str, float]) -> list[Labels]:
        """Return the rows of what was measured in one trial."""
        rest = dict(numbers)
        rows = []
        for values, pattern in self.names.items():
            begin, end = pattern.split("{}")
            mine = [n for n in rest if n.startswith(begin) and n.endswith(end)]
            row: Labels = dict(zip(self.columns, values, strict=True))
            for name in mine:
                row[self.prefix + name[len(begin) : len(name) - len(end)]] = rest.pop(name)
            if mine:
                rows.append(row)
        whole: Labels = dict.fromkeys(self.columns)
        return [whole | rest, *rows] if rest or not rows else rows


def by_robot(*robots: int) -> Rows:
    """Return that numbers whose names end in a robot's place in line have a row of their own."""
    return Rows(("robot",), {(robot,): f"{{}}_{robot}" for robot in robots})


@dataclass(frozen=True)
class Study:
    """A question, the labelled conditions, the function that measures a trial, and what is made of
    the table.

    Attributes:
        function: measures a trial: numbers by name, none of them a label's.
        plots: name of a figure, of all studies' its own → function that draws it from the table.
        verdicts: identifier of a claim → function that decides it from the table, a ``Verdict``.
    """

    name: str
    question: str
    cases: Callable[[], Sequence[Case]]
    function: Callable[[Any], Mapping[str, float]] = measure  # of a Trial, or of a subclass
    steps: int = 200_000
    minutes: float = 20.0
    seeds: int = 10
    rows: Rows = Rows()
    plots: Mapping[str, Plot] = field(default_factory=dict)
    verdicts: Mapping[str, Callable[[pd.DataFrame], Any]] = field(default_factory=dict)

    def trials(
        self, seeds: Sequence[int], *, quick: bool = False
    ) -> tuple[list[Labels], list[Trial]]:
        """Return the labels and the trials of all conditions and seeds, one of each per line of the
        table.
        """
        labels = []
        trials = []
        for label, case in self.cases():
            whole = (
                case
                if isinstance(case, Trial)
                else Trial(config=case, steps=self.steps, minutes=self.minutes)
            )
            trial = replace(whole, steps=min(whole.steps, 2000), minutes=2.5) if quick else whole
            for seed in seeds:
                labels.append({**label, "seed": seed})
                trials.append(replace(trial, config=trial.config.with_seed(seed)))
        return labels, trials
