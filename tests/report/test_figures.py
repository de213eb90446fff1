"""Figures of the reports."""

import numpy as np

from gravcal.report.figures import thinned


def test_thinning_keeps_every_peak_and_every_gap():
    """Analytic: of a long series the lowest and highest of each group stay, in order; what is unknown stays unknown."""
    x, y = np.linspace(0, 10, 100_001), np.zeros(100_001)
    y[54_321], y[65_432], y[10_000:20_000] = 0.9, -0.8, np.nan
    across, values = thinned(x, y)
    assert across.size <= 802
    assert (np.diff(across) >= 0).all()
    assert (np.nanmax(values), np.nanmin(values)) == (0.9, -0.8)
    assert np.isnan(values[(across > 1.03) & (across < 1.97)]).all()
    assert np.isfinite(values[(across < 0.97) | (across > 2.03)]).all()
