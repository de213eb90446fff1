"""Products: schemas of their kinds, checks of a Dataset against these, and reading and writing netCDF.

A schema is plain data, {variable: its keys}, as `docs/adding_a_calibration.md` says. Products as returned have the
attributes their schema states, so a stage's body need not set them.

Files are netCDF-4, written and read through netCDF4 and xarray. netCDF4 is not thread-safe, whatever files its threads
use: all of it holds one lock of the process. Names along a dimension, in memory a coordinate of that name, are the
label coordinate ``<dimension>_label`` of the file, as the CF conventions want. Equal content gives an equal digest;
bytes may differ between versions.
"""

import contextlib
import errno
import hashlib
import json
import re
import threading
from collections.abc import Iterable

import numpy as np

from gravcal.errors import refuse

TIME = {
    "units": "seconds since 2000-01-01 12:00:00",
    "units_metadata": "leap_seconds: none",
    "calendar": "standard",
    "standard_name": "time",
    "long_name": "GPS time",
    "time_scale": "GPS",
}
ANY = None  # schema of kinds whose variables differ from file to file (ingest): only the general rules hold
STATED = ("units", "long_name", "frame")
PROVENANCE = ("Conventions", "title", "source", "history", "gravcal_key", "gravcal_digest", "gravcal_recipe")
CHANGE = "Return it so, or change the schema and the version of the stage."
LOCK = threading.RLock()
PIECE = 1 << 20  # bytes of a compressed piece, before it is compressed
SMALL = 4096  # bytes; below this a compressed chunk costs more than it saves
LABEL = "_label"
MEASURED, SIMULATED, MIXED = ORIGINS = ("measured", "simulated", "mixed")  # of records; saying nothing: measured
_schemas = {}


def register(kind, schema):
    """Register the schema of a kind ("*.report": of any calibration); again only with the same schema."""
    if kind in _schemas and _schemas[kind] != schema:
        refuse(f"product kind {kind}", "it registered twice with different schemas", "one", "Give one another name.")
    _schemas[kind] = schema


def registered(calibration, **schemas):
    """Register the schemas {stage: schema} of a calibration; returns {"calibration.stage": schema}."""
    kinds = {f"{calibration}.{name}": one for name, one in schemas.items()}
    for kind, one in kinds.items():
        register(kind, one)
    return kinds


def schema(kind):
    """Schema of a kind: {variable: {"dims", "units", ...}}, or ANY (None)."""
    known = kind if kind in _schemas else f"*.{kind.partition('.')[2]}"
    if known not in _schemas:
        fault = f"no schema is registered, only of {', '.join(sorted(_schemas)) or 'none'}"
        refuse(f"product kind {kind}", fault, "one", "Call product.register in the module of its stage.", kind=kind)
    return _schemas[known]


def check(dataset, kind):
    """`settled` Dataset of a stage's body with the attributes that the schema of its kind states.

    Variables, dimensions, types and units are compared with the schema first.
    """
    expected = schema(kind)
    present = set(dataset.variables)
    required = {name for name, stated in (expected or {}).items() if not stated.get("optional")}
    missing, extra = sorted(required - present), [] if expected is ANY else sorted(present - set(expected))
    if missing or extra:
        fault = f"variables missing: {', '.join(missing) or 'none'}; not in the schema: {', '.join(extra) or 'none'}"
        refuse(kind, fault, "what the schema says", CHANGE, missing=missing, extra=extra)
    stated = {name: {} if expected is ANY else expected[name] for name in dataset.variables}
    labels = {n: _labels(n, own, stated[n], f"{kind}, variable {n}") for n, own in dataset.variables.items()}
    labelled = settled(dataset, labels, without_provenance(dataset.attrs))
    for name, variable in labelled.variables.items():
        where, entry = f"{kind}, variable {name}", stated[name]
        dims = tuple(entry["dims"].split()) if "dims" in entry else variable.dims
        form = "str" if variable.dtype == object else variable.dtype.str.lstrip("<>|=")
        wanted = entry.get("dtype", "f8") if entry else form
        if variable.dims != dims or form != wanted:
            refuse(where, f"{form} over {variable.dims}", f"{wanted} over {dims}", CHANGE)
        allowed = entry.get("units", ())
        if isinstance(allowed, tuple) and allowed and variable.attrs.get("units") not in allowed:
            refuse(where, f"units {variable.attrs.get('units')!r}", f"one of {', '.join(allowed)}", CHANGE)
        if form != "str" and "units" not in variable.attrs:
            refuse(where, "no units", "those of the schema", "State them; '1' for a pure number or a flag.")
        if is_time(name, variable):
            values = variable.values
            wrong = ~np.isfinite(values) | np.append(False, np.diff(values) <= 0)[: values.size]
            if wrong.any():
                first = int(np.argmax(wrong))
                epoch, remedy = f"{values[first]!r} at index {first}", "Sort first, or call the dimension 'record'."
                refuse(f"{kind}, coordinate {name}", epoch, "finite GPS seconds that increase", remedy)
    return labelled


