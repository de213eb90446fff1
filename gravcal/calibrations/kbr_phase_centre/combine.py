"""The three observables together: what is determined, what the sub-sets say, which result is adopted."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build, replaced, widened
from gravcal.calibrations.kbr_phase_centre.schemas import COMBINE, MANOEUVRE, SUBSETS

STACKED = (
    *("centre", "covariance", "formal_sigma", "condition", "sigma0", "kept"),
    *("arc_value", "arc_sigma", "arcs_chi2", "arcs_dof"),
)


def combine(
    *solved: xr.Dataset,
    adopted_observable: str,
    adopted_estimator: str,
    determined_limit_mm: float,
    offset_deg: float,
) -> xr.Dataset:
    """Estimates of all observables beside each other.

    Parameters
    ----------
    solved : Dataset, "kbr_phase_centre.solve", one per observable
    adopted_observable, adopted_estimator : the result that goes into the vector files
    determined_limit_mm : mm, a component with a larger sigma is not determined
    offset_deg : deg, offset angle of the design, for the predicted shifts of one-sided sets

    Returns
    -------
    combined : Dataset, "kbr_phase_centre.combine"
    """
    values = {name: np.stack([one[name].values for one in solved]) for name in STACKED}
    values["determined"] = _determined(values["covariance"], determined_limit_mm)
    values["shift"] = values["centre"][:, :, 0] - values["centre"][:, :1, 0]
    values["predicted_shift"] = predicted_shift(values["shift"], np.radians(offset_deg))
    values |= {name: solved[0][name].values for name in MANOEUVRE}
    return build(
        COMBINE,
        values,
        title="Phase centres from all observables",
        adopted_observable=adopted_observable,
        adopted_estimator=adopted_estimator,
        observables=" ".join(one.attrs["observable"] for one in solved),
        **{n: solved[0].attrs[n] for n in ("satellites", "ranging", "method")},
    )


def with_model_error(combined: xr.Dataset, *moved: xr.Dataset, determined_limit_mm: float) -> xr.Dataset:
    """The same with covariances that hold the errors of the effects that were taken out of the records before.

    Parameters
    ----------
    combined : Dataset, "kbr_phase_centre.combine"
    moved : Dataset, "kbr_phase_centre.combine", one for each direction of the model's errors
    determined_limit_mm : mm, a component with a larger sigma is not determined

    Returns
    -------
    combined : Dataset, "kbr_phase_centre.combine"
    """
    new = widened(combined, moved, {"centre": ("covariance",)})
    known = _determined(new["covariance"], determined_limit_mm).astype("u1")
    return replaced(combined, new | {"determined": known})


def _determined(covariance, limit_mm):
    """Which parameters of least squares are known better than the limit (observable, subset, parameter)."""
    sigma = np.sqrt(np.diagonal(covariance[:, :, 0], axis1=-2, axis2=-1))
    return np.isfinite(sigma) & (sigma <= 1e-3 * limit_mm)


def predicted_shift(shift: np.ndarray, offset: float) -> np.ndarray:
    """Shift of y and z of a one-sided set that follows from the shift of its x.

    Parameters
    ----------
    shift : (..., subset, 6) m, sub-set minus all
    offset : rad, offset angle of the positive set

    Notes
    -----
    dY = +tan(theta0) dX and dZ = -tan(theta0) dX for the positive set, the other way for the mirror set: at first
    order in the amplitude x and the transverse component have proportional columns; Remote Sens. 2022, 14, 3395,
    Table 5 (erratum K-2).
    """
    result = np.full_like(shift, np.nan)
    for name, sign in (("positive", 1.0), ("mirror", -1.0)):
        row = SUBSETS.index(name)
        for first in (0, 3):
            x = shift[..., row, first]
            result[..., row, first + 1] = sign * np.tan(offset) * x
            result[..., row, first + 2] = -sign * np.tan(offset) * x
    return result
