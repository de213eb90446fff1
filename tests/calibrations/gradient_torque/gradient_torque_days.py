"""Invented days of S-GRS for the tests, without files."""

import functools

import numpy as np
import xarray as xr

from gravcal import catalog
from gravcal.calibrations.gradient_torque import estimate, model
from gravcal.io import daily, icgem
from gravcal.simulation import by_slug
from gravcal.simulation import gradient_torque as simulation

SATELLITE = catalog.satellite("S").settings()
FIELD = icgem.read_field(icgem.shipped(), 20)
STORED = model.field(FIELD)
DAY = 633830400.0
SHORT = {"duration_s": 7200, "step_s": 5, "field_degree": 20}


def observed(columns):
    """Dataset as the reader of SGRS files gives it."""
    known = {name: (dims, columns[name]) for name, (dims, _, _) in daily.LAYOUTS["SGRS"].items()}
    return xr.Dataset(known, {"time": columns["time"]})


def fly(seed, effects=None, nongravitational=None, **settings):
    """Columns and truth of an invented record."""
    chosen = catalog.parameters("simulate_gradient_torque").with_settings(SHORT | settings)
    return simulation.simulate(SATELLITE, chosen, FIELD, DAY, seed, by_slug(effects or {}), nongravitational)


def solve(columns, methods=estimate.VARIANTS, **settings):
    """Products gradient and drag, by the stages' own functions."""
    chosen = catalog.parameters("gradient_torque").with_settings({"field_degree": 20} | settings)
    modelled = model.gradient(observed(columns), STORED, satellite=SATELLITE, **chosen.for_stage("gradient"))
    given = {"satellite": SATELLITE, **chosen.for_stage("drag")}
    return modelled, {name: estimate.drag(modelled, variant=name, **given) for name in methods}


@functools.cache
def solved_day():
    """Columns, truth and products of one record, by all methods."""
    columns, truth = fly(1)
    return columns, truth, *solve(columns)


def ratio(found, truth, total=False):
    """Errors over standard deviations, (n, 3)."""
    covariance = found["covariance_total" if total else "covariance"].values
    return (found["drag_b"].values - truth["drag"]) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
