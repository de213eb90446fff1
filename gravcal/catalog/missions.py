"""Satellites, their calibration events, and what was published of them.

Constants of a satellite have value, unit, frame, sigma and source; events have a date, planned and found manoeuvres and
the Level-1 files that hold them; published values are as printed, each with its citation.
"""

import csv
import datetime
import io
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from pathlib import Path

import numpy as np

from gravcal.catalog import files
from gravcal.errors import CatalogError, refuse

QUANTITY = ("value", "unit", "frame", "sigma", "source")
HEADING = ("letter", "mission", "platform", "launched")
FRAMES = ("none", "i", "e", "o", "b", "s", "bs")
REQUIRED = ("calibration", "satellites", "date", "date_status", "source", "design", "release", "found")
OPTIONAL = ("end_date", "date_as_printed", "note", "printed", "sha256", "origin")
STATUS = ("printed", "corrected", "unknown")
ORIGINS = ("measured", "simulated")
FOUND = ("kind", "start", "stop")
DESIGN = ("calibration", "source", "products", "manoeuvre")
DESIGNED = ("kind", "count", "duration_s", "period_s")
SUFFIXES = {"GRACE": "dat", "GRACE-FO": "txt"}
PAIRS = {"GRACE": ("AB", "X"), "GRACE-FO": ("CD", "Y")}
RELEASES = {"GRACE": "02", "GRACE-FO": "04"}
TABLE = ("file", "calibration", "section", "doi", "table", "labels", "value", "sigma", "unit", "direction", "note")


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
        """Plain numbers of these quantities, or all: ``{name: value, name_sigma: sigma}``, sigma where known."""
        wanted = names or [name for name, q in self.quantities.items() if not isinstance(q.value, (str, tuple))]
        values = {name: getattr(self, name).value for name in wanted}
        sigmas = {f"{name}_sigma": getattr(self, name).sigma for name in wanted}
        every = values | {name: sigma for name, sigma in sigmas.items() if sigma is not None}
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in every.items()}


@dataclass(frozen=True)
class Designed:
    """Manoeuvres of one kind as planned: how many, how long, and where or how far (``facts``)."""

    kind: str
    count: int
    duration_s: float
    period_s: float
    facts: Mapping[str, object]


@dataclass(frozen=True)
class Manoeuvre:
    """One manoeuvre found in the data; start and stop in GPS seconds past 2000-01-01 12:00:00."""

    kind: str
    start: float
    stop: float
    satellite: str = ""  #: letter, where the event is of several and one of them moved


@dataclass(frozen=True)
class RawFile:
    """One Level-1 file an event needs; its SHA-256 is None until the file was at hand."""

    name: str
    product: str
    letter: str
    date: datetime.date
    release: str
    sha256: str | None


@dataclass(frozen=True)
class Event:
    """One event of the catalogue; ``date`` is None where it is not known, ``origin`` "" where the files say it."""

    name: str
    calibration: str
    satellites: tuple[str, ...]
    letters: str
    date: datetime.date | None
    end_date: datetime.date | None
    date_status: str
    date_as_printed: datetime.date | None
    source: str
    note: str
    designed: tuple[Designed, ...]
    printed: tuple[Mapping[str, object], ...]
    found: tuple[Manoeuvre, ...]
    raw_files: tuple[RawFile, ...]
    origin: str


def satellite(name):
    """Satellite by letter or name: "C", "grace-c", "GRACE C", "GRACE-C"."""
    key = str(name).strip().lower().replace(" ", "-").replace("_", "-")
    known = files.names("satellites")
    if len(key) == 1:
        named = (entry for entry in known if files.read("satellites", entry)[1].get("letter", "").lower() == key)
        key = next(named, key)
    if key not in known:
        raise files.unknown("satellite", name, known, where="catalogue")
    return _satellite(key, *files.read("satellites", key))


def _satellite(key, path, content):
    """Satellite from the content of its file."""
    tables = {name: entry for name, entry in content.items() if isinstance(entry, dict)}
    heading = {name: entry for name, entry in content.items() if name not in tables}
    files.require(heading, HEADING, path)
    for name in HEADING[:3]:
        if not isinstance(heading[name], str):
            files.wrong(path, name, heading[name], "a text", "Put it in quotes.")
    launched = heading.pop("launched")
    if launched != "none" and not isinstance(launched, datetime.date):
        files.wrong(path, "launched", launched, 'a date or "none"', "Write it as 2018-05-22, without quotes.")
    quantities = {name: _quantity(table, path, name) for name, table in tables.items()}
    return Satellite(key, **heading, launched=None if launched == "none" else launched, quantities=quantities)


