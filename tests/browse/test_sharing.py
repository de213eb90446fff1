"""What leaves the store: an event in one zip, the catalogue of results."""

import csv
import io
import json
import urllib.parse
import zipfile
from pathlib import Path
from unittest import mock

import pytest
import xarray as xr
import yaml
from commands import gravcal, printed_json
from invented_store import EVENT, calibration, dataset, model, put, result

from flows import export
from flows.calibration import load, model_text
from gravcal.errors import ProductError
from gravcal.report import comparison
from gravcal.store import configurations, history, location, product
from gravcal.store.schemas import VERSION

ROOT = Path(__file__).parent.parent.parent


def test_an_event_leaves_in_one_zip(shop, tmp_path, capsys):
    """Contract: report, document, products as they are, provenance, citation; nothing that is there is overwritten."""
    out = tmp_path / "shared" / "event.zip"
    assert gravcal("export", EVENT, "--out", out) == 0
    assert capsys.readouterr().out == f"8 files in {out}; CITATION.cff says what to cite\n"
    with zipfile.ZipFile(out) as archive:
        files = {name.removeprefix(f"{EVENT}/"): archive.read(name) for name in archive.namelist()}
    assert {"report/com_offset.report/report.html", "report/com_offset.report/result.json"} <= set(files)
    assert files["products/com_offset.solve.mtq.nc"] == shop["again"]["mtq"].path.read_bytes()
    assert product.digest(product.from_bytes(files["products/com_offset.align.nc"]))
    made_of = json.loads(files["provenance.json"])["com_offset.report"]
    assert [one["name"].split("/")[1] for one in made_of["inputs"]] == ["com_offset.solve.mtq", "com_offset.solve.acc"]
    assert [bool(one["inputs"][0]["record"]) for one in made_of["inputs"]] == [True, False]  # written out once
    assert gravcal("export", EVENT, "--out", out) == 1
    with pytest.raises(ProductError, match="gravcal run"):
        export.export("nothing", tmp_path / "x.zip")
    assert gravcal("export", EVENT, "--out", tmp_path / "folder", "--as", "nothing") == 1
    assert sorted(files) == printed_json(capsys, "export", EVENT, "--out", tmp_path / "folder")["files"]
    with xr.open_dataset(tmp_path / "folder" / "products" / "com_offset.align.nc") as opened:
        assert opened.attrs["Conventions"].startswith("CF-")


@pytest.mark.usefixtures("shop")
def test_the_model_of_a_run_leaves_with_it(tmp_path):
    """Contract: a file that gives the same settings, bit for bit, to --model; none without one, a search keeps its own.

    Days, and what the search added to the result, are in it.
    """
    result = {"calibration": "com_offset", "records": "0" * 64, "correction": [1.1e-7], "covariance": [[3.3e-14]]}
    given = model(0.0298, **{"from": "2020-01-01", "to": "2021-01-01"}, result=result)
    with location.configured("model-a"):
        calibration(EVENT, 1.1, gain=1.5, extended=given)
        put(f"{EVENT}/com_offset.discovery_report", dataset(10), {"settings": given}, files={"model.toml": "its own"})
    files = {name: export.export(EVENT, tmp_path / str(name), name)[0] for name in ("model-a", None)}
    models = {name: [one for one in own if one.endswith(".toml")] for name, own in files.items()}
    parts = ("discovery_report", "report")
    assert models == {"model-a": [f"report/com_offset.{one}/model.toml" for one in parts], None: []}
    found, written = (tmp_path / "model-a" / one for one in models["model-a"])
    assert found.read_text() == "its own"
    assert model_text(written) == given["model"]
    assert written.read_text().startswith(f"# Taken out of the records of {EVENT};")


@pytest.mark.usefixtures("shop")
def test_what_was_not_run_since_a_promotion_is_not_compared(monkeypatch):
    """Contract: links stay those of before a promotion until the next run: results of another configuration."""
    for when, count in (("", 2), ("2026-01-01T00:00:00+00:00", 1), ("2026-01-01T00:00:01+00:00", 0)):
        monkeypatch.setattr(configurations, "operational", lambda _, when=when: {"settings": {}, "when": when})
        assert len(comparison.between(load("com_offset"), ["operational"] * 2)["events"]) == count


@pytest.mark.usefixtures("shop")
def test_what_was_made_of_other_files_is_left_out_and_said(tmp_path, capsys):
    """Contract: an archive is of the files of the newest report; the same day of other files is named."""
    for number, stage in enumerate(("magnetometer.align", "magnetometer.report", "ranging.report")):
        put(f"{EVENT}/{stage}", dataset(9), source=f"{number // 2:064}")
    assert gravcal("export", EVENT, "--out", tmp_path / "x.zip") == 0
    assert "of these days: magnetometer.align, magnetometer.report\n" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        names = {Path(name).name for name in archive.namelist()}
    assert names >= {"ranging.report.nc", "com_offset.report.nc"}
    assert "magnetometer.report.nc" not in names