def settled(dataset, labels=None, attributes=None):
    """Dataset in the form that writing and reading preserve: loaded, native byte order, text as objects.

    Attributes are plain: its own, or ``labels`` {variable: attributes} and global ``attributes``.
    """
    import xarray as xr

    variables = {}
    for name, one in dataset.variables.items():
        values, own = one.values, labels[name] if labels else one.attrs
        if values.dtype.kind in "US" or values.dtype == object and all(isinstance(item, str) for item in values.flat):
            values = np.array([str(item) for item in values.astype(str).flat], dtype=object).reshape(values.shape)
        elif values.dtype.kind not in "iuf":
            remedy = "Make truth values uint8, times GPS seconds (f8), complex numbers two variables."
            refuse("a product", f"values of type {values.dtype}", "numbers and text", remedy)
        else:  # as after reading: BLAS sums by order
            values = np.asarray(values, dtype=values.dtype.newbyteorder("="), order="C")
        variables[name] = one.dims, values, _settled_attributes(own)
    coordinates = {name: variables.pop(name) for name in sorted(dataset.coords)}
    return xr.Dataset(variables, coordinates, _settled_attributes(dataset.attrs if attributes is None else attributes))


def digest(dataset):
    """SHA-256 of a settled dataset: names, dimensions, types, values, attributes; NaN equal to NaN, no provenance."""
    total = hashlib.sha256(_attribute_text(without_provenance(dataset.attrs)))
    for name in sorted(dataset.variables):
        variable = dataset.variables[name]
        values = np.ascontiguousarray(variable.values)
        header = [name, list(variable.dims), list(values.shape), "str" if values.dtype == object else values.dtype.str]
        total.update(json.dumps(header).encode() + _attribute_text(variable.attrs))
        if values.dtype == object:
            total.update(json.dumps(values.ravel().tolist()).encode())
            continue
        if values.dtype.kind == "f" and np.isnan(values).any():  # one bit pattern for NaN
            values = np.where(np.isnan(values), values.dtype.type(np.nan), values)
        total.update(np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"), copy=False)).data)
    return total.hexdigest()


def provenance(recipe, key, content_digest, version):
    """{global attribute: text} on how a product was made; nothing in them depends on the clock or the machine."""
    name = ".".join(part for part in (recipe["kind"], recipe["variant"]) if part)
    return {
        "Conventions": "CF-1.11",
        "title": f"{name} of {recipe['event']}",
        "source": f"gravcal {version}",
        "history": f"gravcal: {recipe['kind']} version {recipe['version']} from {len(recipe['inputs'])} input(s)",
        "gravcal_key": key,
        "gravcal_digest": content_digest,
        "gravcal_recipe": json.dumps(recipe, sort_keys=True),
    }


def without_provenance(attributes):
    """Global attributes {name: value} without those of `provenance`."""
    return {name: value for name, value in attributes.items() if name not in PROVENANCE}


def is_time(name, variable):
    """True for a coordinate of GPS time: it bears the name of its dimension, ``time`` or ``time_...``."""
    return variable.dims == (name,) and re.fullmatch(r"time(_\w+)?", name) is not None


def _labels(name, variable, stated, where):
    """Attributes of one variable completed by its entry ``stated`` of the schema; refused if they contradict it."""
    known = {label: stated[label] for label in STATED if isinstance(stated.get(label), str)}
    known = TIME | known if is_time(name, variable) else known
    present = {label: value for label, value in variable.attrs.items() if label not in ("_FillValue", "coordinates")}
    for label in ("units", "frame"):
        if label in present and label in known and present[label] != known[label]:
            refuse(where, f"{label} is {present[label]!r}, the schema says {known[label]!r}", "the same", "Convert it.")
    return known | present | {label: known[label] for label in ("units", "frame") if label in known}


def _settled_attributes(attributes):
    """Attributes in the types that reading returns: str, int, float, list of str or array of numbers."""
    plain = {}
    for name, value in attributes.items():
        items = np.asarray(value)
        if isinstance(value, (str, int, float, np.generic)):
            plain[name] = int(value) if items.dtype.kind == "b" else items.item()
        elif items.ndim == 1 and items.size and items.dtype.kind in "iufU":
            several = items.tolist() if items.dtype.kind == "U" else items
            plain[name] = items.item() if items.size == 1 else several
        else:
            expected = "text, a number or a list of either"
            refuse(f"attribute {name}", repr(value), expected, "Give a mapping as JSON text.")
    return plain


def _attribute_text(attributes):
    """JSON (bytes) of attributes, independent of their order."""
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in attributes.items()}
    return json.dumps(plain, sort_keys=True).encode()


