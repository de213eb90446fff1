"""The command line in this process."""

import json
import sys
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
