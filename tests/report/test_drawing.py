"""Drawings of the reports: places, thinning, scales."""

import re

import numpy as np
import pytest

from gravcal.report import drawing, drawing_frame
from gravcal.report.drawing import Look, Panel

PANEL = Panel((0, 0, 100, 50), (0.0, 10.0), (-1.0, 1.0))
BLACK = Look("#000000")


def points(path):
    """Absolute points (n, 2) of every piece of a path of whole numbers."""
    pieces = re.findall(r"M(-?\d+) (-?\d+)l([-\d ]+)", path)
    return [
        np.cumsum([[int(x), int(y)], *np.reshape(rest.split(), (-1, 2)).astype(int)], axis=0) for x, y, rest in pieces
    ]


def test_a_line_runs_from_corner_to_corner():
    """Analytic: the lower left corner is (0, height), the upper right (width, 0), ten steps a unit."""
    (found,) = points(drawing.line(PANEL, [0, 5, 10], [-1, 0, 1], BLACK))
    assert found.tolist() == [[0, 500], [500, 250], [1000, 0]]


def test_a_logarithmic_panel_places_by_powers():
    """Analytic: a decade is the same length everywhere."""
    panel = Panel((0, 0, 100, 50), (0.01, 1.0), (1e-10, 1e-8), log=True)
    (found,) = points(drawing.line(panel, [0.01, 0.1, 1.0], [1e-10, 1e-9, 1e-8], BLACK))
    assert found.tolist() == [[0, 500], [500, 250], [1000, 0]]


def test_a_missing_value_breaks_a_line():
    """Analytic: three pieces; nothing bridges what is not known."""
    found = points(drawing.line(PANEL, np.arange(7.0), [0, 0, np.nan, 0, np.nan, 0, 0], BLACK))
    assert [len(one) for one in found] == [2, 2, 2]


def test_thinning_keeps_every_peak():
    """Analytic: of a long noisy series the lowest and highest of each unit stay."""
    x = np.linspace(0, 10, 100_000)
    y = np.zeros(x.size)
    y[54_321], y[65_432] = 0.9, -0.8
    (found,) = points(drawing.line(PANEL, x, y, BLACK))
    assert len(found) < 1000
    assert found[:, 1].min() == 25
    assert found[:, 1].max() == 450


def test_steps_hold_their_value_to_the_next():
    """Analytic: no slope between two values."""
    (found,) = points(drawing.steps(PANEL, [0, 1, 2, 3], [0.0, 0.0, 1.0, 1.0], BLACK))
    assert found.tolist() == [[0, 250], [200, 250], [200, 0], [300, 0]]


@pytest.mark.parametrize(
    ("low", "high", "count", "texts"),
    [
        (-121, 121, 2, ["−100", "0", "100"]),
        (0.0, 1.0, 4, ["0.00", "0.25", "0.50", "0.75", "1.00"]),
        (-3.1e-7, 2.9e-7, 3, ["−0.0000002", "0.0000000", "0.0000002"]),
        (99.9, 100.1, 2, ["99.9", "100.0", "100.1"]),
    ],
)
def test_scales_have_round_numbers(low, high, count, texts):
    """Analytic: steps of 1, 2, 2.5 or 5 times a power of ten, as many digits as they need."""
    assert list(drawing_frame.round_numbers(low, high, count).values()) == texts


def test_powers_of_ten_are_written_as_such():
    """Analytic: raised exponents where plain numbers are long."""
    assert list(drawing_frame.decades(3e-10, 2e-8).values()) == ["10⁻⁹", "10⁻⁸"]
    assert list(drawing_frame.decades(0.005, 1.0).values()) == ["0.01", "0.1", "1"]


def test_a_series_without_values_draws_nothing():
    """Contract: no path, and limits all the same."""
    nothing = np.full(3, np.nan)
    assert drawing.line(PANEL, np.arange(3.0), nothing, BLACK) == ""
    assert drawing.dots(PANEL, np.arange(3.0), nothing, Look("#000000", shape="circle")) == ""
    low, high = drawing.limits(nothing)
    assert high > low


def test_a_strip_stands_from_top_to_bottom():
    """Analytic: from 2 to 3 on a scale of 0 to 10 over 100 units is the third tenth of the fine grid."""
    panel = Panel((0, 0, 100, 50), (0.0, 10.0), (0.0, 1.0))
    text = drawing.strip(panel, 2.0, 3.0, "#000000", 0.5)
    assert 'x="200" y="0" width="100" height="500"' in text
