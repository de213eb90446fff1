"""One file over http: resumed where it broke off, repeated with growing pauses, written aside by the caller's path."""

import json
import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import urljoin, urlsplit

from gravcal.errors import ProductError
from gravcal.io import fetch_login

CHUNK = 1 << 16
REDIRECTS = 10  # Earthdata needs four
TEXT_LIMIT = 1 << 16  # bytes of a checksum file
SIZE_LIMIT = 1 << 34  # bytes; the largest archive of a day has less than 1e9
AGAIN = (408, 425, 429, 500, 502, 503, 504)


@dataclass(frozen=True)
class Patience:
    """How long a server is waited for; an attempt that brought 1 % more bytes starts the count anew.

    tell : function of a line, called before every pause; or None
    """

    attempts: int = 6
    wait_s: float = 1.0  # first pause, doubled each time
    longest_wait_s: float = 60.0
    connect_s: float = 8.0
    stall_s: float = 60.0  # without any byte
    slowest: float = 100.0  # bytes per second, over the time of a stall
    tell: Callable | None = None


class Interrupted(Exception):
    """A transfer that may go better the next time."""

    def __init__(self, reason, pause_s=0.0):
        super().__init__(reason)
        self.pause_s = pause_s


class Missing(Exception):
    """The server has no such file."""


def session():
    """Session that keeps the cookies of a login; proxies and certificates are those of the environment."""
    import requests

    return requests.Session()


def text(opened, url, patience):
    """Text of a small file.

    Parameters
    ----------
    opened : session
    url : str
    patience : Patience

    Raises
    ------
    Missing : there is none
    ProductError : the server refuses or does not answer
    """

    def attempt():
        with _ask(opened, url, {}, patience) as response:
            _check_status(response, url)
            return b"".join(_chunks(response, patience, TEXT_LIMIT)).decode(errors="replace")

    return _persistently(attempt, url, patience, lambda: 0)


def download(opened, url, part, patience, listener):
    """Bring a file, from where an earlier attempt broke off.

    Parameters
    ----------
    opened : session
    url : str
    part : Path, file that grows; its note stands beside it
    patience : Patience
    listener : function of bytes there and bytes in all (or None)

    Raises
    ------
    Missing : the server has no such file
    ProductError : the server refuses, or breaks off too often; what came stays for the next run
    """
    if _note(part).get("url") != url:
        discard(part)
    return _persistently(lambda: _go_on(opened, url, part, patience, listener), url, patience, lambda: _size(part))


def discard(part):
    """Forget what came."""
    part.unlink(missing_ok=True)
    _note_path(part).unlink(missing_ok=True)


