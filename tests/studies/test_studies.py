"""What every study makes of its published table: rows, figures, verdicts."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.lab.storage import table_bytes
from workbench.measures.verdicts import RULINGS
from workbench.plots.style import style
from workbench.studies import decide, draw
from workbench.studies.published import formation, load_study, per_robot
from workbench.studies.tables import STUDIES

WIDE = json.loads((Path(__file__).parents[1] / "data" / "wide_tables.json").read_text())
PLOTS = [(name, plot) for name, study in STUDIES.items() for plot in study.plots]
CLAIMS = [(name, claim) for name, study in STUDIES.items() for claim in study.verdicts]


def _wide(study, table, labels):
    """Return a table as it was before numbers of robots and levels became rows: a line a trial."""
    rows = study.rows
    lines = []
    for label, trial in table.groupby(labels, sort=False, dropna=False):
        line = dict(zip(labels, label, strict=True))
        for row in trial.to_dict("records"):
            level = tuple(row[column] for column in rows.columns)
            pattern = rows.names.get(level)
            for name, value in row.items():
                if name in labels or name in rows.columns:
                    continue
                if pattern is not None:
                    line[pattern.format(name.removeprefix(rows.prefix))] = value
                elif not pd.isna(value) or name not in line:
                    line[name] = value
        lines.append(line)
    return pd.DataFrame(lines)


@pytest.mark.parametrize("name", WIDE)
def test_rows_of_robots_and_levels_hold_what_columns_held_before(name):
    before = WIDE[name]
    wide = _wide(STUDIES[name], load_study(name), before["labels"])
    for column in before["columns"]:
        if column not in wide:  # a number that no trial has
            wide[column] = np.nan
    content = table_bytes(wide[before["columns"]], digits=10)
    assert hashlib.sha256(content).hexdigest() == before["sha256"]


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
    with pytest.raises(ValueError, match="study 'iner'; expected one of actions, buffer"):
        draw("iner", "inner_cell")


def test_formations_and_robots_are_taken_apart_in_the_same_order():
    table = load_study("stability")
    whole = formation(table)
    each = per_robot(table, "learning_losses")
    assert list(each.columns) == [1, 2, 3, 4] and len(each) == len(whole) == 60
    np.testing.assert_array_equal(each.sum(axis=1), whole["learning_losses"])
