"""The interface for scientists: estimators on plain arrays, products of an event as a tree."""

import doctest
import importlib

import numpy as np
import pytest
import seeds
from numpy.testing import assert_allclose

import gravcal
from gravcal import com_offset, gradient_torque, inertial_sensor, kbr_phase_centre
from gravcal.errors import EstimationError, ProductError
from gravcal.estimation.estimate import estimate, together
from gravcal.estimation.least_squares import polynomial
from gravcal.estimation.noise import coloured, fit_noise
from gravcal.physics.sensing import offset_tensor

DOCUMENTED = (
    *(f"gravcal.calibrations.{one}.estimate" for one in ("com_offset", "kbr_phase_centre", "inertial_sensor")),
    *("gravcal.calibrations.magnetometer.estimate", "gravcal.calibrations.gradient_torque.model"),
)


@pytest.mark.parametrize("name", DOCUMENTED)
def test_examples_of_the_docstrings_hold(name):
    """Contract: what a reader copies works."""
    tried = doctest.testmod(importlib.import_module(name))
    assert tried.attempted
    assert not tried.failed


def test_the_package_leads_to_its_interface():
    """Contract: `help(gravcal)` names it, completion shows it, what is not there is an AttributeError."""
    for name in ("open", "com_offset", "magnetometer", "physics", "effects", "catalog"):
        assert name in gravcal.__doc__
        assert name in dir(gravcal)
    assert gravcal.com_offset is com_offset
    with pytest.raises(AttributeError, match="nothing"):
        getattr(gravcal, "nothing")  # noqa: B009 - a plain attribute would be a useless expression


def manoeuvre(rng, offset, noise_size=1e-10):
    """Arguments of com_offset.estimate for an invented manoeuvre: red noise, measured beside it."""
    time = 0.1 * np.arange(1800)
    phase = 2 * np.pi * time / 12 + rng.uniform(0, 6, (3, 1))
    rate_dot = 3e-6 * np.sin(phase * np.array([[1], [1], [2]])).T
    rate, gradient = np.cumsum(rate_dot, axis=0) * 0.1, np.tile(np.diag([-1.2e-6, -1.2e-6, 2.4e-6]), (1800, 1, 1))
    reading = -offset_tensor(rate, rate_dot, gradient) @ offset + 1e-7 * np.sin(time[:, None] / 300)
    noise = []
    for axis in range(3):
        whole = coloured(lambda f: noise_size**2 * (1 + 0.01 / np.maximum(f, 1e-3)), 8000, 0.1, rng)  # of order 8
        reading[:, axis] += whole[:1800]
        noise.append(fit_noise([whole[2000:]], 8, 0.1))
    return rate, rate_dot, gradient, reading, time, noise


def test_errors_over_sigma_are_those_of_chance():
    """Recovery: 30 manoeuvres in red noise; chi-square of the errors within its interval at 1e-4."""
    rng, offset, total, fit = seeds.generator("api", 2e-4), np.array([80e-6, -30e-6, 50e-6]), 0.0, []
    for _ in range(30):
        found = com_offset.estimate(*manoeuvre(rng, offset))
        error = found.value - offset
        total += error @ np.linalg.solve(found.covariance, error)
        fit.append(found.chi2 / found.dof)
    assert 45 < total < 150  # chi-square of 90 degrees of freedom, 5e-5 at either end, noise models known to 3 %
    assert 0.92 < np.mean(fit) < 1.08


def test_manoeuvres_together_are_one_least_squares():
    """Analytic: normal equations add up; the chi-square holds the disagreement."""
    rng, offset = seeds.generator("together", 0), np.array([80e-6, -30e-6, 50e-6])
    parts = [com_offset.estimate(*manoeuvre(rng, offset)) for _ in range(3)]
    whole = together(*parts)
    weights = [np.linalg.inv(one.covariance) for one in parts]
    expected = np.linalg.solve(sum(weights), sum(w @ one.value for w, one in zip(weights, parts, strict=True)))
    assert_allclose(whole.value, expected, rtol=1e-6)
    assert whole.dof == sum(one.dof for one in parts) + 6
    assert whole.chi2 > sum(one.chi2 for one in parts)
    assert "chi2" in str(whole)
    assert_allclose(whole.scaled(-1e6, "um").sigma, 1e6 * whole.sigma)


