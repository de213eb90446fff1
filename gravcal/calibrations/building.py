"""Datasets made from plain arrays by the schema of their kind, so that names, dimensions and units stand once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr


def build(schema: Mapping[str, Mapping[str, str]], values: Mapping[str, object], **attrs) -> xr.Dataset:
    """Dataset of a kind.

    Parameters
    ----------
    schema : {variable: {"dims", "units", "frame", "long_name", "dtype"}}
    values : {variable: array}, every variable of the schema that is not optional
    attrs : global attributes

    Returns
    -------
    dataset : Dataset; a variable named like its dimension is a coordinate
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
    """Copy of a dataset with other numbers in some of its variables, everything else as it is.

    Parameters
    ----------
    dataset : Dataset
    values : {variable: array of its shape}
    """
    return dataset.copy(deep=True).assign({name: dataset[name].copy(data=array) for name, array in values.items()})
