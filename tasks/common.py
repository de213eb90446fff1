"""Start of every calibration: finding the Level-1 files of an event, and reading them."""

import datetime
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

from gravcal import catalog
from gravcal.errors import NoDataError, ProductError, refuse
from gravcal.store import product, store
from tasks.stage import lazy, stage

archive = lazy("gravcal.io.archive")
readers = lazy("gravcal.io.readers")

product.register("ingest", product.ANY)


@dataclass(frozen=True)
class Source:
    """Where the Level-1 files of an event are."""

    event: str
    satellite: str  #: letters, such as "C" or "CD"
    date: str | None  #: YYYY-MM-DD, None if the event has all days of the folder
    folder: Path  #: holds the files, loose or in archives

    def file(self, *products: str, satellite: str | None = None):
        """LevelOneFile of the first of these products that the folder holds of a satellite (default: of the source)."""
        letter = satellite or self.satellite
        for name in products:
            if file := archive.find(self.folder, name, letter, self.date):
                return file
        own = {letter, *self.satellite}
        day = (f for f in archive.inventory(self.folder) if str(f.date) == self.date and f.satellite in own)
        there = ", ".join(sorted({f.product for f in day}))
        beside = f"beside {there}" if there else "and nothing else of that day"
        missing = f"no {' or '.join(products)} of satellite {letter} on {self.date} {beside}"
        remedy = "Put the file or its daily archive there, or give another --data, --satellite or --date."
        kind = ProductError if there else NoDataError
        return refuse(self.folder, missing, "one", remedy, kind, folder=str(self.folder), products=products)

    def files(self, *products: str):
        """[LevelOneFile] of those of these products that the folder holds."""
        files = (archive.find(self.folder, name, self.satellite, self.date) for name in products)
        return [file for file in files if file]


def source_of(one, *, event=None, data=None, satellite=None, date=None) -> Source:
    """Source of a catalogue event, whose files are looked for in GRAVCAL_DATA, or of any folder of Level-1 files.

    one : Calibration; satellite, date : needed where the folder holds several; one satellite stands for its pair.
    """
    satellite = next((letter for letter, pair in one.pairs.items() if satellite and satellite in pair), satellite)
    if event is not None:
        source = _from_catalogue(one, event)
        pair = next((pair for pair in one.pairs.values() if source.satellite in pair), source.satellite)
        return replace(source, satellite=pair)
    folder = Path(data)
    if not folder.is_dir():
        refuse(folder, "no folder", "one with Level-1 files", "Check --data.", folder=str(folder))
    inventory = one.files.inventory(folder)
    of_day = [f for f in inventory if satellite in (None, f.satellite) and date in (None, f.date)]
    fitting = [f for f in of_day if f.product in one.begins]
    if not fitting:
        candidates = [f for f in inventory if f.product in one.begins]
        have = sorted({f"{f.product} of {f.satellite} on {f.date}" for f in candidates})
        have = [*have[:3], f"and {len(have) - 3} more"] if len(have) > 4 else have
        wanted = f"{' or '.join(one.begins)}{f' of {satellite}' if satellite else ''}{f' on {date}' if date else ''}"
        remedy, kind = "Correct --satellite or --date, or give another --data.", ProductError if of_day else NoDataError
        refuse(folder, ", ".join(have) or "none of its files", wanted, remedy, kind)
    satellite = satellite or _only(folder, sorted({f.satellite for f in fitting}), "satellite", "--satellite")
    dates = sorted({f.date for f in fitting if f.satellite == satellite})
    joined = date is None and _are_joined(dates, one.span_days)
    first = dates[0] if joined else date or _only(folder, dates, "day", "--date")
    letters = one.pairs.get(satellite, satellite)
    return Source(f"{one.mission}-{letters.lower()}-{first}", letters, None if joined else first, folder)


def level_one_files(one, source) -> list:
    """[LevelOneFile] of a source, one or more for each role in the ``inputs`` of a Calibration (one)."""
    return [file for names in one.inputs.values() for file in source.files(*names) or [source.file(*names)]]


def _are_joined(dates, span_days):  # True if days YYYY-MM-DD lie within ``span_days``, more than one: one event
    first, last = (datetime.date.fromisoformat(one) for one in (min(dates), max(dates)))
    return span_days > 1 and (last - first).days < span_days


