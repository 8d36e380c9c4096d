"""Verdict boxes say what the evidence says."""

import pytest

from workbench.measures.verdicts import RULINGS, Verdict, no_worse, ruling, similar


def test_the_ruling_follows_from_the_parts_of_a_claim():
    assert ruling(True) == ruling(True, True) == "supported"
    assert ruling(True, False) == "mostly"
    # the claim's own main part decides on which side it falls
    assert ruling(False, True, True) == "mostly not"
    assert ruling(False) == ruling(False, False) == "contradicted"
    for untested in ((float("nan"),), ("not tested",), (True, None)):
        with pytest.raises(ValueError, match="True or False for the main part"):
            ruling(*untested)


def test_being_similar_is_a_matter_of_the_far_end():
    assert similar(-0.4, 0.5, 0.5) and not similar(-0.6, 0.1, 0.5)
    assert no_worse(0.5, 0.5) and not no_worse(0.51, 0.5)


@pytest.mark.parametrize("word", RULINGS)
def test_a_box_shows_claim_ruling_and_evidence_as_text_and_as_html(word):
    box = Verdict("E9", "5 < 6 & so on", word, "0.2 [0.1, 0.3], n = 10", "6 < 5", "5 < 5.5")
    assert str(box).splitlines() == [
        f"E9 · {word}",
        "claim: 5 < 6 & so on",
        "because: 0.2 [0.1, 0.3], n = 10",
        "would have failed: 6 < 5",
        "our bars: 5 < 5.5",
    ]
    page = box._repr_html_()
    assert "5 &lt; 6 &amp; so on" in page and word in page and "n = 10" in page
    assert "our bars" not in str(Verdict("E9", "", word, "", "never"))


def test_no_other_words_are_accepted():
    with pytest.raises(ValueError, match="ruling = 'proven'; expected one of 'supported'"):
        Verdict("E9", "", "proven", "", "")
