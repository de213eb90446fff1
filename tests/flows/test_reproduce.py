"""Source papers again, from an archive on loopback and without one."""

import functools
import http.server
import json
import tarfile
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows import calibration, cli, reproduce
from gravcal import catalog

ROOT = Path(__file__).parents[2]


@pytest.fixture
def archive(tmp_path):
    """Address of a server that has the simulated files of 2020-02-01 as the archives keep them."""
    raw, root = tmp_path / "raw", tmp_path / "served"
    settings = {"date": "2020-02-01", "manoeuvres": "pitch_high,roll_high"}
    paper = reproduce.papers()["com_offset"]
    calibration.load("com_offset").simulate(raw, seed=1, settings=paper["simulate"] | settings)
    for level in ("1A", "1B"):
        folder = root / f"grace-fo/Level-{level}/JPL/INSTRUMENT/RL04/2020"
        folder.mkdir(parents=True)
        with tarfile.open(folder / f"gracefo_{level}_2020-02-01_RL04.ascii.noLRI.tgz", "w:gz") as packed:
            for path in sorted(raw.glob(f"*{level}_*")):
                packed.add(path, path.name)
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=root)
    handler.log_message = lambda *_: None
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_paper_is_reproduced_from_an_archive(archive, tmp_path, monkeypatch):
    """Contract: days fetched, both runs beside print, each table and figure with rows, figures or a reason."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    out = tmp_path / "out"
    done = CliRunner().invoke(cli.app, ["reproduce", "com_offset", "--from", archive, "--out", str(out)])
    assert done.exit_code in (0, 4), done.output
    assert {path.suffix for path in (out / "data").iterdir()} == {".tgz"}
    document = json.loads((out / "reproduction.json").read_text())
    assert document["origin"] == "simulated"
    items = {item["name"]: item for item in document["items"]}
    assert all(item["rows"] or item.get("reason") or item.get("report") for item in items.values())
    row = next(row for row in items["Table 6"]["rows"] if row["row"] == "mtq x")
    assert row["printed"] == [107.2, 0.7]
    for run in reproduce.RUNS:  # truth of these days is 107.0
        value, sigma = row[run]
        assert abs(value - 107.0) < 5 * sigma + 5
        assert (out / run / "report.html").is_file()
    assert row["corrected"][1] > row["as_printed"][1]
    page = (out / "index.html").read_text()
    assert page.count("<figure") >= 2
    assert page.count("Not made") == sum("reason" in item for item in items.values())
    assert len((out / "comparison.csv").read_text().splitlines()) == 1 + sum(len(i["rows"]) for i in items.values())


def test_papers_name_sections_that_there_are_and_reports_have(tmp_path):
    """Contract: what a paper names is in the catalogue, its calibration can recompute it, unknown names are usage."""
    for name, paper in reproduce.papers().items():
        one = calibration.load(name)
        assert one.recomputed is not None
        chosen = catalog.parameters(name).with_settings(paper["as_printed"])
        assert chosen.calibration == name
        catalog.parameters(f"simulate_{name}").with_settings(paper["simulate"])
        sections = catalog.published(name)
        for item in [*paper["tables"], *paper["figures"]]:
            assert ("reason" in item) != ("section" in item or "report" in item), item["name"]
            assert item.get("section", "scalars") in sections
            headings = (ROOT / f"gravcal/calibrations/{name}/page.py").read_text()
            assert f'"{item["report"]}' in headings if "report" in item else True, item["name"]
    done = CliRunner().invoke(cli.app, ["reproduce", "nothing", "--out", str(tmp_path)])
    assert done.exit_code == 2
