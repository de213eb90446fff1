"""Source papers again, from an archive on loopback and without one."""

import functools
import json
import re
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import serving
from typer.testing import CliRunner

from benchmarks import published_methods
from flows import calibration, cli, reproduce
from gravcal import catalog

ROOT = Path(__file__).parents[2]
PICTURE = re.compile(r"!\[[^\]]*\]\(([^)]*)\)")


def section(paper):
    """What the page of docs says of a paper."""
    return (ROOT / "docs" / "papers.md").read_text().split(f"\n## {paper}\n")[1].partition("\n## ")[0]


#: A row of two days of a paper, the value that was simulated, how far the printed processing may be off, and settings
#: that make them quick.
SHORT = {"manoeuvres": "pitch_high,roll_high"}
WIGGLES = {"manoeuvres": "+pitch_a,-pitch_a,+yaw_a,-yaw_a", "phase_step_s": "1.0"}
TWO_DAYS = {
    "com_offset": ("Table 6", "mtq x", 107.0, 15.0, SHORT),
    "kbr_phase_centre": ("Table 4", "grace-c x range_rate", 1443.7, 200.0, WIGGLES),
}


@pytest.mark.long
@pytest.mark.parametrize("name", TWO_DAYS)
def test_a_paper_is_reproduced_from_an_archive(name, tmp_path, monkeypatch):
    """Contract: two days fetched, both runs beside print, each table and figure with rows, figures or a reason."""
    table, label, truth, apart, settings = TWO_DAYS[name]
    paper = reproduce.papers()[name]
    tables = [one | {"simulate": SHORT} if one["name"] == "Table 8" else one for one in paper["tables"]]
    tables = [one for one in tables if one["name"] != "Table 9"]  # twenty days
    figures = [one | {"series": "Table 8"} if "series" in one else one for one in paper["figures"]]
    narrowed = paper | {"tables": tables, "figures": figures, "simulate": paper["simulate"] | settings}
    monkeypatch.setattr(reproduce, "papers", lambda: {name: narrowed})
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _, to, **__: to.write(b"<svg/>"))  # none is seen
    served, out = published_methods.served(name, tmp_path), tmp_path / "out"
    for variable, value in (("NO_PROXY", "127.0.0.1"), ("NETRC", str(tmp_path / "netrc"))):
        monkeypatch.setenv(variable, value)
    with serving(functools.partial(SimpleHTTPRequestHandler, directory=served)) as address:
        done = CliRunner().invoke(cli.app, ["reproduce", name, "--from", address, "--out", str(out)])
    assert done.exit_code in (0, 4), done.output
    assert sorted(path.suffix for path in (out / "data").iterdir()) == [".tgz"] * 4  # two levels of two days
    document = json.loads((out / "reproduction.json").read_text())
    assert document["origin"] == "simulated"
    items = {item["name"]: item for item in document["items"]}
    assert all(item["rows"] or {"reason", "report", "series"} & set(item) for item in items.values())
    row = next(row for row in items[table]["rows"] if row["row"] == label)
    for run in reproduce.RUNS:
        value, sigma = row[run]
        assert abs(value - truth) < (5 * sigma if run == "corrected" else apart)
        assert (out / run / "report.html").is_file()
    assert row["corrected"][1] > row["as_printed"][1] or name != "com_offset"
    if name == "com_offset":  # a table of many dates has a day for each, simulated as printed and drawn over time
        rows = items["Table 8"]["rows"]
        assert [one["row"] for one in rows] == [f"grace-{c} 2018-06-06 {a}" for c in "cd" for a in "xyz"]
        assert all(abs(one["corrected"][0] - one["printed"][0]) < 5 * one["corrected"][1] for one in rows)
    pictures = PICTURE.findall((out / "gallery.md").read_text())
    assert len(pictures) >= 2
    assert all((out / path).is_file() for path in pictures)
    page = (out / "index.html").read_text()
    assert page.count("<figure") >= 2
    assert page.count('<div class="scroll"><table>') == sum(bool(item["rows"]) for item in items.values())
    assert page.count("Not made") == sum("reason" in item for item in items.values())
    assert len((out / "comparison.csv").read_text().splitlines()) == 1 + sum(len(i["rows"]) for i in items.values())


def test_the_page_is_what_the_command_prints_now(tmp_path):
    """Contract: of the quickest paper every word, numbers within 0.1 %; of all papers rows as printed, all dates."""
    reproduce.reproduce("inertial_sensor", tmp_path, simulated=True)
    made = (tmp_path / "gallery.md").read_text().replace(".svg)", ".png)").split()
    for mine, theirs in zip(section("inertial_sensor").split()[-len(made) :], made, strict=True):
        number = re.fullmatch(r"[-+.\de]*\d", theirs)
        assert float(mine) == pytest.approx(float(theirs), rel=1e-3) if number else mine == theirs
    for name, paper in reproduce.papers().items():
        everything = SimpleNamespace(name=name, recomputed=lambda *about: ([0.0] * len(about[2].value),) * 2)
        for item in (item for item in paper["tables"] if "section" in item):
            rows = reproduce._compared(everything, item, dict.fromkeys(reproduce.RUNS, [None]))["rows"]
            part = section(name).split(f"**{item['name']}** ")[1].partition("\n**")[0]
            shown = {tuple(line.split(" | ")[:2]) for line in part.splitlines() if line.startswith("| ")}
            known = {(f"| {row['row']}", reproduce._text(row["printed"])) for row in rows}
            assert not ({row for row in shown if row[1] not in ("printed", "---")} - known), item["name"]
            assert "truth" not in item or known <= shown, item["name"]


