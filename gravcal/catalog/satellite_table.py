"""Satellites: constants with value, unit, frame, sigma and source, as frozen records."""

import datetime
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gravcal.catalog import files

QUANTITY = ("value", "unit", "frame", "sigma", "source")
HEADING = ("letter", "mission", "platform", "launched")
FRAMES = ("none", "i", "e", "o", "b", "s", "bs")


@dataclass(frozen=True, eq=False)
class Quantity:
    """One constant. An unknown sigma is None; sigma has the shape of the value."""

    value: float | np.ndarray | str | tuple[str, ...]
    unit: str
    frame: str
    sigma: float | np.ndarray | None
    source: str


@dataclass(frozen=True, eq=False)
class Satellite:
    """One satellite; its quantities are attributes: ``satellite.com_to_antenna.value``. Not launched: None."""

    name: str
    letter: str
    mission: str
    platform: str
    launched: datetime.date | None
    quantities: Mapping[str, Quantity]

    def __getattr__(self, name):
        """Quantity of that name."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.quantities:
            return self.quantities[name]
        raise files.unknown("quantity", name, sorted(self.quantities), where=f"satellite {self.name}")

    def __dir__(self):
        """Fields and quantities, for completion."""
        return [*super().__dir__(), *self.quantities]

    def settings(self, *names):
        """Plain numbers for the settings of a stage: ``{name: value, name_sigma: sigma}``.

        Parameters
        ----------
        *names : quantities wanted; none means all that are numbers

        Returns
        -------
        settings : dict of float and nested lists; ``_sigma`` only where a sigma is known
        """
        wanted = names or [name for name, q in self.quantities.items() if not isinstance(q.value, (str, tuple))]
        plain = {}
        for name in wanted:
            quantity = getattr(self, name)
            plain[name] = _plain(quantity.value)
            if quantity.sigma is not None:
                plain[f"{name}_sigma"] = _plain(quantity.sigma)
        return plain


def satellite(name):
    """Satellite by letter or name: "C", "grace-c", "GRACE C", "GRACE-C".

    Raises
    ------
    CatalogError : unknown name, or a file that breaks the form of a quantity
    """
    key = str(name).strip().lower().replace(" ", "-").replace("_", "-")
    known = files.names("satellites")
    if len(key) == 1:
        key = next(
            (entry for entry in known if files.read("satellites", entry)[1].get("letter", "").lower() == key), key
        )
    if key not in known:
        raise files.unknown("satellite", name, known, where="catalogue")
    return files.made("satellites", key, _satellite)


def _satellite(key, path, content):
    """Satellite from the content of its file."""
    tables = {k: v for k, v in content.items() if isinstance(v, dict)}
    heading = {k: v for k, v in content.items() if k not in tables}
    files.require(heading, HEADING, path)
    heading["launched"] = _checked_launch(heading, path)
    quantities = {k: quantity(v, path, k) for k, v in tables.items()}
    return Satellite(name=key, **heading, quantities=quantities)


def quantity(table, path, key):
    """Quantity from its TOML table; every departure from the form is named."""
    files.require(table, QUANTITY, f"{path}: [{key}]")
    for text in ("unit", "frame", "source"):
        if not isinstance(table[text], str) or not table[text].strip():
            raise files.wrong(path, f"{key}.{text}", table[text], "a text that is not empty", "State it.")
    if table["frame"] not in FRAMES:
        raise files.wrong(path, f"{key}.frame", table["frame"], f"one of {', '.join(FRAMES)}", "Name the frame.")
    value = _value(table["value"], path, f"{key}.value")
    sigma = None if table["sigma"] == "unknown" else _value(table["sigma"], path, f"{key}.sigma")
    if sigma is not None and (isinstance(value, (str, tuple)) or np.shape(sigma) != np.shape(value)):
        remedy = 'Give one sigma per number, or "unknown".'
        raise files.wrong(path, f"{key}.sigma", table["sigma"], f"the shape of the value, {np.shape(value)}", remedy)
    if sigma is not None and np.min(sigma) < 0:
        raise files.wrong(path, f"{key}.sigma", table["sigma"], "no negative number", "Correct the sign.")
    return Quantity(value, table["unit"], table["frame"], sigma, table["source"])


def _checked_launch(heading, path):
    """Launch date, None for "none", once the heading's entries are known to have their types."""
    for key in HEADING[:3]:
        if not isinstance(heading[key], str):
            raise files.wrong(path, key, heading[key], "a text", "Put it in quotes.")
    launched = heading["launched"]
    if launched != "none" and not isinstance(launched, datetime.date):
        raise files.wrong(path, "launched", launched, 'a date or "none"', "Write it as 2018-05-22, without quotes.")
    return None if launched == "none" else launched


def _value(entry, path, key):
    """Float, read-only array, text or tuple of texts."""
    if isinstance(entry, str):
        return entry
    if isinstance(entry, list) and entry and all(isinstance(item, str) for item in entry):
        return tuple(entry)
    if isinstance(entry, bool):
        raise files.wrong(path, key, entry, "a number or a list of numbers", "Write a number.")
    try:
        array = np.array(entry, dtype=float)
    except (TypeError, ValueError) as error:
        raise files.wrong(path, key, entry, "a number or a full list of numbers", "Correct the list.") from error
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise files.wrong(path, key, entry, "finite numbers", "Leave the quantity out if it is not known.")
    array.flags.writeable = False
    return float(array) if array.ndim == 0 else array


def _plain(value):
    """Lists and floats instead of arrays."""
    return value.tolist() if isinstance(value, np.ndarray) else value
