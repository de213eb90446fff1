"""Where the store is: ``GRAVCAL_PRODUCTS``, or ``gravcal/products`` below the user's cache folder."""

import os
from pathlib import Path


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
