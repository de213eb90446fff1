"""Commands and flows in this process, on the files of a folder; pages of docs; servers on loopback."""

import contextlib
import io
import json
import re
import sys
import tarfile
import threading
import time
from http.server import ThreadingHTTPServer
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows import cli, discover, engine
from flows.calibration import load
from gravcal import catalog
from gravcal.errors import GravcalError
from gravcal.io import archive, readers, writers
from gravcal.store.schemas import validate

MEASURED = Path(__file__).parents[2] / "shared" / "data"


def blocks(page, *languages):
    """Language and text of the fenced blocks of a page in some languages."""
    found = re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    return [one for one in found if one[0] in languages]


def gravcal(*arguments):
    """Exit code of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gravcal", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return ended.value.code or 0


def printed_json(capsys, *arguments):
    """What a command says as JSON; it must deliver."""
    capsys.readouterr()
    assert gravcal(*arguments, "--json", "-") == 0
    return json.loads(capsys.readouterr().out)


def document(word, calibration, data, *options, origin="simulated"):
    """Exit code and valid document of a command on the files of a folder; without one its own error fails the test."""
    target = Path(data).parent / f"{word}.json"
    where = ("--data", data, "--engine", "inline", "--json", target)
    result = CliRunner().invoke(cli.app, [str(one) for one in (word, calibration, *where, *options)])
    if not target.exists():
        raise AssertionError(f"no document, exit code {result.exit_code}: {result.output}") from result.exception
    found = json.loads(target.read_text())
    validate(found, "discovery" if word == "discover" else None)
    assert found["origin"] == origin
    return result.exit_code, found


@contextlib.contextmanager
def serving(handler):
    """Address of a server on this machine that answers by a handler until the end."""
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def tarred(path, members, kind=tarfile.REGTYPE):
    """Archive with members, {name: bytes or a number of zeros}, or with links of these names."""
    with tarfile.open(path, "w:gz", compresslevel=1) as packed:
        for name, data in members.items():
            item = tarfile.TarInfo(name)
            item.size, item.type, item.linkname = len(bytes(data)), kind, "elsewhere" * (kind != tarfile.REGTYPE)
            packed.addfile(item, io.BytesIO(bytes(data)))
    return path


def until(found, seconds, every=0.1):
    """What a function finds, as soon as that is true, at the latest when its time is over."""
    limit = time.monotonic() + seconds
    while not (value := found()) and time.monotonic() < limit:
        time.sleep(every)
    return value


def run(calibration, folder, discovery=False, satellite=None, **settings):
    """Document, a valid one, of a run or a search on the files of a folder, and its product."""
    one, chosen = load(calibration), catalog.parameters(calibration).with_settings(settings)
    flow, read = (discover.flow_of(calibration), discover.document) if discovery else (one.flow, one.document)
    ref = engine.run(flow, one.source(data=folder, satellite=satellite), chosen, engine="inline")
    found = read(ref)
    validate(found, "discovery" if discovery else None)
    return found, ref


def questionable(calibration, folder, **settings):
    """True if files are refused, or make a questionable document that names a failed check; False if delivered."""
    try:
        document, _ = run(calibration, folder, **settings)
    except GravcalError:
        return True
    failed = [one["name"] for one in document["checks"] if not one["passed"]]
    assert all(one in document["verdict"]["text"] for one in failed)
    return document["status"] == "questionable"


def simulated(calibration, folder, seed, effects=None, **settings):
    """Truth of an invented event whose files are in a folder; effects as {slug: {parameter: value}}."""
    hidden = {f"{slug}.{name}": size for slug, given in (effects or {}).items() for name, size in given.items()}
    return load(calibration).simulate(folder, seed=seed, effects=hidden, settings=settings)


def discovered(calibration, folder, *options, origin="simulated"):
    """Document of `gravcal discover` on the files in level1 of a folder."""
    code, found = document("discover", calibration, folder / "level1", *options, origin=origin)
    assert code == 0, found.get("error")
    return found


def causes(found):
    """Causes that a search has named."""
    return [one["cause"] for one in found["findings"]]


def shortened(folder, hours, late="", by_s=0):
    """Leave of the files of a day the first hours; tags of a product of some satellites ("SCA1B CD") are late."""
    for path in sorted(folder.iterdir()):
        file = archive.from_name(path)
        columns = {name: one.values for name, one in readers.read(file).items()}
        tags = "gps_time" if "gps_time" in columns else "time_intg"
        kept = columns[tags] < columns[tags][0] + 3600 * hours
        columns = {name: one[kept] for name, one in columns.items()}
        columns[tags] = columns[tags] + by_s * (file.product == late[:5] and file.satellite in late[6:])
        writers.write(columns, path)
