"""Contents this process has read or made, kept while they are small, and files whose bytes it has verified."""

import threading
from collections import OrderedDict

LIMIT = 256e6  # bytes kept in memory, the least recently used go first
_held = OrderedDict()
_trusted = {}
_guard = threading.Lock()


def keep(path, dataset):
    """Keep a content as long as its file does not change."""
    status = path.stat()
    with _guard:
        _held[path] = (status.st_size, status.st_mtime_ns), dataset
        _held.move_to_end(path)
        while sum(held.nbytes for _, held in _held.values()) > LIMIT:
            _held.popitem(last=False)


def recall(path):
    """Copy of a content kept, or None if there is none or the file changed."""
    try:
        status = path.stat()
    except OSError:
        return None
    with _guard:
        seen, dataset = _held.get(path, (None, None))
        if seen != (status.st_size, status.st_mtime_ns):
            return None
        _held.move_to_end(path)
    return dataset.copy(deep=True)


def drop(path):
    """Forget a content."""
    with _guard:
        _held.pop(path, None)


def trust(folder, status):
    """Note that the bytes of a product were verified as they are now."""
    _trusted[folder] = (status.st_size, status.st_mtime_ns)


def is_trusted(folder, status):
    """Whether the bytes were verified and have not changed since."""
    return _trusted.get(folder) == (status.st_size, status.st_mtime_ns)


def clear():
    """Forget everything, as a new process would."""
    with _guard:
        _held.clear()
    _trusted.clear()
