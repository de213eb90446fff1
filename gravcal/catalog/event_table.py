"""Calibration events: who manoeuvred when, as designed and as found, and the Level-1 files that hold it."""

import datetime
import re
from collections.abc import Mapping
from dataclasses import dataclass

from gravcal.catalog import files
from gravcal.catalog.satellite_table import satellite

REQUIRED = ("calibration", "satellites", "date", "date_status", "source", "design", "release", "found")
OPTIONAL = ("end_date", "date_as_printed", "note", "printed", "sha256", "origin")
STATUS = ("printed", "corrected", "unknown")
ORIGINS = ("measured", "simulated")
FOUND = ("kind", "start", "stop")
DESIGN = ("calibration", "source", "products", "manoeuvre")
DESIGNED = ("kind", "count", "duration_s", "period_s")
SUFFIXES = {"GRACE": "dat", "GRACE-FO": "txt"}
PAIRS = {"GRACE": ("AB", "X"), "GRACE-FO": ("CD", "Y")}


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
    """One manoeuvre found in the data; start and stop in GPS seconds past 2000-01-01 12:00:00.

    satellite : letter, where the event is of several and one of them moved
    """

    kind: str
    start: float
    stop: float
    satellite: str = ""


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


def event(name):
    """Event of the catalogue by name, ``grace-c-2020-02-01``.

    Raises
    ------
    CatalogError : unknown name, or a file that breaks the form of an event
    """
    known = files.names("events")
    if name not in known:
        raise files.unknown("event", name, known, where="catalogue")
    path, content = files.read("events", name)
    _check(content, path)
    date = _date(content, "date", path)
    end_date = _date(content, "end_date", path) or date
    design_path, design = files.read("designs", content["design"])
    files.require(design, DESIGN, design_path)
    members = tuple(satellite(member) for member in content["satellites"])
    return Event(
        name=name,
        calibration=content["calibration"],
        satellites=tuple(member.name for member in members),
        letters="".join(member.letter for member in members),
        date=date,
        end_date=end_date,
        date_status=_status(content, path),
        date_as_printed=_date(content, "date_as_printed", path),
        source=content["source"],
        note=content.get("note", ""),
        designed=tuple(_designed(table, design_path) for table in design["manoeuvre"]),
        printed=tuple(table for table in content.get("printed", [])),
        found=tuple(_found(table, path) for table in content["found"]),
        raw_files=_raw_files(content, design, members, _days(date, end_date), path),
        origin=_origin(name, path, content),
    )


def origin(name):
    """Origin that an event of the catalogue states for its files, "" where it states none or there is no such event."""
    return files.made("events", name, _origin) if name in files.names("events") else ""


def events(satellite=None, calibration=None):
    """Events of the catalogue, by date, those of unknown date last.

    Parameters
    ----------
    satellite : str or None, letter or name of a satellite that manoeuvred
    calibration : str or None, "com_offset" ...

    Returns
    -------
    events : tuple of Event
    """
    wanted = None if satellite is None else _satellite_name(satellite)
    every = [event(name) for name in files.names("events")]
    chosen = [
        entry
        for entry in every
        if (wanted is None or wanted in entry.satellites) and calibration in (None, entry.calibration)
    ]
    return tuple(sorted(chosen, key=lambda entry: (entry.date or datetime.date.max, entry.name)))


def _satellite_name(name):
    """Name of the satellite; the parameter of `events` hides the function."""
    return satellite(name).name


def _check(content, path):
    """Keys, calibration and satellites are what an event has."""
    files.require(content, REQUIRED, path, OPTIONAL)
    if not isinstance(content["calibration"], str):
        raise files.wrong(path, "calibration", content["calibration"], "its name", "Name the calibration.")
    if not isinstance(content["satellites"], list) or not content["satellites"]:
        raise files.wrong(path, "satellites", content["satellites"], "a list of names", 'Write ["grace-c"].')


def _origin(name, path, content):  # noqa: ARG001 - as files.made calls it
    """Origin that an event states: its files may be simulated without saying so."""
    found = content.get("origin", "")
    if found not in ("", *ORIGINS):
        raise files.wrong(path, "origin", found, f"one of {', '.join(ORIGINS)}", "Leave it out where the files say it.")
    return found


def _date(content, key, path):
    """Date, or None where there is none or it is unknown."""
    found = content.get(key, "unknown")
    if found == "unknown":
        return None
    if not isinstance(found, datetime.date):
        raise files.wrong(path, key, found, 'a date or "unknown"', "Write it as 2020-02-01, without quotes.")
    return found


def _status(content, path):
    """How far the date is trusted; agrees with the date."""
    status = content["date_status"]
    if status not in STATUS:
        raise files.wrong(path, "date_status", status, f"one of {', '.join(STATUS)}", "Say where the date is from.")
    if (status == "unknown") != (content["date"] == "unknown"):
        raise files.wrong(path, "date_status", status, f"a status that fits date {content['date']}", "Correct one.")
    return status


def _designed(table, path):
    """Planned manoeuvres of one kind."""
    missing = [key for key in DESIGNED if key not in table]
    if missing:
        raise files.wrong(path, "manoeuvre", sorted(table), f"also {', '.join(missing)}", "Add the key.")
    facts = {key: value for key, value in table.items() if key not in DESIGNED}
    return Designed(*(table[key] for key in DESIGNED), facts=facts)


def _found(table, path):
    """Manoeuvre found in the data."""
    files.require(table, FOUND, f"{path}: [[found]]", ("satellite",))
    if not table["stop"] > table["start"]:
        raise files.wrong(path, "found.stop", table["stop"], f"later than start {table['start']}", "Correct the times.")
    return Manoeuvre(table["kind"], float(table["start"]), float(table["stop"]), table.get("satellite", ""))


def _days(first, last):
    """Days of an event; none where the date is unknown."""
    return [] if first is None else [first + datetime.timedelta(days=n) for n in range((last - first).days + 1)]


def _raw_files(content, design, members, days, path):
    """Every Level-1 file the event needs, day by day."""
    digests = content.get("sha256", {})
    for name, digest in digests.items():
        if not re.fullmatch("[0-9a-f]{64}", str(digest)):
            raise files.wrong(path, f"sha256.{name}", digest, "64 hexadecimal digits", "Run sha256sum on the file.")
    needed = [item for member in members for item in _products(design, member)]
    mission, release = members[0].mission, content["release"]
    suffix = SUFFIXES.get(mission, "nc")
    raw = [
        (f"{item[0]}_{day}_{item[1]}_{release}.{suffix}", *item, day) for day in days for item in dict.fromkeys(needed)
    ]
    return tuple(RawFile(*entry, release, digests.get(entry[0])) for entry in raw)


def _products(design, member):
    """Pairs of product and letter that a satellite's event needs; ranging needs both satellites and the pair's own."""
    products = design["products"].get(member.mission, {})
    pair, both = PAIRS.get(member.mission, (member.letter, ""))
    letters = {"own": member.letter, "pair": pair, "ranging": both}
    return [(product, letter) for key in letters for product in products.get(key, []) for letter in letters[key]]
