"""Fetching: from a server on this machine that breaks off, stalls, lies, redirects and asks who is there."""

import base64
import datetime
import gzip
import hashlib
import io
import tarfile
import time
from dataclasses import replace
from http.server import BaseHTTPRequestHandler

import pytest
from commands import serving
from typer.testing import CliRunner

from flows import cli
from gravcal import catalog
from gravcal.errors import CatalogError, GravcalError, ProductError
from gravcal.io import fetch
from gravcal.io.fetch import Patience, is_loopback

DAY = datetime.date(2020, 2, 1)
SOON = Patience(attempts=3, wait_s=0.01, longest_wait_s=0.05, connect_s=5.0, stall_s=0.3)
SECRET = "s3cret-word"
BASIC = "Basic " + base64.b64encode(f"me:{SECRET}".encode()).decode()


def packed(content):
    """Return the bytes of an archive with one Level-1 file."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as archive:
        item = tarfile.TarInfo("MAG1B_2020-02-01_C_04.txt")
        item.size = len(content)
        archive.addfile(item, io.BytesIO(content))
    return gzip.compress(plain.getvalue(), 0, mtime=0)


CONTENT = bytes(range(256)) * 1200
IMAGE = packed(CONTENT)
ONE = fetch.Archive("gracefo", "1B", DAY, "04")


class Server:
    """An archive on loopback: files by path, faults to be had once each, and what it was asked."""

    def __init__(self):
        self.files, self.faults, self.asked, self.login = {}, [], [], None
        silent = {"do_GET": lambda request: self.answer(request), "log_message": lambda *_: None}
        self.handler = type("Handler", (BaseHTTPRequestHandler,), silent)

    def put(self, archive, image, md5=True):
        """Store an archive where the layout has it."""
        path = fetch.addresses(archive, self.url)[0].removeprefix(self.url)
        self.files[path] = image
        if md5:
            self.files[f"{path}.md5"] = f"{hashlib.md5(image).hexdigest()}  {archive.name}\n".encode()

    def answer(self, request):
        """Answer one request, with the next fault if it is for an archive."""
        self.asked.append((request.path, request.headers.get("Range"), request.headers.get("Authorization")))
        if self.login and request.headers.get("Authorization") != self.login:
            return self.reply(request, 401, b"", {"WWW-Authenticate": "Basic"})
        body = self.files.get(request.path.partition("?")[0])
        if body is None:
            return self.reply(request, 404, b"")
        is_archive = request.path.partition("?")[0].endswith("gz")
        fault, value = self.faults.pop(0) if is_archive and self.faults else ("none", None)
        if fault == "status":
            return self.reply(request, value, b"", {"Retry-After": "0"})
        if fault == "redirect":
            return self.reply(request, 302, b"", {"Location": value + request.path})
        return self.send(request, fault, value or body)

    def send(self, request, fault, body):
        """Send a file or the part asked for, whole, cut in the middle or with a pause."""
        start = 0
        if request.headers.get("Range") and fault != "whole":
            start = int(request.headers["Range"].removeprefix("bytes=").partition("-")[0])
        part, head = body[start:], {}
        if start:
            head["Content-Range"] = f"bytes {start}-{len(body) - 1}/{len(body)}"
        if fault in ("cut", "stall"):
            self.reply(request, 206 if start else 200, part, head, len(part) // 2)
            time.sleep(2 * SOON.stall_s if fault == "stall" else 0)
            request.close_connection = True
        else:
            self.reply(request, 206 if start else 200, part, head)

    def reply(self, request, status, body, headers=None, sent=None):
        """Status, headers and as much of the body as wanted."""
        request.send_response(status)
        for name, value in ({"Content-Length": str(len(body))} | (headers or {})).items():
            request.send_header(name, value)
        request.end_headers()
        request.wfile.write(body[:sent])
        request.wfile.flush()

    def archives_asked(self):
        """Requests for archives that exist: Range and Authorization."""
        return [(r, a) for path, r, a in self.asked if path.endswith("gz")]


@pytest.fixture(autouse=True)
def _no_credentials(monkeypatch, tmp_path):
    """Keep the user's own credentials out."""
    for name in ("EARTHDATA_USERNAME", "EARTHDATA_PASSWORD", "EARTHDATA_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def archive():
    """An archive that has one day; at its end it closes."""
    one = Server()
    with serving(one.handler) as one.url:
        one.put(ONE, IMAGE)
        yield one


server, other = pytest.fixture(archive, name="server"), pytest.fixture(archive, name="other")


def get(server, folder, archive=ONE, patience=SOON):
    """Fetch one archive."""
    return fetch.fetch([archive], folder, server.url, patience=patience)[0]


def names(folder):
    """Names of the files of a folder."""
    return sorted(path.name for path in folder.iterdir())


def test_an_archive_is_checked_and_the_second_time_it_is_there(server, tmp_path):
    """Contract: MD5 of the archive; the second run asks nothing."""
    told = []
    done = fetch.fetch([ONE], tmp_path / "out", server.url, lambda *known: told.append(known), SOON)[0]
    assert (done.state, done.checked, done.size) == ("fetched", "md5", len(IMAGE))
    assert done.path.read_bytes() == IMAGE
    assert told[-1] == (ONE.name, len(IMAGE), len(IMAGE))
    assert names(tmp_path / "out") == [ONE.name, f"{ONE.name}.md5"]
    asked = len(server.asked)
    assert get(server, tmp_path / "out").state == "there"
    assert len(server.asked) == asked


@pytest.mark.parametrize(
    "faults",
    [
        [("cut", None), ("cut", None), ("status", 503)],
        [("stall", None), ("cut", None), ("status", 503)],
        [("cut", None), ("whole", None)],
    ],
    ids=["cut", "stall", "without ranges"],
)
def test_a_broken_or_silent_transfer_goes_on_where_it_stopped(server, tmp_path, faults):
    """Contract: Range after a break and after a stall, 200 in answer to it too; the bytes are whole."""
    server.faults = list(faults)
    assert get(server, tmp_path).path.read_bytes() == IMAGE
    starts = [int(r[6:-1]) for r, _ in server.archives_asked() if r]
    assert starts == sorted(starts)
    assert starts[0] == len(IMAGE) // 2


@pytest.mark.parametrize("changed", [False, True])
def test_the_next_run_resumes_what_the_last_one_gave_up(server, tmp_path, changed):
    """Contract: the part stays and is no archive to the readers; a file that changed meanwhile starts anew."""
    server.faults = [("cut", None)] + [("status", 503)] * 3
    with pytest.raises(ProductError, match="503, 3 times in a row"):
        get(server, tmp_path)
    assert names(tmp_path) == [f".{ONE.name}.part"]
    image = IMAGE
    if changed:
        image = packed(CONTENT[::-1])
        server.put(ONE, image)
    assert get(server, tmp_path).path.read_bytes() == image
    assert [part for part, _ in server.archives_asked()][4:] == [f"bytes={len(IMAGE) // 2}-"] + [None] * changed


def test_wrong_bytes_are_fetched_again_and_never_delivered(server, tmp_path):
    """Contract: once wrong, then right; always wrong is an error with both digests and leaves nothing."""
    wrong = IMAGE[:1000] + b"\0" + IMAGE[1001:]
    server.faults = [("wrong", wrong)]
    assert get(server, tmp_path / "one").path.read_bytes() == IMAGE
    server.faults = [("wrong", wrong)] * 3
    with pytest.raises(ProductError, match=hashlib.md5(wrong).hexdigest()):
        get(server, tmp_path / "two")
    assert names(tmp_path / "two") == []


def test_a_web_page_or_damaged_archive_without_checksum_is_refused(server, tmp_path):
    """Contract: what the archive does not vouch for is read to its end."""
    for image in (b"<html>please log in</html>", IMAGE[: len(IMAGE) // 2]):
        server.files.clear()
        server.put(ONE, image, md5=False)
        with pytest.raises(ProductError):
            get(server, tmp_path)
        assert names(tmp_path) == []
    server.put(ONE, IMAGE, md5=False)
    assert get(server, tmp_path).checked == "compression only"


def test_members_are_what_the_catalogue_knows(server, tmp_path):
    """Contract: SHA-256 of the Level-1 files of the event."""
    name, digest = "MAG1B_2020-02-01_C_04.txt", hashlib.sha256(CONTENT).hexdigest()
    known = fetch.Archive("gracefo", "1B", DAY, "04", digests=((name, digest),))
    assert get(server, tmp_path / "one", known).checked == "md5 and sha256"
    with pytest.raises(ProductError, match="as catalogued"):
        get(server, tmp_path / "two", replace(known, digests=((name, "0" * 64),)))


def test_credentials_of_netrc_reach_their_host_and_no_other(server, other, tmp_path, capfd):
    """Contract: sent where asked; not to another port after a redirect; not in the folder, not on the screen."""
    (tmp_path / "netrc").write_text(f"machine 127.0.0.1 login me password {SECRET}\ndefault login me password x\n")
    server.login = BASIC
    server.faults = [("redirect", other.url)]
    assert get(server, tmp_path / "out").path.read_bytes() == IMAGE
    assert {login for _, login in server.archives_asked()} == {BASIC}
    assert {login for _, login in other.archives_asked()} == {None}
    assert not any(SECRET.encode() in path.read_bytes() for path in (tmp_path / "out").iterdir())
    assert capfd.readouterr() == ("", "")


def test_a_refused_login_is_not_tried_again(server, tmp_path, monkeypatch):
    """Contract: one request, an error that says where to put the login and not what it was."""
    server.login = "Basic other"
    monkeypatch.setenv("GRAVCAL_FETCH_USERNAME", "me")
    monkeypatch.setenv("GRAVCAL_FETCH_PASSWORD", SECRET)
    with pytest.raises(ProductError, match=r"answers 401.*netrc") as caught:
        get(server, tmp_path)
    assert SECRET not in str(caught.value)
    assert [login for _, login in server.archives_asked()] == [BASIC]


def test_logins_belong_to_one_host_and_an_encrypted_line(monkeypatch, tmp_path):
    """Contract: Earthdata's only to Earthdata, over https; a netrc that cannot be read is not quoted."""
    monkeypatch.setenv("EARTHDATA_USERNAME", "me")
    monkeypatch.setenv("EARTHDATA_PASSWORD", SECRET)
    start = f"{fetch.PLACES['podaac']}/file"
    login = fetch.authorization
    assert login("https://urs.earthdata.nasa.gov/oauth/authorize?x=1", start) == BASIC
    assert login("http://urs.earthdata.nasa.gov/oauth", start) is None
    assert login("https://urs.earthdata.nasa.gov.example.org/", start) is None
    assert login(start, start) is None
    monkeypatch.setenv("EARTHDATA_TOKEN", "token")
    assert login(start, start) == "Bearer token"
    assert login("https://example.org/", start) is None
    (tmp_path / "netrc").write_text(f"machine example.org {SECRET} password")
    with pytest.raises(CatalogError) as caught:
        login("https://example.org/", start)
    assert SECRET not in str(caught.value)


def test_unsafe_redirects_and_places_are_refused(server, tmp_path):
    """Contract: other schemes, and passwords in an address; errors show no query of a signed one, nor a login."""
    server.faults = [("redirect", "file://")]
    with pytest.raises(ProductError, match="redirects to"):
        get(server, tmp_path)
    for place in ("nasa", "ftp://example.org", "https://me:pw@example.org"):
        with pytest.raises(CatalogError) as caught:
            fetch.fetch([ONE], tmp_path, place)
        assert "pw" not in str(caught.value)
    assert fetch.shown("https://me:pw@example.org/a?signature=x") == "https://example.org/a"


def test_a_link_in_the_folder_does_not_lead_outside(server, tmp_path):
    """Contract: the name is replaced, what it pointed to stays."""
    outside = tmp_path / "outside"
    outside.write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ONE.name).symlink_to(outside)
    (tmp_path / "out" / f".{ONE.name}.part").symlink_to(outside)
    get(server, tmp_path / "out")
    assert outside.read_text() == "mine"
    assert (tmp_path / "out" / ONE.name).read_bytes() == IMAGE


def test_one_missing_archive_stops_no_other(server, tmp_path):
    """Contract: the error comes after all were tried."""
    with pytest.raises(ProductError, match="no such file"):
        fetch.fetch([replace(ONE, level="1A"), ONE], tmp_path, server.url, patience=SOON)
    assert (tmp_path / ONE.name).exists()


def test_an_event_needs_the_archives_of_its_products():
    """Contract: names as in the archives; both levels for the offset, one for GRACE's ranging; none for Taiji."""
    found = fetch.of_event(catalog.event("grace-c-2020-02-01"))
    assert [one.name for one in found] == [f"gracefo_1{level}_2020-02-01_RL04.ascii.noLRI.tgz" for level in "AB"]
    found = fetch.of_event(catalog.event("grace-ab-2002-04-08"))
    assert [one.name for one in found] == ["grace_1B_2002-04-08_02.tar.gz", "grace_1B_2002-04-09_02.tar.gz"]
    assert fetch.addresses(found[0], "isdc")[0].endswith("/grace/Level-1B/JPL/INSTRUMENT/RL02/2002/" + found[0].name)
    with pytest.raises(GravcalError):
        fetch.of_event(catalog.event("taiji-1-2022-05-18"))


def test_the_checksums_of_podaac_are_in_its_public_store(server, tmp_path):
    """Contract: same name below another bucket; a wrong file is noticed by it."""
    address = fetch.addresses(ONE, "podaac")[0]
    first = fetch.checksum_addresses(address)[0]
    assert first == f"{fetch.PODAAC}/podaac-ops-cumulus-public/GRACEFO_L1B_ASCII_GRAV_JPL_RL04/{ONE.name}.md5"
    path = address.removeprefix(fetch.PODAAC)
    server.files = {path: IMAGE, first.removeprefix(fetch.PODAAC): hashlib.md5(IMAGE).hexdigest().encode()}
    (found,) = fetch.fetch([ONE], tmp_path, f"{server.url}/{fetch.PROTECTED}", patience=SOON)
    assert found.checked == "md5"


def test_a_login_page_of_earthdata_is_followed_and_its_cookie_kept(server, other, tmp_path, monkeypatch):
    """Contract: data host to login host, which gets the login, and back with a cookie: the way of Earthdata."""
    monkeypatch.setattr(fetch, "EARTHDATA", fetch.origin(other.url))
    monkeypatch.setenv("EARTHDATA_USERNAME", "me")
    monkeypatch.setenv("EARTHDATA_PASSWORD", SECRET)
    path = fetch.addresses(ONE, server.url)[0].removeprefix(server.url)
    other.login, reply = BASIC, other.reply

    def granted(request, status, body, headers=None, sent=None):
        if status == 401:
            return reply(request, status, body, headers, sent)
        return reply(request, 302, b"", {"Location": f"{server.url}{path}", "Set-Cookie": "asked=yes; Path=/"})

    monkeypatch.setattr(other, "reply", granted)
    answer = server.answer

    def guarded(request):
        if request.path == path and "asked=yes" not in request.headers.get("Cookie", ""):
            server.asked.append((request.path, None, request.headers.get("Authorization")))
            return server.reply(request, 302, b"", {"Location": f"{other.url}/oauth/authorize?client=x"})
        return answer(request)

    monkeypatch.setattr(server, "answer", guarded)
    assert get(server, tmp_path / "out").path.read_bytes() == IMAGE
    assert {login for path, _, login in other.asked if path.startswith("/oauth")} == {BASIC}
    assert {login for _, login in server.archives_asked()} == {None}


def test_other_parts_have_their_places_and_are_checked(server, tmp_path):
    """Contract: each layout says where it was read; a dry run asks nobody; wrong bytes are seen; wrong usage is 2."""
    wrong = ["grace-c-2020-02-01", "--satellite", "C", "--date", "2020-02-01"]
    assert CliRunner().invoke(cli.app, ["fetch", *wrong]).exit_code == 2
    arguments = ["fetch", "--satellite", "CD", "--date", "2024-01-03", "--out", str(tmp_path), "--from", "isdc"]
    done = CliRunner().invoke(cli.app, [*arguments, "--part", "noLRI,LRI,ACX2,MAG,SOE", "--dry-run"])
    assert done.exit_code == 0, done.output
    named = [line.rpartition("/")[2] for line in done.stdout.splitlines()[::2]]
    assert named[3:5] == [f"gracefo_1B_2024-01-03_RL04.ascii.{part}.tgz" for part in ("LRI", "ACX2")]
    assert named[5] == "GF1_OPER_FGM_ACAL_CORR_20240103T000000_20240103T235959_0201.cdf"
    assert named[7:] == ["TN-01_SOE.txt"]
    assert not server.asked
    magnetometer, sequence = fetch.of_day("C", DAY, ["MAG", "SOE"])
    for archive, good in ((magnetometer, fetch.CDF[0] + b"x" * 99), (sequence, b"0.0  GRACEC VKB 3 1.4 0 0\n")):
        server.put(archive, b"<html>log in</html>", md5=False)
        with pytest.raises(ProductError, match="perhaps a web page"):
            get(server, tmp_path, archive)
        server.put(archive, good, md5=False)
        assert get(server, tmp_path, archive).checked.startswith("first bytes")
    with pytest.raises(CatalogError, match="found no place at podaac"):
        fetch.addresses(magnetometer, "podaac")


def test_what_counts_as_loopback():
    """Contract: only there plain http is trusted with a password."""
    assert all(map(is_loopback, ("127.0.0.1", "localhost", "::1", "[::1]", "127.8.9.1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.0.5", "example.org", None)))
