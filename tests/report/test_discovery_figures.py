"""Figures of a discovery."""

import numpy as np
import xarray as xr

from gravcal.report import discovery_figures


def found(count):
    """Product with one block of `count` rows on the first axis, four sigma of signal before the extension."""
    values = {"time_row": np.arange(count, dtype=float), "residual_before": np.full(count, 4.0)}
    values |= {"residual_after": np.zeros(count), "channel": np.zeros(count, dtype=int)}
    values |= {"block": np.zeros(count, dtype=int), "component": np.zeros(count, dtype=int)}
    data = {name: ("row", column) for name, column in values.items()}
    return xr.Dataset(data, attrs={"channels": "timing", "blocks": "timing"})


def test_a_handful_of_edge_times_is_no_curve():
    """Contract: eight edge times give no figure, a series on one axis gives one with that axis alone."""
    assert discovery_figures.residuals(found(8)) is None
    figure = discovery_figures.residuals(found(200))
    assert len(figure.axes) == 1
    assert [line.get_label() for line in figure.axes[0].lines] == ["baseline", "extended model"]