def test_offsets_of_all_dates_come_back():
    """Recovery: of the page's Table 9 the corrected values are off by their errors, those as printed by more."""
    text = section("com_offset")
    form = r"^\| (?!2020-02-01)\S+ \S+ (.) \| (\S+) \+- \S+ \| (\S+) \+- (\S+) \| (\S+) \+- (\S+) \|$"
    rows = re.findall(form, text.split("**Table 9**")[1].partition("\n**")[0], re.MULTILINE)
    off = {axis: np.array([row[1:] for row in rows if row[0] == axis], dtype=float).T for axis in "xyz"}
    assert {axis: one.shape[1] for axis, one in off.items()} == {"x": 19, "y": 19, "z": 19}
    rms = lambda value, sigma: [f"{np.sqrt(np.mean(((o[value] - o[0]) / o[sigma]) ** 2)):.1f}" for o in off.values()]  # noqa: E731
    words = " ".join(text.split())
    assert "{} (x), {} (y) and {} (z) of their own sigma".format(*rms(1, 2)) in words
    assert f"z comes out {np.mean(off['z'][0] - off['z'][1]):.1f} um low on average" in words
    assert "corrected values are off by {}, {} and {} sigma".format(*(corrected := rms(3, 4))) in words
    assert max(map(float, corrected)) < 1.3  # 19 values: within twice the scatter of an rms of one


def test_papers_name_sections_that_there_are_and_reports_have(tmp_path):
    """Contract: what a paper names is in the catalogue, its calibration can recompute it, unknown names are usage."""
    for name, paper in reproduce.papers().items():
        assert calibration.load(name).recomputed is not None
        assert catalog.parameters(name).with_settings(paper["as_printed"]).calibration == name
        catalog.parameters(f"simulate_{name}").with_settings(paper["simulate"])
        sections = catalog.published(name)
        for item in [*paper["tables"], *paper["figures"]]:
            assert len({"reason", "section", "report", "series"} & set(item)) == 1, item["name"]
            assert not re.search(r"gravcal (run|fetch)", item.get("reason", "")), "an instruction is no reason"
            assert item.get("section", "scalars") in sections
            headings = (ROOT / f"gravcal/calibrations/{name}/page.py").read_text()
            assert f'"{item["report"]}' in headings if "report" in item else True, item["name"]
    assert CliRunner().invoke(cli.app, ["reproduce", "nothing", "--out", str(tmp_path)]).exit_code == 2


def test_no_table_or_figure_of_a_paper_is_missing():
    """Contract: numbered without a gap, each on the page, with rows, pictures of both runs, or why there are none."""
    used = []
    for name, paper in reproduce.papers().items():
        part = " ".join(section(name).split())
        for item in [*paper["tables"], *paper["figures"]]:
            _, said = part.split(f"**{item['name']}** ")
            assert said.startswith("not made: ") == ("reason" in item), item["name"]
            assert "reason" in item or item["difference"] in said
            own = said.partition(" **")[0]
            pictures = PICTURE.findall(own)
            if {"report", "series"} & set(item):  # of both runs, or one that is that of both
                both, *each = (own.count(f" *{one}:") for one in ("Both runs", "As printed, recomputed", "Corrected"))
                assert len(pictures) == both + sum(each) > 0
                assert each[0] == each[1]
            used += pictures
        for kind, items in (("Table", paper["tables"]), ("Figure", paper["figures"])):
            numbers = set()
            for one in items:
                named = one["name"] if one["name"].startswith(kind) else ""
                for first, last in re.findall(r"(\d+)(?: to (\d+))?", named):
                    numbers |= set(range(int(first), int(last or first) + 1))
            if not any(one["name"].startswith("Figures of") for one in items):  # by what they show, not by number
                assert numbers == set(range(1, len(numbers) + 1)), (name, kind)

    files = {f"images/papers/{path.name}": path for path in (ROOT / "docs" / "images" / "papers").iterdir()}
    assert sorted(used) == sorted(files)
    assert max(path.stat().st_size for path in files.values()) < 60_000
    assert "The column of print has no pictures" in (ROOT / "docs" / "papers.md").read_text()


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
    drag = calibration.load("gradient_torque").recomputed
    single = row("gradient_torque", "scalars", name="drag_error_order_single_accelerometer")
    methods = {"one_sensor": {"rms_error": 1e-11}, "one_sensor_published": {"rms_error": None, "sigma_total_rms": 2e-9}}
    assert drag({"drag": methods}, "scalars", single, "corrected")[0] == [1e-11]
    assert drag({"drag": methods}, "scalars", single, "as_printed")[0] == [2e-9]
    pressure, panels = row("gradient_torque", "pressure", component="z"), {"area_weighted": [0, 0, 0.05]}
    balance = {"value": [0, 0, 0.01], "sigma": [0.1, 0.1, 0.002]}
    both = {"panel_pressure_m": panels, "centre_of_pressure_m": balance}
    assert drag(both, "pressure", pressure, "as_printed") == ([0.05], [None])
    assert drag(both, "pressure", pressure, "corrected") == ([0.01], [0.002])
    assert drag({"panel_pressure_m": panels}, "pressure", pressure, "corrected") is None
