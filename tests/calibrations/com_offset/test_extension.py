"""Records less the effects of a model."""

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import responses
from gravcal.calibrations.com_offset.motion import _star_camera


def field_written_twice(count=6):
    """Field that is renewed once a second and written twice."""
    values = np.repeat(np.random.default_rng(1).normal(0, 2e-5, (count, 3)), 2, axis=0)
    time = np.arange(2 * count) * 0.5 + 0.083
    return xr.Dataset({"field_measured_b": (("time_mag", "axis"), values.copy())}, {"time_mag": time}), values


def test_a_field_that_is_written_twice_is_changed_twice():
    """Analytic: either record of a pair may be the one that is looked at; both lose the contribution, once."""
    for first in (0, 1):
        extended, before = field_written_twice()
        rows = np.arange(first, before.shape[0], 2)
        added = np.random.default_rng(2).normal(0, 1e-8, (rows.size, 3))
        responses.subtract_field(extended, extended["time_mag"].values[rows], added)
        np.testing.assert_allclose(
            before - extended["field_measured_b"].values, np.repeat(added, 2, axis=0), atol=1e-20
        )


def test_a_field_that_is_written_twice_turns_as_one():
    """Analytic: the angle grows from record to record, a repeated value takes the one of its first record."""
    _, values = field_written_twice()
    angle = np.arange(12)[:, None] * np.array([0.0, 0.0, 1e-4])
    turned = responses.rotated(angle, values)
    np.testing.assert_array_equal(turned[1::2], turned[::2])
    expected = values[::2] + np.cross(angle[::2], values[::2])
    np.testing.assert_allclose(turned[::2], expected, atol=2e-6 * np.abs(values).max())


def test_fields_that_are_all_different_are_changed_where_they_are_looked_at():
    """Analytic: records without repetition keep what is not looked at."""
    extended, _ = field_written_twice()
    values = extended["field_measured_b"].values
    values += np.arange(12)[:, None] * 1e-9
    before = values.copy()
    responses.subtract_field(extended, extended["time_mag"].values[::2], np.full((6, 3), 1e-8))
    np.testing.assert_allclose((before - values)[::2], 1e-8, rtol=1e-6)
    np.testing.assert_array_equal(before[1::2], values[1::2])


def test_the_star_camera_may_sample_anywhere_in_the_second():
    """Analytic: tags moved by a delay keep every sample, at its own time; a missing one is a gap, not a shift."""
    for delay in (0.0, 0.2789, -0.4, 0.5):
        time = np.delete(np.arange(0.0, 200.0), 50) - delay
        aligned = xr.Dataset(
            {
                "sca_flag": ("time_sca", np.zeros(time.size, dtype=int)),
                "quaternion": (("time_sca", "component"), np.tile([1.0, 0, 0, 0], (time.size, 1))),
            },
            {"time_sca": time},
        )
        grid, _, good = _star_camera(aligned, 10.2, 190.7)
        inside = time[(time > 10.2) & (time < 190.7)]
        assert good.sum() == inside.size
        assert grid.size == inside.size + 2
        np.testing.assert_allclose(grid[good], inside, atol=1e-9)
