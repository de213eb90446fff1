"""The command line in this process, and servers on loopback for what it asks."""

import contextlib
import json
import sys
import threading
from http.server import ThreadingHTTPServer
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows import cli
from gravcal.store.schemas import validate


def gravcal(*arguments):
    """Exit code of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gravcal", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return ended.value.code or 0


def document(word, calibration, data, *options, origin="simulated"):
    """Exit code and document, a valid one, of a command on the files of a folder, written beside it as WORD.json.

    Without a document the test fails with the command's own error.
    """
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
