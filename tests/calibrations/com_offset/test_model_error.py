"""Errors of an extended model in the offset that is found with it."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest

from flows import calibration, discover, engine
from flows import com_offset as flow
from gravcal import catalog
from gravcal.calibrations import schemas
from gravcal.calibrations.com_offset.estimate import with_model_error
from gravcal.calibrations.schemas import build
from gravcal.errors import CatalogError

SCHEMA = schemas.of("com_offset.toml")["combine"]
SIGMA = np.array([2e-6, 0.5e-6, 0.7e-6])
LEAK = 3e-11  # m s-2 A-1 m-2, of the x rod in z


def combined(offset):
    """Two angular accelerations, three components."""
    names = ("manoeuvre", "variants_", "catalogue_")
    values = {n: np.zeros([2, 3, 3, 3][: len(s["dims"].split())]) for n, s in SCHEMA.items() if n not in names}
    values |= {"offset": offset, "covariance": np.tile(np.diag(SIGMA**2), (2, 1, 1)), "determined": np.ones((2, 3))}
    values |= {"covariance_total": 4 * np.tile(np.diag(SIGMA**2), (2, 1, 1))}
    values |= {n: 0.0 for n, s in SCHEMA.items() if not s["dims"]}
    for name in ("kind", "start", "stop"):
        values[name] = np.zeros(3)
    return build(SCHEMA, values, variants="mtq acc")


def test_moves_add_to_both_covariances():
    """Analytic: S + sum d d', the offsets as they were."""
    offset = np.array([[1e-4, 2e-5, -3e-5], [1.1e-4, 2e-5, -3e-5]])
    moves = np.array([[3e-6, 0, -1e-6], [0, 2e-6, 0]])
    widened = with_model_error(combined(offset), *(combined(offset + m) for m in moves), determined_sigma_um=50.0)
    for name, factor in (("covariance", 1), ("covariance_total", 4)):
        expected = factor * np.diag(SIGMA**2) + moves.T @ moves
        np.testing.assert_allclose(widened[name].values, [expected] * 2, rtol=1e-9, atol=1e-20)
    np.testing.assert_array_equal(widened["offset"].values, offset)
    search = {"correction": [1e-6, 0, -2e-6], "covariance": np.diag([1e-12, 4e-12, 0]).tolist()}
    found = with_model_error(combined(offset), determined_sigma_um=50.0, added=json.dumps(search))
    np.testing.assert_allclose(found["offset"].values, offset + search["correction"])
    np.testing.assert_allclose(found["covariance"].values[1], np.diag(SIGMA**2) + search["covariance"])


def test_a_component_that_the_model_leaves_open_is_not_determined():
    """Contract: not determined instead of a number, from the limit on."""
    offset = np.full((2, 3), 1e-5)
    widened = with_model_error(combined(offset), combined(offset + [0, 60e-6, 0]), determined_sigma_um=50.0)
    np.testing.assert_array_equal(widened["determined"].values, [[1, 0, 1]] * 2)
    assert np.isnan(widened["offset"].values[:, 1]).all()


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
    expected = [[1e-4, 0, -1.8e-4], [0, 9e-4, 0], [-1.8e-4, 0, 4e-4]]
    np.testing.assert_allclose(moves.T @ moves, expected, atol=1e-12)


@pytest.mark.parametrize("wrong", ["sigma = -1.0", "sigma = nan", "sigma = 0.1, correlation = { rod_x = 2.0 }"])
def test_errors_that_are_none_are_refused(wrong):
    """Bad input: file, parameter, what was found, what is expected."""
    text = '[[effect]]\ncause = "torque.dipole_gain"\nparameters.rod_z = { value = 0.1, unit = "1", '
    with pytest.raises(
        CatalogError, match=r"model\.toml: effect\.0\.parameters\.rod_z\.(sigma|correlation\.rod_x): found "
    ):
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
    folder, effects = tmp_path_factory.mktemp("leak") / "files", {"accelerometer.current_leak.z_from_x": LEAK}
    flow.CALIBRATION.simulate(folder, seed=8, truth=None, effects=effects, settings={})
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


def test_the_error_of_a_leak_is_in_the_offset(files):
    """Recovery: a leak that is wrong by its error moves the offset by what the covariance holds beyond the noise."""
    given = (LEAK, ""), (0.97 * LEAK, ""), (LEAK, f"sigma = {0.03 * LEAK}, ")
    sharp, wrong, open_ = (adopted(files, leak(*one)) for one in given)
    moved = np.subtract(wrong["offset_um"], sharp["offset_um"])
    assert np.abs(moved).max() > 2 * np.min(sharp["sigma_um"])  # it matters
    assert open_["offset_um"] == sharp["offset_um"]
    np.testing.assert_allclose(open_["sigma_um"], np.hypot(sharp["sigma_um"], moved), rtol=0.02)


def test_a_search_begins_with_the_model_that_is_given(files):
    """Contract: what the model holds is not found again; half of it is, and the new model holds both halves."""
    whole, half = (found(files, leak(share * LEAK)) for share in (1.0, 0.5))
    assert json.loads((whole / "discovery.json").read_text())["findings"] == []
    assert not (whole / "model.toml").exists()
    entries = json.loads(calibration.model_text(half / "model.toml"))
    first, *others = (one["parameters"].get("z_from_x", {}).get("value", 0.0) for one in entries)
    assert first == 0.5 * LEAK
    assert abs(sum(others) - 0.5 * LEAK) < 0.1 * LEAK
    assert entries[0]["parameters"]["z_from_x"]["unit"] == "m s-2 A-1 m-2"


def test_a_run_with_the_model_of_a_search_gives_its_value_and_its_error(files):
    """Contract: the averaged value and all of the error are in the model, for the records it was found in."""
    folder = found(files, "")
    change = json.loads((folder / "discovery.json").read_text())["calibration_change"]
    result = adopted(files, calibration.model_text(folder / "model.toml"))
    np.testing.assert_allclose(result["offset_um"], change["after"], rtol=1e-9)
    np.testing.assert_allclose(result["sigma_um"], change["sigma_after"], rtol=1e-9)
    other = calibration.model_result(calibration.model_text(folder / "model.toml"), "com_offset", "other records")
    assert not other


def found(files, model):
    """Folder of the report of a search."""
    chosen = catalog.parameters("com_offset").with_settings({"model": model, "discovery_level": "0.0002"})
    return engine.run(
        discover.flow_of("com_offset"), flow.CALIBRATION.source(data=files), chosen, engine="inline"
    ).folder


def adopted(files, model):
    """Adopted result with a model."""
    chosen = catalog.parameters("com_offset").with_settings({"model": model})
    document = flow.CALIBRATION.document(
        engine.run(flow.calibrate, flow.CALIBRATION.source(data=files), chosen, engine="inline")
    )
    return document["variants"][document["adopted"]["variant"]]
