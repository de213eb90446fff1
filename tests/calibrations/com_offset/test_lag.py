"""First-order lag of the rods beside edges that are free, and edge times as discovery sees them."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad, solve_ivp

from gravcal.calibrations.com_offset import lag, responses
from gravcal.effects import torque
from gravcal.estimation.records import Entry

RNG_LEVEL = 1e-4  # a mean square of 1000 draws 0.9 +- 0.04 below 1.1, one of 400 within 15 %
EDGES = np.array([2.0, 8.0, 14.0, 20.0])
DIPOLE = np.array([[0.0, 3.0, 1.0], [0.5, -3.0, 1.0], [0.0, 3.0, 0.0]])


def commanded(t):
    """Dipole at an epoch, zero outside the edges."""
    k = np.searchsorted(EDGES, t, side="right") - 1
    return DIPOLE[k] if 0 <= k < len(DIPOLE) else np.zeros(3)


@pytest.mark.parametrize("tau", [0.05, 0.3, 1.6])
def test_a_lagging_rod_follows_its_equation(tau):
    """Analytic: tau dm/dt = m_commanded - m, integrated between the edges; edges a lead before the fitted ones."""
    lead, time = 0.4 * tau, np.arange(0.05, 25.0, 0.1)
    missing, _ = torque.lag_missing(EDGES, DIPOLE, tau)
    found = torque.lagging(time, EDGES + lead, DIPOLE, missing, tau, np.array([0.0, lead]))[:, :, 1]
    state, begin, expected = np.zeros(3), 0.0, []
    for end in [*EDGES, 26.0]:
        inside = time[(time >= begin) & (time < end)]
        held = commanded((begin + end) / 2)
        run = solve_ivp(lambda _, m: (held - m) / tau, (begin, end), state, dense_output=True, rtol=1e-11, atol=1e-13)  # noqa: B023
        expected += [run.sol(t) for t in inside]
        state, begin = run.y[:, -1], end
    np.testing.assert_allclose(found, expected, atol=1e-8)


@pytest.mark.parametrize("tau", [0.1, 0.8])
def test_twice_integrated_a_lag_is_a_later_edge_and_half_its_square(tau):
    """Analytic: quadrature of (t - s) times lagging less late dipole over s."""
    time = np.array([1.0, 2.3, 2.9, 5.0, 8.05, 9.4, 13.9, 19.0, 24.0])
    found = torque.lag_swing(EDGES, DIPOLE, tau, time, tau)  # edges fitted later by the lag
    missing, _ = torque.lag_missing(EDGES, DIPOLE, tau)

    def weighed(s, t, axis):
        lagging = torque.lagging(np.array([s]), EDGES, DIPOLE, missing, tau, np.zeros(1))[0, axis, 0]
        return (t - s) * (lagging - commanded(s - tau)[axis])

    for t, row in zip(time, found, strict=True):
        ends = [0.0, *(b for e in EDGES for b in (e, e + tau) if b < t), t]
        for axis in range(3):
            swung = sum(quad(weighed, a, b, args=(t, axis))[0] for a, b in pairwise(ends))
            assert abs(swung - row[axis]) < 1e-7


def test_an_entry_keeps_its_leads_by_manoeuvre():
    """Property: what a finding says of one manoeuvre is not taken for another's."""
    views = [SimpleNamespace(time=np.array([t, t + 1])) for t in (100.0, 700.0)]
    entry = Entry(lag.CAUSE, "", {}, leads=lag.leads(views, [0.1, 0.2]))
    assert [lag.known_lead(v, entry) for v in views] == [0.1, 0.2]
    elsewhere = SimpleNamespace(time=np.array([2000.0]))
    assert lag.known_lead(elsewhere, entry) is None


def test_the_part_of_a_sample_that_all_manoeuvres_share_is_in_the_error_of_a_late_star_camera(rng):
    """Commanded a whole number of samples apart, every edge falls on the same part of one; or on a part of its own."""
    sigma = {f"{name}_shift_sigma": ("manoeuvre", np.full(7, size)) for name, size in (("acc", 2e-4), ("sca", 0.012))}
    smoothed = xr.Dataset({"time_acc": np.arange(20) / 10, "acc_shift": ("manoeuvre", np.zeros(7)), **sigma})
    smoothed = smoothed.assign(acc_delay_sigma=0.07)
    column = responses.edge_column("timing.star_camera_delay", smoothed, np.arange(7.0))[:, 0]
    for part in (np.repeat(rng.uniform(-0.05, 0.05, (1000, 1)), 8, axis=1), rng.uniform(-0.05, 0.05, (1000, 8))):
        seen = part + rng.standard_normal((1000, 8)) * np.append(np.full(7, 0.012), 0.07)
        rows = lag.whitened_edges(smoothed, seen.T).T
        assert np.mean((rows @ column) ** 2) / (column @ column) < 1.1


def test_an_edge_between_two_samples_is_no_delay_and_a_delay_moves_every_row(rng):
    """Analytic: rows of momentary samples have the spread of their errors, 1 within 15 %; a column is a later tag."""
    shifts = {"acc_shift": ("arc", rng.uniform(-0.05, 0.05, 400)), "sca_shift": ("arc", rng.normal(0, 0.01, 400))}
    sigmas = {"acc_shift_sigma": ("arc", np.full(400, 5e-4)), "sca_shift_sigma": ("arc", np.full(400, 0.01))}
    product = xr.Dataset(shifts | sigmas | {"time_acc": ("sample", np.arange(50) * 0.1)})
    product = product.assign(acc_delay=float(shifts["acc_shift"][1].mean()), acc_delay_sigma=0.037)
    rows = responses.edge_block(product).observed
    assert abs(np.mean(rows[:-1] ** 2) - 1) < 0.15
    late = product.assign(acc_shift=product["acc_shift"] + 0.2, acc_delay=product["acc_delay"] + 0.2)
    column = responses.edge_column("timing.accelerometer_delay", product, np.zeros(400))[:, 0]
    np.testing.assert_allclose(responses.edge_block(late).observed - rows, 0.2 * column, rtol=1e-9)
