"""Level-1 archives from an official archive: resumed, checked, written aside and renamed, all in one folder.

Credentials are read when needed, sent to the host that they belong to, never printed and never stored.
"""

import base64
import contextlib
import datetime
import functools
import hashlib
import ipaddress
import netrc
import os
import re
import tarfile
import time
import tomllib
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

import requests
import urllib3

from gravcal.errors import CatalogError, GravcalError, ProductError, refuse
from gravcal.io.archive import members, opened

LAYOUTS = tomllib.loads(Path(__file__).with_name("archives.toml").read_text(encoding="utf-8"))
PODAAC = "https://archive.podaac.earthdata.nasa.gov"
PROTECTED, PUBLIC = "podaac-ops-cumulus-protected", "podaac-ops-cumulus-public"
PLACES = {"isdc": "https://isdc-data.gfz.de", "podaac": f"{PODAAC}/{PROTECTED}"}
MISSIONS = {"A": "grace", "B": "grace", "X": "grace", "C": "gracefo", "D": "gracefo", "Y": "gracefo"}
RELEASES = {"grace": "02", "gracefo": "04"}
RANGING_LASER = ("LRI1A", "LRI1B", "LLK1A", "LLK1B", "LHK1A", "LHK1B", "LLT1A", "LSM1A", "LSM1B")
TRANSPLANTS = ("ACH1A", "ACH1B")
PARTS = ("noLRI", "LRI", "ACX", "ACX2", "MAG", "SOE")  # kinds of archives that `of_day` knows
MAGNETOMETER = "0201"  # release of GFZ's calibration
CDF = (b"\xcd\xf3\x00\x01", b"\xcd\xf2\x60\x02")  # first bytes of a CDF, version 3 and 2.6
EARTHDATA = ("https", "urs.earthdata.nasa.gov", 443)  # scheme, host, port: what credentials belong to
TOKENS = ("https", "archive.podaac.earthdata.nasa.gov", 443)
PORTS = {"http": 80, "https": 443}
UNCHECKED = ("MAG", "SOE")  # levels whose files have no checksum of their own: not resumed in another run
WHOLE_ATTEMPTS = 3  # whole transfers that may arrive with wrong bytes
CHUNK = 1 << 16  # bytes read at once
REDIRECTS = 10  # Earthdata needs four
TEXT_LIMIT = 1 << 16  # bytes of a checksum file
SIZE_LIMIT = 1 << 34  # bytes; the largest archive of a day has less than 1e9
AGAIN = (408, 425, 429, 500, 502, 503, 504)  # HTTP statuses after which a request is repeated


@dataclass(frozen=True)
class Archive:
    """One daily archive; ``digests`` are pairs of member name and SHA-256 that the catalogue knows."""

    mission: str
    level: str  #: "1A", "1B", "MAG" or "SOE"
    date: datetime.date
    release: str
    part: str = "noLRI"  #: of GRACE-FO as of `PARTS`; of MAG the number of the satellite
    digests: tuple[tuple[str, str], ...] = ()

    @property
    def layout(self) -> dict:
        """{key: text} of its kind in `archives.toml`, filled in: "file" name, folder by archive, source ("read")."""
        kind = f"{self.mission}-{self.level}"
        words = {name: getattr(self, name) for name in ("level", "date", "release", "part")}
        words |= {"day": f"{self.date:%Y%m%d}", "year": self.date.year}
        return {key: text.format(**words) for key, text in LAYOUTS.get(kind, LAYOUTS[self.mission]).items()}

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.layout["file"]


@dataclass(frozen=True)
class Fetched:
    """One archive in the folder, and the checks that it passed."""

    path: Path
    state: str  #: "fetched" or "there"
    checked: str  #: "md5", "md5 and sha256", "compression only" ...
    size: int  #: bytes


@dataclass(frozen=True)
class Patience:
    """Retries and time limits of a transfer; an attempt that brought 1 % more bytes starts the count anew."""

    attempts: int = 6  # in a row without progress
    wait_s: float = 1.0  # first pause, doubled each time
    longest_wait_s: float = 60.0
    connect_s: float = 8.0  # limit to connect
    stall_s: float = 60.0  # without any byte
    tell: Callable | None = None  #: function of a line, called before every pause; or None


class Interrupted(Exception):
    """A failed transfer that is worth repeating, after ``pause_s`` at least."""

    def __init__(self, reason, pause_s=0.0):  # pause that the server asks for
        super().__init__(reason)
        self.pause_s = pause_s


