"""Every verdict can fail: data that contradict a claim are read as "contradicted"."""

import numpy as np
import pandas as pd
import pytest

from workbench import paths
from workbench.studies import delays, transfer
from workbench.studies.published import load_study
from workbench.studies.replication import FILE, card, card_text, short_rows
from workbench.studies.tables import STUDIES


def _put(table, where=slice(None), **values):
    """Return a table with other values in some columns and rows."""
    other = table.copy()
    for name, value in values.items():
        other[name] = other[name].astype(float) if other[name].dtype.kind in "iu" else other[name]
        other.loc[where, name] = value
    return other


def _scaled(table, factor, *names, where=slice(None)):
    other = table.copy()
    for name in names:
        other[name] = other[name].astype(float)
        other.loc[where, name] = other.loc[where, name] * factor
    return other


def _e1(table):
    bad = _put(table, greedy_losses=5.0)
    return _put(bad, losses_per_hour_last_third=1e6)


def _e4(table):
    return table.assign(robot=5 - table["robot"])


def _e6(table):
    juddering = _put(table, table["robot"] == 1, judder_mm=30.0, excess=5.0)
    fresh = (table["robot"] == 1) & (table["updates"] == 0)
    return _put(juddering, fresh, excess=2.0)


def _e5(table):
    calm = _put(table, turn_rms_deg_s=1.0, ldlj_vector=-30.0)
    during = _put(calm, learning_turn_rms_deg_s=0.5, learning_ldlj_vector=-1.0)
    chance = np.random.default_rng(0).normal(size=len(table)) / 100
    return during.assign(turn_rms_deg_s=during["turn_rms_deg_s"] + chance)


def _e7(table):
    copies = table["weights"] == "copied"
    bad = _put(table, copies, losses=9.0)
    return _scaled(bad, 10.0, "rms_distance_error_mm", "rms_bearing_deg", where=copies)


def _e8(table):
    judging = table["world"] == "judging"
    return _scaled(_put(table, judging, losses=9.0), 10.0, "rms_distance_error_mm", where=judging)


def _e10(table):
    learner = table["controller"] == "learner"
    names = ["following_rms_distance_error_mm", "following_bearing_std_deg", "turn_rms_deg_s"]
    bad = _scaled(table, 50.0, *names, where=learner)
    return _put(bad, learner, following_losses=3.0, learning_losses=0.0)


def _e11(table):
    there = table["training"] == "there"
    bad = _put(table, there, learning_minutes_to_lossfree=0.0, judged_turn_rms_deg_s=0.0)
    return _put(bad, ~there, learning_minutes_to_lossfree=50.0)


def _e9(table):
    bad = _put(table, judged_losses=9.0, judged_share_inside=0.1)
    return _scaled(bad, 100.0, "judged_rms_distance_error_mm")


def _l6(table):
    on = table[table["buffer"] == "on"].set_index(["table", "seed"])["losses"]
    keys = pd.MultiIndex.from_frame(table[["table", "seed"]])
    off = on.loc[keys].to_numpy() - 50.0 + np.arange(len(table)) % 3
    return table.assign(losses=np.where(table["buffer"] == "off", off, table["losses"]))


def _n5(table):
    warped = table["world"].str.contains("distortion")
    bad = _put(table, warped, share_inside_last_third=0.1)
    return _scaled(bad, 9.0, "rms_distance_error_mm", "bearing_std_deg", where=warped)


def _s3(table):
    linear = table["world"] == "linear tiles"
    return _scaled(table, 0.01, "rms_distance_error_mm", "bearing_std_deg", where=linear)


def _x2(table):
    other = {"restart": "manoeuvre", "manoeuvre": "restart"}
    return table.assign(reset=table["reset"].map(other))


def _c1(table):
    own = table["setting"] == "recommended"
    return _put(
        table, own, rms_distance_error_mm=50.0, bearing_ripple_deg=9.0, losses=3.0, turning=90.0
    )


def _pattern(table):
    turned = table.assign(bearing_deg=-table["bearing_deg"], right=-2.0)
    return turned.assign(cell=0.1, block=0.2)


def _drives(table):
    rolling = table["drive"] == "rolling"
    names = [name for name in table.select_dtypes("number") if name != "seed"]
    return _scaled(table, 10.0, *names, where=rolling)


def _rivals(table):
    rows = table[table["rule"] == "greedy-gq"]
    return table[table["rule"].isin(["greedy-gq", "qrc"])] if rows.empty else table


def _f1(table):
    return _put(table, place_rms_mm=99.0, losses=5.0, contacts=2.0)


def _f2(table):
    return _put(table, place_rms_mm=99.0, losses=5.0, learning_losses=500.0)


def _heading(table):
    known = table["errors"] == "with the leader's heading"
    near = _put(table, learning_losses=100.0)
    return _put(near, known | (table["angle_deg"] == 90), learning_losses=40.0)


def _changes(table):
    return _put(table, changes_with_contact=9.0, changes_with_loss=9.0, median_reform_s=99.0)


CONTRADICTING = {
    ("recommended", "E1"): _e1,
    ("stability", "E4"): _e4,
    ("smoothness", "E5"): _e5,
    ("smoothness", "E6"): _e6,
    ("smoothness", "M3"): lambda table: _put(table, following_collisions=2.0),
    ("copies", "E7"): _e7,
    ("delays", "E8"): _e8,
    ("controllers", "E10"): _e10,
    ("transfer", "E9"): _e9,
    ("transfer", "E11"): _e11,
    ("buffer", "L6"): _l6,
    ("infrared-world", "N5"): _n5,
    ("infrared-world", "S3"): _s3,
    ("reset", "X2"): _x2,
    ("calm", "C1, C2"): _c1,
    ("pattern", "E2, E3"): _pattern,
    ("drives", "drives"): _drives,
    ("rivals", "rival learners"): _rivals,
    ("shapes", "F1"): _f1,
    ("shapes", "F2"): _f2,
    ("shapes", "F6, graphs"): _f2,
    ("set-point", "F2, why"): _heading,
    ("reform", "F1, changes"): _changes,
    ("range-bearing", "F1, heard"): lambda table: _put(table, share_in_place=0.5, losses=99.0),
}
CLAIMS = [(name, claim) for name, study in STUDIES.items() for claim in study.verdicts]


@pytest.mark.parametrize(("name", "claim"), CLAIMS)
def test_data_that_contradict_a_claim_are_read_as_that(name, claim, monkeypatch):
    if claim == "E8":  # which looks at weights as late as the worlds have them, too
        bad = _e9(load_study("transfer"))
        monkeypatch.setattr(delays, "load_study", lambda _: bad)
    if claim == "E9":  # and at real readings: no filter helps them
        worst = pd.read_csv(transfer.REAL).assign(share=0.5)
        right = transfer.in_the_right_tile

        def never(table):
            found = right(table)
            return found.assign(**{column: 0.5 for column in found.columns})

        assert len(worst)
        monkeypatch.setattr(transfer, "in_the_right_tile", never)
    table = CONTRADICTING[name, claim](load_study(name))
    found = STUDIES[name].verdicts[claim](table)
    assert found.ruling == "contradicted", str(found)
    assert found.fails


def test_the_replication_card_says_what_the_tables_say():
    table = card()
    assert FILE == paths.NOTEBOOKS / "REPLICATION.md"
    assert FILE.read_text(encoding="utf-8") == card_text()
    readme = (paths.ROOT / "README.md").read_text(encoding="utf-8")
    assert "\n".join(short_rows()) in readme
    assert len(table) == len(CLAIMS) and table["ident"].is_unique
    assert (table["n"] >= 10).all()
