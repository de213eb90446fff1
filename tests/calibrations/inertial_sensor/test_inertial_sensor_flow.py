"""The whole way: voltages and attitude in, document and page out."""

import json
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from inertial_events import ROLL, one, run, simulated, within

from flows import calibration
from flows import inertial_sensor as flow
from gravcal.errors import EstimationError
from gravcal.store.schemas import validate
from tasks.stage import read

TURN, ERROR = 0.05, 0.03


def test_files_in_document_out(delivered):
    """Recovery: the document is valid and every determined value within 4.5 sigma; one seed of 11 values."""
    document, truth = delivered["document"], delivered["truth"]
    validate(document)
    assert document["event"] == "taiji-t-2022-05-18"
    swing, bias = document["swing"], document["roll"]["bias"]
    for index, axis in enumerate("xyz"):
        assert within(one(swing["beta"][axis]), truth["beta"][index : index + 1])
        if axis != "y":
            assert within(one(swing["k"][axis]), truth["k"][index : index + 1])
            assert abs(bias["value"][index] - truth["bias"][index]) < 4.5 * bias["sigma_total"][index]
            assert bias["sigma"][index] < 1e-3 * abs(bias["value"][index])  # 0.1 %, scale factors held
    assert within(swing["com_to_test_mass_um"], truth["com_to_test_mass_um"])
    assert within(one(swing["delay_s"]), [truth["delay_s"]])
    assert swing["filter_minus_batch"]["sigmas"] < 1e-5  # start 1e5 times wider than the result


def test_what_is_not_determined_is_null_and_said(delivered):
    """Contract: b_y is null and a reason is given, k_y is that of the swing alone; both arms are shown."""
    document, true = delivered["document"], delivered["truth"]["k"][1]
    own = document["swing"]["k"]["y"]
    assert abs(own["value"] - true) < 4.5 * own["sigma"]
    assert 0.05 < own["sigma_total"] / own["value"] < 1 / 3
    assert "k_y" not in document["not_determined"]
    assert document["roll"]["bias"]["value"][1] is document["roll"]["bias"]["sigma"][1] is None
    assert set(document["swing"]["arms"]) == {"8.00 mm", "10.45 mm"}
    assert "rolling about y" in document["not_determined"]["bias_y"]


def test_mass_inertia_and_arm_enter_the_factors_and_the_factors_the_bias(delivered):
    """Contract: the squares of the budget add up to the total errors (errata T-6, T-8)."""
    swing, roll = delivered["document"]["swing"], delivered["document"]["roll"]
    assert set(swing["k_budget_relative"]) == {"beta", "mass", "inertia", "arm"}
    assert swing["k_budget_relative"]["mass"]["y"] is None
    for axis, index in (("x", 0), ("z", 2)):
        k, parts = swing["k"][axis], [shares[axis] for shares in swing["k_budget_relative"].values()]
        assert np.linalg.norm(parts) == pytest.approx(k["sigma_total"] / k["value"], rel=1e-9)
        factor = roll["budget"]["factor_sigma"][index]
        assert factor == pytest.approx(abs(roll["bias"]["value"][index]) * k["sigma_total"] / k["value"], rel=1e-9)
        assert factor < roll["bias"]["sigma_total"][index]


def test_the_page_holds_tables_and_figures_and_a_second_run_reuses_everything(delivered):
    """Contract: nine figures, nothing fetched from elsewhere, nothing made again."""
    assert delivered["page"].count("data:image/svg+xml;base64,") == 9
    assert "http://" not in delivered["page"].replace("http://www.w3.org", "")
    assert {step.action for step in delivered["steps"]} == {"reuse"}


def test_the_printed_forms_double_the_linear_factors(delivered):
    """Published: eqs. 8-10 with 1/2 give k twice as large from the same beta (erratum T-4)."""
    right, printed = (delivered[name]["swing"] for name in ("document", "printed"))
    ratio = printed["k"]["z"]["value"] / right["k"]["z"]["value"] * right["beta"]["x"]["value"]
    assert ratio / printed["beta"]["x"]["value"] == pytest.approx(2.0, rel=1e-9)


