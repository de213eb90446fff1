"""One event with a swing and, the day after, a short roll, and what its run delivers."""

import pytest
from inertial_events import run, simulated

from flows import engine, inertial_sensor
from gravcal import catalog


@pytest.fixture(scope="session")
def both(tmp_path_factory):
    """Folder with both days, and the truth."""
    folder = tmp_path_factory.mktemp("both")
    return folder, simulated(folder)


@pytest.fixture(scope="session")
def delivered(both, tmp_path_factory):
    """Document, page and steps of a second plan; truth; document of the published method; store."""
    store = tmp_path_factory.mktemp("store")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRAVCAL_PRODUCTS", str(store))
        document, ref = run(both[0])
        page = (ref.folder / "report.html").read_text(encoding="utf-8")
        source = inertial_sensor.CALIBRATION.source(data=both[0])
        steps, _ = engine.plan(inertial_sensor.calibrate, source, catalog.parameters("inertial_sensor"))
        printed = run(both[0], method="published")[0]
    made = {"document": document, "page": page, "steps": steps, "printed": printed}
    return made | {"truth": both[1], "store": str(store)}


@pytest.fixture
def shared_store(delivered, monkeypatch):
    """Store in which what a test does not change is found."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", delivered["store"])
