"""Ranging, Taiji-1 and S-GRS by simulators of another hand: what reader and writer of the package share shows here."""

import re

import numpy as np
import pytest
from commands import run
from numpy.testing import assert_allclose

from gravcal.store import store
from tasks.stage import read

from . import gradient, ranging, taiji


def within(value, sigma, truth, limit=4.0):
    """Assert that values are within so many sigma of the truth."""
    assert np.abs((np.array(value) - truth) / sigma).max() < limit


def checked(said):
    """The largest value of each check of a delivered document, by name."""
    assert said["status"] == "delivered", [check for check in said["checks"] if not check["passed"]]
    return {check["name"]: check["value"] for check in said["checks"]}


def only(said):
    """The one finding of a search, tied with nothing."""
    assert [(one["cause"], one["tied_with"]) for one in said["findings"]] == [(said["findings"][0]["cause"], [])]
    return said["findings"][0]["cause"], said["findings"][0]["parameters"]


def test_both_phase_centres_come_back(tmp_path):
    """Recovery: exact orbits, so that light time and filter show in range minus orbit."""
    truth = ranging.make_campaign(tmp_path / "data", 1, orbit_error_m=0.0)
    said = run("kbr_phase_centre", tmp_path / "data")[0]
    apart = checked(said)
    for letter, centre in truth["phase_centre_mm"].items():
        for kind in ("range", "range_rate", "range_acceleration"):
            found = said["satellites"][letter][kind]["ls"]
            within(found["phase_centre_mm"], found["sigma_mm"], centre)
    assert apart["range against orbits, rms"] < 0.03  # mm; half of a light time left out is 0.2
    assert apart["range rate against orbits, rms"] < 0.3  # um/s


def test_swing_and_roll_come_back(tmp_path):
    """Recovery: factors, offset and bias, the roll about -y."""
    truth = taiji.make_event(tmp_path / "data", 1)
    said = run("inertial_sensor", tmp_path / "data")[0]
    apart, swing, bias = checked(said), said["swing"], said["roll"]["bias"]
    for axis, number in (("x", 0), ("z", 2)):
        within(swing["k"][axis]["value"], swing["k"][axis]["sigma_total"], truth["k"][number])
        within(swing["beta"][axis]["value"], swing["beta"][axis]["sigma"], truth["beta"][number])
        held = bias["value"][number] * truth["k"][number] / swing["k"][axis]["value"]  # with the true factor
        within(held, bias["sigma"][number], truth["bias"][number])
    offset = swing["com_to_test_mass_um"]
    within(offset["value"], offset["sigma"], truth["com_to_test_mass_um"])
    within(swing["delay_s"]["value"], swing["delay_s"]["sigma"], truth["delay_s"])
    assert apart["angular reading y over gravity torque while rolling, from one"] < 0.3


def test_drag_and_centre_of_pressure_come_back(tmp_path):
    """Recovery: a planet whose order two is ten times that of the Earth; one sensor and two."""
    truth = gradient.make_day(tmp_path / "data", 3)
    said = run("gradient_torque", tmp_path / "data", field=str(tmp_path / "field.gfc"))[0]
    checked(said)
    for method in ("one_sensor", "two_sensor"):
        series = read(store.find(said["drag"][method]["series"]))
        off = series["drag_b"].values - truth["drag"]
        sigma = np.sqrt(np.einsum("nii->ni", series["covariance"].values))
        within(off.mean(0), sigma.mean(0) / np.sqrt(len(off) / 50), 0.0)  # errors of the attitude last 50 s
        # of one sensor the smoother leaves what lies below 10 mHz, and there its noise is 1.2 times the catalogue's
        assert_allclose(np.sqrt(np.mean(off**2 / sigma**2, axis=0)), 1.0, atol=0.25 if method == "one_sensor" else 0.15)
    centre = said["centre_of_pressure_m"]
    within(centre["value"], centre["sigma"], truth["centre_of_pressure_m"])


@pytest.mark.long
def test_multipath_of_one_satellite_is_named(tmp_path):
    """Recovery: with size and period."""
    hidden = {"value": 1e-6, "satellite": "C", "axis": 2, "period": 0.02, "phase": 0.7}
    ranging.make_campaign(tmp_path / "data", 1, {"multipath": hidden})
    cause, found = only(run("kbr_phase_centre", tmp_path / "data", discovery=True)[0])
    assert cause == "ranging.multipath"
    assert found["period"]["value"] == pytest.approx(0.02, rel=0.01)
    size = np.hypot(found["yaw_a"]["value"], found["cosine_yaw_a"]["value"])
    assert size == pytest.approx(1e-6, abs=4 * found["yaw_a"]["sigma"])


@pytest.mark.long
def test_a_turned_star_tracker_is_named(tmp_path):
    """Recovery: with its angles."""
    angles = [0.05, -0.02, 0.05]
    taiji.make_event(tmp_path / "data", 3, {"tracker_misalignment": angles}, roll_s=0.0)
    cause, found = only(run("inertial_sensor", tmp_path / "data", discovery=True)[0])
    assert cause == "inertial_sensor.tracker_misalignment"
    for axis, angle in zip("xyz", angles, strict=True):
        within(found[f"angle_{axis}"]["value"], found[f"angle_{axis}"]["sigma"], angle)


@pytest.mark.long
def test_a_square_of_voltages_that_changes_their_scale_by_a_third_is_found_as_its_law_has_it(tmp_path):
    """Recovery: V + 15 V^2 is recorded, of a mean that is not zero; the factor within its error, which holds it all."""
    truth = taiji.make_event(tmp_path / "data", 3, {"quadratic": [0.0, 0.0, -15.0]}, roll_s=0.0)
    said = run("inertial_sensor", tmp_path / "data", discovery=True)[0]
    within(*(said["findings"][0]["parameters"]["z"][name] for name in ("value", "sigma")), 15.0)
    change = said["calibration_change"]
    within(change["after"][0], change["sigma_after"][0], 1e6 * truth["beta"][0])


@pytest.mark.long
def test_a_telegraph_signal_in_the_quiet_data_too_is_no_noise(tmp_path):
    """Recovery: it is in all of the record of a swing; jumps nearer than two seconds to each other are not told."""
    taiji.make_event(tmp_path / "data", 3, {"odd_telegraph": {"value": [0, 6e-9, 0], "rate_hz": 0.05}}, roll_s=0.0)
    (found,) = run("inertial_sensor", tmp_path / "data", discovery=True, round_limit="1")[0]["findings"]
    assert found["cause"] == "unknown:excess"
    assert re.fullmatch(r"linear reading y, [4-7]\d jumps between two levels", found["form"])


@pytest.mark.long
def test_a_residual_dipole_is_named(tmp_path):
    """Recovery: with its size, and the centre of pressure beside it; in under five revolutions it passes for noise."""
    truth = gradient.make_day(tmp_path / "data", 3, {"residual_dipole": [1.0, 0.0, 1.0]}, duration_s=30000.0, step=3.0)
    said = run("gradient_torque", tmp_path / "data", discovery=True, field=str(tmp_path / "field.gfc"))[0]
    (found,) = [one for one in said["findings"] if one["cause"] == "torque.residual_dipole"]
    assert not found["tied_with"]
    for axis, size in zip("xyz", (1.0, 0.0, 1.0), strict=True):
        within(found["parameters"][axis]["value"], found["parameters"][axis]["sigma"], size)
    change = said["calibration_change"]
    within(change["after"], change["sigma_after"], 1e3 * np.array(truth["centre_of_pressure_m"]))
    assert max(change["sigma_after"]) < max(change["sigma_before"])
