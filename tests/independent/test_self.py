"""The second simulator judged by itself: law and signs; that gravcal returns its truth judges the rest."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from . import earth, orbit, sensors
from .conftest import table
from .field import field_earth


def test_the_reading_is_the_force_that_holds_the_proof_mass(event):
    """Analytic: (M1) against second differences of the inertial path of the proof mass."""
    scene, h = event["scenes"][0], 0.01
    k = np.flatnonzero((np.diff(scene.t) > 0.02) & (np.abs(scene.current[1:]).max(axis=1) > 100))[50:400:50]
    p = -np.array(event["offset_um"]) * 1e-6
    w, wd, turn = scene.rate[k], scene.rate_dot[k], scene.rotation[k]
    ahead, behind = (turn * Rotation.from_rotvec(s * h * w + h * h / 2 * wd) for s in (1, -1))
    path = (ahead.apply(p) - 2 * turn.apply(p) + behind.apply(p)) / h**2
    place = scene.world.orbit.solution(scene.t[k])[:3].T
    to = scene.world.orbit.to_gcrs
    pull = [to @ orbit.oblate_gradient(r[None])[0] @ to.T @ x for r, x in zip(place, turn.apply(p), strict=True)]
    extra = turn.inv().apply(path - np.array(pull))
    reading = sensors.truth_at_proof_mass(scene)[k] - scene.world.force(scene.t[k])
    assert np.abs(reading).max() > 1e-10
    assert_allclose(reading, extra, atol=1e-13)  # rounding of second differences


def test_axes_and_signs_of_the_files(event):
    """Contract: SCA1B turns inertial to SRF with z to nadir; GNV1B is GNI1B in the turning frame; axes of ACC1A."""
    sca, inertial, fixed = (table(event, product) for product in ("SCA1B", "GNI1B", "GNV1B"))
    assert_allclose(np.linalg.norm(sca[:, 3:7], axis=1), 1, atol=1e-14)
    turn = Rotation.from_quat(sca[:, 3:7], scalar_first=True).inv()
    down = turn.apply(-inertial[:, 3:6]) / np.linalg.norm(inertial[:, 3:6], axis=1)[:, None]
    assert down[:, 2].min() > 0.999
    assert_allclose(turn.apply(inertial[:, 9:12])[:, 0], -7600, atol=100)  # C leads, m/s
    assert_allclose(*(np.linalg.norm(x[:, 3:6], axis=1) for x in (inertial, fixed)), rtol=1e-14)
    slope = (fixed[2:, 3:6] - fixed[:-2, 3:6]) / 2
    assert_allclose(slope, fixed[1:-1, 9:12], atol=0.01)  # third derivative, 9e-3 m/s
    acc = table(event, "ACC1A")
    assert_allclose(acc[:, 6:9].mean(axis=0), [-1.06e-5, -1.8e-7, -2.8e-7], atol=2e-7)
    assert_allclose(acc[:, 9:12].mean(axis=0), [1.3e-5, 1.19e-4, -7.8e-4], atol=2e-7)


@pytest.mark.measured
def test_field_and_frames_give_the_measured_place():
    """Published: IGRF in SRF of C and D at 2023-06-01 00:00:00, from the real orbit and attitude."""
    folder = Path(__file__).parents[3] / "shared" / "data" / "gracefo-2023-06-01"
    for letter, printed in (("C", [12849, 7110, -32103]), ("D", [-13913, -6919, -30971])):
        files = {p: folder / f"{p}_2023-06-01_{letter}_04.txt" for p in ("GNV1B", "GNI1B", "SCA1B")}
        fixed, inertial, sca = (table({"files": files}, p)[0] for p in files)
        turn = earth.gcrs_to_earth("2023-06-01", [0.0])[0]
        assert_allclose(turn @ inertial[3:6], fixed[3:6], atol=0.5)  # m
        field = turn.T @ field_earth("2023-06-01", [0.0], fixed[None, 3:6], generation=14)[0]
        body = Rotation.from_quat(sca[3:7], scalar_first=True).inv().apply(field)
        assert_allclose(body * 1e9, printed, atol=1.0)  # nT, printed to 1; generation 13 is 10 nT off
