"""Where the store is, and where its readable links are for the configuration that is running.

The store is ``GRAVCAL_PRODUCTS``, or ``gravcal/products`` below the user's cache folder.
"""

import contextlib
import contextvars
import os
from pathlib import Path

OPERATIONAL = "operational"
_running = contextvars.ContextVar("gravcal_configuration", default=OPERATIONAL)


def folder():
    """Root of the store; nothing is created.

    Returns
    -------
    root : Path, absolute
    """
    named = os.environ.get("GRAVCAL_PRODUCTS")
    if named:
        return Path(named).expanduser().absolute()
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "gravcal" / "products"


def configuration():
    """Name of the configuration that is running: "operational", or that of an experiment."""
    return _running.get()


@contextlib.contextmanager
def configured(name):
    """Let links written and read inside be those of this configuration."""
    before = _running.set(name)
    try:
        yield
    finally:
        _running.reset(before)


def links(event, name=None):
    """Folder of the readable links of an event: ``latest/<event>``, of an experiment ``latest/<event>/as/<NAME>``.

    Parameters
    ----------
    event : str
    name : of a configuration, by default the one that is running
    """
    found = folder() / "latest" / event
    name = name or configuration()
    return found if name == OPERATIONAL else found / "as" / name
