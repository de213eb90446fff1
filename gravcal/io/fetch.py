"""Level-1 archives from an official archive: resumed, checked, written aside and renamed, all in one folder."""

import contextlib
import fcntl
import functools
import hashlib
import os
import re
import tarfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from gravcal.errors import GravcalError, ProductError, refuse
from gravcal.io import fetch_http, fetch_layout, unpacked
from gravcal.io.fetch_http import Patience

WHOLE_ATTEMPTS = 3  # whole transfers that may arrive with wrong bytes


@dataclass(frozen=True)
class Fetched:
    """One archive in the folder: whether it came now ("fetched") or was there, and by what it was checked."""

    path: Path
    state: str
    checked: str
    size: int


def fetch(archives, out, place, listener=None, patience=None):
    """Bring archives into a folder; one that fails stops no other.

    Parameters
    ----------
    archives : list of Archive
    out : Path, folder; nothing is written outside
    place : "podaac", "isdc" or address of a server with the same layout
    listener : function of archive name, bytes there, bytes in all (None: unknown); or None
    patience : Patience or None

    Returns
    -------
    fetched : list of Fetched

    Raises
    ------
    ProductError : the first archive that could not be had, after all were tried
    """
    fetch_layout.check_place(place)
    _prepare(out)
    fetched, failed = [], []
    with _alone(out), fetch_http.session() as opened:
        for archive in archives:
            told = functools.partial(listener, archive.name) if listener else None
            try:
                fetched.append(_one(opened, archive, out, place, (patience or Patience(), told)))
            except GravcalError as error:
                failed.append(error)
    if failed:
        raise failed[0]
    return fetched


def _prepare(out):
    """Create the folder."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        refuse(out, error.strerror, "a folder that can be written", "Name another folder with --out.")


def _one(opened, archive, out, place, how):
    """Bring one archive, unless it is there."""
    path = out / archive.name
    if checked := _is_there(archive, path):
        return Fetched(path, "there", checked, path.stat().st_size)
    part = out / f".{archive.name}.part"
    for url in fetch_layout.addresses(archive, place):
        try:
            return _from_address(opened, archive, (url, part, path), how)
        except fetch_http.Missing:
            continue
        except OSError as error:
            refuse(out, error.strerror or error, "a folder that takes the archive", "Free space or rights there.")
    tried = fetch_http.shown(fetch_layout.addresses(archive, place)[0])
    return refuse(tried, "no such file", f"archive {archive.name}", "Check the day, or name another with --from.")


def _from_address(opened, archive, names, how):
    """Bring one archive from one address, again if its bytes are wrong."""
    (url, part, path), (patience, told) = names, how
    for attempt in range(WHOLE_ATTEMPTS):
        fetch_http.download(opened, url, part, patience, told)
        digest = _published_md5(opened, url, archive.name, patience)
        try:
            checked = _check(archive, part, digest)
        except ProductError:
            fetch_http.discard(part)
            if attempt == WHOLE_ATTEMPTS - 1:
                raise
            continue
        _publish(part, path, digest)
        return Fetched(path, "fetched", checked, path.stat().st_size)
    raise AssertionError("unreachable")


def _publish(part, path, digest):
    """Bring a checked file down to the disk and give it its name; its MD5 stands beside it."""
    with part.open("rb") as stream:
        os.fsync(stream.fileno())
    beside = path.with_name(f"{path.name}.md5")
    beside.unlink(missing_ok=True)
    if digest:
        beside.write_text(f"{digest}  {path.name}\n")
    part.replace(path)
    fetch_http.discard(part)


def _is_there(archive, path):
    """By what a file that is there was checked; None if there is none or a wrong one."""
    if not path.is_file():
        return None
    beside = path.with_name(f"{path.name}.md5")
    try:
        digest = _md5_of(beside.read_text(), archive.name) if beside.is_file() else None
        return _check(archive, path, digest)
    except ProductError:
        return None


def _published_md5(opened, url, name, patience):
    """MD5 that the archive publishes, or None."""
    for address in fetch_layout.checksum_addresses(url):
        with contextlib.suppress(fetch_http.Missing):
            try:
                found = _md5_of(fetch_http.text(opened, address, patience), name)
            except ProductError as error:
                if error.facts.get("status") != 403:  # how some stores answer for a file they do not have
                    raise
                continue
            if found:
                return found
    return None


def _md5_of(text, name):
    """MD5 of a file in a list of checksums, or alone in the text; None if there is none."""
    lines = [line for line in text.splitlines() if re.search(r"\b[0-9a-fA-F]{32}\b", line)]
    named = [line for line in lines if name in line] or [line for line in lines if len(line.split()) == 1]
    return re.search(r"\b[0-9a-fA-F]{32}\b", named[0])[0].lower() if named else None


def _check(archive, path, digest):
    """What a file was checked by; raises if its bytes are wrong.

    Raises
    ------
    ProductError : another MD5 than published, a web page, a damaged archive, or a member unlike the catalogue's
    """
    with path.open("rb") as stream:
        is_packed = stream.read(2) == b"\x1f\x8b"
        stream.seek(0)
        found = hashlib.file_digest(stream, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
    remedy = "Try again later, or name another archive with --from."
    if digest and found != digest:
        refuse(archive.name, f"MD5 {found}", f"{digest}, as the archive publishes", remedy)
    if not is_packed:
        refuse(
            archive.name, "no compressed archive, perhaps a web page", "a tar archive", f"Check your login. {remedy}"
        )
    if digest and not archive.digests:
        return "md5"
    members = _members(archive.name, path, dict(archive.digests))
    for name, expected in archive.digests:
        if members.get(name) != expected:
            refuse(archive.name, f"{name} with SHA-256 {members.get(name)}", f"{expected}, as catalogued", remedy)
    return " and ".join(["md5"] * bool(digest) + ["sha256"] * bool(archive.digests)) or "compression only"


def _members(name, path, wanted):
    """SHA-256 of the members wanted, by bare name; reading to the end checks the compression."""
    digests = {}
    try:
        with unpacked.archive(path) as packed:
            for item in unpacked.members(packed, path):
                bare = PurePosixPath(item.name).name
                if item.isfile() and bare in wanted:
                    digests[bare] = hashlib.file_digest(packed.extractfile(item), "sha256").hexdigest()
    except (EOFError, OSError, zlib.error, tarfile.TarError) as reason:
        refuse(name, f"a damaged archive ({reason})", "a whole one", "Fetch it again.")
    return digests


@contextlib.contextmanager
def _alone(out):
    """Keep other processes from fetching into the same folder."""
    held = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        refuse(out, "another process that fetches into this folder", "none", "Wait for it, or name another folder.")
    finally:
        os.close(held)
