"""The catalogue: satellites, events, parameters and published values, read from TOML and CSV files.

``satellite("C")``, ``event("grace-c-2020-02-01")``, ``events(satellite="C")``, ``names("events")``,
``parameters("com_offset")``, ``published("com_offset")`` and ``trims("C")`` ask it, ``save_event`` adds to it. Files
ship with the package; a folder named by the environment variable GRAVCAL_CATALOG is searched first: a user's own
entries add or override.

What each holds: docs/adding_a_satellite.md, docs/adding_an_event.md. Published values are as printed, with citation.
"""

import csv
import datetime
import difflib
import io
import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path

import jsonschema_rs
import numpy as np

from gravcal import toml
from gravcal.errors import CatalogError, refuse

SUFFIXES = {"GRACE": "dat", "GRACE-FO": "txt"}
PAIRS = {"GRACE": ("AB", "X"), "GRACE-FO": ("CD", "Y")}
RELEASES = {"GRACE": "02", "GRACE-FO": "04"}
DESIGNED = ("kind", "count", "duration_s", "period_s")  # fields of `Designed`; all others of a table are its facts
WORDS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
ENVIRONMENT = "GRAVCAL_CATALOG"
_added = []  # folders of calibrations of other packages


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
    quantities: Mapping[str, Quantity]  #: by name, such as "com_to_antenna"

    def __getattr__(self, name):
        """Quantity of that name; CatalogError names the nearest if there is none."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.quantities:
            return self.quantities[name]
        raise _unknown("quantity", name, sorted(self.quantities), where=f"satellite {self.name}")

    def __dir__(self):
        """Fields and quantities, for completion."""
        return [*super().__dir__(), *self.quantities]

    def settings(self, *names):
        """Settings ``{name: value, name_sigma: sigma}`` of these quantities (none: all numbers), sigma where known."""
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
class Design:
    """Manoeuvres of a session as planned, and the Level-1 products {mission: {whose: names}} that they need."""

    calibration: str
    source: str
    manoeuvres: tuple[Designed, ...]
    products: Mapping[str, Mapping]  #: whose: "own" satellites, both of the "pair", its "ranging" (X, Y)


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
    letter: str  #: of the satellite; X or Y of a pair
    date: datetime.date
    release: str
    sha256: str | None


@dataclass(frozen=True)
class Event:
    """One event of the catalogue; ``date`` is None where it is not known, ``origin`` "" where the files say it."""

    name: str
    calibration: str
    satellites: tuple[str, ...]  #: names
    letters: str  #: of these
    date: datetime.date | None
    end_date: datetime.date | None
    date_status: str  #: "printed", "unknown" ...
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
    known = names("satellites")
    if len(key) == 1:
        named = (entry for entry in known if read("satellites", entry)[1].get("letter", "").lower() == key)
        key = next(named, key)
    if key not in known:
        raise _unknown("satellite", name, known, where="catalogue")
    path, content = read("satellites", key)
    tables = {name: entry for name, entry in content.items() if isinstance(entry, dict)}
    heading = {name: entry for name, entry in content.items() if name not in tables}
    heading["launched"] = None if heading["launched"] == "none" else _date(heading, "launched")
    quantities = {}
    for name, table in tables.items():
        value = _value(table["value"], path, f"{name}.value")
        sigma = None if table["sigma"] == "unknown" else _value(table["sigma"], path, f"{name}.sigma")
        if sigma is not None and (isinstance(value, (str, tuple)) or np.shape(sigma) != np.shape(value)):
            remedy = 'Give one sigma per number, or "unknown".'
            _wrong(path, f"{name}.sigma", table["sigma"], f"the shape of the value, {np.shape(value)}", remedy)
        if sigma is not None and np.min(sigma) < 0:
            _wrong(path, f"{name}.sigma", table["sigma"], "no negative number", "Correct the sign.")
        quantities[name] = Quantity(value, table["unit"], table["frame"], sigma, table["source"])
    return Satellite(key, **heading, quantities=quantities)


_satellite = satellite  # for functions with a parameter of that name


def _value(entry, path, key):
    """Value of a TOML entry: float, read-only array, text or tuple of texts; path and key are for messages."""
    if isinstance(entry, str) or isinstance(entry, list) and isinstance(entry[0], str):
        return entry if isinstance(entry, str) else tuple(entry)
    try:
        numbers = np.array(entry, dtype=float)
    except ValueError:
        _wrong(path, key, entry, "a full list of numbers", "Correct it.")
    if not np.isfinite(numbers).all():
        _wrong(path, key, entry, "finite numbers", "Leave the quantity out if it is not known.")
    numbers.flags.writeable = False
    return float(numbers) if numbers.ndim == 0 else numbers


def event(name):
    """Event of the catalogue by name, ``grace-c-2020-02-01``; CatalogError names the nearest if there is none."""
    known = names("events")
    if name not in known:
        raise _unknown("event", name, known, where="catalogue")
    path, content = read("events", name)
    date, status = _date(content, "date"), content["date_status"]
    if (status == "unknown") != (date is None):
        _wrong(path, "date_status", status, f"a status that fits date {content['date']}", "Correct one.")
    end_date = _date(content, "end_date") or date
    planned = design(content["design"])
    members = tuple(satellite(member) for member in content["satellites"])
    for one in content["found"]:
        if not one["stop"] > one["start"]:
            _wrong(path, "found.stop", one["stop"], f"later than start {one['start']}", "Correct the times.")
    return Event(
        name=name,
        calibration=content["calibration"],
        satellites=tuple(member.name for member in members),
        letters="".join(member.letter for member in members),
        date=date,
        end_date=end_date,
        date_status=status,
        date_as_printed=_date(content, "date_as_printed"),
        source=content["source"],
        note=content.get("note", ""),
        designed=planned.manoeuvres,
        printed=tuple(content.get("printed", [])),
        found=tuple(Manoeuvre(**one | {n: float(one[n]) for n in ("start", "stop")}) for one in content["found"]),
        raw_files=() if date is None else _raw_files(content, planned.products, members, (date, end_date)),
        origin=content.get("origin", ""),
    )


def design(name):
    """Design of the catalogue by name, or of a file by its path (a name that ends with .toml)."""
    _, content = read_file(Path(name), "designs") if str(name).endswith(".toml") else read("designs", name)
    manoeuvres = []
    for table in content["manoeuvre"]:
        facts = {key: item for key, item in table.items() if key not in DESIGNED}
        manoeuvres.append(Designed(*(table[key] for key in DESIGNED), facts=facts))
    return Design(content["calibration"], content["source"], tuple(manoeuvres), content.get("products", {}))


def event_origin(name):
    """Origin that an event of the catalogue states for its files, "" where it states none or there is no such event."""
    return read("events", name)[1].get("origin", "") if name in names("events") else ""


def events(satellite=None, calibration=None):
    """Events of the catalogue of a satellite (letter or name) and calibration, by date, those of unknown date last."""
    wanted = satellite and _satellite(satellite).name
    every = [event(name) for name in names("events")]
    every = [one for one in every if wanted in (None, *one.satellites) and calibration in (None, one.calibration)]
    return tuple(sorted(every, key=lambda one: (one.date or datetime.date.max, one.name)))


def _date(content, key):  # date of a TOML entry, None if it is missing or "unknown"
    date = content.get(key, "unknown")
    return None if date == "unknown" else datetime.date.fromisoformat(str(date))


def _raw_files(content, designed, members, span):
    """RawFile of every Level-1 file an event needs, day by day; span: first and last date; members: Satellites."""
    digests = content.get("sha256", {})
    wanted = {}  # in the order of the design, each once
    for member in members:
        pair, ranging = PAIRS.get(member.mission, (member.letter, ""))
        products = designed.get(member.mission, {})
        for kind, letters in (("own", member.letter), ("pair", pair), ("ranging", ranging)):
            wanted |= {(product, letter): None for product in products.get(kind, []) for letter in letters}
    release, suffix, raw = content["release"], SUFFIXES.get(members[0].mission, "nc"), []
    for day in (span[0] + datetime.timedelta(days=n) for n in range((span[1] - span[0]).days + 1)):
        for product, letter in wanted:
            name = f"{product}_{day}_{letter}_{release}.{suffix}"
            raw.append(RawFile(name, product, letter, day, release, digests.get(name)))
    return tuple(raw)


def event_text(calibration, design, satellites, date, manoeuvres, sha256, origin="measured", source="", last=None):
    """TOML text of an event found in data: manoeuvres with kind, start, stop (GPS s), SHA-256 by name of the file.

    sha256 : {file name: digest}; source : of an event found elsewhere; last : last day if there are several.
    """
    members = [satellite(name) for name in satellites]
    found_in = f"found in the {'' if origin == 'measured' else f'{origin} '}Level-1 files below"
    rows = [dict(item) if isinstance(item, dict) else vars(item) for item in manoeuvres]
    content = {
        "calibration": calibration,
        "satellites": [member.name for member in members],
        "date": date,
        "end_date": last if last and last > date else None,
        "date_status": "printed",
        "source": source or found_in,
        "design": design,
        "release": RELEASES.get(members[0].mission, "01"),
        "found": [row | {"satellite": row.get("satellite") or None} for row in rows],
        "sha256": dict(sorted(sha256.items())),
    }
    return toml.text(content)


def save_event(name, text):
    """Write the TOML text of an event into the user's own catalogue; returns the Event read back."""
    folder = os.environ.get(ENVIRONMENT)
    if not folder:
        expected, remedy = f"a folder in {ENVIRONMENT}", f"Set {ENVIRONMENT} to a folder of yours."
        refuse(name, "no own catalogue to write to", expected, remedy, CatalogError, event=name)
    path = Path(folder) / "events" / f"{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)
    return event(name)


