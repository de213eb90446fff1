"""Magnetometer against the reference field: recovery, what minutes leave open, and inputs that contradict."""

import sys

import commands
import numpy as np
import pytest
import seeds
from scipy import stats

from flows.calibration import load, model_text
from gravcal import catalog
from gravcal.calibrations.magnetometer import model
from gravcal.calibrations.magnetometer.estimate import estimate
from gravcal.errors import ProductError
from gravcal.estimation import least_squares
from gravcal.io import archive, cdf, readers
from gravcal.physics import earth, magnetic, orbit_environment

COUNT = 24
LEVEL = 3e-4  # chance that a correct code fails, over all statistics of the study
CALIBRATION = load("magnetometer")
CHOSEN = catalog.parameters("magnetometer")
DAY = "2020-02-01"


def aligned(folder, seed, duration_s=10800, gap=None, **settings):
    """Aligned records of an invented day, and its true parameters; gap: records that a product has not."""
    made = CALIBRATION.simulate(folder, seed=seed, settings={"duration_s": str(duration_s)} | settings)
    observed = [readers.read(archive.find(folder, name, "C", DAY)) for name in ("MAG1B", "SCA1B", "GNV1B")]
    if gap is not None:
        observed[gap[0]] = observed[gap[0]].drop_isel(record=gap[1])
    torquers = catalog.satellite("C").settings()["dipole_per_current"]
    return model.align(*observed, dipole_per_current=torquers, **CHOSEN.for_stage("align")), made["parameters"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Errors over sigma (n, 23) of invented records of three hours, and the disagreement of their parts."""
    seed, errors, agreement = seeds.seed("magnetometer", 4e-4), [], []
    for k in range(COUNT):
        records, truth = aligned(tmp_path_factory.mktemp("magnetometer"), seed + k)
        found = estimate(records, **CHOSEN.for_stage("estimate"))
        true = np.array([truth[str(name)] for name in found["parameter"].values])
        errors.append((found["value"].values - true) / found["sigma"].values)
        agreement.append((float(found["agreement_chi2"]), int(found["agreement_dof"])))
    return seed, np.array(errors), np.array(agreement)


@pytest.mark.long
def test_errors_scatter_as_their_sigma_says(study):
    """Recovery: sum of (error/sigma)^2 of 23 parameters in its interval, 5 % of noise model; that of the parts."""
    seed, errors, agreement = study
    low, high = stats.chi2.interval(1 - LEVEL / 23, COUNT)
    total = np.sum(errors**2, axis=0)
    assert ((low / 1.1 < total) & (total < high * 1.1)).all(), f"GRAVCAL_TEST_SEED={seed}: {total}"
    assert 0.85 < np.sqrt(np.mean(errors**2)) < 1.15, f"GRAVCAL_TEST_SEED={seed}"
    chi2, dof = agreement.sum(axis=0)
    assert 0.85 < chi2 / dof < 1.2, f"GRAVCAL_TEST_SEED={seed}"


@pytest.mark.parametrize("product", [1, 2])
def test_attitude_and_orbit_are_interpolated_over_minutes_only(tmp_path, product):
    """Contract: what is measured in a longer gap of either is left out."""
    for seconds, held in ((170, 590), (190, 400)):
        records, _ = aligned(tmp_path / str(seconds), 3, 600, gap=(product, np.arange(200, 200 + seconds)))
        assert records["time"].size == pytest.approx(held, abs=3)


def test_minutes_leave_open_what_they_do_not_determine(tmp_path):
    """Contract: five minutes: the leak is determined, bias and scale are null; held groups leave a bias."""
    records, truth = aligned(tmp_path, 3, 300)
    found = estimate(records, **CHOSEN.for_stage("estimate") | {"determined_ratio": 0.5})
    names, known = found["parameter"].values, np.isfinite(found["value"].values)
    assert not known[names == "external_field"]
    assert known[names == "leak_y_from_x"]
    assert (np.isnan(found["covariance"].values) == ~np.outer(known, known)).all()
    held = ("scale", "misalignment", "nonorthogonality", "external_field", "delay", "leak")
    settings = CHOSEN.for_stage("estimate") | {"held": held}
    assert list(estimate(records, **settings)["parameter"].values) == ["bias_x", "bias_y", "bias_z"]


CDF = "GF1_OPER_FGM_ACAL_CORR_20200201T000000_20200201T235959_0201.cdf"


def published(folder, strength, late=0.0):
    """CDF file of the reference field, ring current, 40 nT down, tags late by seconds; 20 records an hour 1 uT off."""
    cdflib = pytest.importorskip("cdflib")
    observed = readers.read(archive.find(folder, "GNV1B", "C", DAY))
    time = observed["gps_time"].values.astype(float)
    position = np.stack([observed[name].values for name in ("xpos", "ypos", "zpos")], axis=1)
    axis = np.matvec(earth.R_ei(time), orbit_environment.dipole_axis_i(time))
    field_e = magnetic.field_e(time, position, 14) + strength * axis
    field_n = np.matvec(np.swapaxes(earth.R_en_from_position(position, geocentric_down=True), 1, 2), field_e)
    latitude, longitude, radius = earth.geocentric(position)
    utc = cdflib.cdfepoch.compute_epoch([2020, 1, 31, 23, 59, 42, 0]) + 1e3 * (time - time[0] + late)  # 18 s behind GPS
    columns = {"Timestamp": utc, "Latitude": np.degrees(latitude), "Longitude": np.degrees(longitude)}
    flag = (np.arange(time.size) % 3600 >= 3580).astype(np.uint8)
    columns |= {"Radius": radius, "B_NEC": 1e9 * field_n + [0, 0, 40] + 1e3 * flag[:, None], "B_FLAG": flag}
    with cdflib.cdfwrite.CDF(folder / CDF, delete=True) as file:
        file.write_globalattrs({"software_version": {0: "gravcal simulation"}})
        for name, values in columns.items():
            kind = {"Timestamp": "CDF_EPOCH", "B_FLAG": "CDF_UINT1"}.get(name, "CDF_DOUBLE")
            kind = getattr(cdflib.cdfwrite.CDF, kind)
            about = {"Variable": name, "Data_Type": kind, "Num_Elements": 1, "Rec_Vary": True}
            file.write_var(about | {"Dim_Sizes": list(values.shape[1:])}, var_data=values)


def test_the_calibrated_field_of_others_stands_beside_ours(tmp_path, monkeypatch):
    """Recovery: the true field and 40 nT along z; four sigma of a mean, 10 nT sqrt(2 x 60 / 7190).

    Without cdflib the extra is named; of another day there is no file.
    """
    truth = CALIBRATION.simulate(tmp_path, seed=4, settings={"duration_s": "7200"})["parameters"]
    published(tmp_path, truth["external_field"])
    document, ref = commands.run("magnetometer", tmp_path)
    facts, theirs = document["facts"], document["theirs"]
    sigma = {name: one["sigma"] for name, one in document["parameters"].items()}
    assert (facts["theirs_records"], facts["theirs_flagged"], document["origin"]) == (7154, 40, "simulated")
    assert np.allclose(facts["theirs_less_ours_mean_nt"], [0, 0, 40], atol=5.2)
    assert np.all(np.abs(facts["theirs_less_ours_rms_nt"] - np.hypot(facts["noise_nt"], [0, 0, 40])) < 5.2)
    assert facts["theirs_from_orbit_m"] < 1
    for name, one in theirs.items():
        expected = truth[name] - (40e-9 if name == "bias_z" else 0)
        assert abs(one["value"] - expected) < 4.5 * max(sigma[name], one["sigma"]), name
    assert "Beside another calibration" in (ref.folder / "report.html").read_text()
    published(tmp_path, truth["external_field"], late=18.0)  # GPS time where UTC is meant
    with pytest.raises(ProductError, match="places 13. km from the orbit"):
        commands.run("magnetometer", tmp_path)
    assert (cdf.files(tmp_path, "D", DAY), cdf.files(tmp_path, "C", "2020-02-02")) == ([], [])
    monkeypatch.setitem(sys.modules, "cdflib", None)
    with pytest.raises(ProductError, match=r"gravcal\[cdf\]"):
        cdf.read(*cdf.files(tmp_path, "C", DAY))


DIRECTION = "direction of the field against the reference"
ATTITUDE, READINGS = "tags of the attitude", "tags of the magnetometer"


@pytest.mark.parametrize(
    ("name", "late", "failed"),
    [
        ("GNV1B", 2800, {DIRECTION: None}),
        ("MAG1B", 137, {READINGS: 137}),
        ("SCA1B", 137, {ATTITUDE: 137}),  # to the field alone a magnetometer turned by 0.15 rad
        ("GNV1B", 137, {ATTITUDE: 137, READINGS: 137}),  # both against the orbit
    ],
)
def test_records_shifted_against_each_other_are_questionable(tmp_path, name, late, failed):
    """Contract: late records contradict each other; everything is written all the same, no cause but timing named."""
    CALIBRATION.simulate(tmp_path, seed=1, settings={"duration_s": "9000"})  # parts too long to try chirps in: 16 s
    commands.shortened(tmp_path, 24, f"{name} C", late)
    document, _ = commands.run("magnetometer", tmp_path)
    assert document["status"] == "questionable"
    found = {one["name"]: one["value"] for one in document["checks"] if not one["passed"]}
    assert set(failed) <= set(found)
    for check, value in failed.items():
        assert value is None or found[check] == pytest.approx(value, rel=0.1)
    if len(failed) == 2:
        findings = commands.run("magnetometer", tmp_path, discovery=True)[0]["findings"]
        found = {one["cause"]: one["parameters"] for one in findings if one["cause"] != "unknown:excess"}
        assert set(found) == {"timing.star_camera_delay", "timing.magnetometer_delay"}
        assert all(abs(one["delay"]["value"] + 137) < 2 * one["delay"]["sigma"] < 31 for one in found.values())


def test_all_that_an_instrument_does_at_once_is_told_apart(tmp_path):
    """Recovery: the 21 numbers of half an hour within four sigma; a run with the model of the search gives the same."""
    truth = CALIBRATION.simulate(tmp_path, seed=6, settings={"duration_s": "1800"})["parameters"]
    found, ref = commands.run("magnetometer", tmp_path, discovery=True)
    models = "", model_text(ref.folder / "model.toml")
    own, others = (commands.run("magnetometer", tmp_path, model=one)[0]["parameters"] for one in models)
    for name in ("bias_x", "scale_x", "misalignment_z"):
        assert own[name]["value"] == pytest.approx(others[name]["value"])
    for one in found["findings"]:
        word = one["cause"].partition(".")[2].removeprefix("current_")
        for name, found in one["parameters"].items():
            assert abs(truth.pop(f"{word}_{name.removeprefix('angle_')}") - found["value"]) < 4 * found["sigma"]
    assert set(truth) == {"external_field", "delay"}


WARMED = ("magnetometer.temperature_bias", "x", 3e-8), ("magnetometer.temperature_scale", "z", 1e-3)


@pytest.mark.parametrize("hidden", [None, *WARMED])
def test_temperature_is_named_alone_where_it_was_hidden_and_nowhere_else(tmp_path, hidden):
    """Recovery: two orbits with slow errors of the reference field; within four sigma, which are a tenth or less."""
    effects = {f"{hidden[0]}.{hidden[1]}": hidden[2]} if hidden else {}
    CALIBRATION.simulate(tmp_path, seed=2, effects=effects, settings={"duration_s": "10800", "scatter": "0"})
    found = {one["cause"]: one for one in commands.run("magnetometer", tmp_path, discovery=True)[0]["findings"]}
    assert list(found) == ([hidden[0]] if hidden else [])
    if hidden:
        one = found[hidden[0]]["parameters"][hidden[1]]
        assert abs(one["value"] - hidden[2]) < 4 * one["sigma"] < 0.4 * hidden[2]


def test_parts_that_contradict_each_other_say_so_and_of_a_sum_no_part_is_determined():
    """Analytic: 1 and 3 with unit variance: chi-square 2 of one degree; of a + b and c a and b are null, c is not."""
    chi2, dof = least_squares.disagreement(np.array([[1.0], [3.0]]), np.ones((2, 1, 1)))
    assert (chi2, dof) == (pytest.approx(2.0), 1)
    design = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    value, covariance = least_squares.solution(design.T @ design, design.T @ [3.0, 5.0], np.full(3, 10.0))
    assert np.isnan(value).tolist() == [True, True, False]
    assert (value[2], covariance[2, 2]) == (pytest.approx(5.0), pytest.approx(1.0))
    assert np.isnan(covariance[0]).all()


LEAK = "magnetometer.current_leak"
MINUTES, SECONDS = "grace-2003-09-14/binary", "gracefo-2023-06-01"


@pytest.mark.measured
@pytest.mark.parametrize(("folder", "satellite"), [(MINUTES, "A"), (MINUTES, "B"), (SECONDS, "C"), (SECONDS, "D")])
def test_minutes_of_magnetometer_name_a_bias_and_a_leak_and_no_more(folder, satellite):
    """Recovery: on 2003-09-14 both leak from the x torquer into y, 0.15 uT per A m2; what grows in 50 s is tied."""
    document, _ = commands.run("magnetometer", commands.MEASURED / folder, discovery=True, satellite=satellite)
    found = {one["cause"]: one for one in document["findings"]}
    assert "magnetometer.bias" in found
    alone = {"magnetometer.bias", *([LEAK] if folder == MINUTES else ())}
    assert all(found[cause]["tied_with"] for cause in set(found) - alone)
    if folder == MINUTES:
        assert np.isclose(found[LEAK]["parameters"]["y_from_x"]["value"], -1.5e-7, rtol=0.2)