class Missing(Exception):
    """The server has no such file."""


def of_event(event):
    """[Archive] that hold the Level-1 files of an Event of the catalogue, with the known SHA-256 of these."""
    if not event.raw_files:
        files, remedy = f"no Level-1 files (date {event.date or 'unknown'})", "Name a day with --satellite and --date."
        refuse(f"event {event.name}", files, "a date and products", remedy, CatalogError)
    digests = {}
    for file in event.raw_files:
        mission, product = _mission(file.letter), file.product
        part = "LRI" if product in RANGING_LASER else "ACX" if product in TRANSPLANTS else "noLRI"
        bare = Archive(mission, product[3:], file.date, file.release, part if mission == "gracefo" else "")
        digests.setdefault(bare, []).extend([(file.name, file.sha256)] if file.sha256 else [])
    return [Archive(a.mission, a.level, a.date, a.release, a.part, tuple(known)) for a, known in digests.items()]


def of_day(satellite, date, parts=("noLRI",), release=None):
    """[Archive] of one day (date) of a satellite or pair, by its letters.

    Parts of GRACE-FO: "noLRI" and "LRI" (Levels 1A and 1B), transplants "ACX" and "ACX2" (Level 1B), "MAG" (GFZ's
    calibrated magnetometer); of both missions "SOE" (sequence of events). GRACE has Level 1B without parts.
    """
    mission, bundle = _mission(satellite[:1]), []
    known = PARTS if mission == "gracefo" else ("noLRI", "SOE")
    for part in parts:
        if part not in known:
            expected = f"one of {', '.join(known)}"
            refuse(f"{mission}: part {part}", "no such archive", expected, "Name one.", CatalogError)
        if part == "SOE":
            bundle.append(Archive(mission, part, date, "", ""))
        elif part == "MAG":
            bundle += [Archive(mission, part, date, release or MAGNETOMETER, str("CD".index(n) + 1)) for n in satellite]
        else:
            levels = ("1A", "1B") if mission == "gracefo" and "LRI" in part else ("1B",)
            bundle += [Archive(mission, level, date, release or RELEASES[mission], part) for level in levels]
    return bundle


def _mission(letter):  # "grace" or "gracefo" of a satellite; refused for others
    if letter not in MISSIONS:
        remedy = "Get its files from its operator."
        refuse(f"satellite {letter}", "no public archive", "one of A, B, C, D", remedy, CatalogError)
    return MISSIONS[letter]


def addresses(archive, place):
    """[URL] where an archive may be, the most likely first.

    The place is "podaac", "isdc", or a server with the layout of one of them, or with one folder for all.
    """
    root, layout = PLACES.get(place, place).rstrip("/"), archive.layout
    if place == "podaac":
        root = root.replace(PROTECTED, layout.get("store", PROTECTED))
    every = {name: f"{root}/{layout[name]}/{archive.name}" for name in PLACES if name in layout}
    if place in PLACES and place not in every:
        refuse(archive.name, f"no place at {place}", f"one of {', '.join(every)}", "Name it with --from.", CatalogError)
    return [every[place]] if place in every else [*every.values(), f"{root}/{archive.name}"]


def checksum_addresses(url):
    """[URL] where the MD5 of an archive (URL) may be; PO.DAAC keeps it in its public store, which needs no login."""
    stem = re.sub(r"\.(tgz|tar\.gz)$", "", url)
    public = [f"{url}.md5".replace(PROTECTED, PUBLIC)] if PROTECTED in url else []
    return [*public, f"{url}.md5", f"{url}.checksum", f"{stem}.checksum", f"{stem}.md5"]


def fetch(archives, out, place, listener=None, patience=None):
    """[Fetched] of archives downloaded into the folder ``out``, and nowhere else; one that fails stops no other.

    The place is "podaac", "isdc" or the address of a server with the same layout; the listener is called with archive
    name, bytes there, bytes in all (None: unknown). Raises the error of the first archive that failed, after
    all were tried, CatalogError for a place that is no known name and no address of http(s), or one with a password.
    """
    address = urlsplit(PLACES.get(place, place))
    if address.scheme not in ("http", "https") or not address.hostname:
        refuse(place, "no archive of this name", "podaac, isdc, or http(s)://...", "Give one.", CatalogError)
    if address.username or address.password:
        remedy = "Put it into your netrc file; an address ends up in logs and in the shell's history."
        refuse(address.hostname, "a login in the address", "none", remedy, CatalogError)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        refuse(out, error.strerror, "a folder that can be written", "Name another folder with --out.")
    fetched, errors = [], []
    with Session() as session:
        session.max_redirects = REDIRECTS
        for archive in archives:
            progress = functools.partial(listener, archive.name) if listener else None
            try:
                fetched.append(_one(session, archive, out, place, patience or Patience(), progress))
            except GravcalError as error:
                errors.append(error)
    if errors:
        raise errors[0]
    return fetched