@dataclass(frozen=True)
class Published:
    """One printed result. A blank of the print is None."""

    section: str
    events: tuple[str, ...]
    labels: Mapping[str, str]  #: columns of the table that identify the row
    value: tuple  #: numbers in ``unit``, or texts as printed
    sigma: tuple
    unit: str
    direction: str
    source: str
    note: str

    def __getattr__(self, name):
        """Text of the label of that name: ``record.variant``."""
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


def published(calibration):
    """{section ("combined", "history" ...): (Published, ...)} of a calibration; CatalogError if none is known."""
    _, tables = read("published", "tables")
    sections = {}
    for table in tables.values():
        if table["calibration"] == calibration:
            file = find("published", table["file"], suffix="")
            rows = csv.DictReader(io.StringIO(file.read_text(encoding="utf-8")))
            wanted = (*table["labels"], *table["value"], *table["sigma"])
            if missing := [name for name in wanted if name not in (rows.fieldnames or [])]:
                _wrong(file, "header", rows.fieldnames, f"also {', '.join(missing)}", "Correct tables.toml.")
            own = sections.setdefault(table["section"], [])
            for row in rows:
                events = filter(None, row["events"].split(";")) if "events" in row else table.get("events", ())
                one = Published(
                    section=table["section"],
                    events=tuple(events),
                    labels={key: row[key] for key in table["labels"]},
                    value=tuple(_number(row[key]) for key in table["value"]),
                    sigma=tuple(_number(row[key]) for key in table["sigma"]),
                    unit=row["unit"] if table["unit"] == "column" else table["unit"],
                    direction=table["direction"],
                    source=f"{table['doi']}, {table['table']}",
                    note=table["note"],
                )
                own.append(one)
    if not sections:
        known = sorted({table["calibration"] for table in tables.values()})
        raise _unknown("calibration with published values", calibration, known, where="catalogue")
    return {name: tuple(records) for name, records in sections.items() if records}


