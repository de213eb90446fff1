"""Names and addresses of the daily archives of Level-1 files, and which of them an event needs."""

import datetime
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from gravcal.errors import CatalogError

ISDC = "https://isdc-data.gfz.de"
PODAAC = "https://archive.podaac.earthdata.nasa.gov"
PROTECTED, PUBLIC = "podaac-ops-cumulus-protected", "podaac-ops-cumulus-public"
PLACES = {"isdc": ISDC, "podaac": f"{PODAAC}/{PROTECTED}"}
MISSIONS = {"A": "grace", "B": "grace", "X": "grace", "C": "gracefo", "D": "gracefo", "Y": "gracefo"}
RELEASES = {"grace": "02", "gracefo": "04"}
RANGING_LASER = ("LRI1A", "LRI1B", "LLK1A", "LLK1B", "LHK1A", "LHK1B", "LLT1A", "LSM1A", "LSM1B")
TRANSPLANTS = ("ACH1A", "ACH1B")


@dataclass(frozen=True)
class Archive:
    """One daily archive; ``digests`` are pairs of member name and SHA-256 that the catalogue knows."""

    mission: str
    level: str
    date: datetime.date
    release: str
    part: str = "noLRI"
    digests: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        """Name of the file."""
        if self.mission == "grace":
            return f"grace_{self.level}_{self.date}_{self.release}.tar.gz"
        return f"gracefo_{self.level}_{self.date}_RL{self.release}.ascii.{self.part}.tgz"


def of_event(event):
    """Archives that hold the Level-1 files of an event.

    Parameters
    ----------
    event : Event of the catalogue

    Returns
    -------
    archives : list of Archive

    Raises
    ------
    CatalogError : the date is unknown, or there is no public archive of this satellite
    """
    if not event.raw_files:
        raise CatalogError(
            f"event {event.name}: found no Level-1 files (date {event.date or 'unknown'}), expected a date and "
            f"products. Name a day with --satellite and --date.",
            event=event.name,
        )
    found = {}
    for file in event.raw_files:
        mission = _mission(file.letter)
        bare = Archive(mission, file.product[3:], file.date, file.release, _part(mission, file.product))
        found.setdefault(bare, []).extend([(file.name, file.sha256)] if file.sha256 else [])
    return [Archive(a.mission, a.level, a.date, a.release, a.part, tuple(known)) for a, known in found.items()]


def of_day(satellite, date):
    """Archives of one day of one satellite: Levels 1A and 1B of GRACE-FO, Level 1B of GRACE.

    Parameters
    ----------
    satellite : str, letters
    date : datetime.date

    Returns
    -------
    archives : list of Archive
    """
    mission = _mission(satellite[:1])
    levels = ("1A", "1B") if mission == "gracefo" else ("1B",)
    return [Archive(mission, level, date, RELEASES[mission]) for level in levels]


def addresses(archive, place):
    """Addresses where an archive may be, the most likely first.

    Parameters
    ----------
    archive : Archive
    place : "podaac", "isdc", or the address of a server with the layout of one of them, or of one folder with all

    Returns
    -------
    urls : list of str
    """
    root = PLACES.get(place, place).rstrip("/")
    mission = {"grace": "grace", "gracefo": "grace-fo"}[archive.mission]
    folder = f"{mission}/Level-{archive.level}/JPL/INSTRUMENT/RL{archive.release}/{archive.date.year}"
    form = "ASCII_GRAV" if archive.mission == "gracefo" else "GRAV"
    collection = f"{archive.mission.upper()}_L{archive.level}_{form}_JPL_RL{archive.release}"
    every = {"isdc": f"{root}/{folder}/{archive.name}", "podaac": f"{root}/{collection}/{archive.name}"}
    return [every[place]] if place in every else [*every.values(), f"{root}/{archive.name}"]


def checksum_addresses(url):
    """Addresses where the MD5 of an archive may be; PO.DAAC keeps it in its public store, which asks for no login."""
    stem = re.sub(r"\.(tgz|tar\.gz)$", "", url)
    public = [f"{url}.md5".replace(PROTECTED, PUBLIC)] if PROTECTED in url else []
    return [*public, f"{url}.md5", f"{url}.checksum", f"{stem}.checksum", f"{stem}.md5"]


def check_place(place):
    """Raise unless archives can be fetched from a place.

    Raises
    ------
    CatalogError : neither a known name nor an address of http or https; or an address with a password in it
    """
    if place in PLACES:
        return
    parts = urlsplit(place)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise CatalogError(f"{place}: found no archive of this name, expected podaac, isdc, or http(s)://... Give one.")
    if parts.username or parts.password:
        raise CatalogError(
            f"{parts.hostname}: found a login in the address, expected none. Put it into your netrc file; an address "
            f"ends up in logs and in the shell's history."
        )


def _mission(letter):
    """Mission of a letter; only GRACE and GRACE-FO have public archives."""
    if letter not in MISSIONS:
        raise CatalogError(
            f"satellite {letter}: found no public archive, expected one of A, B, C, D. Get its files from its operator."
        )
    return MISSIONS[letter]


def _part(mission, product):
    """Which of the archives of a day holds a product."""
    if mission == "grace":
        return ""
    return "LRI" if product in RANGING_LASER else "ACX" if product in TRANSPLANTS else "noLRI"
