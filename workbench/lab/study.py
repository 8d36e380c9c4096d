"""A study: a question, the function that measures a trial, and the conditions that answer it.

A study is one file of ``workbench/studies``, found by scanning: its docstring is the question, and
it binds ``STUDY``. All conditions differ from the defaults of ConvoyConfig in what their label says
and in nothing else.

>>> study = Study("one", "Does it follow?", lambda: [({"speed": 1}, ConvoyConfig())], minutes=1.0)
>>> labels, trials = study.trials([1, 2])
>>> labels, [trial.config.seed for trial in trials]
([{'speed': 1, 'seed': 1}, {'speed': 1, 'seed': 2}], [1, 2])
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.formation.config import ConvoyConfig
from workbench.lab.trial import Trial, measure

Labels = dict[str, Any]
# a configuration takes the study's own steps and minutes
Case = tuple[Mapping[str, Any], ConvoyConfig | Trial]


@dataclass(frozen=True)
class Study:
    """A question, the function that measures a trial, and the labelled conditions that it is
    measured on.
    """

    name: str
    question: str
    cases: Callable[[], Sequence[Case]]
    function: Callable[[Any], Mapping[str, float]] = measure  # of a Trial, or of what its cases are
    steps: int = 200_000
    minutes: float = 20.0
    seeds: int = 10

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