def trims(satellite=None):
    """(Trim, ...) of a satellite (letter or name) or of all, in the order of trims.toml."""
    _, content = read("published", "trims")
    wanted = satellite and _satellite(satellite).name
    return tuple(Trim(**table) for table in content["trim"] if wanted in (None, table["satellite"]))


def _number(text):
    """Float of a CSV cell, None for a blank, or the text itself where the print has no number."""
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


@dataclass(frozen=True)
class Parameter:
    """One setting: value, unit, range or allowed values, the stages that take it, and the reason for its value."""

    name: str
    value: object
    stages: tuple[str, ...]
    reason: str
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    allowed: tuple | None = None


@dataclass(frozen=True)
class Parameters:
    """All parameters of a calibration; their values are attributes: ``chosen.lowpass_hz``.

    ``configuration`` is "operational" or the name of the experiment that they belong to.
    """

    calibration: str
    entries: Mapping[str, Parameter]  #: by name
    configuration: str = "operational"

    def __getattr__(self, name):
        """Value of the parameter of that name."""
        if name.startswith("_"):
            raise AttributeError(name)
        return self.entry(name).value

    def entry(self, name):
        """Parameter of that name; CatalogError names the nearest if there is none."""
        if name not in self.entries:
            raise _unknown("parameter", name, sorted(self.entries), where=self.calibration)
        return self.entries[name]

    def with_settings(self, settings):
        """Copy with some values replaced; texts, as from ``--set``, take the type of the catalogue's value."""
        changed = {}
        for name, setting in settings.items():
            entry = self.entry(name)
            if isinstance(entry.value, tuple):
                items = setting if isinstance(setting, (list, tuple)) else str(setting).split(",")
                example = entry.value[0] if entry.value else ""
                value = tuple(_scalar(item, example, entry, self.calibration) for item in items)
            else:
                value = _scalar(setting, entry.value, entry, self.calibration)
            changed[name] = replace(entry, value=value)
            _check(changed[name], self.calibration)
        return replace(self, entries={**self.entries, **changed})

    def for_report(self):
        """{name: value} of all parameters, and "configuration": its name, as a report lists them."""
        return {name: entry.value for name, entry in self.entries.items()} | {"configuration": self.configuration}

    def for_stage(self, stage):
        """Settings of one stage by name, sorted, ready as keyword arguments."""
        stages = sorted({known for entry in self.entries.values() for known in entry.stages})
        if stage not in stages:
            raise _unknown("stage", stage, stages, where=self.calibration)
        return {name: entry.value for name, entry in sorted(self.entries.items()) if stage in entry.stages}