def days_of(one, data) -> list[tuple[Path, str, str | None]]:
    """[(folder, letters, date or None)] of the events of a Calibration (one) below the folder ``data``.

    A day is where its file is; if the other files of that day are elsewhere, as in a mirror with one tree for each
    level, it is the whole folder. Days that a run would join are one event, without date.
    """
    folders, there, days = {}, {}, {}
    for file in one.files.inventory(data):
        there.setdefault((file.path.parent, file.date), set()).add(file.product)
        there.setdefault((None, file.date), set()).add(file.product)
        if file.product in one.begins:
            folders.setdefault((file.satellite, file.date), set()).add(file.path.parent)
    places = set()
    for (letter, date), own in folders.items():
        elsewhere = len(own) == 1 and there[next(iter(own)), date] != there[None, date]
        places |= {(date, str(data if elsewhere else folder), letter) for folder in own}
    for date, folder, letter in sorted(places):
        days.setdefault((Path(folder), one.pairs.get(letter, letter)), set()).add(date)
    joined = {place for place, dates in days.items() if _are_joined(dates, one.span_days)}
    return [(*place, day) for place in days for day in ([None] if place in joined else sorted(days[place]))]


def _from_catalogue(one, event):
    """Source of a catalogue event of a Calibration (one); folder: GRAVCAL_DATA/event if there, else GRAVCAL_DATA."""
    entry = catalog.event(event)
    if entry.calibration != one.name:
        refuse(f"event {event}", f"a {entry.calibration} event", f"one of {one.name}", "Choose another event.")
    if entry.date is None:
        raise NoDataError(f"event {event}: its true date is not known, so no files can be found. Choose another event.")
    root = os.environ.get("GRAVCAL_DATA")
    if not root:
        expected = f"the folder with the Level-1 files of {entry.date}"
        refuse(f"event {event}", "that GRAVCAL_DATA is not set", expected, "Set it, or use --data DIR.")
    own = Path(root) / event
    folder = own if own.is_dir() else Path(root)
    if not folder.is_dir():
        refuse(f"GRAVCAL_DATA = {root}", "no folder", "one with Level-1 files", "Set it anew.")
    first, last = str(entry.date), str(entry.end_date or entry.date)
    days = {str(file.date) for file in one.files.inventory(folder) if file.satellite in entry.letters}
    if not any(first <= day <= last for day in days):
        missing = f"no file of satellite {' or '.join(entry.letters)} on {entry.date} in {folder}"
        remedy = "Put the files there (gravcal fetch), or give another folder with GRAVCAL_DATA."
        refuse(f"event {event}", missing, "one", remedy, NoDataError)
    return Source(event, "".join(entry.letters), str(entry.date), folder)


def _only(folder, choices, what, option):  # the only one of choices, refused if there are several
    if len(choices) == 1:
        return choices[0]
    return refuse(folder, f"{what}s {', '.join(choices)}", f"one {what}", f"Give {option}, or another --data.")


def printed_of(calibration: str, event: str | None = None) -> dict[str, list[dict]]:
    """{section: [dict]} of the published values of a calibration, or of those of an event; {} without."""
    every = catalog.published(calibration).items()
    own = {section: [one for one in records if event is None or event in one.events] for section, records in every}
    plain = lambda one: vars(one) | dict(one.labels) | {"labels": dict(one.labels)}  # noqa: E731
    return {section: [plain(one) for one in records] for section, records in own.items() if records}


def document(ref, name="result.json") -> dict:
    """Document (file ``name``) of a report, whose provenance gets its key and {stage: key} of its nearest ancestors."""
    document, ancestors, key_of = json.loads((ref.folder / name).read_text()), store.ancestry(ref.key), {}
    if ancestors[ref.key] is None:
        raise ProductError(f"{ref.name} ({ref.path}): its record was damaged since it was found. Run again.")
    for part, label in (pair for record in ancestors.values() if record for pair in store.inputs(record)):
        if "key" in part:
            key_of.setdefault(".".join(filter(None, (label["kind"], label["variant"]))), part["key"])
    document["provenance"] |= {"key": ref.key, "products": dict(sorted(key_of.items()))}
    return document


@stage(reads=["file"], writes="ingest", version=1)
def ingest(file):
    """Records of one LevelOneFile as of `readers.read`; columns of characters (satellite, clock) are left out."""
    observed = readers.read(file, expect_satellite=file.satellite, expect_date=file.date)
    return observed.drop_vars([name for name in observed if observed[name].dtype.kind == "S"])
