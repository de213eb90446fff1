"""Errors of an extended model in the offset that is found with it."""

import json
import tempfile
from pathlib import Path

import commands
import numpy as np
import pytest

from flows import calibration
from gravcal.errors import CatalogError

LEAK = 3e-11  # m s-2 A-1 m-2, of the x rod in z


def test_directions_of_a_model_have_its_covariance():
    """Analytic: moves of correlated parameters multiply out to sigma R sigma; names in any order."""
    text = """
[[effect]]
cause = "torque.dipole_gain"
form = ""
parameters.rod_z = { value = 0.1, sigma = 0.02, unit = "1", correlation = { rod_x = -0.9 } }
parameters.rod_x = { value = 0.2, sigma = 0.01, unit = "1", correlation = { rod_z = -0.9 } }
parameters.rod_y = { value = 0.3, sigma = 0.03, unit = "1" }
"""
    moved = [json.loads(one)[0]["parameters"] for one in calibration.moved_models(read(text))]
    moves = np.array([[m["rod_x"]["value"] - 0.2, m["rod_y"]["value"] - 0.3, m["rod_z"]["value"] - 0.1] for m in moved])
    np.testing.assert_allclose(moves.T @ moves, [[1e-4, 0, -1.8e-4], [0, 9e-4, 0], [-1.8e-4, 0, 4e-4]], atol=1e-12)


@pytest.mark.parametrize("wrong", ["sigma = -1.0", "sigma = nan", "sigma = 0.1, correlation = { rod_x = 2.0 }"])
def test_errors_that_are_none_are_refused(wrong):
    """Bad input: file, parameter, what was found, what is expected."""
    text = '[[effect]]\ncause = "torque.dipole_gain"\nparameters.rod_z = { value = 0.1, unit = "1", '
    where = r"model\.toml: effect\.0\.parameters\.rod_z\.(sigma|correlation\.rod_x): found "
    with pytest.raises(CatalogError, match=where):
        calibration.moved_models(read(f"{text}{wrong} }}"))


def read(text):
    """Entries of a model file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        path.write_text(text)
        return calibration.model_text(path)


@pytest.fixture(scope="module")
def leaking(tmp_path_factory):
    """Folder with a day that holds a leak, beside the store of all that is made of it."""
    folder = tmp_path_factory.mktemp("leak") / "files"
    kinds = {"manoeuvres": ("pitch_low", "pitch_high", "roll_high")}
    commands.simulated("com_offset", folder, 8, {"accelerometer.current_leak": {"z_from_x": LEAK}}, **kinds)
    return folder


@pytest.fixture
def files(leaking, monkeypatch):
    """Return the folder, and let the store of this test be that beside it."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(leaking.parent / "products"))
    return leaking


def leak(value, error=""):
    """Entries of a model with the leak."""
    text = '[[effect]]\ncause = "accelerometer.current_leak"\n'
    return read(f'{text}parameters.z_from_x = {{ value = {value}, {error}unit = "m s-2 A-1 m-2" }}')


HALF = leak(0.5 * LEAK, f"sigma = {0.02 * LEAK}, ")


def test_the_error_of_a_leak_is_in_the_offset(files):
    """Recovery: a leak that is wrong by its error moves the offset by what the covariance holds beyond the noise."""
    given = (LEAK, ""), (0.97 * LEAK, ""), (LEAK, f"sigma = {0.03 * LEAK}, ")
    sharp, wrong, open_ = (adopted(files, leak(*one)) for one in given)
    moved = np.subtract(wrong["offset_um"], sharp["offset_um"])
    assert np.abs(moved).max() > 2 * np.min(sharp["sigma_um"])  # it matters
    assert open_["offset_um"] == sharp["offset_um"]
    np.testing.assert_allclose(open_["sigma_um"], np.hypot(sharp["sigma_um"], moved), rtol=0.02)


@pytest.mark.long
def test_a_search_begins_with_the_model_that_is_given(files):
    """Contract: what the model holds is not found again; half of it is, and the new model holds both halves."""
    (document, whole), (_, half) = (found(files, one) for one in (leak(LEAK), HALF))
    assert document["findings"] == []
    assert not (whole / "model.toml").exists()
    entries = json.loads(calibration.model_text(half / "model.toml"))
    first, *others = (one["parameters"].get("z_from_x", {}).get("value", 0.0) for one in entries)
    assert first == 0.5 * LEAK
    assert abs(sum(others) - 0.5 * LEAK) < 0.1 * LEAK
    assert entries[0]["parameters"]["z_from_x"]["unit"] == "m s-2 A-1 m-2"


@pytest.mark.long
def test_a_run_with_the_model_of_a_search_gives_its_value_and_its_error(files):
    """Contract: averaged value and all of the error, for these records; also where the search began with a model."""
    for given in ("", HALF):
        document, folder = found(files, given)
        change, model = document["calibration_change"], calibration.model_text(folder / "model.toml")
        for entries, when in ((given, "before"), (model, "after")):
            result = adopted(files, entries)
            np.testing.assert_allclose(result["offset_um"], change[when], rtol=1e-9)
            np.testing.assert_allclose(result["sigma_um"], change[f"sigma_{when}"], rtol=1e-9)
    assert not calibration.model_result(model, "com_offset", "other records")


def test_a_driver_is_taken_out_and_another_sensor_refused(files):
    """Contract: a run takes out an effect in no list. Bad input: a parameter of a sensor that is not there."""
    text = '[[effect]]\ncause = "unknown:torquer_current"\nform = "linear reading, a memory of the current, tau 50 s"\n'
    text += 'parameters = { linear_x = { value = 1e-6, unit = "m s-2" }, tau = { value = 50.0, unit = "s" } }'
    assert np.abs(np.subtract(adopted(files, read(text))["offset_um"], adopted(files, "")["offset_um"])).max() > 1.0
    with pytest.raises(CatalogError, match=r"found accelerometer\.temperature\.y_1, expected"):
        adopted(files, read('[[effect]]\ncause = "accelerometer.temperature"\nparameters.y_1 = { value = 1e-9 }'))


def found(files, model):
    """Document and folder of the report of a search."""
    document, ref = commands.run("com_offset", files, discovery=True, model=model, discovery_level="0.0002")
    return document, ref.folder


def adopted(files, model):
    """Adopted result with a model."""
    document, _ = commands.run("com_offset", files, model=model)
    return document["variants"][document["adopted"]["variant"]]