def test_what_is_not_determined_or_missing_is_no_number_and_has_no_weight():
    """Contract: nothing of what lies along a single turn; NaN is left out; wrong shape and short records are errors."""
    rng = seeds.generator("undetermined", 0)
    time, zero = 0.1 * np.arange(600), np.zeros((600, 3))
    rate_dot = np.stack([1e-6 * np.sin(time), 0 * time, 0 * time], axis=1)
    noise = [fit_noise([1e-10 * rng.standard_normal(2000)], 1, 0.1)] * 3
    found = com_offset.estimate(zero, rate_dot, np.zeros((600, 3, 3)), zero, time, noise)
    assert np.isnan(found.value).tolist() == np.isnan(found.sigma).tolist() == [True, False, False]
    assert "not determined" in str(found)
    assert found.dof == 3 * (600 - 6) - 2
    given = list(manoeuvre(rng, np.zeros(3)))
    given[3][500:700] = np.nan
    assert com_offset.estimate(*given).dof == 3 * (1600 - 6) - 3
    with pytest.raises(EstimationError, match="expected"):
        estimate(given[3], np.zeros((1800, 3, 2)), given[5], polynomial(given[4], 1, 0, 180), ("x",), "m")
    with pytest.raises(EstimationError, match="longer record"):
        com_offset.estimate(*(one[:5] for one in given[:5]), given[5])


def test_the_other_estimators_take_what_the_equations_say():
    """Analytic: without noise each returns the truth; signs as the conventions of the package say."""
    rng = seeds.generator("others", 0)
    time = 0.1 * np.arange(2000)
    small = [fit_noise([1e-15 * rng.standard_normal(2000)], 1, 0.1)] * 3
    rate, rate_dot = 1e-4 * np.sin(time[:, None] * [0.3, 0.5, 0.7]), 1e-4 * np.cos(time[:, None] * [0.2, 0.4, 0.3])
    gradient = np.tile(np.diag([-1e-6, -1e-6, 2e-6]), (2000, 1, 1))
    place, scale = np.array([-140e-6, 628e-6, -896e-6]), np.array([5.4e-4, 2.7e-4, 1.1e-4])
    volt = offset_tensor(rate, rate_dot, gradient) @ place / scale + 0.2
    found = inertial_sensor.estimate(rate, rate_dot, gradient, volt, time, small, scale)
    assert_allclose(found.value, place, atol=1e-12)
    angle = 0.03 * np.sin(time / 9)
    line = np.stack([np.cos(angle), np.sin(angle), 0.01 * np.cos(time / 11)], axis=1)
    both = np.stack([line, line[::-1] * [1, -1, 1]], axis=1)
    centres = np.array([[1.444, 1e-3, -2e-3], [1.445, -1e-3, 3e-3]])
    for bias, close in ((0.0, 1e-7), (2e7, 1e-4)):  # that of a range is of any size
        found = kbr_phase_centre.estimate(both, bias - np.einsum("nka,ka->n", both, centres), time, small[0], 1)
        assert_allclose(found.value, centres.ravel(), atol=close)
    linear = gradient[:, None] @ np.array([0.1, 0.0, 0.0]) - np.array([1e-7, 2e-8, 0.0])
    drag = gradient_torque.drag(linear, 0 * rate, 0 * rate, gradient, np.array([[0.1, 0.0, 0.0]]))
    assert_allclose(drag, np.tile([1e-7, 2e-8, 0.0], (2000, 1)), atol=1e-20)


def test_products_of_an_event_open_as_a_tree(pipeline):
    """Contract: a node a product, with its provenance and a view for notebooks; an event without products says so."""
    pipeline.run()
    tree = gravcal.open("fake-1")
    assert tree[f"{pipeline.name}/start"]["value"].size
    assert tree[f"{pipeline.name}/start"].attrs["key"]
    assert "xarray" in tree._repr_html_()
    with pytest.raises(ProductError, match="those of a run"):
        gravcal.open("no-such-event")
