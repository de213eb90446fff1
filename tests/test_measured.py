"""The centre-of-mass flow on measured records of one day: nothing to calibrate, and the figures of that day."""

import json

import numpy as np
import pytest
from commands import MEASURED, gravcal
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.store import store
from gravcal.store.schemas import validate
from tasks.stage import read

pytestmark = pytest.mark.measured
FOLDER = MEASURED / "gracefo-2023-06-01"
MIDNIGHT = 738849600.0  # s GPS, 2023-06-01 00:00:00
#: nT in SRF at midnight, from the README of the data: IGRF and magnetometer.
FIGURES = {"C": ((12849, 7110, -32103), (12328, 7118, -31842)), "D": ((-13913, -6919, -30971), (-12779, -6760, -31384))}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Exit code, document and field product of both satellites, by letter."""
    root, found = tmp_path_factory.mktemp("measured"), {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRAVCAL_PRODUCTS", str(root / "store"))
        for letter in FIGURES:
            path = root / f"{letter}.json"
            options = ("--data", FOLDER, "--satellite", letter, "--date", "2023-06-01", "--engine", "inline")
            code = gravcal("run", "com_offset", *options, "--json", path)
            document = json.loads(path.read_text())
            field = read(store.find(document["provenance"]["products"]["com_offset.field"])).load()
            found[letter] = (code, document, field)
    return found


@pytest.mark.parametrize("letter", sorted(FIGURES))
def test_no_manoeuvre_is_said_so_every_check_is_passed_and_the_field_at_midnight_is_the_printed_one(results, letter):
    """Published: IGRF-14 in the body to the printed nanotesla, carried from the first samples back to midnight.

    First reading of MAG1B in SRF; bias over 50 s lies near the difference, rms^2 = bias^2 + scatter^2. Exit code 3, a
    valid document without offset; residuals of the fitted dynamics over 100 s of control below 5 urad on every axis.
    """
    code, document, field = results[letter]
    assert code == 3
    assert document["status"] == "no_manoeuvre"
    assert document["manoeuvres"] == []
    assert "variants" not in document
    validate(document)
    checks = {one["name"]: one for one in document["checks"]}
    cut = [checks.pop(name) for name in [*checks] if name.startswith("records of ")]  # excerpts of files of a day
    assert [one["passed"] for one in cut] == [False] * 7
    assert len(checks) == 10
    assert all(one["passed"] for one in checks.values())
    assert checks["orbit products"]["value"] < 0.05  # m
    assert checks["position against velocity"]["value"] < 1e-3  # m/s
    assert checks["attitude against orbit"]["value"] < 1.5  # deg
    assert max(document["attitude"]["rms_urad"]) < 5
    assert document["attitude"]["samples"] > 90
    check, (model, reading) = document["field_check"], FIGURES[letter]
    assert check["model"] == "IGRF-14"
    time = field["time_mag"].values[:20] - MIDNIGHT
    at_midnight = [np.polyval(np.polyfit(time, 1e9 * field["model_b"].values[:20, c], 2), 0.0) for c in range(3)]
    assert_allclose(at_midnight, model, atol=0.6)  # half a nanotesla of rounding
    assert_allclose(1e9 * field["measured_b"].values[0], reading, atol=0.5)  # rounding
    bias, rms = np.array(check["bias_nt"]), np.array(check["rms_nt"])
    assert_allclose(bias, np.subtract(reading, model), atol=25)  # nT of change in 50 s
    assert np.all(np.sqrt(rms**2 - bias**2) < 15)
    assert np.all(np.array(check["max_nt"]) >= rms)
    assert check["samples"] == 100


def test_roll_answers_the_torque_as_published(results):
    """Published: slope of roll acceleration on torque of C over 50 s, 0.0028 +- 0.0003 rad s-2 per mA T."""
    found = results["C"][1]["roll_response"]
    assert found["value"] == pytest.approx(0.0028, abs=3e-4)
    assert 0 < found["sigma"] < 1e-3
    satellite = catalog.satellite("C").settings()
    assert abs(found["value"] - (satellite["dipole_per_current"][0] / satellite["inertia"][0][0])) < 3 * found["sigma"]
