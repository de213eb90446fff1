"""Results for the terminal."""

import invented
import pytest

from gravcal.report.com_offset_text import TRUTH_HEADS, summary, truth_table

TRUTH = {"direction": "proof_mass_to_com", "offset_um": [107.2, 3.4, -12.4]}


def test_estimates_stand_beside_the_truth(document):
    """Analytic: y of mtq is 0.3 um off, one sigma."""
    rows = truth_table(document, TRUTH)
    assert len(rows) == 12
    assert all(len(row) == len(TRUTH_HEADS) for row in rows)
    assert rows[1] == ["mtq", "y", "3.70", "0.30", "3.40", "+1.00"]


def test_an_undetermined_component_has_no_ratio(products, documented):
    """Contract: never a number for what is not determined."""
    document = documented(products | {"combine": invented.combine(3, undetermined=(2,))})
    assert truth_table(document, TRUTH)[2] == ["mtq", "z", "not determined", "", "-12.40", ""]


def test_a_truth_of_the_other_direction_is_refused(document):
    """Contract: signs are never guessed."""
    with pytest.raises(ValueError, match="com_to_proof_mass"):
        truth_table(document, TRUTH | {"direction": "com_to_proof_mass"})


def test_the_summary_fits_a_terminal(document, quiet_document):
    """Contract: plain ASCII lines of at most 100 signs with verdict, offsets and delays."""
    for text in (summary(document), summary(quiet_document)):
        assert text.isascii()
        assert max(len(line) for line in text.splitlines()) <= 100
    assert "*acc_calibrated" in summary(document)
    assert "sca not determined" in summary(document)
    assert "expected 0.0028" in summary(quiet_document)
