"""What every study makes of its published table: rows, figures, verdicts."""

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.measures.verdicts import RULINGS
from workbench.plots.style import style
from workbench.studies import decide, draw
from workbench.studies.published import formation, load_study, per_robot
from workbench.studies.tables import STUDIES

PLOTS = [(name, plot) for name, study in STUDIES.items() for plot in study.plots]
CLAIMS = [(name, claim) for name, study in STUDIES.items() for claim in study.verdicts]


def _measured(rows, trial, labels):
    """Return a trial's rows of a published table as the numbers that its function measured."""
    numbers = {}
    for row in trial.to_dict("records"):
        pattern = rows.names.get(tuple(row[column] for column in rows.columns), "{}")
        prefix = "" if pattern == "{}" else rows.prefix
        for name, value in row.items():
            if name not in (*labels, *rows.columns) and not pd.isna(value):
                numbers[pattern.format(name.removeprefix(prefix))] = value
    return numbers


@pytest.mark.parametrize("name", [name for name, study in STUDIES.items() if study.rows.names])
def test_rows_of_a_published_trial_hold_what_was_measured(name):
    study = STUDIES[name]
    labels = [*study.cases()[0][0], "seed"]
    table = load_study(name)
    for _, lines in list(table.groupby(labels, sort=False, dropna=False))[::7]:
        # what does not exist for a condition was not measured: its row has no numbers
        own = [name for name in lines if name not in (*labels, *study.rows.columns)]
        trial = lines.dropna(how="all", subset=own)
        again = pd.DataFrame(study.rows.of(_measured(study.rows, trial, labels)))
        shown = trial[again.columns].dropna(axis=1, how="all").reset_index(drop=True)
        again = again[shown.columns]
        assert len(again) == len(trial)
        pd.testing.assert_frame_equal(again, shown, check_dtype=False)


@pytest.mark.parametrize(("name", "plot"), PLOTS)
def test_a_studys_figure_shows_the_numbers_that_are_published_with_it(name, plot, tmp_path):
    with style():
        figure, numbers = STUDIES[name].plots[plot](load_study(name))
    assert figure.axes
    drawn = numbers.to_csv(index=False, float_format="%.10g", lineterminator="\n")
    (tmp_path / "drawn.csv").write_text(drawn)
    published = pd.read_csv(paths.FIGURES / f"{plot}.csv")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "drawn.csv"), published, rtol=1e-9)


@pytest.mark.parametrize(("name", "claim"), CLAIMS)
def test_a_verdict_follows_from_its_table(name, claim):
    verdict = STUDIES[name].verdicts[claim]
    table = load_study(name)
    found = verdict(table)
    assert found.ident == claim and found.ruling in RULINGS
    assert found == decide(name, claim)
    # other numbers, other words
    other = table.copy()
    numbers = [c for c in table.select_dtypes("number") if c not in STUDIES[name].rows.columns]
    odd = np.arange(len(table)) % 7 < 3
    for column in numbers:
        if column in ("seed", *STUDIES[name].cases()[0][0]):
            continue  # the conditions
        other[column] = other[column].astype(float).where(~odd, other[column] / 2 + 0.5)
    assert verdict(other).because != found.because


def test_unknown_plots_and_claims_are_refused_with_what_there_is():
    with pytest.raises(ValueError, match="study 'inner': plot 'tiles'; expected one of inner_cell"):
        draw("inner", "tiles")
    with pytest.raises(ValueError, match="study 'inner': claim 'E1'; expected one of none"):
        decide("inner", "E1")
    with pytest.raises(ValueError, match="study 'iner'; expected one of actions, bound"):
        draw("iner", "inner_cell")


def test_formations_and_robots_are_taken_apart_in_the_same_order():
    table = load_study("stability")
    whole = formation(table)
    each = per_robot(table, "learning_losses")
    assert list(each.columns) == [1, 2, 3, 4] and len(each) == len(whole) == 60
    np.testing.assert_array_equal(each.sum(axis=1), whole["learning_losses"])
