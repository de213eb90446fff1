"""Figures of a discovery: measured and simulated readings, residuals."""

import numpy as np
import xarray as xr

from gravcal.report import discovery_figures


def found(axes=3, parts=("measured", "baseline", "extended"), **attrs):
    """Product with a linear reading of some nm s-2, 200 samples of one manoeuvre."""
    time = 6e8 + np.arange(200.0)
    wave = 1e-9 * np.sin(time / 9)[:, None] * np.ones(axes)
    values = {"measured": wave, "baseline": 0.8 * wave, "extended": wave - 1e-12}
    channel, unit = ("linear", "m s-2") if axes == 3 else ("range", "m")
    data = {f"{channel}_{p}": (("time_reading", "axis"), values[p], {"units": unit}) for p in parts}
    data |= {"time_row": ("row", np.repeat([5e8, 6e8], 200) + np.tile(np.arange(200.0), 2))}
    data |= {"block": ("row", np.repeat([0, 1], 200)), "channel": ("row", np.zeros(400, dtype=int))}
    coords = {"time_reading": time}
    return xr.Dataset(data, coords, attrs={"blocks": "manoeuvre 1, manoeuvre 2", "channels": channel} | attrs)


def labels(figure):
    """Labels of the panels and names of the curves."""
    panels = figure.axes
    return [panel.get_ylabel() for panel in panels], {line.get_label() for panel in panels for line in panel.lines}


def test_every_axis_has_its_reading_and_its_difference():
    """Contract: two panels an axis in units with a prefix that suits each, the manoeuvre named."""
    figure = discovery_figures.readings(found())
    names, curves = labels(figure)
    assert names == [f"{delta}{axis} (nm s-2)" for axis in "xyz" for delta in ("", "Δ")]
    assert curves == {"measured", "baseline", "extended model"}
    assert figure.axes[0].get_title() == "linear, manoeuvre 2"


def test_a_range_has_one_axis():
    """Contract: the channel's own name beside the scale."""
    assert labels(discovery_figures.readings(found(axes=1)))[0] == ["range (nm)", "Δrange (nm)"]


def test_without_findings_only_the_baseline_is_drawn():
    """Contract: no curve of an extended model that does not exist."""
    product = found(parts=("measured", "baseline"))
    assert "extended model" not in labels(discovery_figures.readings(product))[1]
    assert "least likely band" in discovery_figures.caption(product, {})


def test_a_product_without_readings_has_no_figure():
    """Contract: clean data, nothing drawn."""
    assert discovery_figures.readings(found(parts=())) is None


def test_the_caption_says_what_the_reading_is():
    """Contract: reference of the reading, and whether it was put together again."""
    caption = discovery_figures.caption(found(), {"linear": " It is low-passed."})
    assert "low-passed" in caption
    assert "linear form" not in caption
    assert "mean is left out" in discovery_figures.caption(found(), {})
    assert "linear form" in discovery_figures.caption(found(rebuilt="yes"), {})


def series(count):
    """Product with one block of `count` rows on the first axis, four sigma of signal before the extension."""
    values = {"time_row": np.arange(count, dtype=float), "residual_before": np.full(count, 4.0)}
    values |= {"residual_after": np.zeros(count), "channel": np.zeros(count, dtype=int)}
    values |= {"block": np.zeros(count, dtype=int), "component": np.zeros(count, dtype=int)}
    data = {name: ("row", column) for name, column in values.items()}
    return xr.Dataset(data, attrs={"channels": "timing", "blocks": "timing"})


def test_a_handful_of_edge_times_is_no_curve():
    """Contract: eight edge times give no figure, a series on one axis gives one with that axis alone."""
    assert discovery_figures.residuals(series(8)) is None
    figure = discovery_figures.residuals(series(200))
    assert len(figure.axes) == 1
    assert [line.get_label() for line in figure.axes[0].lines] == ["baseline", "extended model"]