def _quantity(table, path, key):
    """Quantity from its TOML table; every departure from the form is named."""
    files.require(table, QUANTITY, f"{path}: [{key}]")
    for text in ("unit", "frame", "source"):
        if not isinstance(table[text], str) or not table[text].strip():
            files.wrong(path, f"{key}.{text}", table[text], "a text that is not empty", "State it.")
    if table["frame"] not in FRAMES:
        files.wrong(path, f"{key}.frame", table["frame"], f"one of {', '.join(FRAMES)}", "Name the frame.")
    value = _value(table["value"], path, f"{key}.value")
    sigma = None if table["sigma"] == "unknown" else _value(table["sigma"], path, f"{key}.sigma")
    if sigma is not None and (isinstance(value, (str, tuple)) or np.shape(sigma) != np.shape(value)):
        remedy = 'Give one sigma per number, or "unknown".'
        files.wrong(path, f"{key}.sigma", table["sigma"], f"the shape of the value, {np.shape(value)}", remedy)
    if sigma is not None and np.min(sigma) < 0:
        files.wrong(path, f"{key}.sigma", table["sigma"], "no negative number", "Correct the sign.")
    return Quantity(value, table["unit"], table["frame"], sigma, table["source"])


def _value(entry, path, key):
    """Float, read-only array, text or tuple of texts."""
    if isinstance(entry, str):
        return entry
    if isinstance(entry, list) and entry and all(isinstance(item, str) for item in entry):
        return tuple(entry)
    try:
        array = np.array(entry, dtype=float)
    except (TypeError, ValueError):
        array = None
    if array is None or isinstance(entry, bool):
        files.wrong(path, key, entry, "a number or a full list of numbers", "Correct it.")
    if array.size == 0 or not np.all(np.isfinite(array)):
        files.wrong(path, key, entry, "finite numbers", "Leave the quantity out if it is not known.")
    array.flags.writeable = False
    return float(array) if array.ndim == 0 else array


def event(name):
    """Event of the catalogue by name, ``grace-c-2020-02-01``."""
    known = files.names("events")
    if name not in known:
        raise files.unknown("event", name, known, where="catalogue")
    path, content = files.read("events", name)
    files.require(content, REQUIRED, path, OPTIONAL)
    if not isinstance(content["calibration"], str):
        files.wrong(path, "calibration", content["calibration"], "its name", "Name the calibration.")
    if not isinstance(content["satellites"], list) or not content["satellites"]:
        files.wrong(path, "satellites", content["satellites"], "a list of names", 'Write ["grace-c"].')
    date = _date(content, "date", path)
    status = content["date_status"]
    if status not in STATUS:
        files.wrong(path, "date_status", status, f"one of {', '.join(STATUS)}", "Say where the date is from.")
    if (status == "unknown") != (date is None):
        files.wrong(path, "date_status", status, f"a status that fits date {content['date']}", "Correct one.")
    end_date = _date(content, "end_date", path) or date
    design_path, design = files.read("designs", content["design"])
    files.require(design, DESIGN, design_path)
    for table in design["manoeuvre"]:
        if missing := [key for key in DESIGNED if key not in table]:
            files.wrong(design_path, "manoeuvre", sorted(table), f"also {', '.join(missing)}", "Add the key.")
    members = tuple(satellite(member) for member in content["satellites"])
    designed = (
        ([table[key] for key in DESIGNED], {key: item for key, item in table.items() if key not in DESIGNED})
        for table in design["manoeuvre"]
    )
    return Event(
        name=name,
        calibration=content["calibration"],
        satellites=tuple(member.name for member in members),
        letters="".join(member.letter for member in members),
        date=date,
        end_date=end_date,
        date_status=status,
        date_as_printed=_date(content, "date_as_printed", path),
        source=content["source"],
        note=content.get("note", ""),
        designed=tuple(Designed(*planned, facts=facts) for planned, facts in designed),
        printed=tuple(content.get("printed", [])),
        found=tuple(_found(table, path) for table in content["found"]),
        raw_files=() if date is None else _raw_files(content, design, members, (date, end_date), path),
        origin=_origin(path, content),
    )


