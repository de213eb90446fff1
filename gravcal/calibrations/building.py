"""Datasets made from plain arrays by the schema of their kind, and results widened by the errors of a model."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from gravcal.estimation.least_squares import covariance_of_moves


def build(schema: Mapping[str, Mapping[str, str]], values: Mapping[str, object], **attrs) -> xr.Dataset:
    """Dataset of a kind from arrays of every variable of its schema that is not optional, and global attributes.

    A variable named like its dimension is a coordinate. A schema has "dims", "units", "frame", "long_name" and "dtype"
    of each variable.
    """
    labelled = {}
    for name, stated in schema.items():
        if name not in values and stated.get("optional"):
            continue
        dims = tuple(stated["dims"].split())
        label = {k: stated[k] for k in ("units", "frame", "long_name") if k in stated}
        array = np.asarray(values[name], dtype=stated.get("dtype", "f8"))
        if dims == (name,) and array.dtype.kind in "fiu":  # an index at once; the other paths import dask
            labelled[name] = xr.IndexVariable(dims, pd.Index(array), label, fastpath=True)
        else:
            labelled[name] = xr.Variable(dims, array, label, fastpath=True)
    coords = {name: entry for name, entry in labelled.items() if entry.dims == (name,)}
    data = {name: entry for name, entry in labelled.items() if name not in coords}
    return xr.Dataset(data, coords=coords, attrs={"time_scale": "GPS"} | attrs)


def replaced(dataset: xr.Dataset, values: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Copy of a dataset with other numbers, arrays of the same shape, in some of its variables."""
    return dataset.copy(deep=True).assign({name: dataset[name].copy(data=array) for name, array in values.items()})


def widened(
    found: xr.Dataset, moved: Sequence[xr.Dataset], covariances: Mapping[str, Sequence[str]], added: str = ""
) -> dict[str, np.ndarray]:
    """Covariances with the errors of a model, {variable: (..., p, p)} for `building.replaced`; values if it adds some.

    There is one moved Dataset of the kind of the found one for each direction of the errors; covariances names, for a
    variable (..., p), the variables that hold its covariances (..., p, p); added is JSON of the "correction" (p,) and
    "covariance" (p, p) that a search adds to the result, "" for none.
    """
    new, more = {}, json.loads(added or "{}")
    for name, held in covariances.items():
        extra = np.array(more.get("covariance", 0.0))
        if more:
            new[name] = found[name].values + more["correction"]
        if moved:
            extra = extra + covariance_of_moves(found[name].values, [one[name].values for one in moved])
        new |= {covariance: found[covariance].values + extra for covariance in held}
    return new


def widened_sigmas(
    found: xr.Dataset, moved: Sequence[xr.Dataset], sigmas: Mapping[str, Sequence[str]]
) -> dict[str, np.ndarray]:
    """Standard deviations with the errors of a model, {variable: array}, of values without covariances."""
    new = {}
    for name, held in sigmas.items():
        each = [one[name].values[..., None] for one in moved]
        square = covariance_of_moves(found[name].values[..., None], each)[..., 0, 0]
        new |= {sigma: np.sqrt(found[sigma].values ** 2 + square) for sigma in held}
    return new