@pytest.mark.usefixtures("shop")
@pytest.mark.parametrize(("satellite", "name"), [("C", "MAG1B"), ("C", "ACC1A"), ("A", "KBR1B"), ("T", "TAIJI")])
def test_a_result_says_what_to_cite(satellite, name, monkeypatch):
    """Contract: measured data and papers by DOI where they have one; a file that the format's keys describe."""
    release = "03" if satellite == "A" else "04"
    monkeypatch.setattr(history, "raw_files", lambda _: [{"satellite": satellite, "product": name, "release": release}])
    reports, both = [one for one in export.housekeeping.entries(event=EVENT) if one.ref.stage.endswith("report")], []
    for origin in ("simulated", "measured"):
        monkeypatch.setattr(export.housekeeping, "content", mock.Mock(return_value=mock.Mock(attrs={"origin": origin})))
        both.append(yaml.safe_load(export.citation(EVENT, "operational", reports)))
    found, measured = both
    for one in (measured, yaml.safe_load((ROOT / "CITATION.cff").read_text())):
        assert {"cff-version", "message", "title", "authors", "type", "references"} <= set(one)
        assert all({"type", "title", "authors"} <= set(reference) for reference in one["references"])
    assert [one["doi"] for one in found["references"]] == ["10.3390/rs14164030"]
    cited = [one.get("doi") for one in measured["references"] if one["type"] == "data"]
    known = {
        "MAG1B": ["10.5067/GFJPL-L1B04"],
        "ACC1A": ["10.5067/GFJPL-L1A04"],
        "KBR1B": ["10.5067/GRJPL-L1B03"],
        "TAIJI": [],
    }
    assert cited == known[name]


@pytest.mark.usefixtures("shop")
def test_delivered_results_are_a_catalogue_with_links(ask, tmp_path, capsys):
    """Contract: a row a value, as CSV from the command line and the pages; links lead to files, or pages."""
    assert gravcal("results", "--out", tmp_path / "results.csv") == 0
    assert "10.0 +- 8.0" in capsys.readouterr().out
    rows = list(csv.DictReader(io.StringIO((tmp_path / "results.csv").read_text())))
    assert [(row["event"], row["quantity"], float(row["value"])) for row in rows[:3]] == [
        (EVENT, "x", 10.0), (EVENT, "y", 0.0), (EVENT, "z", -5.0)]  # fmt: skip
    for link in ("report", "document", "product"):
        assert Path(urllib.parse.urlsplit(rows[0][link]).path).is_file()
    served = list(csv.DictReader(io.StringIO(ask("/results.csv").text)))
    assert [row["value"] for row in served] == [row["value"] for row in rows]
    assert ask(urllib.parse.urlsplit(served[0]["document"]).path).status_code == 200
    assert printed_json(capsys, "results", "kbr_phase_centre") == []


@pytest.mark.usefixtures("shop")
def test_a_calibration_has_a_series_and_of_nothing_an_older_page_stays(tmp_path, capsys):
    """Contract: page and document of the values that are determined; nothing: exit code 3, "no_data", no page."""
    document = result("grace-c-2021-05-01", [10.0, None, -5.0])
    put("grace-c-2021-05-01/com_offset.report", dataset(10), files={"result.json": json.dumps(document)})
    page, path = tmp_path / "deep" / "series.html", tmp_path / "rows.json"
    how = ("series", "com_offset", "--out", page, "--json", path)
    assert gravcal(*how) == 0
    found = json.loads(path.read_text())
    assert (found["schema_version"], found["status"], found["calibration"]) == (VERSION, "delivered", "com_offset")
    events = [row["event"] for row in found["rows"] if row["kind"] == "measured"]
    assert [events.count(one) for one in (EVENT, "grace-c-2021-03-01", "grace-c-2021-05-01")] == [3, 3, 2]
    assert f"{len(found['rows'])} rows in {page}" in capsys.readouterr().out
    before = page.read_text()
    assert EVENT in before
    assert gravcal(*how, "--satellite", "D") == 3
    assert "no result of com_offset of D in " in capsys.readouterr().out
    found = json.loads(path.read_text())
    assert (found["status"], found["rows"], page.read_text()) == ("no_data", [], before)
    assert gravcal("series", "com_offset", "--satellite", "X", "--out", page) == 2
