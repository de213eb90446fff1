"""From an SGRS file to document and page, through the store; errors of an extended model in the drag."""

import json

import commands
import numpy as np
import pytest

from flows import calibration, engine
from flows import gradient_torque as flow
from gravcal import catalog
from gravcal.errors import EstimationError, ProductError
from gravcal.io import daily, writers
from gravcal.store import store
from tasks.stage import read

SHORT = {"duration_s": "3600", "step_s": "5", "field_degree": "12"}
SETTINGS = {"field_degree": "12", "highest_degree": "6"}


def invented(folder, **settings):
    """Folder with a short record, and its truth."""
    given = {"seed": 2, "truth": folder / "truth.json", "effects": None, "settings": SHORT | settings}
    return flow.CALIBRATION.simulate(folder / "data", **given)


def run(folder, **settings):
    """Document and product of the record of a folder."""
    return commands.run("gradient_torque", folder / "data", **(SETTINGS | settings))


def test_a_run_delivers_document_and_page_and_is_reused(tmp_path):
    """Contract: schema, errors of each method where the truth is given, and nothing made twice."""
    truth = invented(tmp_path)
    settings = SETTINGS | {"truth": str(tmp_path / "truth.nc")}
    document, ref = run(tmp_path, **settings)
    source, chosen = flow.CALIBRATION.source(data=tmp_path / "data"), catalog.parameters("gradient_torque")
    assert truth["date"] == source.date
    assert document["event"] == "demo-s-2020-02-01"
    assert set(document["drag"]) == {"two_sensor", "one_sensor_published", "one_sensor"}
    for name, held_back in (("two_sensor", 0.1), ("one_sensor", 0.5)):  # motion too small for its noise to show it
        block = document["drag"][name]
        assert 0.8 < block["rms_error"] / block["sigma_rms"] < 1.2
        assert block["rms_error_without_noise"] < held_back * block["rms_error"]
        assert block["series"] == document["provenance"]["products"][f"gradient_torque.drag.{name}"]
    assert document["drag"]["one_sensor_published"]["rms_error"] > 1e-10
    assert document["identifiability"]["rank"] == 6
    assert "gains nothing" in document["verdict"]["text"]
    assert (ref.folder / "report.html").read_text().count("data:image/svg") == 5
    steps, again = engine.plan(flow.calibrate, source, chosen.with_settings(settings))
    assert again == ref
    assert {step.action for step in steps} == {"reuse"}
    changed = chosen.with_settings(settings | {"gravity_sigma_scale": "2"})
    steps, _ = engine.plan(flow.calibrate, source, changed)
    made = {step.stage for step in steps if step.action == "run"}
    assert any("drag" in name for name in made)
    assert not any("gradient_torque.gradient" in name for name in made)


def test_a_truth_of_other_epochs_is_refused(tmp_path):
    """Contract: a record of which doubtful samples were dropped, or another one's truth; was a trace."""
    invented(tmp_path / "a")
    invented(tmp_path / "b", duration_s="1800")
    with pytest.raises(EstimationError, match="Give the truth of this record"):
        run(tmp_path / "a", truth=str(tmp_path / "b" / "truth.nc"))


def test_without_truth_second_sensor_and_control_law_what_needs_them_is_left_out(tmp_path):
    """Contract: errors are null; places with a zero leave the printed method out, control_hz 0 the torque balance."""
    invented(tmp_path, mounting_mm="0,0,0,0,0,0", sensors="1")
    document, _ = run(tmp_path, control_hz="0")
    assert list(document["drag"]) == ["one_sensor"]
    assert document["drag"]["one_sensor"]["rms_error"] is None
    assert "differs from the solution" in document["verdict"]["text"]
    assert "centre_of_pressure_m" not in document
    assert document["panel_pressure_m"] == {"area_weighted": [0, 0, 0.052471714], "facing_the_flow": [1.5615, 0, 0]}


def test_simulation_writes_truth_beside_and_takes_measured_accelerations(tmp_path):
    """Contract: JSON with the name of its series; ACT1B columns become the drag."""
    rows = 700
    columns = {"gps_time": 633830400 + np.arange(rows)}
    for axis, value in zip("xyz", (-3e-8, 1e-9, 2e-9), strict=True):
        columns |= {f"lin_accl_{axis}": np.full(rows, value), f"ang_accl_{axis}": np.zeros(rows)}
        columns[f"acl_{axis}_res"] = np.zeros(rows)
    path = tmp_path / writers.file_name("ACT1B", "2020-02-01", "C")
    writers.write(columns, path)
    invented(tmp_path, nongravitational=str(path), duration_s="600")
    truth = json.loads((tmp_path / "truth.json").read_text())
    series = daily.read_sgrs(daily.other_file(tmp_path / truth["series"], "TRUTH", "2020-02-01"), truth=True)
    np.testing.assert_allclose(series["drag"].values, [[-3e-8, 1e-9, 2e-9]] * 120)
    with pytest.raises(ProductError, match="found 699 s of accelerations; expected 900 s"):
        invented(tmp_path, nongravitational=str(path), duration_s="900")


BIAS, ERROR = 4e-11, 2e-11  # rad s-2


def drag_with(folder, value, error=""):
    """Drag by one sensor with a model of a biased angular reading."""
    path = folder / "model.toml"
    line = f'parameters.y = {{ value = {value}, {error}unit = "rad s-2" }}'
    path.write_text(f'[[effect]]\ncause = "gradient.angular_bias"\n{line}\n')
    document, _ = run(folder, model=calibration.model_text(path))
    return read(store.find(document["drag"]["one_sensor"]["series"]))


def test_the_error_of_a_bias_is_in_the_drag(tmp_path):
    """Recovery: a bias that is wrong by its error moves the drag by what its errors hold beyond the noise."""
    commands.simulated("gradient_torque", tmp_path / "data", 3, {"gradient.angular_bias": {"y": BIAS}}, **SHORT)
    given = (BIAS, ""), (BIAS + ERROR, ""), (BIAS, f"sigma = {ERROR}, ")
    sharp, wrong, wide = (drag_with(tmp_path, *one) for one in given)
    np.testing.assert_array_equal(wide["drag_b"].values, sharp["drag_b"].values)
    of_drag = ("drag_b", "covariance"), ("drag_b", "covariance_total")
    for name, covariance in (*of_drag, ("pressure", "pressure_covariance")):
        moved = wrong[name].values - sharp[name].values
        assert np.abs(moved).max() > 0
        extra = wide[covariance].values - sharp[covariance].values
        expected = moved[..., :, None] * moved[..., None, :]
        np.testing.assert_allclose(extra, expected, rtol=1e-3, atol=1e-6 * np.abs(extra).max())
