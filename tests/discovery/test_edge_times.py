"""Edge times as discovery sees them."""

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import responses


def edges(rng, count):
    """Product with edges that momentary samples 0.1 s apart show: anywhere between two of them."""
    shift = rng.normal(0, 0.01, count)
    between = rng.uniform(-0.05, 0.05, count)
    return xr.Dataset(
        {
            "acc_shift": ("arc", between),
            "sca_shift": ("arc", shift),
            "acc_shift_sigma": ("arc", np.full(count, 5e-4)),
            "sca_shift_sigma": ("arc", np.full(count, 0.01)),
            "acc_delay": ((), float(between.mean())),
            "acc_delay_sigma": ((), 0.037),
            "time_acc": ("sample", np.arange(50) * 0.1),
        }
    )


def test_an_edge_between_two_samples_is_no_delay():
    """Analytic: rows of momentary samples have the spread of their errors, chi-square 400 in 400 rows within 15 %."""
    rows = responses.edge_block(edges(np.random.default_rng(3), 400)).observed[:-1]
    assert abs(np.mean(rows**2) - 1) < 0.15


def test_a_delay_moves_every_row_by_the_same_time():
    """Analytic: the column of the accelerometer's delay is what a later tag does to the rows."""
    product = edges(np.random.default_rng(4), 7)
    late = product.assign(acc_shift=product["acc_shift"] + 0.2, acc_delay=product["acc_delay"] + 0.2)
    moved = responses.edge_block(late).observed - responses.edge_block(product).observed
    column = responses.edge_column("timing.accelerometer_delay", product, np.zeros(7))[:, 0]
    np.testing.assert_allclose(moved, 0.2 * column, rtol=1e-9)
