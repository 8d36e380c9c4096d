"""Verdict boxes say what the evidence says."""

import pytest

from workbench.measures.verdicts import RULINGS, Verdict, ruling


def test_the_ruling_follows_from_the_parts_of_a_claim():
    assert ruling(True, True) == "supported"
    assert ruling(True, False) == "supported under conditions"
    assert ruling(False) == ruling(False, False) == "not supported"
    for untested in ((), (float("nan"),), ("not tested",), (True, None)):
        with pytest.raises(ValueError, match="True or False for at least one part"):
            ruling(*untested)


@pytest.mark.parametrize("word", RULINGS)
def test_a_box_shows_claim_ruling_and_evidence_as_text_and_as_html(word):
    box = Verdict("E9", "5 < 6 & so on", word, "0.2 [0.1, 0.3], n = 10")
    assert str(box).splitlines() == [
        f"E9 · {word}",
        "claim: 5 < 6 & so on",
        "because: 0.2 [0.1, 0.3], n = 10",
    ]
    page = box._repr_html_()
    assert "5 &lt; 6 &amp; so on" in page and word in page and "n = 10" in page


def test_no_other_words_are_accepted():
    with pytest.raises(ValueError, match="ruling = 'proven'; expected one of 'supported'"):
        Verdict("E9", "", "proven", "")
