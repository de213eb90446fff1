"""Schemas of products from the TOML file of a calibration; products from arrays, and with errors of a model added."""

from __future__ import annotations

import functools
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # a plan looks at the schemas alone
    import xarray as xr

HERE = Path(__file__).parent


@functools.cache
def of(file: str) -> dict[str, dict[str, dict]]:
    """{stage: {variable: {"dims", "units", ...}}}: schemas of the products of a calibration from its TOML file.

    Tables that begin with "_" are no products: others include them. Every calibration has the products "checks" and
    "report" of the file that all share, unless it has its own. Where units differ between variants they are a tuple.
    Axes of time, and of frequency, are coordinates without being listed.
    """
    shared = tomllib.loads((HERE / "shared.toml").read_text())
    own_tables = tomllib.loads((HERE / Path(file).stem / file).read_text()) if file != "shared.toml" else {}
    tables = own_tables | shared | own_tables  # its own first
    for table in tables.values():
        for included in table.pop("include", ()):
            table |= tables[included]
        axes = {dim for entry in table.values() for dim in entry["dims"].split()} - table.keys()
        table |= {dim: {"dims": dim} for dim in sorted(axes) if dim.startswith("time")}
        table |= {dim: {"dims": dim, "units": "Hz", "long_name": dim} for dim in axes & {"frequency"}}
        for entry in table.values():
            if isinstance(entry.get("units"), list):
                entry["units"] = tuple(entry["units"])
    return {name: table for name, table in tables.items() if not name.startswith("_")}


def build(schema: Mapping[str, Mapping[str, str]], values: Mapping[str, object], **attrs) -> xr.Dataset:
    """Dataset of a schema from arrays of its variables, of which optional ones may be missing, and global attributes.

    A variable named like its dimension is a coordinate. A schema has "dims", "units", "frame", "long_name" and "dtype"
    of each variable.
    """
    import pandas as pd
    import xarray as xr

    labelled = {}
    for name, entry in schema.items():
        if name not in values and entry.get("optional"):
            continue
        dims = tuple(entry["dims"].split())
        label = {k: entry[k] for k in ("units", "frame", "long_name") if k in entry}
        array = np.asarray(values[name], dtype=entry.get("dtype", "f8"))
        if dims == (name,) and array.dtype.kind in "fiu":  # an index at once; the other paths import dask
            labelled[name] = xr.IndexVariable(dims, pd.Index(array), label, fastpath=True)
        else:
            labelled[name] = xr.Variable(dims, array, label, fastpath=True)
    coords = {name: variable for name, variable in labelled.items() if variable.dims == (name,)}
    data = {name: variable for name, variable in labelled.items() if name not in coords}
    return xr.Dataset(data, coords=coords, attrs={"time_scale": "GPS"} | attrs)


def replaced(dataset: xr.Dataset, values: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Copy of a dataset with other numbers, arrays of the same shape, in some of its variables."""
    return dataset.copy(deep=True).assign({name: dataset[name].copy(data=array) for name, array in values.items()})


def widened(
    solved: xr.Dataset, moved: Sequence[xr.Dataset], errors: Mapping[str, Sequence[str]], added: str = ""
) -> dict[str, np.ndarray]:
    """{variable: array} for `replaced`: errors of a product enlarged by those of a model, and values with a correction.

    There is one moved Dataset of the kind of the solved one for each direction of the errors; errors names, for a
    variable (..., p), those that hold its covariances (..., p, p) or standard deviations (..., p); added is JSON of the
    "correction" (p,) and "covariance" (p, p) that a search adds to the result, "" for none.
    """
    from gravcal.estimation.least_squares import covariance_of_moves

    enlarged, addition = {}, json.loads(added or "{}")
    for name, error_names in errors.items():
        value, others = solved[name].values, [one[name].values for one in moved]
        if addition:
            enlarged[name] = value + addition["correction"]
        for error in (solved[one] for one in error_names):
            if error.ndim == value.ndim:  # standard deviations
                variance = covariance_of_moves(value[..., None], [one[..., None] for one in others])[..., 0, 0]
                enlarged[error.name] = np.sqrt(error.values**2 + variance)
            else:
                extra = covariance_of_moves(value, others) if moved else 0.0
                enlarged[error.name] = error.values + (np.array(addition.get("covariance", 0.0)) + extra)
    return enlarged
