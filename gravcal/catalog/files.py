"""Where the catalogue's TOML files are, how they are read, and what is said when a name or a key is wrong."""

import difflib
import os
import tomllib
from functools import lru_cache
from importlib import resources
from pathlib import Path

from gravcal.errors import CatalogError, refuse

ENVIRONMENT = "GRAVCAL_CATALOG"
_added = []  # folders of calibrations of other packages


def roots():
    """Folders searched, in order: the user's own, the one of the package, those of other packages."""
    own = os.environ.get(ENVIRONMENT)
    if own and not Path(own).is_dir():
        expected, remedy = "a folder with satellites/, events/ or parameters/", f"Create it, or unset {ENVIRONMENT}."
        refuse(ENVIRONMENT, repr(own), expected, remedy, CatalogError)
    return [*([Path(own)] if own else []), resources.files("catalog"), *_added]


def add_root(folder):
    """Search one more folder, after those of the user and of the package."""
    if folder not in _added:
        _added.append(folder)


def names(kind, suffix=".toml"):
    """Names of all entries of a kind ("satellites", "events", ...), sorted."""
    folders = [root / kind for root in roots()]
    every = {entry.name for folder in folders if folder.is_dir() for entry in folder.iterdir()}
    return sorted(name.removesuffix(suffix) for name in every if name.endswith(suffix))


def find(kind, name, suffix=".toml"):
    """Path of one entry, the user's own before the shipped one; CatalogError names the nearest if there is none."""
    for root in roots():
        path = root / kind / f"{name}{suffix}"
        if path.is_file():
            return path
    raise unknown(kind.removesuffix("s"), name, names(kind, suffix), where="catalogue")


def read(kind, name):
    """Path of one TOML entry, for messages, and its content as a dict; what is wrong with it is said with the line."""
    path = find(kind, name)
    try:
        return path, _loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        found = f"bytes that are not UTF-8 ({error.reason} at byte {error.start})"
        return refuse(path, found, "a TOML file", "Save it as UTF-8.", CatalogError)
    except tomllib.TOMLDecodeError as error:
        return refuse(path, f"text that is not valid TOML ({error})", "a TOML file", "Correct it.", CatalogError)


@lru_cache(maxsize=128)
def _loads(text):
    """Content of a TOML text; the same satellite stands in many events."""
    return tomllib.loads(text)


def unknown(what, name, known, where):
    """CatalogError for a name that is not there, with the nearest that are."""
    near = difflib.get_close_matches(str(name).lower(), known, n=3, cutoff=0.5)
    hint = f"Nearest: {', '.join(near)}." if near else f"Known: {', '.join(known) or 'none'}."
    return CatalogError(
        f"{where}: no {what} named {name!r} among the {len(known)} known. {hint}", name=str(name), nearest=near
    )


def require(content, keys, path, optional=()):
    """Check that a table holds exactly these keys (and perhaps the optional ones)."""
    missing = [key for key in keys if key not in content]
    surplus = [key for key in content if key not in keys and key not in optional]
    if missing:
        refuse(path, sorted(content), f"also {', '.join(missing)}", "Add the missing key.", CatalogError)
    if surplus:
        expected = f"only {', '.join([*keys, *optional])}"
        refuse(path, f"the unknown key {surplus[0]!r}", expected, "Correct or remove it.", CatalogError)


def wrong(path, key, found, expected, remedy):
    """Refuse a value of the wrong kind."""
    refuse(f"{path}: {key}", repr(found), expected, remedy, CatalogError)
