"""The whole way: voltages and attitude in, document and page out."""

import numpy as np
import pytest

from flows import engine, inertial_sensor
from gravcal import catalog
from gravcal.errors import EstimationError
from gravcal.store.schemas import validate
from tasks.stage import read

QUICK = {"roll_s": 10500.0, "roll_disturbed_share": 0.0}


def simulated(folder, **settings):
    """Truth of an invented event whose files are in a folder."""
    chosen = QUICK | settings
    return inertial_sensor.CALIBRATION.simulate(
        folder, seed=1, truth=folder / "truth.json", effects={}, settings=chosen
    )


def run(folder, **settings):
    """Result document and report product."""
    chosen = catalog.parameters("inertial_sensor").with_settings(settings)
    ref = engine.run(
        inertial_sensor.calibrate, inertial_sensor.CALIBRATION.source(data=folder), chosen, engine="inline"
    )
    return inertial_sensor.CALIBRATION.document(ref), ref


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Folder with a swing and a short roll, and the truth."""
    folder = tmp_path_factory.mktemp("both")
    return folder, simulated(folder)


@pytest.fixture(scope="module")
def delivered(both, tmp_path_factory):
    """Document, page and steps of a second plan for the event with both manoeuvres, and its truth."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRAVCAL_PRODUCTS", str(tmp_path_factory.mktemp("store")))
        document, ref = run(both[0])
        page = (ref.folder / "report.html").read_text(encoding="utf-8")
        chosen = catalog.parameters("inertial_sensor")
        steps, _ = engine.plan(inertial_sensor.calibrate, inertial_sensor.CALIBRATION.source(data=both[0]), chosen)
        printed = run(both[0], method="published")[0]
    return {"document": document, "page": page, "steps": steps, "truth": both[1], "printed": printed}


def within(value, sigma, truth, limit=4.5):
    """Whether all errors are within a number of standard deviations."""
    return np.all(np.abs(np.array(value) - truth) < limit * np.array(sigma))


def test_files_in_document_out(delivered):
    """Recovery: the document is valid and every determined value within 4.5 sigma; one seed of 11 values."""
    document, truth = delivered["document"], delivered["truth"]
    validate(document)
    swing, roll = document["swing"], document["roll"]
    for index, axis in enumerate("xyz"):
        one = swing["beta"][axis]
        assert within(one["value"], one["sigma"], truth["beta"][index])
        if axis != "y":
            assert within(swing["k"][axis]["value"], swing["k"][axis]["sigma"], truth["k"][index])
            bias = roll["bias"]
            assert within(bias["value"][index], bias["sigma_total"][index], truth["bias"][index])
            size = bias["sigma"][index] / abs(bias["value"][index])
            assert size < 1e-3  # 0.1 %, scale factors held
    offset = swing["com_to_test_mass_um"]
    assert within(offset["value"], offset["sigma"], truth["com_to_test_mass_um"])
    assert within(swing["delay_s"]["value"], swing["delay_s"]["sigma"], truth["delay_s"])
    assert swing["filter_minus_batch"]["sigmas"] < 1e-5  # start 1e5 times wider than the result
    assert document["event"] == "taiji-t-2022-05-18"


def test_what_is_not_determined_is_null_and_said(delivered):
    """Contract: k_y and b_y are null; both arms are shown; a reason is given."""
    document = delivered["document"]
    assert document["swing"]["k"]["y"] is None
    assert document["roll"]["bias"]["value"][1] is None
    assert document["roll"]["bias"]["sigma"][1] is None
    assert set(document["swing"]["arms"]) == {"8.00 mm", "10.45 mm"}
    assert "rolling about y" in document["not_determined"]["bias_y"]


def test_mass_inertia_and_arm_enter_the_factors_and_the_factors_the_bias(delivered):
    """Contract: the squares of the budget add up to the total errors (errata T-6, T-8)."""
    swing, roll = delivered["document"]["swing"], delivered["document"]["roll"]
    for axis, index in (("x", 0), ("z", 2)):
        k, parts = swing["k"][axis], [one[axis] for one in swing["k_budget_relative"].values()]
        assert np.linalg.norm(parts) == pytest.approx(k["sigma_total"] / k["value"], rel=1e-9)
        factor = roll["budget"]["factor_sigma"][index]
        assert factor == pytest.approx(abs(roll["bias"]["value"][index]) * k["sigma_total"] / k["value"], rel=1e-9)
        assert factor < roll["bias"]["sigma_total"][index]
    assert set(swing["k_budget_relative"]) == {"beta", "mass", "inertia", "arm"}
    assert swing["k_budget_relative"]["mass"]["y"] is None