def parameters(calibration):
    """Parameters of a calibration from ``catalog/parameters/<calibration>.toml``."""
    path, content = read("parameters", calibration)
    entries = {}
    for name, table in content.items():
        stages = (table["stage"],) if isinstance(table["stage"], str) else tuple(table["stage"])
        rest = {key: table[key] for key in ("unit", "minimum", "maximum") if key in table}
        allowed = tuple(_typed(item, table) for item in table["allowed"]) if "allowed" in table else None
        value = _typed(table["value"], table)
        entries[name] = Parameter(name, value, stages, table["reason"], allowed=allowed, **rest)
        _check(entries[name], str(path))
    return Parameters(calibration, entries)


def _typed(value, table):
    """Value of a TOML table of a parameter: numbers with a unit become float; lists become tuples."""
    if isinstance(value, list):
        return tuple(_typed(item, table) for item in value)
    is_int = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if is_int and "unit" in table else value


def _scalar(setting, example, entry, where):
    """Setting (text or value) in the type of the example; refused if it has no such form."""
    kind = type(example)
    text = setting.strip() if isinstance(setting, str) else setting
    try:
        if kind is bool:
            return WORDS[str(text).lower()]
        if kind is int and str(text) != str(int(text)):
            raise ValueError(text)
        return kind(text)
    except (KeyError, TypeError, ValueError):
        expected = {bool: "true or false", int: "a whole number", float: "a number"}.get(kind, "a text")
        return _refused(where, entry.name, setting, expected)


