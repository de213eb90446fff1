"""An invented calibration that the command line can run, and one Prefect home for all tests."""

import os
import sys
import textwrap

import pytest

from flows import calibration

CALIBRATION = '''
    """An invented calibration on the stages of {name}."""
    from dataclasses import dataclass
    from flows.calibration import Calibration
    from flows.engine import flow
    from gravcal.io.archive import LevelOneFile
    from gravcal.errors import CatalogError, EstimationError
    from {name} import stages
    from tasks.stage import read

    BEGINS, SATELLITES = ("MAG1B", "SCA1B"), ("C", "D")

    @dataclass(frozen=True)
    class Source:
        event: str
        folder: object

    def source(event=None, data=None, satellite=None, date=None):
        if event == "unheard":
            raise CatalogError("event unheard: not in the catalogue, expected one of fake-1. Give one of these.")
        return Source(event or (f"fake-{data.name}" if data.name.isdigit() else "fake-1"), data)

    @flow(name="fakecal")
    def calibrate(source, chosen):
        file = LevelOneFile(source.folder / "MAG1B_2020-02-01_C_04.txt", None, "MAG1B", "C", "2020-02-01", "04")
        started = stages.start(file, event=source.event, variant="", count=chosen.count, offset=0.0)
        return stages.scale(started, variant="one", gain=chosen.gain)

    def document(ref):
        total = float(read(ref)["value"].sum())
        if total == 0:
            raise EstimationError("fake-1: nothing is determined (0, limit 1). Use more.", limit=1)
        status = "no_manoeuvre" if total < 0 else "delivered"
        return {{"schema_version": 1, "status": status, "calibration": "fakecal", "event": ref.event, "total": total}}

    def simulation(out, chosen, day, seed, effects, truth):
        (out / "said.json").write_text(str([seed, str(truth), [str(one) for one in effects], chosen.gain, day]))
        return {{"satellite": "C"}}

    CALIBRATION = Calibration(
        name="fakecal", title="Invented", quantity="A sum", begins=BEGINS, satellites=SATELLITES, inputs={{}},
        flow=calibrate, products={{}}, result=lambda document: [], simulation=simulation, detect=calibrate,
        manoeuvres=lambda found: [], document=document, source=source,
    )
'''
PARAMETERS = """
    [gain]
    value = 2.0
    unit = "1"
    minimum = -5.0
    maximum = 9.0
    stage = "scale"
    reason = "invented"

    [count]
    value = 4
    stage = "start"
    reason = "invented"
"""
DATE = """
    [date]
    value = "2020-02-01"
    stage = "files"
    reason = "invented"
"""


@pytest.fixture
def fakecal(pipeline, tmp_path, monkeypatch):
    """Return the folder of Level-1 files of an invented calibration that the command line knows."""
    extra = tmp_path / "extra"
    about = extra / "fakecal-1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: fakecal\nVersion: 1\n")
    (about / "entry_points.txt").write_text(f"[{calibration.GROUP}]\nfakecal = fakecal:CALIBRATION\n")
    (extra / "fakecal.py").write_text(
        textwrap.dedent(CALIBRATION.replace("{{", "{").replace("}}", "}")).replace("{name}", pipeline.name)
    )
    parameters = tmp_path / "catalog" / "parameters"
    parameters.mkdir(parents=True)
    (parameters / "fakecal.toml").write_text(textwrap.dedent(PARAMETERS))
    (parameters / "simulate_fakecal.toml").write_text(textwrap.dedent(PARAMETERS + DATE))
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path / "catalog"))
    monkeypatch.syspath_prepend(extra)
    yield tmp_path
    sys.modules.pop("fakecal", None)
    calibration.load.cache_clear()


@pytest.fixture
def environment(fakecal, pipeline):
    """Return the environment in which other processes find the invented calibration."""
    known = {"FAKE_CODE": str(pipeline.folder.parent), "FAKE_FLOWS": str(fakecal / "extra")}
    return {name: value for name, value in os.environ.items() if not name.startswith("PREFECT")} | known


@pytest.fixture(scope="session")
def prefect_home(tmp_path_factory):
    """Return one home for all tests of this process: its first start migrates a database for 10 s.

    Other test processes have their own: two servers on one database see each other's deployments, and run them.
    """
    home = tmp_path_factory.getbasetemp() / "prefect"
    home.mkdir(exist_ok=True)
    return home