def shown(url):
    """Address as messages show it: without query, which may carry a signature, and without login."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


def _persistently(attempt, url, patience, progress):
    """Result of an attempt, repeated while it is interrupted."""
    failed, best = 0, max(progress(), 1)
    while True:
        try:
            return attempt()
        except Interrupted as stop:
            reached = progress()
            failed = 0 if reached > 1.01 * best else failed + 1
            best = max(best, reached)
            if failed >= patience.attempts:
                raise ProductError(
                    f"{shown(url)}: {stop}, {failed} times in a row; expected the whole file. Run the command again "
                    f"later, it goes on where it stopped; or name another archive with --from.",
                    attempts=failed,
                ) from None
            pause = min(max(stop.pause_s, patience.wait_s * 2**failed), patience.longest_wait_s)
            if patience.tell:
                patience.tell(f"{shown(url)}: {stop}; attempt {failed + 1} of {patience.attempts} in {pause:.0f} s")
            time.sleep(pause)


def _go_on(opened, url, part, patience, listener):
    """One attempt to bring what is missing."""
    note, have = _note(part), _size(part)
    if have and have == note.get("total"):
        return
    headers = {"Range": f"bytes={have}-"} if have else {}
    if have and note.get("validator"):
        headers["If-Range"] = note["validator"]
    with _ask(opened, url, headers, patience) as response:
        if response.status_code == 416:
            discard(part)
            raise Interrupted("the server does not know the part that is missing")
        _check_status(response, url)
        start, total = _extent(response, have, part)
        validator = _validator(response)
        _note_path(part).write_text(json.dumps({"url": url, "validator": validator, "total": total}))
        _append(part, start, total, listener, _chunks(response, patience, SIZE_LIMIT))
    if total is not None and _size(part) != total:
        raise Interrupted(f"broke off at {_size(part)} of {total} bytes")


def _append(part, start, total, listener, chunks):
    """Write chunks from a position on; a full disk is no reason to try again."""
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    with os.fdopen(descriptor, "wb") as stream:
        stream.truncate(start)
        stream.seek(start)
        done = start
        for chunk in chunks:
            stream.write(chunk)
            done += len(chunk)
            if listener:
                listener(done, total)


def _ask(opened, url, headers, patience):
    """Answer to a question, redirects followed one by one so that credentials go to their own host only."""
    here = url
    for _ in range(REDIRECTS):
        login = fetch_login.authorization(here, url)
        sent = {"Accept-Encoding": "identity", **headers} | ({"Authorization": login} if login else {})
        response = _get(opened, here, sent, patience)
        if not response.is_redirect:
            return response
        following = urljoin(here, response.headers["Location"])
        response.close()
        _check_redirect(here, following)
        here = following
    raise ProductError(f"{shown(url)}: more than {REDIRECTS} redirects, expected a file. Check your login.")


def _get(opened, url, headers, patience):
    """Answer of one server; its errors without the address, which may be signed."""
    import requests

    def as_is(request):  # keeps requests from looking for credentials itself
        return request

    limits = (patience.connect_s, patience.stall_s)
    try:
        return opened.get(url, headers=headers, auth=as_is, stream=True, allow_redirects=False, timeout=limits)
    except requests.exceptions.SSLError:
        raise ProductError(
            f"{shown(url)}: its certificate is not trusted. Check the address and the clock; certificates of your "
            f"institute are named in REQUESTS_CA_BUNDLE."
        ) from None
    except requests.RequestException as error:
        raise Interrupted(f"no answer ({type(error).__name__})") from None


def _check_redirect(here, following):
    """Raise unless a redirect stays with http(s), encrypted if it was, and carries no login."""
    scheme, host, _ = fetch_login.origin(following)
    open_line = scheme == "http" and here.startswith("https:") and not fetch_login.is_loopback(host)
    if scheme not in ("http", "https") or open_line or "@" in urlsplit(following).netloc:
        raise ProductError(
            f"{shown(here)}: redirects to {shown(following)}, expected a secure address. Name another archive."
        )


def _check_status(response, url):
    """Raise what a status means, unless it is success."""
    status = response.status_code
    if status in (200, 206):
        return
    if status in (404, 410):
        raise Missing(shown(url))
    if status in AGAIN:
        pause = response.headers.get("Retry-After", "")
        raise Interrupted(f"the server answers {status}", float(pause) if pause.isdigit() else 0.0)
    if status in (401, 403):
        host = urlsplit(response.url).hostname
        raise ProductError(
            f"{shown(url)}: {host} answers {status}, expected the file; it wants a login, or another one. "
            f"{fetch_login.REMEDY}",
            status=status,
        )
    raise ProductError(f"{shown(url)}: the server answers {status}, expected the file. Check the address.")


def _extent(response, have, part):
    """Position at which the answer starts, and size of the whole file (None if the server does not say)."""
    if response.status_code == 200:
        length = response.headers.get("Content-Length", "")
        return 0, int(length) if length.isdigit() else None
    found = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", response.headers.get("Content-Range", "").strip())
    known = _note(part).get("validator")
    if not found or int(found[1]) != have or (known and _validator(response) not in (None, known)):
        discard(part)
        raise Interrupted("the server sent another part than was asked for")
    return have, None if found[2] == "*" else int(found[2])


def _chunks(response, patience, limit):
    """Bytes as they come; a line that is silent or hardly moves ends with Interrupted."""
    import urllib3

    count, total, since = 0, 0, time.monotonic()
    while True:
        try:
            chunk = response.raw.read1(CHUNK, decode_content=False)
        except (urllib3.exceptions.HTTPError, OSError) as error:
            stalled = isinstance(error, urllib3.exceptions.ReadTimeoutError | TimeoutError)
            reason = f"nothing came for {patience.stall_s:g} s" if stalled else "the connection broke off"
            raise Interrupted(reason) from None
        if not chunk:
            return
        count, total = count + len(chunk), total + len(chunk)
        if total > limit:
            raise ProductError(f"{shown(response.url)}: more than {limit} bytes, expected less. Check the address.")
        yield chunk
        if (passed := time.monotonic() - since) > patience.stall_s:
            if count < patience.slowest * passed:
                raise Interrupted(f"{count} bytes in {passed:.0f} s")
            count, since = 0, time.monotonic()


def _validator(response):
    """What tells whether the file is still the same, or None."""
    tag = response.headers.get("ETag")
    return tag if tag and not tag.startswith("W/") else response.headers.get("Last-Modified")


def _size(part):
    """Bytes that came."""
    return part.stat().st_size if part.exists() else 0


def _note_path(part):
    """File that says what a part is of."""
    return part.with_name(f"{part.name}.json")


def _note(part):
    """What is known of the file a part is of: address, validator, size."""
    try:
        return json.loads(_note_path(part).read_text())
    except (OSError, ValueError):
        return {}
