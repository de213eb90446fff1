"""NetCDF-4 bytes to datasets, everything in memory, through low-level calls of h5py, since there are many."""

import contextlib
import uuid
from types import SimpleNamespace

import numpy as np

from gravcal.data.netcdf import BARE_DIMENSION, HIDDEN, LABEL, UNREAD


def from_bytes(image):
    """Dataset from the bytes of a netCDF-4 file, everything in memory, times as the numbers they are.

    Parameters
    ----------
    image : bytes

    Returns
    -------
    dataset : Dataset
    """
    import xarray as xr

    with _opened(image) as file:
        variables, attributes = _read_variables(file), _read_attributes(file)
    coordinates = {name for name, content in variables.items() if content[0] == (name,)}
    for _, _, labels in [((), (), attributes), *variables.values()]:
        coordinates |= set(labels.get("coordinates", "").split())
    variables = {
        name: xr.Variable(dims, np.asarray(values), _own(labels), fastpath=True)  # the other path imports dask.array
        for name, (dims, values, labels) in variables.items()
    }
    return xr.Dataset(
        {name: content for name, content in variables.items() if name not in coordinates},
        {name: content for name, content in variables.items() if name in coordinates},
        _own(attributes),
    )


def arrays(image, names):
    """Some variables of a netCDF-4 file as plain arrays, without what datasets need to be loaded.

    Parameters
    ----------
    image : bytes
    names : of the variables

    Returns
    -------
    arrays : {name: array}
    """
    from h5py import h5d

    with _opened(image) as file:
        return {name: _values(h5d.open(file, name.encode())) for name in names}


@contextlib.contextmanager
def _opened(image):
    """HDF5 file in memory, as low-level identifier."""
    from h5py import h5f, h5p

    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fapl_core(backing_store=False)
    access.set_file_image(image)
    file = h5f.open(uuid.uuid4().hex.encode(), h5f.ACC_RDONLY, fapl=access)
    try:
        yield file
    finally:
        file.close()


def _read_variables(file):
    """Dimensions, values and attributes of each variable by name, in the order of the file; low-level calls again."""
    from h5py import h5, h5d, h5g, h5p

    root, names = h5g.open(file, b"/"), []
    tracked = root.get_create_plist().get_link_creation_order() & h5p.CRT_ORDER_TRACKED
    root.links.iterate(names.append, idx_type=h5.INDEX_CRT_ORDER if tracked else h5.INDEX_NAME)
    variables = {}
    for name in names:
        node = h5d.open(root, name)
        labels = _read_attributes(node)
        if labels.get("NAME", "").startswith(BARE_DIMENSION):
            continue
        dimensions, values, text = _dimensions(node, name, labels), _values(node), name.decode()
        labelled = values.dtype == object and len(dimensions) == 1 and dimensions[0] + LABEL == text
        variables[dimensions[0] if labelled else text] = dimensions, values, labels
    return variables


def _read_attributes(node):
    """Attributes as str, int, float, list of str or arrays of numbers, with those of the format that tell of axes."""
    from h5py import h5a

    names = []
    h5a.iterate(node, names.append)
    wanted = set(names) - UNREAD if b"CLASS" in names else set(names) - UNREAD - {b"NAME"}
    return {name.decode(): _attribute(node, name) for name in names if name in wanted}


def _attribute(node, name):
    """One attribute as it was before writing."""
    from h5py import AttributeManager, h5a, h5s, h5t

    attribute = h5a.open(node, name)
    kind = attribute.get_type()
    if isinstance(kind, h5t.TypeStringID) and not kind.is_variable_str() and not attribute.shape:
        values = np.zeros((), f"S{kind.get_size()}")
        if attribute.get_space().get_simple_extent_type() != h5s.NULL:
            attribute.read(values, mtype=kind)
        return values.item().decode()
    if isinstance(kind, (h5t.TypeIntegerID, h5t.TypeFloatID)):
        values = np.zeros(attribute.shape, attribute.dtype)
        attribute.read(values)
        return values if values.ndim else values.item()
    found = AttributeManager(SimpleNamespace(id=node))[name.decode()]
    return [_text(item) for item in found] if isinstance(found, np.ndarray) else _text(found)


def _own(labels):
    """Attributes that are the variable's own, not those of the file format."""
    return {name: value for name, value in labels.items() if name not in HIDDEN}


def _text(value):
    """Text from what HDF5 returns for a string, an empty one included."""
    if isinstance(value, bytes):
        return value.decode()
    return value if isinstance(value, str) else ""


def _values(node):
    """Values of one variable; text as str objects."""
    from h5py import Dataset, h5s

    dtype = node.dtype
    if dtype.kind == "O":
        return np.asarray(Dataset(node).asstr()[...], dtype=object)
    values = np.empty(node.shape, dtype)
    if values.size:
        node.read(h5s.ALL, h5s.ALL, values)
    return values


def _dimensions(node, name, labels):
    """Names of the dimensions of one variable."""
    from h5py import h5a, h5ds, h5i

    if not h5a.exists(node, b"DIMENSION_LIST"):
        return (name.decode(),) if "CLASS" in labels else ()
    found = []

    def note(scale):
        found.append(h5i.get_name(scale).decode().lstrip("/"))
        return True  # the first one is enough

    for axis in range(node.rank):
        h5ds.iterate(node, axis, note)
    return tuple(found)
