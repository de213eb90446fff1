"""Products open anywhere: the CF conventions 1.11, checked by IOOS compliance-checker on products of every kind."""

import functools
import importlib
import json
import re
import shutil
import subprocess
import warnings
from importlib import resources
from pathlib import Path

import pytest

from gravcal import catalog
from gravcal.store import housekeeping, location, product

SMALL = {
    "com_offset": {"manoeuvres": "pitch_high"},
    "kbr_phase_centre": {"manoeuvres": "+pitch_a,-yaw_a,+pitch_b,-yaw_b", "quiet_s": 900.0, "phase_step_s": 1.0},
    "inertial_sensor": {"roll_s": "9000"},
    "gradient_torque": {"duration_s": "10800"},
    "magnetometer": {"duration_s": "1800"},
    "ranging": {"phase_step_s": "1", "date": "2020-09-12"},
    "thrusters": {"duration_s": "10800", "quiet_s": "900"},
    "routine": {"quiet_s": "300"},
}
ORDER = "§2.4 Dimensions"  # the house puts vectors on the last axis; CF recommends, but does not ask, the contrary


def chains(folder):
    """Run a small invented event of every calibration into one store; files of the newest products by kind."""
    from flows import calibration, discover, engine

    for name, settings in SMALL.items():
        flow = calibration.load(name)
        truth = flow.simulate(folder / name, seed=1, truth=None, effects={}, settings=settings)
        source = flow.source(event=None, data=folder / name, satellite=truth.get("satellite"), date=truth.get("date"))
        engine.run(flow.flow, source, catalog.parameters(name), engine="inline")
        if name in discover.names():
            engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline")
    found = {}
    for link in sorted((location.folder() / "latest").glob("*/*")):
        kind = link.name if link.name.startswith("ingest") else ".".join(link.name.split(".")[:2])
        found.setdefault(kind, link / "product.nc")
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return files of products by kind."""
    folder = tmp_path_factory.mktemp("conventions")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("GRAVCAL_PRODUCTS", str(folder / "products"))
        return chains(folder)


@functools.cache
def checker():
    """IOOS compliance-checker with its conventions."""
    from compliance_checker.suite import CheckSuite

    CheckSuite.load_all_available_checkers()
    return CheckSuite()


def complaints(path):
    """What the checker finds in one file, but for the recommended order of dimensions."""
    suite = checker()
    results = suite.run_all(suite.load_dataset(str(path)), ["cf:1.11"])
    found = []
    for groups, errors in results.values():
        found += [f"{name}: {problem[0]!r}" for name, problem in errors.items()]
        found += [f"{group.name}: {'; '.join(group.msgs)}" for group in groups if group.value[0] < group.value[1]]
    return [text for text in found if not text.startswith(ORDER)]


def test_every_kind_of_product_passes_the_checker(made):
    """Contract: no error, warning or remark on any kind that the calibrations make."""
    kinds = {kind.partition(".")[0] for kind in made}
    assert {"ingest", *SMALL} <= kinds
    assert len(made) > 70
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the checker's own libraries
        found = {kind: complaints(path) for kind, path in made.items()}
    assert {kind: texts for kind, texts in found.items() if texts} == {}


def test_the_checker_finds_what_is_wrong(made, tmp_path):
    """Contract: the test above can fail: a wrong unit and a flag without meaning are found."""
    import h5py

    path = tmp_path / "product.nc"
    path.write_bytes(made["com_offset.attitude"].read_bytes())
    with h5py.File(path, "a") as file:
        file["rate_b"].attrs["units"] = "furlongs per blink"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert any("furlongs" in text for text in complaints(path))


@pytest.mark.skipif(not shutil.which("ncdump"), reason="ncdump is not installed")
def test_ncdump_shows_every_kind(made):
    """Contract: another netCDF library reads names, units and sizes of what we write."""
    for path in made.values():
        shown = subprocess.run(["ncdump", "-h", path], check=True, capture_output=True, text=True).stdout
        assert 'Conventions = "CF-' in shown


def test_every_unit_of_the_schemas_is_known_to_udunits():
    """Contract: also of kinds and variables that the small events do not make."""
    from cf_units import Unit

    for name in (*SMALL, "discovery"):
        importlib.import_module(f"tasks.{name}")
    stated = [one.get("units") for schema in product._schemas.values() for one in (schema or {}).values()]
    units = {unit for one in stated for unit in (one if isinstance(one, tuple) else (one,)) if unit}
    assert len(units) > 30
    for unit in units:
        Unit(unit)


def test_every_unit_of_the_level_one_files_is_known_to_udunits():
    """Contract: all columns of all records."""
    from cf_units import Unit

    from gravcal.io.readers import records

    names = [path.stem for path in Path(records.PRODUCTS).glob("*.toml")]
    assert len(names) > 20
    for name in names:
        table = records.product(name)
        for column in (*table.columns, *table.optional, *table.repeated):
            Unit(column.units)


def report_of(made, calibration):
    """Folder of a calibration's report."""
    return made[f"{calibration}.report"].parent


@pytest.mark.parametrize("calibration", SMALL)
def test_a_report_begins_with_its_verdict_and_needs_nothing_else(made, calibration):
    """Contract: origin, then verdict; one style, no script, nothing asked of other hosts, pictures described."""
    page = (report_of(made, calibration) / "report.html").read_text()
    body = page.partition("<body>")[2].lstrip()
    assert re.match(r'<p class="origin">Simulated data: [^<]*</p>\s*<p class="verdict', body)
    style = (resources.files("gravcal.report") / "report.css").read_text()
    assert style.strip() in page
    assert "<script" not in page
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#|https://doi\.org)[^"']+""", page)
    assert all("alt=" in tag for tag in re.findall(r"<img[^>]*>", page))


@pytest.mark.parametrize("calibration", SMALL)
def test_every_number_of_a_report_can_be_traced(made, calibration, monkeypatch):
    """Contract: what the document and the page name finds the product, as `gravcal products show` looks for it."""
    folder = report_of(made, calibration)
    document = json.loads((folder / "result.json").read_text())
    page = (folder / "report.html").read_text()
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder.resolve().parent.parent.parent))
    keys = document["provenance"]["products"]
    assert len(keys) >= 3
    for name, key in keys.items():  # of a routine day also whose
        assert set(housekeeping.resolve(key).ref.stage.split(".")) <= set(name.split("."))
        assert key[:12] in page, name
