"""The CRN filter: one operator for data and columns."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.estimation import crn

CRN = crn.Crn()


def test_the_filter_passes_the_wiggle_and_its_derivatives_at_either_rate():
    """Analytic: gain one at the normalising frequency, within 1e-8 at 4 and 8 mHz, nil from 0.2 Hz on.

    The derivative of a wave is its frequency times the wave; a filter sampled at 1 Hz differs by images alone.
    """
    assert_allclose(crn.gain(CRN, 0.1, 0, np.array([0.37e-3, 4e-3, 8e-3])), 1.0, atol=1e-8)
    assert np.abs(crn.gain(CRN, 0.1, 0, np.linspace(0.2, 4.9, 200))).max() < 2e-5  # stop band
    f = np.array([4e-3, 8e-3, 0.05])
    lowpass = crn.gain(CRN, 0.1, 0, f)
    assert_allclose(crn.gain(CRN, 0.1, 1, f), 2 * np.pi * f * lowpass, rtol=1e-9)
    assert_allclose(crn.gain(CRN, 0.1, 2, f), -((2 * np.pi * f) ** 2) * lowpass, rtol=1e-6)
    f = np.linspace(0, 0.3, 61)
    for derivative in range(3):
        fine, coarse = (crn.gain(CRN, step, derivative, f) for step in (0.1, 1.0))
        assert_allclose(coarse, fine, atol=1e-8)


def test_a_parabola_keeps_its_slope_and_a_bad_sample_spoils_its_window():
    """Analytic: t^2 goes to 2 t and 2, a constant to nothing; the window reaches 35 s, off the grid is no value."""
    time = np.arange(0.0, 400.0)
    at = np.array([100.0, 200.0])
    columns = np.column_stack([time**2, np.full(time.size, 2e5)])
    slope, bend = (crn.operator(CRN, d, np.ones(400, bool), (0.0, 1.0), at)(columns) for d in (1, 2))
    assert_allclose(slope, np.column_stack([2 * at, 0 * at]), rtol=1e-9, atol=1e-8)
    assert_allclose(bend, [[2, 0], [2, 0]], atol=1e-6)  # rounding of 4e4 and 2e5
    good = np.ones(400, bool)
    good[200] = False
    through = crn.operator(CRN, 0, good, (0.0, 1.0), np.array([20.0, 36.0, 164.0, 165.0, 235.0, 236.0, 300.5]))
    assert through.valid.tolist() == [False, True, True, False, False, True, False]
