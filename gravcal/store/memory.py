"""Contents this process has read or made, kept while they are small, and files whose bytes it has verified."""

import threading
from collections import OrderedDict

LIMIT = 256e6  # bytes kept in memory, the least recently used go first
_held = OrderedDict()  # path -> (size and time of change of the file), content, bytes of the content
_trusted = {}
_guard = threading.Lock()


def keep(path, dataset):
    """Keep a content, whose arrays nobody can change from now on, as long as its file does not change."""
    status = path.stat()
    for variable in dataset.variables.values():
        variable.values.flags.writeable = False
    with _guard:
        _held[path] = (status.st_size, status.st_mtime_ns), dataset, dataset.nbytes
        _held.move_to_end(path)
        while sum(size for _, _, size in _held.values()) > LIMIT:
            _held.popitem(last=False)


def recall(path):
    """A content kept, its labels the caller's own, its arrays shared; None if there is none or the file changed."""
    try:
        status = path.stat()
    except OSError:
        return None
    with _guard:
        seen, dataset, _ = _held.get(path, (None, None, None))
        if seen != (status.st_size, status.st_mtime_ns):
            return None
        _held.move_to_end(path)
    return dataset.copy()


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
