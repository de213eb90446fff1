"""The antenna correction of the ranging product: computed from phase centres, and phase centres from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.estimation import least_squares, robust


@dataclass(frozen=True)
class Recovered:
    """Phase centres behind a given antenna correction.

    Attributes
    ----------
    centre : (2, 3) m, centre of mass to phase centre, b
    sigma : (2, 3) m, if the misfit were white
    rms : m, of the misfit of the records that keep their weight
    kept : share of the records that do
    singular : (6,) 1, singular values of the columns over the root of the number of records
    """

    centre: np.ndarray
    sigma: np.ndarray
    rms: float
    kept: float
    singular: np.ndarray


def antenna_correction(line_of_sight_b: np.ndarray, centre_b: np.ndarray) -> np.ndarray:
    """Correction that turns the range of the phase centres into that of the centres of mass when added.

    Parameters
    ----------
    line_of_sight_b : (2, n, 3), from each satellite to the other
    centre_b : (2, 3) m, centre of mass to phase centre

    Returns
    -------
    correction : (n,) m

    Notes
    -----
    rho_AOC = e^T R_ib,A c_A - e^T R_ib,B c_B; Remote Sens. 2022, 14, 3395, eq. 11 (erratum K-1).
    """
    return np.einsum("kni,ki->n", line_of_sight_b, centre_b)


def recover(aligned: xr.Dataset, pointed: xr.Dataset, constants: tuple[float, float]) -> Recovered:
    """Phase centres from the antenna correction of a ranging file, without a free bias.

    Records whose correction was interpolated or is unreliable lose their weight.

    Parameters
    ----------
    aligned : Dataset, "kbr_phase_centre.align"
    pointed : Dataset, "kbr_phase_centre.pointing"
    constants : k0 and k1 of IGG-III
    """
    at, time = aligned["time_kbr"].values, pointed["time"].values
    inside = (at >= time[0]) & (at <= time[-1]) & np.isfinite(aligned["antenna_correction"].values)
    epoch = np.rint(at[inside] - time[0]).astype(int)
    design = np.concatenate(list(pointed["line_of_sight_b"].values[:, epoch]), axis=1)
    known = np.isfinite(design).all(axis=1)
    design, observed = design[known], aligned["antenna_correction"].values[inside][known]
    found = robust.solve(observed, design, constants, 6)
    left = observed - design @ found.value
    used = found.weight > 0
    sigma = np.sqrt(np.diag(least_squares.covariance(found.information)))
    singular = np.linalg.svd(design, compute_uv=False) / np.sqrt(len(design))
    centre, sigma = found.value.reshape(2, 3), sigma.reshape(2, 3)
    return Recovered(centre, sigma, float(np.std(left[used])), float(used.mean()), singular)