@pytest.mark.usefixtures("shared_store")
@pytest.mark.parametrize("settings", [{"uniformity_limit": 1e-5}, {"segment_s": 4500.0}])
def test_a_roll_of_few_good_segments_does_not_take_the_swing_with_it(both, settings):
    """Contract: swing delivered, bias null, the reason said; no segment uniform enough, or too few in all."""
    document, ref = run(both[0], **settings)
    validate(document)
    assert document["status"] == "delivered"
    assert within(one(document["swing"]["delay_s"]), [both[1]["delay_s"]])
    assert document["roll"]["bias"]["value"] == [None] * 3
    assert "expected 3" in document["not_determined"]["bias"]
    assert "Bias not determined" in document["verdict"]["text"]
    assert "Not determined: found" in (ref.folder / "report.html").read_text(encoding="utf-8")


def test_a_roll_without_a_swing_uses_the_assumed_factors_and_fails_without_good_segments(both, tmp_path):
    """Contract: the document says so, the swing is left out; where nothing could be delivered the error says why."""
    for path in both[0].glob(f"*_{ROLL}_*"):
        (tmp_path / path.name).symlink_to(path)
    document, _ = run(tmp_path)
    assert "swing" not in document
    assert document["roll"]["source"] == "assumed"
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


def test_bad_samples_do_not_bias_a_swing_and_a_long_gap_is_refused(tmp_path):
    """Recovery: a second without voltages, one without attitude, spikes: within 4.5 sigma; 4 s of nothing: refused."""
    truth = simulated(tmp_path, 1, manoeuvre="swing", spikes_per_hour=600.0)
    with h5py.File(next(tmp_path.glob("IS1*")), "r+") as file:
        file["V_x2"][5000:5010] = np.nan
    with h5py.File(next(tmp_path.glob("ATT*")), "r+") as file:
        file["q"][1900:1904] = np.nan
    swing = run(tmp_path)[0]["swing"]
    assert within(swing["com_to_test_mass_um"], truth["com_to_test_mass_um"])
    assert all(within(one(swing["beta"][axis]), [beta]) for axis, beta in zip("xy", truth["beta"], strict=False))
    with h5py.File(next(tmp_path.glob("IS1*")), "r+") as file:
        file["V_z1"][5000:5040] = np.nan
    with pytest.raises(EstimationError, match=r"gap of 4\.[01] s"):
        run(tmp_path)


def test_the_error_of_a_turned_tracker_is_in_factors_and_offset(tmp_path):
    """Recovery: a turn that is wrong by its error moves the results by what their errors hold beyond the noise."""
    effects = {"inertial_sensor.tracker_misalignment.angle_z": TURN}
    simulated(tmp_path / "files", 5, effects, manoeuvre="swing")
    swings = []
    for value, error in ((TURN, ""), (TURN + ERROR, ""), (TURN, f"sigma = {ERROR}, ")):
        line = f'parameters.angle_z = {{ value = {value}, {error}unit = "rad" }}'
        (tmp_path / "model.toml").write_text(f'[[effect]]\ncause = "inertial_sensor.tracker_misalignment"\n{line}\n')
        swings.append(run(tmp_path / "files", model=calibration.model_text(tmp_path / "model.toml"))[0]["swing"])
    sharp, wrong, wide = swings
    for axis in "xyz":
        held, moved = sharp["beta"][axis]["sigma"], wrong["beta"][axis]["value"] - sharp["beta"][axis]["value"]
        assert wide["beta"][axis]["value"] == sharp["beta"][axis]["value"]
        assert wide["beta"][axis]["sigma"] == pytest.approx(np.hypot(held, moved), rel=0.02)
    assert any(wide["beta"][a]["sigma"] > 1.5 * sharp["beta"][a]["sigma"] for a in "xyz")  # it matters
    sharp, wrong, wide = (one["com_to_test_mass_um"] for one in swings)
    moved = np.subtract(wrong["value"], sharp["value"])
    np.testing.assert_allclose(wide["sigma"], np.hypot(sharp["sigma"], moved), rtol=0.02)


@pytest.mark.parametrize("widened", [True, False])
def test_a_model_of_other_days_changes_nothing(widened, monkeypatch):
    """Contract: an effect of the model of a satellite holds between its days, in a run and where discovery looks."""
    entry = {"cause": "inertial_sensor.tracker_misalignment", "form": "", "parameters": {}, "to": "2022-05-19"}
    chosen, made = SimpleNamespace(model=json.dumps([entry])), []
    monkeypatch.setattr(type(flow.DISCOVERY), "without", lambda *_, **__: made.append("without") or "without")
    for date in ("2022-05-18", "2022-05-19"):
        how = SimpleNamespace(date=date), chosen, lambda _, records, __: {"solved": records}
        made.append(flow._without_model(*how, "records", {}, (widened, None))["solved"])
    assert made == ["without", "without", "records"]