def _one(session, archive, out, place, patience, progress):
    """Fetched: one archive, downloaded unless there, from one URL after the other, again if its bytes are wrong."""
    path, part = out / archive.name, out / f".{archive.name}.part"
    checksum_file = path.with_name(f"{path.name}.md5")
    if path.is_file():
        with contextlib.suppress(ProductError):
            digest = _md5_of(checksum_file.read_text(), archive.name) if checksum_file.is_file() else None
            return Fetched(path, "there", _check(archive, path, digest), path.stat().st_size)
    if archive.level in UNCHECKED or part.is_symlink():  # somebody else's link is not followed
        part.unlink(missing_ok=True)
    for url in addresses(archive, place):
        for attempt in range(WHOLE_ATTEMPTS):
            try:
                _download(session, url, part, patience, progress)
                digest = _published_md5(session, url, archive.name, patience)
                try:
                    checked = _check(archive, part, digest)
                except ProductError:
                    part.unlink()
                    if attempt == WHOLE_ATTEMPTS - 1:
                        raise
                    continue
                with part.open("rb") as stream:
                    os.fsync(stream.fileno())
                checksum_file.unlink(missing_ok=True)
                if digest:
                    checksum_file.write_text(f"{digest}  {path.name}\n")
                part.replace(path)
                return Fetched(path, "fetched", checked, path.stat().st_size)
            except Missing:
                break
            except OSError as error:
                refuse(out, error.strerror or error, "a folder that takes the archive", "Free space or rights there.")
    tried = shown(addresses(archive, place)[0])
    return refuse(tried, "no such file", f"archive {archive.name}", "Check the day, or name another with --from.")


def _published_md5(session, url, name, patience):
    """MD5 (32 hexadecimal digits) that the server publishes for the archive at url, or None."""
    for address in checksum_addresses(url):

        def attempt(address=address):  # text of the checksum file
            with _ask(session, address, {}, patience) as response:
                return b"".join(_chunks(response, patience, TEXT_LIMIT)).decode(errors="replace")

        with contextlib.suppress(Missing):
            try:
                digest = _md5_of(_persistently(attempt, address, patience, lambda: 0), name)
            except ProductError as error:
                if error.facts.get("status") != 403:  # how some stores answer for a file they do not have
                    raise
                continue
            if digest:
                return digest
    return None


def _md5_of(text, name):
    """MD5 of the file ``name`` in a text of checksums, or the only one of a line; None if there is none."""
    lines = [line for line in text.splitlines() if re.search(r"\b[0-9a-fA-F]{32}\b", line)]
    named = [line for line in lines if name in line] or [line for line in lines if len(line.split()) == 1]
    return re.search(r"\b[0-9a-fA-F]{32}\b", named[0])[0].lower() if named else None


