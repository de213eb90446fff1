"""Error of the offset from that of the extended model whose effects were taken out of the records."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.methods.estimation import covariance_of_moves


def with_model_error(combined: xr.Dataset, *moved: xr.Dataset, determined_sigma_um: float) -> xr.Dataset:
    """Offsets whose covariances hold the errors of the effects that were taken out before.

    Single manoeuvres and the tests of consistency keep the errors of the noise alone.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    moved : Dataset, "com_offset.combine", one for each direction of the model's errors
    determined_sigma_um : um, a component with a larger error is not determined

    Returns
    -------
    widened : Dataset, "com_offset.combine"
    """
    before = combined["offset"].values
    extra = covariance_of_moves(before, [one["offset"].values for one in moved])
    widened = combined.copy(deep=True)
    for name in ("covariance", "covariance_total"):
        widened[name] = combined[name].copy(data=combined[name].values + extra)
    sigma = np.sqrt(np.diagonal(widened["covariance"].values, axis1=1, axis2=2))
    known = combined["determined"].values.astype(bool) & (sigma < determined_sigma_um * 1e-6)
    widened["determined"] = combined["determined"].copy(data=known.astype("u1"))
    widened["offset"] = combined["offset"].copy(data=np.where(known, before, np.nan))
    return widened