def _check(entry, where):
    """Refuse a Parameter whose value is not allowed or is out of its range."""
    for item in entry.value if isinstance(entry.value, tuple) else (entry.value,):
        if entry.allowed is not None and item not in entry.allowed:
            _refused(where, entry.name, item, f"one of {', '.join(map(str, entry.allowed))}")
        if isinstance(item, float) and item != item:
            _refused(where, entry.name, item, "a number")
        if entry.minimum is not None and item < entry.minimum or entry.maximum is not None and item > entry.maximum:
            low = "-" if entry.minimum is None else f"{entry.minimum:g}"
            high = "-" if entry.maximum is None else f"{entry.maximum:g}"
            _refused(where, entry.name, item, f"between {low} and {high} {entry.unit or ''}".rstrip())


def _refused(where, name, value, expected):  # CatalogError for a value of the parameter ``name``
    remedy = f"Choose such a value, or leave {name} as it is."
    refuse(f"{where}: {name}", repr(value), expected, remedy, CatalogError, parameter=name)


def roots():
    """[Path] of the folders searched, in order: the user's own, the one of the package, those of other packages."""
    user_folder = os.environ.get(ENVIRONMENT)
    if user_folder and not Path(user_folder).is_dir():
        expected, remedy = "a folder with satellites/, events/ or parameters/", f"Create it, or unset {ENVIRONMENT}."
        refuse(ENVIRONMENT, repr(user_folder), expected, remedy, CatalogError)
    return [*([Path(user_folder)] if user_folder else []), resources.files("catalog"), *_added]


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
    raise _unknown(kind.removesuffix("s"), name, names(kind, suffix), where="catalogue")


def read(kind, name):
    """(path, content as a dict) of one TOML entry, checked by its schema; CatalogError for what is wrong in it."""
    return read_file(find(kind, name), name if kind == "published" else kind)


def read_file(path, form="any"):
    """(path, content as a dict) of any TOML file, checked by the schema ``form`` of `catalog/schema.json`."""
    try:
        return path, _loads(path.read_text(encoding="utf-8"), form)
    except OSError as error:
        return refuse(path, f"no file to read ({error.strerror})", "a TOML file", "Correct the path.", CatalogError)
    except UnicodeDecodeError as error:
        fault = f"bytes that are not UTF-8 ({error.reason} at byte {error.start})"
        return refuse(path, fault, "a TOML file", "Save it as UTF-8.", CatalogError)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        return refuse(path, f"text that is not valid TOML ({error})", "a TOML file", "Correct it.", CatalogError)
    except jsonschema_rs.ValidationError as error:
        where = f"{path}: {'.'.join(map(str, error.instance_path)) or 'the whole'}"
        return refuse(where, error.message, "what catalog/schema.json says", "Correct it.", CatalogError)


@lru_cache(maxsize=128)
def _loads(text, form):
    """Content (dict) of a TOML text valid for a schema; cached, as many events name the same satellite."""
    content = tomllib.loads(text)
    _form(form).validate(json.loads(json.dumps(content, default=str), parse_constant=str))
    return content


@lru_cache
def _form(name):  # validator of the schema of that name
    schema = json.loads((resources.files("catalog") / "schema.json").read_text(encoding="utf-8"))
    return jsonschema_rs.Draft202012Validator(schema | {"$ref": f"#/$defs/{name}"})


def _unknown(what, name, known, where):
    """CatalogError (to raise) for an unknown name, with the nearest of the known ones; what: "satellite", "event"."""
    near = difflib.get_close_matches(str(name).lower(), known, n=3, cutoff=0.5)
    hint = f"Nearest: {', '.join(near)}." if near else f"Known: {', '.join(known) or 'none'}."
    return CatalogError(
        f"{where}: no {what} named {name!r} among the {len(known)} known. {hint}", name=str(name), nearest=near
    )


def _wrong(path, key, value, expected, remedy):  # raises for the value of a key of a TOML file
    refuse(f"{path}: {key}", repr(value), expected, remedy, CatalogError)