def write(dataset, path):
    """Write a settled dataset (`settled`) as a netCDF-4 file; OSError if it cannot be written.

    `Dataset.to_netcdf` in a worker of Dask asks the scheduler for a lock of the file, and both keep it for ever.
    """
    import netCDF4
    from xarray.backends import NetCDF4DataStore

    texts = [name for name in dataset.coords if dataset[name].dims == (name,) and dataset[name].dtype == object]
    labels = {name + LABEL: (name, dataset[name].values, dataset[name].attrs) for name in texts}
    labelled = dataset.drop_vars(texts).assign_coords(labels) if texts else dataset.copy()
    encoding = {}
    for name, variable in labelled.variables.items():
        flags = {key: variable.attrs[key] for key in ("flag_masks", "flag_values") if key in variable.attrs}
        variable.attrs |= {key: np.asarray(value, variable.dtype) for key, value in flags.items()}
        encoding[name] = {"_FillValue": None} if variable.dims == (name,) else {}  # no gaps to fill in a coordinate
        if variable.dtype.kind in "iuf" and variable.nbytes >= SMALL:
            rows = max(1, min(variable.shape[0], PIECE * variable.shape[0] // variable.nbytes))
            pieces = {"chunksizes": (rows, *variable.shape[1:])}
            encoding[name] |= {"zlib": True, "complevel": 1, "shuffle": True} | pieces
    try:
        with LOCK, netCDF4.Dataset(path, "w") as file:
            labelled.dump_to_store(NetCDF4DataStore(file), encoding=encoding)
    except RuntimeError as error:  # netCDF4 does not say which error of the system it was: plain writing does
        path.write_bytes(bytes(dataset.nbytes + (1 << 16)))
        raise OSError(errno.EIO, str(error), str(path)) from error


def from_bytes(image):
    """Dataset in memory from the bytes of a netCDF-4 file; times stay numbers, text becomes objects."""
    import netCDF4
    import xarray as xr

    with LOCK, _damage_as_oserror(), netCDF4.Dataset("product", memory=image) as file:
        store = xr.backends.NetCDF4DataStore(file)
        read = xr.open_dataset(store, decode_times=False, mask_and_scale=False).load()
    variables, coordinates = {}, {}
    for name, variable in read.variables.items():
        values = variable.values.astype(object) if variable.dtype.kind in "US" else variable.values
        own = {label: _attribute(value) for label, value in variable.attrs.items() if label != "_FillValue"}
        dimension = name.removesuffix(LABEL)  # labels have the name of their dimension
        kept = coordinates if name in read.coords else variables
        kept[dimension if variable.dims == (dimension,) else name] = variable.dims, values, own
    return xr.Dataset(variables, coordinates, {name: _attribute(value) for name, value in read.attrs.items()})


def _attribute(value):  # Python scalar of a numpy scalar, otherwise as it is
    return value.item() if getattr(value, "shape", None) == () else value


@contextlib.contextmanager
def opened(path):
    """Context with a file as netCDF4.Dataset of raw values, under the lock of the process; OSError if damaged."""
    import netCDF4

    with LOCK, _damage_as_oserror(), netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        yield file


@contextlib.contextmanager
def _damage_as_oserror():
    """Context that turns errors of netCDF4 for damaged files into OSError."""
    try:
        yield
    except (RuntimeError, AttributeError) as error:
        raise OSError(f"netCDF: {error}") from error


def attributes(node):
    """{name: value} of the attributes of an open netCDF4 file or variable, plain."""
    return {name: _attribute(node.getncattr(name)) for name in node.ncattrs()}


def foreword(origin: str) -> str:
    """Start of a verdict: "SIMULATED. " or "MIXED. ", "" where all data are measured."""
    return "" if origin == MEASURED else f"{origin.upper()}. "


def listed(name: str, datasets: Iterable) -> list[str]:
    """Sorted entries of an attribute of datasets, texts with "; " between entries; files and None have none."""
    return sorted({part for one in datasets for part in getattr(one, "attrs", {}).get(name, "").split("; ") if part})


def origins_together(origins: Iterable[str]) -> str:
    """Common origin of several, "mixed" if they differ; "" (no records) is ignored, and returned if alone."""
    distinct = {one for one in origins if one}
    return distinct.pop() if len(distinct) == 1 else MIXED if distinct else ""
