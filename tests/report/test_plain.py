"""Plain values and their plain."""

import numpy as np
import pytest

from gravcal.report import plain


def test_what_is_not_finite_becomes_null():
    """Contract: NaN and infinity never reach a document."""
    assert plain.numbers([[1.0, np.nan], [np.inf, -2.0]]) == [[1.0, None], [None, -2.0]]
    assert plain.as_plain({"a": (np.float64("nan"), np.int64(3), np.bool_(True))}) == {"a": [None, 3, True]}


def test_value_and_error_are_null_together():
    """Contract: a value without error is not determined."""
    assert plain.estimate([1.0, 2.0], [0.1, np.nan]) == {"value": [1.0, None], "sigma": [0.1, None]}


def test_no_degree_of_freedom_is_no_test():
    """Contract: null, dof 0."""
    assert plain.chi_square_test(0.0, 0) == {"chi2": None, "dof": 0, "p": None}


def test_gps_seconds_read_as_a_date():
    """Published: the epoch is 2000-01-01 12:00:00."""
    assert plain.gps_text(0) == "2000-01-01 12:00:00"
    assert plain.gps_text(633787200.25, 2) == "2020-02-01 00:00:00.25"


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ((107.24, 2.34, None), "107.2 ± 2.3"),
        ((-38.834, 0.478, 3.93), "−38.83 ± 0.48 (3.93)"),
        ((12.3651, 0.0812, None), "12.365 ± 0.081"),
        ((None, None, None), "–"),
        ((-0.01, 1.0, None), "0.0 ± 1.0"),
    ],
)
def test_numbers_show_the_digits_of_their_error(given, text):
    """Contract: two digits of the error, a true minus, no negative zero."""
    assert plain.plus_minus(*given) == text


@pytest.mark.parametrize(("p", "text"), [(0.546, "0.55"), (0.0123, "0.012"), (1e-9, "< 0.001"), (None, "–")])
def test_probabilities_are_short(p, text):
    """Contract: no exponents in a table."""
    assert plain.probability(p) == text
