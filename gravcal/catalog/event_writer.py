"""Writes events into a user's own catalogue, so that what was found in the data is kept."""

import os
from pathlib import Path

from gravcal.catalog import files
from gravcal.catalog.event_table import event
from gravcal.catalog.satellite_table import satellite
from gravcal.errors import CatalogError

RELEASES = {"GRACE": "02", "GRACE-FO": "04"}


def event_text(calibration, design, satellites, date, found, sha256, origin="measured"):
    """TOML text of an event found in data.

    Parameters
    ----------
    calibration, design : str, its name and the entry of designs/ that plans such an event
    satellites : sequence of str, letters or names
    date : datetime.date
    found : sequence of Manoeuvre, or of mappings with kind, start, stop (GPS seconds)
    sha256 : mapping of Level-1 file name to digest
    origin : of the files; the source of the event says what was not measured

    Returns
    -------
    text : str
    """
    members = [satellite(name) for name in satellites]
    rows = [item if isinstance(item, dict) else vars(item) for item in found]
    names = ", ".join(f'"{name}"' for name in (member.name for member in members))
    heading = [
        f'calibration = "{calibration}"',
        f"satellites = [{names}]",
        f"date = {date.isoformat()}",
        'date_status = "printed"',
        f'source = "found in the {"" if origin == "measured" else f"{origin} "}Level-1 files below"',
        f'design = "{design}"',
        f'release = "{RELEASES.get(members[0].mission, "01")}"',
    ]
    empty = [] if rows else ["found = []"]
    tables = [line for row in rows for line in ("", "[[found]]", *_lines(row))]
    digests = ["", "[sha256]", *(f'"{name}" = "{digest}"' for name, digest in sorted(sha256.items()))]
    return "\n".join([*heading, *empty, *tables, *digests]) + "\n"


def save_event(name, text):
    """Write an event into the user's own catalogue and read it back.

    Parameters
    ----------
    name : str, "grace-c-2024-02-01"
    text : str, from `event_text`

    Returns
    -------
    event : Event, as read back

    Raises
    ------
    CatalogError : no own catalogue is set, or the text breaks the form of an event
    """
    own = os.environ.get(files.ENVIRONMENT)
    if not own:
        raise CatalogError(
            f"{name}: found no own catalogue to write to, expected a folder in {files.ENVIRONMENT}. "
            f"Set {files.ENVIRONMENT} to a folder of yours.",
            event=name,
        )
    path = Path(own) / "events" / f"{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_suffix(f".{os.getpid()}.tmp")
    aside.write_text(text, encoding="utf-8")
    aside.replace(path)
    return event(name)


def _lines(row):
    """Lines of one found manoeuvre; times keep all their digits."""
    letter = [f'satellite = "{row["satellite"]}"'] if row.get("satellite") else []
    times = [f"{name} = {float(row[name])!r}" for name in ("start", "stop")]
    return [f'kind = "{row["kind"]}"', *times, *letter]
