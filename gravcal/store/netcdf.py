"""Datasets to netCDF-4 files and back, through netCDF4 and xarray.

netCDF4 is not thread-safe, whatever files its threads use: everything here holds one lock of the process. Names along a
dimension, in memory a coordinate of that name, are the label coordinate ``<dimension>_label`` of the file, as the CF
conventions want. Equal content gives an equal digest (`gravcal.store.product`); bytes may differ between versions.
"""

import contextlib
import errno
import threading

import numpy as np

LOCK = threading.RLock()
PIECE = 1 << 20  # bytes of a compressed piece, before it is compressed
SMALL = 4096  # bytes; below this a compressed chunk costs more than it saves
LABEL = "_label"


def write(dataset, path):
    """Write a settled dataset (`product.settled`) as a netCDF-4 file; OSError if it cannot be written."""
    texts = [name for name in dataset.coords if dataset[name].dims == (name,) and dataset[name].dtype == object]
    labels = {name + LABEL: (name, dataset[name].values, dataset[name].attrs) for name in texts}
    labelled = dataset.drop_vars(texts).assign_coords(labels) if texts else dataset.copy()
    encoding = {}
    for name, variable in labelled.variables.items():
        flags = {key: variable.attrs[key] for key in ("flag_masks", "flag_values") if key in variable.attrs}
        variable.attrs |= {key: np.asarray(value, variable.dtype) for key, value in flags.items()}
        encoding[name] = _encoding(name, variable)
    try:
        with LOCK:
            labelled.to_netcdf(path, engine="netcdf4", encoding=encoding)
    except RuntimeError as error:  # netCDF4 does not say which error of the system it was: plain writing does
        path.write_bytes(bytes(dataset.nbytes + (1 << 16)))
        raise OSError(errno.EIO, str(error), str(path)) from error


def _encoding(name, variable):
    """How a variable is kept in the file; the coordinate of a dimension has no gaps to fill."""
    kept = {"_FillValue": None} if variable.dims == (name,) else {}
    if variable.dtype.kind not in "iuf" or variable.nbytes < SMALL:
        return kept
    rows = max(1, min(variable.shape[0], PIECE * variable.shape[0] // variable.nbytes))
    return kept | {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": (rows, *variable.shape[1:])}


def from_bytes(image):
    """Dataset from the bytes of a netCDF-4 file, in memory, times as the numbers they are, text as objects."""
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


def _attribute(value):
    """Attribute as str, int, float, list of str or array of numbers."""
    return value.item() if getattr(value, "shape", None) == () else value


@contextlib.contextmanager
def opened(path):
    """File as a netCDF4.Dataset that gives values as they are, alone in this process; OSError where it is damaged."""
    import netCDF4

    with LOCK, _damage_as_oserror(), netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        yield file


@contextlib.contextmanager
def _damage_as_oserror():
    """Errors that netCDF4 raises for files of damaged structure as one kind."""
    try:
        yield
    except (RuntimeError, AttributeError) as error:
        raise OSError(f"netCDF: {error}") from error


def attributes(node):
    """Attributes of a file or variable of netCDF4, plain."""
    return {name: _attribute(node.getncattr(name)) for name in node.ncattrs()}
