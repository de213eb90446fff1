"""Source papers again, from an archive on loopback and without one."""

import functools
import http.server
import json
import re
import tarfile
from pathlib import Path

import pytest
from commands import serving
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
    with serving(handler) as address:
        yield address


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


def test_no_table_or_figure_of_a_paper_is_missing():
    """Contract: numbered without a gap, each on the page, with rows, or why there are none."""
    page = (ROOT / "docs" / "papers.md").read_text()
    for name, paper in reproduce.papers().items():
        _, part = page.split(f"\n## {name}\n")
        part = " ".join(part.partition("\n## ")[0].split())
        for item in [*paper["tables"], *paper["figures"]]:
            _, said = part.split(f"**{item['name']}** ")
            assert said.startswith("not made: ") == ("reason" in item), item["name"]
            assert "reason" in item or item["difference"] in said
        for kind, items in (("Table", paper["tables"]), ("Figure", paper["figures"])):
            numbers = set()
            for one in items:
                for first, last in re.findall(
                    r"(\d+)(?: to (\d+))?", one["name"] if one["name"].startswith(kind) else ""
                ):
                    numbers |= set(range(int(first), int(last or first) + 1))
            if not any(one["name"].startswith("Figures of") for one in items):  # by what they show, not by number
                assert numbers == set(range(1, len(numbers) + 1)), (name, kind)


def row(calibration_name, section, **labels):
    """One printed record."""
    records = catalog.published(calibration_name)[section]
    return next(one for one in records if all(one.labels[key] == value for key, value in labels.items()))


def test_each_calibration_finds_the_number_beside_a_printed_one():
    """Contract: by observable, estimator, component and run; what a document lacks is none."""
    block = {"phase_centre_mm": [1443.0, None, 0.5], "sigma_mm": [2.0, None, 0.1]}
    ranging = {
        "satellites": {"C": {"range": {"ls": block}, "range_acceleration": {"robust": block}}},
        "subsets": {},
        "adopted": {"satellites": {"C": block | {"phase_centre_mm": [1.0, 2.0, 3.0]}}},
    }
    kbr = calibration.load("kbr_phase_centre").recomputed
    asked = {"satellite": "grace-c", "component": "z", "observable": "range"}
    assert kbr(ranging, "ls", row("kbr_phase_centre", "ls", **asked), "corrected") == ([0.5], [0.1])
    assert not kbr(ranging, "robust", row("kbr_phase_centre", "robust", **asked), "corrected")
    assert not kbr(ranging, "subsets", row("kbr_phase_centre", "subsets", **asked), "corrected")
    vector = row("kbr_phase_centre", "vkb1b", solution="paper_2020_09", satellite="grace-c")
    assert kbr(ranging, "vkb1b", vector, "as_printed")[0] == [1443.0, None, 500.0]
    assert kbr(ranging, "vkb1b", vector, "corrected")[0] == [1.0, 2000.0, 3000.0]
    sensor = calibration.load("inertial_sensor").recomputed
    swing = {"swing": {"k": {"x": {"value": 5e-4, "sigma": 1e-6}, "y": None}}}
    factors = {name: row("inertial_sensor", "scale_factors", factor=name) for name in ("k_x", "k_y")}
    assert sensor(swing, "scale_factors", factors["k_x"], "corrected") == ((None, None, 5e-4), (None, None, 1e-6))
    assert not sensor(swing, "scale_factors", factors["k_y"], "corrected")
    assert not sensor(swing, "bias", row("inertial_sensor", "bias", component="x"), "corrected")
    drag = calibration.load("gradient_torque").recomputed
    single = row("gradient_torque", "scalars", name="drag_error_order_single_accelerometer")
    methods = {"one_sensor": {"rms_error": 1e-11}, "one_sensor_published": {"rms_error": None, "sigma_total_rms": 2e-9}}
    assert drag({"drag": methods}, "scalars", single, "corrected")[0] == [1e-11]
    assert drag({"drag": methods}, "scalars", single, "as_printed")[0] == [2e-9]
