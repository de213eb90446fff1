"""Published values, as printed, each with its citation; and the mass trims."""

import csv
import datetime
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import lru_cache

from gravcal.catalog import files, missions

TABLE = ("file", "calibration", "section", "doi", "table", "labels", "value", "sigma", "unit", "direction", "note")


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
    wanted = None if satellite is None else missions.satellite(satellite).name
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
