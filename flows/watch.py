"""A folder that is watched: its inventory as a digest, and a loop that notices when it changed and came to rest."""

import contextlib
import hashlib

from gravcal.io import archive


def digest(folder):
    """Digest of the names, sizes and times of change of the Level-1 files and archives of a folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    digest : str, or None where there is no such file
    """
    seen = []
    for path in sorted(folder.rglob("*")):
        if not path.name.startswith(".") and (archive.is_archive(path) or archive.from_name(path)):
            with contextlib.suppress(OSError):  # it went while we looked
                status = path.stat()
                seen.append(f"{path.relative_to(folder)} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(seen).encode()).hexdigest() if seen else None


def loop(folder, every_s, ended, changed):
    """Call a function each time the folder changed and was then the same for two looks: copying takes time.

    Parameters
    ----------
    folder : Path
    every_s : float, between two looks
    ended : threading.Event, ends the loop
    changed : function without arguments; one that raises OSError is called again at the next look
    """
    known = last = None
    while not ended.wait(every_s):
        now = digest(folder)
        if now is not None and now == last and now != known:
            with contextlib.suppress(OSError):
                changed()
                known = now
        last = now
