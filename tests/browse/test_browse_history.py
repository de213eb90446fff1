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


def test_a_calibration_has_a_series_and_of_nothing_an_older_page_stays(tmp_path):
    """Contract: page and document of the values that are determined; nothing: exit code 3, "no_data", no page."""
    page, path = tmp_path / "deep" / "series.html", tmp_path / "rows.json"
    code, said = gravcal("com_offset", "--out", page, "--json", path)
    assert code == 0
    found = json.loads(path.read_text())
    assert (found["schema_version"], found["status"], found["calibration"]) == (VERSION, "delivered", "com_offset")
    assert [row["event"] for row in found["rows"] if row["kind"] == "measured"] == [EVENT] * 2
    assert f"{len(found['rows'])} rows in {page}" in said
    before = page.read_text()
    assert EVENT in before
    code, said = gravcal("com_offset", "--satellite", "D", "--out", page, "--json", path)
    assert code == 3
    assert "no result of com_offset of D in " in said
    found = json.loads(path.read_text())
    assert (found["status"], found["rows"], page.read_text()) == ("no_data", [], before)
    assert gravcal("com_offset", "--satellite", "X", "--out", page)[0] == 2
