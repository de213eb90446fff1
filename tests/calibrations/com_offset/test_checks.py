"""Checks of com_offset: records that contradict each other, and results that cannot be."""

import shutil

import com_offset_chain as tools
import commands
import numpy as np
import pytest
import xarray as xr
from independent import make_event
from independent.damage import MARK

from gravcal import catalog
from gravcal.calibrations import checks as checking
from gravcal.calibrations.com_offset import checks, observations
from gravcal.calibrations.com_offset import page as documented
from gravcal.discovery import driver
from gravcal.discovery.evidence import evidence
from gravcal.errors import EstimationError
from gravcal.estimation.quantities import result_of
from gravcal.estimation.records import Entry, Parameter

LIMITS = catalog.parameters("com_offset").for_stage("checks")
X, Y, VX, VY = 3, 4, 9, 10  # columns of GNI1B


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with one pitch and one roll."""
    folder = tmp_path_factory.mktemp("checks") / "files"
    make_event(folder, 5, manoeuvres=[("pitch", "high"), ("roll", "high")], field_generation=14)
    return folder


def failed(document):
    """Names of the checks that fail."""
    return {one["name"] for one in document["checks"] if not one["passed"]}


def test_an_orbit_that_contradicts_other_records_makes_the_result_questionable(files, tmp_path):
    """Contract: x and y exchanged: exit code 4; what fails stands in document, verdict, page and VCM line."""
    contradicted = {"orbit products", "attitude against orbit", "magnetometer against IGRF"}
    folder = shutil.copytree(files, tmp_path / "files")
    path = next(folder.glob("GNI1B*"))
    head, body = path.read_bytes().split(MARK)
    rows = [line.split() for line in body.splitlines()]
    for row in rows:
        row[X], row[Y], row[VX], row[VY] = row[Y], row[X], row[VY], row[VX]
    path.write_bytes(head + MARK + b"".join(b" ".join(row) + b"\n" for row in rows))
    code, document = commands.document("run", "com_offset", folder, origin="measured")
    assert (code, document["status"]) == (4, "questionable")
    assert contradicted <= failed(document)
    page, line = (next((tmp_path / "products").rglob(name)) for name in ("report.html", "result.vcm"))
    for name in contradicted:
        assert name in document["verdict"]["text"]
        assert name in page.read_text()
    assert "QUESTIONABLE" in line.read_text()


def test_a_day_without_contradiction_passes_all_its_checks(files):
    """Contract: exit code 0, every check made and passed, each with a finite value and its limit."""
    code, document = commands.document("run", "com_offset", files, origin="measured")
    assert (code, document["status"], failed(document)) == (0, "delivered", set())
    assert len(document["checks"]) == len({one["name"] for one in document["checks"]}) == 23
    assert all(np.isfinite([one["value"], one["limit"]]).all() for one in document["checks"])


@pytest.fixture(scope="module")
def made():
    """Records and products of a pitch and a roll, in memory."""
    observed, _ = tools.event(3, manoeuvres=["pitch_high", "roll_high"])
    return observed, tools.smoothed(observed)[0]


def moved(dataset, **changes):
    """Dataset with other values in some variables."""
    return dataset.assign({name: dataset[name].copy(data=value) for name, value in changes.items()})


def held(values, samples):
    """The same with some samples that repeat the first of them."""
    values = values.copy()
    values[samples] = values[samples][0]
    return values


ALIGN, FIELD, ATTITUDE = range(3)
#: What is wrong, by the check that has to see it: (product, variable, change) each.
SPOILT = {
    "position against velocity": [(ALIGN, "velocity_i", lambda v: v * [1, 1, -1])],
    "velocity against gravity": [(ALIGN, name, lambda v: 1.02 * v) for name in ("velocity_i", "position_i")],
    "lowest height": [(ALIGN, "position_i", lambda r: 0.95 * r)],
    "greatest height": [(ALIGN, "position_i", lambda r: 1.3 * r)],
    "attitude against orbit": [(ALIGN, "quaternion", lambda q: q * [1, -1, -1, -1])],
    "magnetometer against IGRF": [(FIELD, "difference_b", lambda b: b + 4e-6)],
    "unchanged readings": [(ALIGN, "linear_b", lambda a: held(a, slice(4000, 4300)))],
    "star camera over torquers, from one": [
        (ATTITUDE, "torque_scale", lambda s: 0.6 * s),
        (ATTITUDE, "torque_scale_sigma", lambda s: 0.1 * s),
    ],
    "angular accelerometer over torquers, from one": [(ATTITUDE, "angular_scale", lambda s: -s)],
    "angular accelerometer over star camera, from one": [(ATTITUDE, "angular_scale", lambda s: s * [0.8, 1, 1])],
    "star camera against dynamics, rms": [(ATTITUDE, "residual_rms", lambda r: 20 * r)],
    "delay of the accelerometer": [(ATTITUDE, "acc_delay", lambda t: t + 1.5)],
    "delay of the star camera": [(ATTITUDE, "sca_delay", lambda t: t - 1.5)],
}


@pytest.mark.parametrize("name", SPOILT)
def test_each_check_sees_what_it_is_for_and_passes_without(made, name):
    """Contract: one product spoilt, the check of that name fails; nothing fails before."""
    products = [made[1][stage] for stage in ("align", "field", "attitude")]
    spoilt = list(products)
    for stage, variable, change in SPOILT[name]:
        spoilt[stage] = moved(spoilt[stage], **{variable: change(spoilt[stage][variable].values)})
    told = [checking.of_product(checks.inputs(*given, **LIMITS)) for given in (products, spoilt)]
    clean, found = ({one.name: one.passed for one in some} for some in told)
    assert all(clean.values())
    assert clean[name]
    assert not found[name]


@pytest.mark.parametrize(("name", "cause"), [("sca", "star_camera"), ("acc", "accelerometer"), ("mag", "magnetometer")])
def test_tags_that_are_minutes_off_are_named_first(made, name, cause):
    """Recovery: one instrument 137 s late: the check of its delay fails, a search names it and moves its tags back.

    A joint search leaves such a day out. All others are held against tags of the torquers: both checks fail.
    """
    aligned, *others = (made[1][stage] for stage in ("align", "field", "attitude"))
    late = moved(aligned, **{f"time_{name}": aligned[f"time_{name}"].values + 137.0})
    assert (checks.late(aligned), checks.late(late)) == ({}, {name: 137})
    assert checks.late(late.isel(manoeuvre=slice(0))) == {}  # nothing that a lag shows in
    told = {one.name: one for one in checking.of_product(checks.inputs(late, *others, **LIMITS))}
    failing = {one for one, check in told.items() if one.startswith("delay of") and not check.passed}
    both = {f"delay of the {one.replace('_', ' ')}" for one in ("accelerometer", "star_camera")}
    assert failing == (both if name == "mag" else {f"delay of the {cause.replace('_', ' ')}"})
    seen = observations.observe({"align": late}, noise_order=20)
    assert evidence(seen)["gram"].size == 0
    one, *rest = result_of(driver.discover(seen, driver.Limits(0.005, 9.0, 4, 15.0, 1)))["findings"]
    assert {other["cause"] for other in rest} <= {"unknown:excess"}  # by edges that telemetry does not know
    assert (one["cause"], one["tied_with"]) == (f"timing.{cause}_delay", [])
    assert one["parameters"]["delay"]["value"] == 137
    back = seen.without([Entry(one["cause"], "", {"delay": Parameter(137.0, 0.5, "s")})])
    assert (back[f"time_{name}"].values == aligned[f"time_{name}"].values).all()
    assert checks.late(back) == {}


def test_an_orbit_of_another_time_is_named_and_nothing_else(made):
    """Recovery: instruments agree and attitudes are off an orbit 137 s late; none is where nothing is."""
    aligned = made[1]["align"]
    seen = observations.observe({"align": moved(aligned, time_orbit=aligned["time_orbit"].values + 137.0)})
    found = result_of(driver.discover(seen, driver.Limits(0.005, 9.0, 4, 15.0, 1)))["findings"]
    (one,) = (finding for finding in found if finding["cause"] != "unknown:excess")  # of minutes of pointing
    assert (one["cause"], one["tied_with"]) == ("timing.orbit_delay", [])
    assert abs(one["parameters"]["delay"]["value"] - 137) < one["parameters"]["delay"]["sigma"] < 20


@pytest.mark.parametrize("value", [0.0, 1e-6])
def test_a_dead_channel_is_an_error(made, value):
    """Contract: a linear channel that never moves has no noise to weigh it with; no division by zero, no result."""
    dead = moved(made[0]["ACC1A"], lin_accl_y=np.full(made[0]["ACC1A"].sizes["record"], value))
    with pytest.raises(EstimationError, match="along y: found the same reading"):
        tools.chain(made[0] | {"ACC1A": dead})


SETTINGS = {"fit_limit": 2.0, "plausible_um": 1000.0}
AGREE = {"level": 1e-4} | {name: {"p": 0.4} for name in ("manoeuvres", "variants", "catalogue")}


def result(chi2=900.0, offset=1e-4, determined=2e-5, **agreement):
    """Checks of an invented result that fail."""
    values = {"manoeuvre_chi2": (("variant", "manoeuvre"), [[chi2, 1000.0]]),
              "manoeuvre_dof": (("variant", "manoeuvre"), [[1000, 1000]]),
              "offset": (("variant", "axis"), [[offset, np.nan, determined]])}  # fmt: skip
    combined = xr.Dataset(values, attrs={"variants": "mtq"})
    tested = AGREE | {name: {"p": p} for name, p in agreement.items()}
    return {one.name for one in documented.result_checks(combined, tested, SETTINGS) if not one.passed}


def test_results_are_checked_for_fit_agreement_and_size():
    """Contract: residuals 2.5 times the noise, p below the level of the verdict, and the -30,055 um of the issue."""
    assert result() == set()
    assert result(chi2=2500.0) == {"chi2 per degree of freedom, mtq"}
    assert result(chi2=2500.0, offset=np.nan, determined=np.nan) == set()  # nothing of it is delivered
    assert result(offset=-30055e-6) == {"size of the offset"}
    assert result(manoeuvres=5e-5) == {"agreement of manoeuvres, p"}
    assert result(variants=5e-5) == {"agreement of angular accelerations, p"}
    assert result(catalogue=5e-5) == {"agreement of torquers and catalogue, p"}
    assert result(variants=None) == set()


def test_an_angular_scale_of_its_prior_stays_within_the_total_error_of_acc():
    """Recovery: 5 % about each axis come back; acc is off by many sigma, by less than two total ones, none fails."""
    effects = {"accelerometer.angular_scale": {"x": 0.05, "y": 0.05, "z": 0.05}}
    observed, truth = tools.event(4, effects, manoeuvres=["pitch_high", "roll_high", "yaw_low"])
    made = tools.chain(observed)
    scale, sigma = (made["attitude"][name].values for name in ("angular_scale", "angular_scale_sigma"))
    about = np.arange(3), made["detect"]["kind"].values  # of each manoeuvre the axis that it turns
    assert np.all(np.abs(scale[about] - 1.05) < 5 * sigma[about] + 1e-3)
    assert sigma[about].max() < 0.02
    combined = made["combine"]
    index = combined.attrs["variants"].split().index("acc")
    wrong = combined["offset"].values[index] - 1e-6 * np.array(truth["offset_um"])
    sigma, total = (np.sqrt(np.diagonal(combined[name].values[index])) for name in ("covariance", "covariance_total"))
    assert np.max(np.abs(wrong) / sigma) > 4
    assert np.max(np.abs(wrong) / total) < 2
    for test in ("variants", "catalogue"):
        assert float(combined[f"{test}_chi2"]) < 21.1  # 3 degrees of freedom at 1e-4
