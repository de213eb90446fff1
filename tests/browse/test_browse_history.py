"""The command `gravcal series`: every calibration, a document, and nothing where there is nothing."""

import json

import pytest
from invented_store import dataset, put, result
from typer.testing import CliRunner

from flows import cli
from gravcal.browse import store_index
from gravcal.store.schemas import VERSION

STATUS = {"status": "delivered", "verdict": {"text": "Delivered."}, "origin": "measured"}
TWO = {"value": [1.0, None, 3.0], "sigma": [0.1, None, 0.3]}
PHASE = {letter: {"phase_centre_mm": [1445.0, 0.1, None], "sigma_mm": [0.1, 0.2, None]} for letter in "CD"}
DOCUMENTS = {
    "com_offset": ("grace-c-2020-03-01", result("grace-c-2020-03-01", [10.0, None, -5.0])),
    "kbr_phase_centre": ("grace-cd-2020-09-10", {"adopted": {"satellites": PHASE}}),
    "inertial_sensor": ("taiji-t-2019-09-20", {"swing": {"adopted": TWO, "k": {"x": None}}, "roll": {}}),
    "gradient_torque": ("demo-s-2020-01-01", {"drag": {"two_sensor": {"sigma_total_rms": 1e-13}}}),
}
EXPECTED = {"com_offset": 2, "kbr_phase_centre": 4, "inertial_sensor": 2, "gradient_torque": 1}


@pytest.fixture(autouse=True)
def results(store_folder):
    """Put one result of each calibration into the store."""
    store_index._known.clear()
    store_index._json.cache_clear()
    for name, (event, content) in DOCUMENTS.items():
        files = {"result.json": json.dumps(STATUS | {"event": event} | content)}
        put(f"{event}/{name}.report", dataset(10), files=files)
    return store_folder


def gravcal(*arguments):
    """Exit code and what was said."""
    done = CliRunner().invoke(cli.app, ["series", *map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_calibration_has_a_series(name, tmp_path):
    """Contract: page and document of the values that are determined, with their event."""
    page, path = tmp_path / "deep" / "series.html", tmp_path / "rows.json"
    code, said = gravcal(name, "--out", page, "--json", path)
    assert code == 0
    found = json.loads(path.read_text())
    assert (found["schema_version"], found["status"], found["calibration"]) == (VERSION, "delivered", name)
    own = [row for row in found["rows"] if row["kind"] == "measured"]
    assert len(own) == EXPECTED[name]
    assert {row["event"] for row in own} == {DOCUMENTS[name][0]}
    assert f"{len(found['rows'])} rows in {page}" in said
    assert DOCUMENTS[name][0] in page.read_text()


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
