"""Where the arrays of a product file lie in it, so that reading it again costs no more than its bytes.

Opening a variable and its attributes through HDF5 takes half a millisecond, and a product has a dozen of each. The
record of a product keeps what they say, and the place of every array, as it is or compressed piece by piece; records of
earlier versions leave out the places of compressed ones, which are read through HDF5. The file itself stays complete:
who has no record reads it with any netCDF library.
"""

from __future__ import annotations

import hashlib
import json
import zlib

import numpy as np

from gravcal.data import netcdf, netcdf_reading, product, variables


def recorded(dataset, places) -> dict:
    """What a record keeps of the layout; arguments as of `of`."""
    text = of(dataset, places)
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


def of(dataset, places) -> str:
    """Layout of a dataset as JSON text.

    Parameters
    ----------
    dataset : Dataset, settled, without provenance
    places : {name: place in the file}, as of `netcdf.written`
    """
    coordinates, entries = set(dataset.coords), {}
    for name, variable in dataset.variables.items():
        entry = {"dims": list(variable.dims), "shape": list(variable.shape), "attrs": _plain(netcdf.of_type(variable))}
        if variable.dtype == object:
            entry["text"] = variable.values.ravel().tolist()
        else:
            place = places.get(name)
            entry |= {"dtype": variable.dtype.str} | (place if isinstance(place, dict) else {"offset": place})
        entries[name] = entry | ({"coordinate": True} if name in coordinates else {})
    return json.dumps({"attrs": _plain(dataset.attrs), "variables": entries})


def dataset_of(image: bytes, text: str):
    """Dataset of a product file by its layout.

    Parameters
    ----------
    image : bytes of the file
    text : JSON of `of`
    """
    import xarray as xr

    layout = json.loads(text)
    entries, parts = layout["variables"], ({}, {})
    placed = ("text", "offset", "pieces")
    through = [n for n, e in entries.items() if all(e.get(k) is None for k in placed) and 0 not in e["shape"]]
    packed = netcdf_reading.arrays(image, through) if through else {}
    for name, entry in entries.items():
        values = packed[name] if name in packed else _values(image, entry)
        variable = variables.made(name, tuple(entry["dims"]), values, _attributes(entry["attrs"]))
        parts["coordinate" in entry][name] = variable
    return xr.Dataset(*parts, _attributes(layout["attrs"]))


def _values(image, entry):
    """Array of one entry."""
    if "text" in entry:
        return np.array(entry["text"], dtype=object).reshape(entry["shape"])
    dtype, count = np.dtype(entry["dtype"]), int(np.prod(entry["shape"]))
    if not count:
        return np.zeros(entry["shape"], dtype)
    if "pieces" in entry:
        return _unpacked(image, entry, dtype)
    return np.frombuffer(image, dtype, count, entry["offset"]).reshape(entry["shape"]).copy()  # aligned, image freed


def _unpacked(image, entry, dtype):
    """Array of compressed pieces, each a number of rows; bytes of the same place in each number lie together."""
    values, rows, size = np.empty(entry["shape"], dtype), entry["rows"], dtype.itemsize
    count = rows * int(np.prod(entry["shape"][1:]))  # the last piece is filled up
    flat = values.reshape(-1).view("u1").reshape(-1, size)
    for number, (first, packed) in enumerate(entry["pieces"]):
        shuffled = zlib.decompress(memoryview(image)[first:][:packed], bufsize=count * size)
        part = flat[number * count : (number + 1) * count]
        for place, plane in enumerate(np.frombuffer(shuffled, "u1").reshape(size, count)):
            part[:, place] = plane[: len(part)]
    return values


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