def event_origin(name):
    """Origin that an event of the catalogue states for its files, "" where it states none or there is no such event."""
    return _origin(*files.read("events", name)) if name in files.names("events") else ""


def events(satellite=None, calibration=None):
    """Events of the catalogue of a satellite (letter or name) and calibration, by date, those of unknown date last."""
    wanted = None if satellite is None else _name_of(satellite)
    every = [event(name) for name in files.names("events")]
    every = [one for one in every if wanted in (None, *one.satellites) and calibration in (None, one.calibration)]
    return tuple(sorted(every, key=lambda one: (one.date or datetime.date.max, one.name)))


def _name_of(member):
    """Name of a satellite; the parameter of `events` hides the function."""
    return satellite(member).name


def _origin(path, content):
    """Origin that an event states: its files may be simulated without saying so."""
    origin = content.get("origin", "")
    if origin not in ("", *ORIGINS):
        files.wrong(path, "origin", origin, f"one of {', '.join(ORIGINS)}", "Leave it out where the files say it.")
    return origin


def _date(content, key, path):
    """Date, or None where there is none or it is unknown."""
    date = content.get(key, "unknown")
    if date != "unknown" and not isinstance(date, datetime.date):
        files.wrong(path, key, date, 'a date or "unknown"', "Write it as 2020-02-01, without quotes.")
    return None if date == "unknown" else date


def _found(table, path):
    """Manoeuvre found in the data."""
    files.require(table, FOUND, f"{path}: [[found]]", ("satellite",))
    if not table["stop"] > table["start"]:
        files.wrong(path, "found.stop", table["stop"], f"later than start {table['start']}", "Correct the times.")
    return Manoeuvre(table["kind"], float(table["start"]), float(table["stop"]), table.get("satellite", ""))


def _raw_files(content, design, members, span, path):
    """Every Level-1 file the event needs, day by day; ranging needs both satellites and the pair's own."""
    digests = content.get("sha256", {})
    for name, digest in digests.items():
        if not re.fullmatch("[0-9a-f]{64}", str(digest)):
            files.wrong(path, f"sha256.{name}", digest, "64 hexadecimal digits", "Run sha256sum on the file.")
    needed = {}  # in the order of the design, each once
    for member in members:
        pair, both = PAIRS.get(member.mission, (member.letter, ""))
        products = design["products"].get(member.mission, {})
        for kind, letters in (("own", member.letter), ("pair", pair), ("ranging", both)):
            needed |= {(product, letter): None for product in products.get(kind, []) for letter in letters}
    release, suffix, raw = content["release"], SUFFIXES.get(members[0].mission, "nc"), []
    for day in (span[0] + datetime.timedelta(days=n) for n in range((span[1] - span[0]).days + 1)):
        for product, letter in needed:
            name = f"{product}_{day}_{letter}_{release}.{suffix}"
            raw.append(RawFile(name, product, letter, day, release, digests.get(name)))
    return tuple(raw)


def event_text(calibration, design, satellites, date, found, sha256, origin="measured"):
    """TOML text of an event found in data: manoeuvres with kind, start, stop (GPS s), SHA-256 by name of the file."""
    members = [satellite(name) for name in satellites]
    names = ", ".join(f'"{member.name}"' for member in members)
    lines = [
        f'calibration = "{calibration}"',
        f"satellites = [{names}]",
        f"date = {date.isoformat()}",
        'date_status = "printed"',
        f'source = "found in the {"" if origin == "measured" else f"{origin} "}Level-1 files below"',
        f'design = "{design}"',
        f'release = "{RELEASES.get(members[0].mission, "01")}"',
        *([] if found else ["found = []"]),
    ]
    for item in found:
        row = item if isinstance(item, dict) else vars(item)
        lines += ["", "[[found]]", f'kind = "{row["kind"]}"']
        lines += [f"{name} = {float(row[name])!r}" for name in ("start", "stop")]  # with all their digits
        lines += [f'satellite = "{row["satellite"]}"'] if row.get("satellite") else []
    lines += ["", "[sha256]", *(f'"{name}" = "{digest}"' for name, digest in sorted(sha256.items()))]
    return "\n".join(lines) + "\n"