def test_the_page_holds_tables_and_figures(delivered):
    """Contract: nine figures, nothing fetched from elsewhere."""
    page = delivered["page"]
    assert page.count("data:image/svg+xml;base64,") == 9
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_a_second_run_reuses_everything(delivered):
    """Contract: nothing is made again."""
    assert {step.action for step in delivered["steps"]} == {"reuse"}


def test_the_printed_forms_double_the_linear_factors(delivered):
    """Published: eqs. 8-10 with 1/2 give k twice as large from the same beta (erratum T-4)."""
    right, printed = (delivered[name]["swing"] for name in ("document", "printed"))
    ratio = printed["k"]["z"]["value"] / right["k"]["z"]["value"] * right["beta"]["x"]["value"]
    assert ratio / printed["beta"]["x"]["value"] == pytest.approx(2.0, rel=1e-9)


def test_a_roll_without_a_swing_uses_the_assumed_factors(both, tmp_path):
    """Contract: the document says so, the swing is left out."""
    for path in both[0].glob("*_2022-05-19_*"):
        (tmp_path / path.name).symlink_to(path)
    document, _ = run(tmp_path)
    assert "swing" not in document
    assert document["roll"]["source"] == "assumed"


@pytest.mark.parametrize("limit", [1e-5, 1.0])
def test_a_roll_of_few_good_segments_does_not_take_the_swing_with_it(both, tmp_path, limit):
    """Contract: swing delivered, bias null, the reason said; no segment uniform enough, or too few in all."""
    settings = {"uniformity_limit": limit} if limit < 1 else {"segment_s": 4500.0}
    document, ref = run(both[0], **settings)
    validate(document)
    assert document["status"] == "delivered"
    assert within(document["swing"]["delay_s"]["value"], document["swing"]["delay_s"]["sigma"], both[1]["delay_s"])
    assert document["roll"]["bias"]["value"] == [None] * 3
    assert "expected 3" in document["not_determined"]["bias"]
    assert "Bias not determined" in document["verdict"]["text"]
    assert "Not determined: found" in (ref.folder / "report.html").read_text(encoding="utf-8")


def test_a_lone_roll_of_few_good_segments_fails(both, tmp_path):
    """Contract: nothing could be delivered, so the error says what was found and what to do."""
    for path in both[0].glob("*_2022-05-19_*"):
        (tmp_path / path.name).symlink_to(path)
    with pytest.raises(EstimationError, match="found 0 usable of 4 segments, expected 3"):
        run(tmp_path, uniformity_limit=1e-5)


def test_quiet_data_give_no_manoeuvre(tmp_path):
    """Contract: status no_manoeuvre, report all the same."""
    simulated(tmp_path, manoeuvre="none")
    document, ref = run(tmp_path)
    validate(document)
    assert document["status"] == "no_manoeuvre"
    assert (ref.folder / "report.html").exists()
    assert read(ref).sizes["axis"] == 3


def test_a_long_gap_in_the_swing_is_refused(tmp_path):
    """Contract: what is integrated twice may not be guessed; the error says how long the gap is."""
    import h5py

    simulated(tmp_path, manoeuvre="swing")
    path = next(tmp_path.glob("IS1*"))
    with h5py.File(path, "r+") as file:
        file["V_z1"][5000:5040] = np.nan
    with pytest.raises(EstimationError, match=r"gap of 4\.[01] s"):
        run(tmp_path)


def test_missing_and_bad_samples_in_a_swing_do_not_bias_it(tmp_path):
    """Recovery: a second of missing voltages and one of missing attitude, spikes; errors within 4.5 sigma."""
    import h5py

    truth = simulated(tmp_path, manoeuvre="swing", spikes_per_hour=600.0)
    with h5py.File(next(tmp_path.glob("IS1*")), "r+") as file:
        file["V_x2"][5000:5010] = np.nan
    with h5py.File(next(tmp_path.glob("ATT*")), "r+") as file:
        file["q"][1900:1904] = np.nan
    swing = run(tmp_path)[0]["swing"]
    offset = swing["com_to_test_mass_um"]
    assert within(offset["value"], offset["sigma"], truth["com_to_test_mass_um"])
    for index, axis in enumerate("xy"):
        assert within(swing["beta"][axis]["value"], swing["beta"][axis]["sigma"], truth["beta"][index])
