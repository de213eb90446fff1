"""Simulated ranging campaigns in memory, made once for all tests."""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import xarray as xr

from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre.model import OBSERVABLES
from gravcal.simulation import kbr_phase_centre as simulation
from tasks import kbr_phase_centre as stages

DAY = 652968000.0  # 2020-09-10 00:00:00 GPS
NOMINAL = tuple(tuple(catalog.satellite(letter).com_to_antenna.value) for letter in "CD")
NOISELESS = dict.fromkeys(("ranging_noise_m", "orbit_error_m", "orbit_red_m", "noise_scale", "ranging_corner_hz"), 0.0)
NOISELESS |= {"phase_breaks": 0}
BENIGN = {"phase_step_s": 1.0, "noise": "benign"}
STILL = (("pointing_rad", 0.0), ("pointing_mean_rad", 0.0), ("phase_centre_scatter_mm", 0.0))


@lru_cache(maxsize=4)
def simulated(seed=1, settings=(), noiseless=False, effects=()):
    """Columns and truth; `settings` and `effects` as tuples of pairs."""
    chosen = catalog.parameters("simulate_kbr_phase_centre").with_settings(BENIGN | dict(settings))
    if noiseless:
        chosen = chosen.with_settings(NOISELESS)
    return simulation.simulate("CD", chosen, DAY, seed, {slug: dict(given) for slug, given in effects})


def ingested(columns):
    """Columns of a simulation as the readers would return the files, {(product, letter): Dataset}."""
    found = {}
    for (product, letter), values in columns.items():
        second = np.asarray(values["gps_time"])
        blank = np.zeros(second.size, dtype=np.uint8)
        record = {"qualflg": blank, "flag": blank} | dict(values)
        record |= {"time_second": second, "time_fraction": np.zeros(second.size), "time_tag": second.astype(float)}
        attrs = {"product": product, "satellite": letter, "file": f"{product} of {letter}"}
        found[product, letter] = xr.Dataset({n: ("record", v) for n, v in record.items()}, attrs=attrs)
    return found


def process(columns, orbit="GNI1B", names=OBSERVABLES, **settings):
    """Products of one campaign; all of them are combined."""
    chosen = catalog.parameters("kbr_phase_centre").with_settings(settings)
    observed = ingested(columns)
    files = [("KBR1B", "Y"), (orbit, "C"), (orbit, "D"), ("SCA1B", "C"), ("SCA1B", "D")]
    aligned = stages.align(*(observed[name] for name in files), **chosen.for_stage("align"))
    pointed = stages.pointing(aligned, **chosen.for_stage("pointing"), nominal_m=NOMINAL, given=())
    given = chosen.for_stage("observable") | {"nominal_m": NOMINAL}
    equations = [stages.observable(aligned, pointed, variant=name, **given) for name in names]
    quiet = stages.noise(equations[0], **chosen.for_stage("noise"))
    given = chosen.for_stage("solve") | {"nominal_m": NOMINAL}
    solved = [stages.solve(e, quiet, variant=name, **given) for name, e in zip(names, equations, strict=True)]
    combined = stages.combine(*solved, **chosen.for_stage("combine")) if names == OBSERVABLES else None
    return SimpleNamespace(
        aligned=aligned, pointed=pointed, equations=equations, noise=quiet, solved=solved, combined=combined
    )


def drawn(seed, **settings):
    """One campaign, not kept: truth (6,) mm and products."""
    columns, truth = simulated.__wrapped__(seed, tuple(settings.items()))
    return true_mm(truth), process(columns)


@lru_cache(maxsize=2)
def campaign(seed=1):
    """One campaign with benign noise: truth (6,) mm and products."""
    return drawn(seed)


def true_mm(truth):
    """Phase centres of both satellites, (6,) mm."""
    return np.concatenate([truth["phase_centre_mm"][letter] for letter in "CD"])


def sigma_mm(combined, subset=0, estimator=0):
    """Standard deviations (observable, 6) mm."""
    return 1e3 * np.sqrt(np.diagonal(combined["covariance"].values[:, subset, estimator], axis1=-2, axis2=-1))
