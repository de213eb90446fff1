"""The whole way: Level-1 files in, documents, vector files and page out."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from flows import engine, kbr_phase_centre
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre.page import vector_files
from gravcal.errors import NoDataError, ProductError
from gravcal.io import vcm
from gravcal.store.schemas import validate
from tasks.stage import read

QUICK = {"phase_step_s": 1.0}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder with the files of a simulated campaign, and its truth."""
    folder = tmp_path_factory.mktemp("campaign")
    truth = kbr_phase_centre.CALIBRATION.simulate(
        folder, seed=1, truth=folder / "truth.json", effects={}, settings=QUICK
    )
    return folder, truth


@pytest.fixture
def shared_store(campaign, monkeypatch):
    """One store for the tests that only look at the campaign, so that it is processed once."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(campaign[0] / "products"))


def run(folder, **settings):
    """Result document and report product."""
    chosen = catalog.parameters("kbr_phase_centre").with_settings(settings)
    source = kbr_phase_centre.CALIBRATION.source(data=folder)
    ref = engine.run(kbr_phase_centre.calibrate, source, chosen, engine="inline")
    return kbr_phase_centre.CALIBRATION.document(ref), ref


@pytest.mark.usefixtures("shared_store")
def test_files_in_vectors_out(campaign, tmp_path):
    """Recovery: the document is valid, its errors within 4.5 sigma; vector files and lines hold the adopted result.

    They do so of measured data; of simulated ones the lines are comments that a reader refuses, without a vector file.
    """
    folder, truth = campaign
    document, ref = run(folder)
    validate(document)
    assert document["status"] == "delivered"
    assert document["event"] == "grace-cd-2020-09-10"
    files = vector_files(document | {"origin": "measured"}, "2020-09-10")
    for letter in "CD":
        for observable in ("range", "range_rate", "range_acceleration"):
            for estimator in ("ls", "robust"):
                found = document["satellites"][letter][observable][estimator]
                error = np.array(found["phase_centre_mm"]) - truth["phase_centre_mm"][letter]
                assert np.all(np.abs(error) < 4.5 * np.array(found["sigma_mm"]))
        adopted = 1e-3 * np.array(document["adopted"]["satellites"][letter]["phase_centre_mm"])
        path = tmp_path / f"VKB1B_2020-09-10_{letter}_04.txt"
        path.write_text(files[path.name])
        time, vector = vcm.read_vector_file(path)
        assert_allclose(vector[0], adopted, rtol=1e-12)
        assert time[0] == np.ceil(max(one["stop"] for one in document["manoeuvres"]))
    lines = [vcm.read_line(line) for line in files["result.soe"].splitlines()]
    assert [(one.satellite, one.name) for one in lines] == [("C", "VKB"), ("D", "VKB")]
    assert not list(ref.folder.glob("VKB1B*"))
    written = (ref.folder / "result.soe").read_text().splitlines()
    assert len(written) == 2
    for line, kept in zip(written, files["result.soe"].splitlines(), strict=True):
        assert line.startswith("# SIMULATED")
        assert line.endswith(kept)
        with pytest.raises(ProductError):
            vcm.read_line(line)
    assert json.loads((folder / "truth.json").read_text())["phase_centre_mm"] == truth["phase_centre_mm"]


@pytest.mark.usefixtures("shared_store")
def test_the_scatter_between_wiggles_stands_beside_the_errors(campaign):
    """Analytic: two wiggles for each component: the error of their mean is half their difference; x has none."""
    document, _ = run(campaign[0])
    told = document["consistency"]["scatter_between_manoeuvres_mm"]["range_rate"]["C"]
    own = [one["estimates_mm"]["range_rate"]["value"] for one in document["manoeuvres"] if one["satellite"] == "C"]
    assert told[0] is None
    assert_allclose(told[1:], [abs(own[2] - own[3]) / 2, abs(own[0] - own[1]) / 2], rtol=1e-9)  # yaw tells y


@pytest.mark.usefixtures("shared_store")
def test_the_page_holds_tables_and_figures(campaign):
    """Contract: five figures, the printed tables beside the result, nothing fetched from elsewhere."""
    _, ref = run(campaign[0])
    page = (ref.folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == page.count("<figcaption>") == 5
    assert page.count('<img src="data:image/svg+xml;base64,') == 5
    for text in ("Table 4", "Table 6", "1457.1 ± 3.2", "tan(offset)", "condition", "result for the sequence"):
        assert text.lower() in page.lower()
    assert "http" not in page


@pytest.mark.usefixtures("shared_store")
def test_detect_tells_the_wiggles(campaign):
    """Contract: satellite, kind, start and stop of all eight."""
    folder, truth = campaign
    source = kbr_phase_centre.CALIBRATION.source(data=folder, satellite="C")
    chosen = catalog.parameters("kbr_phase_centre")
    ref = engine.run(kbr_phase_centre.detect, source, chosen, engine="inline")
    found = kbr_phase_centre.CALIBRATION.detected(ref)["manoeuvres"]
    assert [(m["satellite"], m["kind"]) for m in found] == [(m["satellite"], m["kind"]) for m in truth["manoeuvres"]]


@pytest.mark.usefixtures("shared_store")
def test_the_published_method_says_that_it_is_for_comparison(campaign):
    """Recovery: x of the range short by decimetres at most, and the page warns."""
    document, ref = run(campaign[0], method="published")
    x = document["satellites"]["C"]["range"]["ls"]["phase_centre_mm"][0]
    assert x is None or 1250 < x < 1420
    assert document["trust"][0].startswith("Method published")
    assert read(ref).attrs["status"] == document["status"]


def test_a_day_without_wiggles_says_so(tmp_path):
    """Contract: status no_manoeuvre, no vectors; the page says what routine pointing can tell."""
    settings = QUICK | {"manoeuvres": ","}
    kbr_phase_centre.CALIBRATION.simulate(tmp_path, seed=2, truth=None, effects={}, settings=settings)
    document, ref = run(tmp_path)
    validate(document)
    assert document["status"] == "no_manoeuvre"
    assert not list(ref.folder.glob("VKB1B*"))
    assert document["noise"]["manoeuvres_um_rthz"] == {"4_mhz": None, "8_mhz": None}
    assert "x is not determined" in (ref.folder / "report.html").read_text(encoding="utf-8")


def test_an_event_of_the_catalogue_stands_for_its_pair(tmp_path, monkeypatch):
    """Contract: the event of one satellite needs the files of both, of its own day."""
    monkeypatch.setenv("GRAVCAL_DATA", str(tmp_path))
    with pytest.raises(NoDataError, match="no file of satellite D on 2020-09-28"):
        kbr_phase_centre.CALIBRATION.source(event="grace-d-2020-09-28")
    (tmp_path / "SCA1B_2020-09-28_D_04.txt").touch()
    source = kbr_phase_centre.CALIBRATION.source(event="grace-d-2020-09-28")
    assert (source.event, source.satellite, source.date) == ("grace-d-2020-09-28", "CD", "2020-09-28")
    with pytest.raises(ProductError, match="found no KBR1B or LRI1B of satellite Y on 2020-09-28"):
        engine.run(kbr_phase_centre.calibrate, source, catalog.parameters("kbr_phase_centre"), engine="inline")


def test_a_campaign_over_days_is_one_solution(tmp_path):
    """Recovery: wiggles of A on one day and of B two days later, a day between missing; all within 4.5 sigma."""
    shared = QUICK | {"quiet_s": 600.0, "first_start_s": 2000.0}
    for date, letter in (("2020-09-17", "a"), ("2020-09-19", "b")):
        wiggles = ",".join(f"{sign}{axis}_{letter}" for axis in ("pitch", "yaw") for sign in "+-")
        settings = shared | {"date": date, "manoeuvres": wiggles}
        truth = kbr_phase_centre.CALIBRATION.simulate(tmp_path, seed=4, truth=None, effects={}, settings=settings)
    document, ref = run(tmp_path)
    validate(document)
    assert document["event"] == "grace-cd-2020-09-17"
    assert [one["kind"] for one in document["manoeuvres"]] == 2 * ["+pitch", "-pitch", "+yaw", "-yaw"]
    for letter in "CD":
        found = document["adopted"]["satellites"][letter]
        error = np.array(found["phase_centre_mm"]) - truth["phase_centre_mm"][letter]
        assert np.all(np.abs(error) < 4.5 * np.array(found["sigma_mm"]))
    one_day = kbr_phase_centre.CALIBRATION.source(data=tmp_path, date="2020-09-19")
    assert [file.date for file in kbr_phase_centre.level_one_files(one_day)] == 5 * ["2020-09-19"]
    assert ref.event == document["event"]