def save_event(name, text):
    """Write the text of an event into the user's own catalogue, and read the event back."""
    own = os.environ.get(files.ENVIRONMENT)
    if not own:
        expected, remedy = f"a folder in {files.ENVIRONMENT}", f"Set {files.ENVIRONMENT} to a folder of yours."
        refuse(name, "no own catalogue to write to", expected, remedy, CatalogError, event=name)
    path = Path(own) / "events" / f"{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_suffix(f".{os.getpid()}.tmp")
    aside.write_text(text, encoding="utf-8")
    aside.replace(path)
    return event(name)


@dataclass(frozen=True)
class Published:
    """One printed result. A blank of the print is None; ``rounding`` is half the last printed digit."""

    section: str
    events: tuple[str, ...]
    labels: Mapping[str, str]
    value: tuple
    sigma: tuple
    rounding: tuple
    unit: str
    direction: str
    source: str
    note: str

    def __getattr__(self, name):
        """Label of that name: ``record.variant``."""
        if name in object.__getattribute__(self, "labels"):
            return self.labels[name]
        raise AttributeError(name)


@dataclass(frozen=True)
class Trim:
    """One move of the trim masses; ``confirmed`` says whether the series of offsets shows it."""

    satellite: str
    date: datetime.date
    axis: str
    trim_um: float
    confirmed: bool
    note: str
    source: str


def published(calibration, event=None):
    """Published values of a calibration by section ("combined", "history" ...), tuples of Published.

    Of an event, or of none in particular, where one is given.
    """
    path, tables = files.read("published", "tables")
    sections = {}
    for name, table in tables.items():
        files.require(table, TABLE, f"{path}: [{name}]", ("events",))
        if table["calibration"] == calibration:
            file = files.find("published", table["file"], suffix="")
            records = _parsed(file, file.read_text(encoding="utf-8"), json.dumps(table))
            sections.setdefault(table["section"], []).extend(records)
    if not sections:
        known = sorted({table["calibration"] for table in tables.values()})
        raise files.unknown("calibration with published values", calibration, known, where="catalogue")
    chosen = {
        name: tuple(one for one in records if event is None or not one.events or event in one.events)
        for name, records in sections.items()
    }
    return {name: records for name, records in chosen.items() if records}


def trims(satellite=None, confirmed=None):
    """Mass trims by date, of a satellite (letter or name), and such as the series of offsets does or does not show."""
    path, content = files.read("published", "trims")
    wanted = None if satellite is None else _name_of(satellite)
    for table in content["trim"]:
        files.require(table, tuple(Trim.__dataclass_fields__), f"{path}: [[trim]]")
    chosen = [Trim(**table) for table in content["trim"]]
    return tuple(t for t in chosen if wanted in (None, t.satellite) and confirmed in (None, t.confirmed))


@lru_cache(maxsize=64)
def _parsed(path, text, table):
    """Records of the text of a CSV file; a campaign asks for them with every event."""
    table, rows = json.loads(table), csv.DictReader(io.StringIO(text))
    missing = [c for c in (*table["labels"], *table["value"], *table["sigma"]) if c not in (rows.fieldnames or [])]
    if missing:
        files.wrong(path, "header", rows.fieldnames, f"also {', '.join(missing)}", "Correct tables.toml.")
    return tuple(_record(row, table) for row in rows)


def _record(row, table):
    """One record of one row."""
    events = tuple(filter(None, row["events"].split(";"))) if "events" in row else tuple(table.get("events", ()))
    return Published(
        section=table["section"],
        events=events,
        labels={key: row[key] for key in table["labels"]},
        value=tuple(_number(row[key]) for key in table["value"]),
        sigma=tuple(_number(row[key]) for key in table["sigma"]),
        rounding=tuple(_rounding(row[key]) for key in table["value"]),
        unit=row["unit"] if table["unit"] == "column" else table["unit"],
        direction=table["direction"],
        source=f"{table['doi']}, {table['table']}",
        note=table["note"],
    )


def _number(text):
    """Float, None for a blank, or the text itself where the print has no number."""
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def _rounding(text):
    """Half the last printed digit, or None."""
    try:
        return float(Decimal(5).scaleb(Decimal(text).as_tuple().exponent - 1))
    except InvalidOperation:
        return None
