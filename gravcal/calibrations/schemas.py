"""What products hold, by the TOML file of a calibration; products of plain arrays, widened by errors of a model."""

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
    """Schemas of the products of a calibration by stage, as `gravcal.store.product` has them.

    Tables that begin with "_" are no products: others include them. Every calibration has the products "checks" and
    "report" of the file that all share, unless it has its own. Where units differ between variants they are a tuple.
    Axes of time, and of frequency, are coordinates without being listed.
    """
    shared = tomllib.loads((HERE / "shared.toml").read_text())
    own = tomllib.loads((HERE / Path(file).stem / file).read_text()) if file != "shared.toml" else {}
    tables = own | shared | own  # its own first
    for table in tables.values():
        for one in table.pop("include", ()):
            table |= tables[one]
        axes = {dim for stated in table.values() for dim in stated["dims"].split()} - table.keys()
        table |= {dim: {"dims": dim} for dim in sorted(axes) if dim.startswith("time")}
        table |= {dim: {"dims": dim, "units": "Hz", "long_name": dim} for dim in axes & {"frequency"}}
        for stated in table.values():
            if isinstance(stated.get("units"), list):
                stated["units"] = tuple(stated["units"])
    return {name: table for name, table in tables.items() if not name.startswith("_")}


def build(schema: Mapping[str, Mapping[str, str]], values: Mapping[str, object], **attrs) -> xr.Dataset:
    """Dataset of a kind from arrays of every variable of its schema that is not optional, and global attributes.

    A variable named like its dimension is a coordinate. A schema has "dims", "units", "frame", "long_name" and "dtype"
    of each variable.
    """
    import pandas as pd
    import xarray as xr

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
    solved: xr.Dataset, moved: Sequence[xr.Dataset], errors: Mapping[str, Sequence[str]], added: str = ""
) -> dict[str, np.ndarray]:
    """Errors that hold those of a model, {variable: array} for `replaced`; values if it adds some.

    There is one moved Dataset of the kind of the solved one for each direction of the errors; errors names, for a
    variable (..., p), those that hold its covariances (..., p, p) or standard deviations (..., p); added is JSON of the
    "correction" (p,) and "covariance" (p, p) that a search adds to the result, "" for none.
    """
    from gravcal.estimation.least_squares import covariance_of_moves

    new, more = {}, json.loads(added or "{}")
    for name, held in errors.items():
        value, others = solved[name].values, [one[name].values for one in moved]
        if more:
            new[name] = value + more["correction"]
        for error in (solved[one] for one in held):
            if error.ndim == value.ndim:  # standard deviations
                square = covariance_of_moves(value[..., None], [one[..., None] for one in others])[..., 0, 0]
                new[error.name] = np.sqrt(error.values**2 + square)
            else:
                extra = covariance_of_moves(value, others) if moved else 0.0
                new[error.name] = error.values + (np.array(more.get("covariance", 0.0)) + extra)
    return new
