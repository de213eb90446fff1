"""The command `gravcal series`: a page and a document, and nothing where there is nothing."""

import json

import pytest
from invented_store import EVENT, dataset, put, result
from typer.testing import CliRunner

from flows import cli
from gravcal.browse import store_index
from gravcal.store.schemas import VERSION


@pytest.fixture(autouse=True)
def results(store_folder):
    """Put a result of which one value is not determined into the store."""
    store_index._known.clear()
    store_index._json.cache_clear()
    put(f"{EVENT}/com_offset.report", dataset(10), files={"result.json": json.dumps(result(EVENT, [10.0, None, -5.0]))})
    return store_folder


def gravcal(*arguments):
    """Exit code and what was said."""
    done = CliRunner().invoke(cli.app, ["series", *map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_a_calibration_has_a_series(tmp_path):
    """Contract: page and document of the values that are determined, with their event."""
    page, path = tmp_path / "deep" / "series.html", tmp_path / "rows.json"
    code, said = gravcal("com_offset", "--out", page, "--json", path)
    assert code == 0
    found = json.loads(path.read_text())
    assert (found["schema_version"], found["status"], found["calibration"]) == (VERSION, "delivered", "com_offset")
    own = [row for row in found["rows"] if row["kind"] == "measured"]
    assert [row["event"] for row in own] == [EVENT] * 2
    assert f"{len(found['rows'])} rows in {page}" in said
    assert EVENT in page.read_text()


def test_a_series_of_nothing_says_so_and_leaves_the_page(tmp_path):
    """Contract: exit code 3 and "no_data"; an older page stays, a new one is not made."""
    old, new = tmp_path / "old.html", tmp_path / "new.html"
    old.write_text("kept")
    for page in (old, new):
        code, said = gravcal("com_offset", "--satellite", "D", "--out", page, "--json", tmp_path / "rows.json")
        assert code == 3
        assert "no result of com_offset of D in " in said
        found = json.loads((tmp_path / "rows.json").read_text())
        assert (found["status"], found["rows"]) == ("no_data", [])
    assert old.read_text() == "kept"
    assert not new.exists()
    assert gravcal("com_offset", "--satellite", "X", "--out", new)[0] == 2
