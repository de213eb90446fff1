"""Series at the resolution of the screen, differences and spectra."""

import numpy as np
import pytest
import xarray as xr
from invented_store import TIME

from gravcal.browse import series
from gravcal.store import product


def series_of(x, y):
    """Return a series in memory."""
    return series.Series(np.asarray(x, float), np.asarray(y, float))


def written(path, x, values):
    """First column of a variable in a file."""
    product.write(xr.Dataset({"v": (("time", "axis"), values, {"units": "V"})}, {"time": ("time", x, TIME)}), path)
    coordinate, kind, _ = series.coordinate(path, series.listed(path)["v"])
    assert kind == "time"
    return series.series(path, "v", 0, coordinate)


def test_no_peak_is_lost_at_any_zoom(tmp_path):
    """Analytic: one sample of a million stands out and is drawn, from the whole series down to a few samples."""
    x, values = 7e8 + 0.1 * np.arange(1_000_000), np.zeros((1_000_000, 2))
    values[765_432, 0] = 5.0
    whole = written(tmp_path / "product.nc", x, values)
    for width in (None, 3e4, 1e3, 10.0, 0.5):
        ends = (None, None) if width is None else (x[765_432] - width / 2, x[765_432] + width / 2)
        drawn, y = series.view(whole, *ends)
        assert np.nanmax(y) == 5.0
        assert drawn.size <= 4 * series.BINS
        peak = drawn[np.nanargmax(y)]
        shown = (x[-1] - x[0]) if width is None else width
        assert abs(peak - x[765_432]) <= max(shown / series.BINS, 0.1) * 2  # s, one bin


def test_a_narrow_view_is_the_data_themselves(tmp_path):
    """Contract: fewer samples than the screen has places are drawn as they are, one more at each side."""
    x, rng = 7e8 + 0.1 * np.arange(200_000), np.random.default_rng(1)
    values = rng.standard_normal((200_000, 1))
    whole = written(tmp_path / "product.nc", x, values)
    assert series.samples(whole, x[1000], x[1100])[0].tolist() == x[1000:1101].tolist()  # of the CSV: none more
    drawn, y = series.view(whole, x[1000], x[1100])
    assert drawn.tolist() == x[999:1102].tolist()
    assert y.tolist() == values[999:1102, 0].tolist()


@pytest.mark.parametrize("count", [300, 40_000, 600_000])
def test_a_gap_is_not_bridged(count):
    """Contract: a NaN stands where the coordinate jumps."""
    x = np.concatenate([np.arange(count), 10.0 * count + np.arange(count)])
    drawn, y = series.view(series_of(x, np.ones(2 * count)))
    (gap,) = np.flatnonzero(np.isnan(y))
    assert drawn[gap - 1] < count <= 10 * count <= drawn[gap + 1]


def test_nan_is_left_out_of_a_range_and_gaps_are_noticed():
    """Contract: a bin of NaN alone is a gap; stretches of 2000 s at the ends of 40,000 s fill a tenth of it."""
    y = np.ones(100_000)
    y[::2] = np.nan
    y[50_000:60_000] = np.nan
    drawn, low = series.view(series_of(np.arange(100_000.0), y))
    assert np.isnan(low[(drawn > 50_200) & (drawn < 59_800)]).all()
    assert (low[(drawn < 49_800)] == 1).all()
    x = np.concatenate([np.arange(2000.0), 38000 + np.arange(2000.0)])
    assert series_of(x, x).filled() == pytest.approx(0.1, rel=0.01)
    assert series_of(x[:2000], x[:2000]).filled() == pytest.approx(1.0, rel=0.01)
    assert series_of(x[:3], x[:3]).filled() == 1.0


def test_difference_of_shifted_grids_interpolates():
    """Analytic: a line minus itself on another grid is zero; gaps are not bridged; without overlap there is none."""
    x, u = np.arange(0.0, 100.0, 1.0), np.arange(10.25, 60.0, 0.5)
    at, rest = series.difference(series_of(x, 3 * x), series_of(u, 3 * u))
    assert (at[0], at[-1]) == (11.0, 59.0)
    np.testing.assert_allclose(rest, 0, atol=1e-12)  # rounding
    holed = np.concatenate([u[:20], u[60:]])
    at, rest = series.difference(series_of(x, 3 * x), series_of(holed, 3 * holed))
    assert np.isnan(rest[(at > holed[19]) & (at < holed[20])]).all()
    assert series.difference(series_of(x, x), series_of(x + 1e6, x))[0].size == 0
    assert series.difference(series_of(x, x), series_of(x + 1e6, x), shift=-1e6)[0].size == 100


def test_spectrum_of_white_noise_is_its_density():
    """Analytic: white noise of variance s^2 at step dt has amplitude density s sqrt(2 dt)."""
    x, y = 0.5 * np.arange(200_000), 3.0 * np.random.default_rng(2).standard_normal(200_000)
    y[150_000] = np.nan
    frequency, density, said = series.spectrum(series_of(x, y))
    assert "Welch" in said
    assert frequency[-1] == pytest.approx(1.0)  # Hz, half the rate of 2 Hz
    assert np.sqrt(np.mean(density**2)) == pytest.approx(3.0 * np.sqrt(2 * 0.5), rel=0.02)  # 150,000 samples
