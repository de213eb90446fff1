"""Errors of an extended model in the results of a swing and of a roll."""

import numpy as np
import pytest
import xarray as xr

from flows import engine, models
from flows import inertial_sensor as flow
from gravcal import catalog
from gravcal.calibrations.inertial_sensor.bias import bias_model_error

TURN, ERROR = 0.05, 0.03


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with a swing whose tracker is turned."""
    folder = tmp_path_factory.mktemp("turned") / "files"
    effects = {"inertial_sensor.tracker_misalignment.angle_z": TURN}
    flow.CALIBRATION.simulate(folder, seed=5, truth=None, effects=effects, settings={"manoeuvre": "swing"})
    return folder


def swing(files, folder, value, error=""):
    """Result of a swing with a model of the turned tracker."""
    path = folder / "model.toml"
    line = f'parameters.angle_z = {{ value = {value}, {error}unit = "rad" }}'
    path.write_text(f'[[effect]]\ncause = "inertial_sensor.tracker_misalignment"\n{line}\n')
    chosen = catalog.parameters("inertial_sensor").with_settings({"model": models.text_of(path)})
    ref = engine.run(flow.calibrate, flow.CALIBRATION.source(data=files), chosen, engine="inline")
    return flow.CALIBRATION.document(ref)["swing"]


def test_the_error_of_a_turned_tracker_is_in_factors_and_offset(files, tmp_path, monkeypatch):
    """Recovery: a turn that is wrong by its error moves the results by what their errors hold beyond the noise."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    given = (TURN, ""), (TURN + ERROR, ""), (TURN, f"sigma = {ERROR}, ")
    sharp, wrong, wide = (swing(files, tmp_path, *one) for one in given)
    for axis in "xyz":
        held, moved = sharp["beta"][axis]["sigma"], wrong["beta"][axis]["value"] - sharp["beta"][axis]["value"]
        assert wide["beta"][axis]["value"] == sharp["beta"][axis]["value"]
        assert wide["beta"][axis]["sigma"] == pytest.approx(np.hypot(held, moved), rel=0.02)
    assert any(wide["beta"][a]["sigma"] > 1.5 * sharp["beta"][a]["sigma"] for a in "xyz")  # it matters
    value, other, held, found = (
        np.array(one["com_to_test_mass_um"][name])
        for one, name in ((sharp, "value"), (wrong, "value"), (sharp, "sigma"), (wide, "sigma"))
    )
    np.testing.assert_allclose(found, np.hypot(held, other - value), rtol=0.02)


def test_the_error_of_a_model_is_in_the_bias_of_a_roll():
    """Analytic: moves add in squares; what one of them leaves undetermined does not move."""

    def biased(value):
        values = {"bias": value, "bias_sigma": [3.0, 1.0, 2.0], "bias_sigma_total": [0.0, 5.0, np.nan]}
        return xr.Dataset({name: ("axis", np.array(given)) for name, given in values.items()})

    moved = biased([4.0, 2.0, 1.0]), biased([0.0, 2.0, np.nan])
    found = bias_model_error(biased([0.0, 2.0, 1.0]), *moved)
    np.testing.assert_allclose(found["bias_sigma"], [5.0, 1.0, 2.0])
    np.testing.assert_allclose(found["bias_sigma_total"], [4.0, 5.0, np.nan])