def _check(archive, path, digest):
    """Text of the checks that a file passed, "md5 and sha256"; raises for a wrong digest, web page, damaged archive."""
    with path.open("rb") as stream:
        md5 = hashlib.file_digest(stream, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
        stream.seek(0)
        first_bytes = stream.read(512)
    remedy = "Try again later, or name another archive with --from."
    if digest and md5 != digest:
        refuse(archive.name, f"MD5 {md5}", f"{digest}, as the archive publishes", remedy)
    expected, fits = "a tar archive", first_bytes[:2] == b"\x1f\x8b"
    if archive.level == "MAG":
        expected, fits = "a CDF file", first_bytes[:4] in CDF
    elif archive.level == "SOE":
        expected, fits = "lines of events", re.match(rb"(#.*\n|\s)*(x\s+)?[-+.0-9eE]+\s+GRACE", first_bytes) is not None
    if not fits:
        refuse(archive.name, "something else, perhaps a web page", expected, f"Check your login. {remedy}")
    if archive.level in UNCHECKED:
        return "md5" if digest else f"first bytes: {expected}"
    if digest and not archive.digests:
        return "md5"
    wanted, digests = dict(archive.digests), {}
    try:  # reading to the end checks the compression
        with opened(path) as packed:
            for item in members(packed, path):
                bare = PurePosixPath(item.name).name
                if item.isfile() and bare in wanted:
                    digests[bare] = hashlib.file_digest(packed.extractfile(item), "sha256").hexdigest()
    except (EOFError, OSError, zlib.error, tarfile.TarError) as reason:
        refuse(archive.name, f"a damaged archive ({reason})", "a whole one", "Fetch it again.")
    for name, expected in wanted.items():
        if digests.get(name) != expected:
            known = f"{expected}, as catalogued"
            refuse(archive.name, f"{name} with SHA-256 {digests.get(name)}", known, remedy)
    return " and ".join(["md5"] * bool(digest) + ["sha256"] * bool(wanted)) or "compression only"


def _download(session, url, part, patience, listener):
    """Download url into ``part``, resuming an earlier attempt; `_check` shows whether both parts are of one file."""

    def attempt():  # raises Interrupted unless ``part`` is complete
        present = _size(part)
        headers = {"Range": f"bytes={present}-"} if present else {}
        with _ask(session, url, headers, patience) as response:
            if response.status_code == 416:
                part.unlink()
                raise Interrupted("the server does not know the part that is missing")
            if response.status_code == 200:
                length = response.headers.get("Content-Length", "")
                start, total = 0, int(length) if length.isdigit() else None
            else:
                extent = response.headers.get("Content-Range", "").strip()
                span = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", extent)
                if not span or int(span[1]) != present:
                    part.unlink()
                    raise Interrupted("the server sent another part than was asked for")
                start, total = present, None if span[2] == "*" else int(span[2])
            descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            with os.fdopen(descriptor, "wb") as stream:
                stream.truncate(start)
                stream.seek(start)
                for chunk in _chunks(response, patience, SIZE_LIMIT):
                    stream.write(chunk)
                    if listener:
                        listener(stream.tell(), total)
        if total is not None and _size(part) != total:
            raise Interrupted(f"broke off at {_size(part)} of {total} bytes")

    _persistently(attempt, url, patience, lambda: _size(part))


def _persistently(attempt, url, patience, progress):
    """Result of ``attempt()``, repeated while it raises Interrupted; ``progress()``: bytes so far."""
    count, furthest = 0, max(progress(), 1)
    while True:
        try:
            return attempt()
        except Interrupted as stop:
            reached = progress()
            count = 0 if reached > 1.01 * furthest else count + 1
            furthest = max(furthest, reached)
            if count >= patience.attempts:
                remedy = "Run the command again later, it goes on where it stopped; or name another with --from."
                refuse(shown(url), f"that {stop}, {count} times in a row", "the whole file", remedy, attempts=count)
            pause = min(max(stop.pause_s, patience.wait_s * 2**count), patience.longest_wait_s)
            if patience.tell:
                patience.tell(f"{shown(url)}: {stop}; attempt {count + 1} of {patience.attempts} in {pause:.0f} s")
            time.sleep(pause)


class Session(requests.Session):
    """Session with the cookies of a login; each host of a redirect gets only its own credentials."""

    asked = ""  # address from which redirects lead on

    def rebuild_auth(self, prepared_request, response):
        """Set the credentials of a redirect's address; refused if it leaves https or contains a login itself."""
        source, target = response.url, prepared_request.url
        prepared_request.headers.pop("Authorization", None)
        parts = urlsplit(target)
        unencrypted = source.startswith("https:") and parts.scheme == "http" and not is_loopback(parts.hostname)
        if parts.scheme not in ("http", "https") or unencrypted or "@" in parts.netloc:
            redirect = f"that it redirects to {shown(target)}"
            refuse(shown(source), redirect, "a secure address", "Name another archive.")
        if login := authorization(target, self.asked):
            prepared_request.headers["Authorization"] = login


def _ask(session, url, headers, patience):
    """Response 200, 206 or 416 to GET; else Missing, Interrupted or refused, without the query, which may be signed."""
    session.asked, login = url, authorization(url, url)
    headers = {"Accept-Encoding": "identity", **headers} | ({"Authorization": login} if login else {})
    limits, failed = (patience.connect_s, patience.stall_s), None
    try:  # a function for auth keeps requests from looking for credentials itself
        response = session.get(url, headers=headers, auth=lambda request: request, stream=True, timeout=limits)
    except requests.RequestException as error:
        failed = error
    if isinstance(failed, requests.exceptions.SSLError):
        remedy = "Check the address and the clock; certificates of your institute are named in REQUESTS_CA_BUNDLE."
        refuse(shown(url), "a certificate that is not trusted", "one that is", remedy)
    if isinstance(failed, requests.TooManyRedirects):
        refuse(shown(url), f"more than {REDIRECTS} redirects", "a file", "Check your login.")
    if isinstance(failed, (requests.exceptions.InvalidSchema, requests.exceptions.InvalidURL)):
        refuse(shown(url), "that it redirects to no address of http", "a file", "Name another archive.")
    if failed is not None:
        raise Interrupted(f"no answer ({type(failed).__name__})")
    status = response.status_code
    if status in (200, 206) or status == 416 and "Range" in headers:
        return response
    response.close()
    if status in (404, 410):
        raise Missing(shown(url))
    if status in AGAIN:
        pause = response.headers.get("Retry-After", "")
        raise Interrupted(f"the server answers {status}", float(pause) if pause.isdigit() else 0.0)
    if status in (401, 403):
        answer = f"that {urlsplit(response.url).hostname} answers {status}: it wants a login, or another one"
        refuse(shown(url), answer, "the file", LAYOUTS["login"], status=status)
    return refuse(shown(url), f"that the server answers {status}", "the file", "Check the address.")


def _chunks(response, patience, limit):
    """Pieces (bytes) of a response as they arrive, ``limit`` in all; Interrupted if the connection stalls or breaks."""
    total = 0
    while True:
        try:
            chunk = response.raw.read1(CHUNK, decode_content=False)
        except (urllib3.exceptions.HTTPError, OSError) as error:
            is_stall = isinstance(error, urllib3.exceptions.ReadTimeoutError | TimeoutError)
            reason = f"nothing came for {patience.stall_s:g} s" if is_stall else "the connection broke off"
            raise Interrupted(reason) from None
        if not chunk:
            return
        total += len(chunk)
        if total > limit:
            refuse(shown(response.url), f"more than {limit} bytes", "less", "Check the address.")
        yield chunk


def _size(part):  # bytes of a file, 0 without
    return part.stat().st_size if part.exists() else 0


def shown(url):
    """Address as messages show it: without query, which may carry a signature, and without login."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


def origin(url):
    """(scheme, host, port) of a URL: the server that credentials belong to."""
    parts = urlsplit(url)
    return parts.scheme, parts.hostname or "", parts.port or PORTS.get(parts.scheme, 0)


def authorization(url, start):
    """Value of the Authorization header for one address, to which redirects from ``start`` may have led; or None.

    Credentials travel encrypted, or stay on this machine. An entry of netrc without a port holds for the server that
    was asked for and for the usual port of https; a redirect to another port of a host gets nothing.
    """
    server, asked = origin(url), origin(start)
    if server[0] != "https" and not is_loopback(server[1]):
        return None
    token = os.environ.get("EARTHDATA_TOKEN")
    if token and server == TOKENS:
        return f"Bearer {token}"
    prefix = "EARTHDATA" if server == EARTHDATA else "GRAVCAL_FETCH" if server == asked and server != TOKENS else None
    login = tuple(os.environ.get(f"{prefix}_{name}") for name in ("USERNAME", "PASSWORD"))
    login = login if prefix and all(login) else _from_netrc(server, asked)
    return login and "Basic " + base64.b64encode(":".join(login).encode()).decode()


def is_loopback(host: str | None) -> bool:
    """True if a host, name or IP address, is this machine itself."""
    try:
        return ipaddress.ip_address((host or "").strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def _from_netrc(here, asked):
    """(name, password) of a server (scheme, host, port) in the netrc file, or None; its default entry is not used."""
    path = Path(os.environ.get("NETRC") or "~/.netrc").expanduser()
    try:
        hosts = netrc.netrc(path).hosts
    except FileNotFoundError:
        return None
    except (netrc.NetrcParseError, OSError, ValueError) as error:
        line = f", line {error.lineno}" if getattr(error, "lineno", None) else ""
        raise CatalogError(
            f"{path}{line}: cannot be read, expected entries 'machine HOST login NAME password PASSWORD'. Correct it."
        ) from None  # the message of netrc quotes the word it stumbled over
    scheme, host, port = here
    usual = here == asked or (scheme, port) == ("https", PORTS["https"])
    entry = hosts.get(f"{host}:{port}") or (hosts.get(host) if usual else None)
    return entry and (entry[0], entry[2])
