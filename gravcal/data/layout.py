"""Where the arrays of a product file lie in it, so that reading it again costs no more than its bytes.

Opening a variable and its attributes through HDF5 takes half a millisecond, and a product has a dozen of each. The
record of a product keeps what they say, and the place of every array that is stored as it is; compressed ones are read
through HDF5. The file itself stays complete: who has no record reads it with any netCDF library.
"""

from __future__ import annotations

import hashlib
import json

import numpy as np

from gravcal.data import netcdf, netcdf_reading, product


def recorded(dataset, offsets) -> dict:
    """What a record keeps of the layout; arguments as of `of`."""
    text = of(dataset, offsets)
    return {"layout": text, "layout_sha256": hashlib.sha256(text.encode()).hexdigest()}


def content(image: bytes, record: dict):
    """Dataset of verified bytes, without provenance; by the record's layout where it has one that is whole.

    Parameters
    ----------
    image : bytes of the file
    record : of the product
    """
    text = record.get("layout")
    if isinstance(text, str) and hashlib.sha256(text.encode()).hexdigest() == record.get("layout_sha256"):
        dataset = dataset_of(image, text)
    else:
        dataset = product.without_provenance(netcdf_reading.from_bytes(image))
    dataset.encoding[product.DIGEST] = record["digest"]
    return dataset


def of(dataset, offsets) -> str:
    """Layout of a dataset as JSON text.

    Parameters
    ----------
    dataset : Dataset, settled, without provenance
    offsets : {name: first byte in the file} of arrays stored as they are, as of `netcdf.written`
    """
    coordinates, variables = set(dataset.coords), {}
    for name, variable in dataset.variables.items():
        entry = {"dims": list(variable.dims), "shape": list(variable.shape), "attrs": _plain(netcdf.of_type(variable))}
        if variable.dtype == object:
            entry["text"] = variable.values.ravel().tolist()
        else:
            entry |= {"dtype": variable.dtype.str, "offset": offsets.get(name)}
        variables[name] = entry | ({"coordinate": True} if name in coordinates else {})
    return json.dumps({"attrs": _plain(dataset.attrs), "variables": variables})


def dataset_of(image: bytes, text: str):
    """Dataset of a product file by its layout; arrays stored as they are lie in `image` and cannot be changed.

    Parameters
    ----------
    image : bytes of the file
    text : JSON of `of`
    """
    import xarray as xr

    layout = json.loads(text)
    entries, parts = layout["variables"], ({}, {})
    through = [name for name, e in entries.items() if "text" not in e and e["offset"] is None and 0 not in e["shape"]]
    packed = netcdf_reading.arrays(image, through) if through else {}
    for name, entry in entries.items():
        values = packed[name] if name in packed else _values(image, entry)
        variable = xr.Variable(tuple(entry["dims"]), values, _attributes(entry["attrs"]), fastpath=True)
        parts["coordinate" in entry][name] = variable
    return xr.Dataset(*parts, _attributes(layout["attrs"]))


def _values(image, entry):
    """Array of one entry that is not compressed."""
    if "text" in entry:
        return np.array(entry["text"], dtype=object).reshape(entry["shape"])
    dtype, count = np.dtype(entry["dtype"]), int(np.prod(entry["shape"]))
    if not count:
        return np.zeros(entry["shape"], dtype)
    return np.frombuffer(image, dtype, count, entry["offset"]).reshape(entry["shape"])


def _plain(attributes):
    """Attributes as JSON knows them."""
    return {name: _item(value) for name, value in attributes.items()}


def _item(value):
    if isinstance(value, np.generic):
        return value.item()
    return {"dtype": value.dtype.str, "values": value.tolist()} if isinstance(value, np.ndarray) else value


def _attributes(plain):
    """Attributes of JSON as they were."""
    return {name: np.array(v["values"], v["dtype"]) if isinstance(v, dict) else v for name, v in plain.items()}
