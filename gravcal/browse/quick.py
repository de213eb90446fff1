"""Long series read past HDF5: plain ones are mapped into memory, packed ones unpacked by several threads at once."""

import os
import zlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np

FILTERS = (2, 1)  # shuffle, then deflate: what the store writes
WORKERS = min(4, os.cpu_count() or 1)


def mapped(column):
    """Values of a column as a map of the file, nothing read yet; None where they are packed or of another type.

    Parameters
    ----------
    column : variables.Column

    Returns
    -------
    values : (n,) read-only, or None
    """
    import h5py

    with h5py.File(column.path, "r") as file:
        node = file[column.variable]
        offset, shape, dtype = node.id.get_offset(), node.shape, node.dtype
    if offset is None or dtype != np.dtype("<f8"):
        return None
    index = list(column.index)
    index.insert(column.axis, slice(None))
    return np.memmap(column.path, dtype, "r", offset, shape)[tuple(index)]


def sampled(column, step):
    """Every step-th value and the last one of a packed series of one dimension, or None where it is not one.

    Of each chunk only the bytes of the samples wanted are put in order again.

    Parameters
    ----------
    column : variables.Column
    step : int

    Returns
    -------
    values : (m,)
    last : float
    """
    import h5py

    with h5py.File(column.path, "r") as file:
        node = file[column.variable]
        if not _is_packed(node):
            return None
        length, (size,) = node.chunks[0], node.shape
        starts = range(0, size, length)
        raw = [node.id.read_direct_chunk((start,)) for start in starts]
        last = float(node[-1])
    if any(skipped for skipped, _ in raw):
        return None
    tasks = [(chunk, -start % step, min(length, size - start)) for start, (_, chunk) in zip(starts, raw, strict=True)]
    parts = together(lambda task: _samples(*task, length, step), tasks)
    return np.concatenate(parts), last


def together(function, tasks):
    """Results of a function that leaves the interpreter free, several at once, in order."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(function, tasks))


def _is_packed(node):
    """Whether an HDF5 dataset holds doubles along one dimension, packed as the store packs them."""
    plan = node.id.get_create_plist()
    filters = tuple(plan.get_filter(number)[0] for number in range(plan.get_nfilters()))
    return node.chunks is not None and node.ndim == 1 and node.dtype == np.dtype("<f8") and filters == FILTERS


def _samples(chunk, first, stop, length, step):
    """Samples first, first + step, ... before stop of one packed chunk."""
    shuffled = np.frombuffer(zlib.decompress(chunk, bufsize=8 * length), np.uint8).reshape(8, length)
    return np.ascontiguousarray(shuffled[:, first:stop:step].T).view("<f8").ravel()
