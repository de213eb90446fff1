"""Discovery in days of S-GRS: effects hidden in simulated files, which is all that the search sees."""

import commands
import numpy as np
import pytest
from commands import causes, gravcal
from scipy.signal import lfilter
from seeds import ALARM, clean

from flows import gradient_torque
from gravcal import catalog
from gravcal.calibrations.gradient_torque import noise, observations, responses
from gravcal.estimation.records import Entry, Parameter
from gravcal.physics import gravity
from gravcal.physics.constants import EARTH_RADIUS, GM
from gravcal.store import product
from tasks.stage import read

RNG_LEVEL = ALARM + 5 * 1e-4  # of all its draws, see seeds.py

QUARTER = {"duration_s": "21600", "step_s": "5", "field_degree": "20"}
#: Effects that a quarter of a day shows at ten times its errors or more, the field by far the most.
LISTED = {
    "gradient.angular_bias": {"y": 4e-11, "z": -5e-11},
    "gradient.field_scale": {"scale": 0.03},
    # 17 sigma of the noise of the sensors, whatever the motion of the day: a millionth of gravity is no noise
    "gradient.field_scale, small": {"scale": 5e-6},
    "gradient.separation": {"y": 2e-3},  # 28 times the stated error of the places
    "gradient.tesseral": {"cosine": 1e-4},
    "attitude.star_camera_misalignment": {"angle_z": 2e-3},
}
PAIR = ("gradient.angular_bias", "gradient.separation")  # in one day; the others have one each
TOGETHER = [*((one,) for one in LISTED if one not in PAIR), PAIR]
MARKS = dict.fromkeys([*TOGETHER[:3], PAIR], pytest.mark.long)


def simulated(folder, rng, effects, **settings):
    """Files of a quarter of a day."""
    seed = int(rng.integers(1_000_000))
    return commands.simulated("gradient_torque", folder / "level1", seed, effects, **(QUARTER | settings))


def discovered(folder, *options):
    """Document of `gravcal discover` on the files of a folder."""
    return commands.discovered("gradient_torque", folder, "--set", "field_degree=20", *options)


def test_nothing_is_named_on_a_clean_day_and_what_cannot_be_seen_is_said(rng, tmp_path):
    """Recovery: at the delivered level; both sensors moved alike look like drag."""
    *_, document = clean(lambda _, at: simulated(at, rng, {}) and discovered(at), rng, tmp_path)
    hidden = {one["cause"]: one for one in document["indistinguishable_from_calibration"]}
    assert {"gradient.mounting", "torque.aerodynamic"} <= set(hidden)
    assert max(hidden["gradient.mounting"]["drag_bias_m_s2"]) > 1e-10


@pytest.mark.parametrize("cases", [pytest.param(one, marks=MARKS.get(one, ())) for one in TOGETHER])
def test_hidden_effects_are_named_with_their_size(rng, tmp_path, cases):
    """Recovery: each alone or in its tied set, parameters within 5 sigma; the model leaves nothing."""
    hidden = {case.partition(",")[0]: LISTED[case] for case in cases}
    simulated(tmp_path, rng, hidden)
    whole = discovered(tmp_path, "--set", "discovery_level=0.0001")
    assert len(whole["findings"]) == len(hidden)
    assert whole["p_before"] < 1e-4
    for slug, sizes in hidden.items():
        (found,) = [one for one in whole["findings"] if slug in (one["cause"], *one["tied_with"])]
        assert found["heldout_gain"]["chi2"] > 0
        for name, true in sizes.items() if found["cause"] == slug else ():
            parameter = found["parameters"][name]
            assert abs(parameter["value"] - true) < 5 * parameter["sigma"] < max(abs(true), 1e-10)
    if cases == TOGETHER[0]:
        paths = sorted((tmp_path / "products").rglob("product.nc"), key=lambda path: path.stat().st_mtime)
        made = [product.from_bytes(path.read_bytes()) for path in paths]
        shown = [one for one in made if "linear_measured" in one][-1]
        measured, before, after = (shown[f"linear_{n}"].values for n in ("measured", "simulated", "extended"))
        assert np.nanstd(measured - after) < np.nanstd(measured - before)
        assert 1e-12 < np.nanstd(measured - after, axis=0).max() < 2e-11 < np.nanstd(measured)
        model = next((tmp_path / "products").rglob("model.toml"))
        assert discovered(tmp_path, "--set", "discovery_level=0.0001", "--model", model)["findings"] == []
        how = tmp_path / "level1", "--set", "field_degree=20", "--model", model
        result, change = commands.document("run", "gradient_torque", *how)[1], whole["calibration_change"]
        for name, when in (("value", "after"), ("sigma", "sigma_after")):  # of a run with the model as in the search
            assert np.allclose(1e3 * np.array(result["centre_of_pressure_m"][name]), change[when], rtol=1e-9)


def test_a_coefficient_of_the_field_is_looked_for_by_degree_and_order(rng, tmp_path):
    """Recovery: what a coefficient adds to the readings by its form leaves the record when its model is taken out.

    Analytic: so does what remembers the drag, a first-order filter. A force of 1e-10 m s-2 that follows the latitude
    does not count as noise of the difference of the sensors.
    """
    simulated(tmp_path, rng, {}, duration_s="7200")
    calibration = gradient_torque.CALIBRATION
    source = calibration.source(data=tmp_path / "level1")
    chosen = catalog.parameters("gradient_torque").with_settings({"field_degree": "20"})
    products = {name: read(ref) for name, ref in calibration.discovery.baseline(source, chosen).items()}
    settings = calibration.discovery.settings(source, chosen)
    entry = Entry("gradient.tesseral", "degree 5, order 3", {"cosine": Parameter(1e-6, None, "1")})
    observed = observations.observe(products, **settings)
    moved = observed.without([entry])["linear"].values - products["ingest"]["linear"].values
    about = observed.about.extra
    cosine = np.zeros((6, 6))
    cosine[5, 3] = 1.0
    unit = gravity.gradient_e(gravity.Field(GM, EARTH_RADIUS, cosine, 0 * cosine), about["position_e"])
    expected = -1e-6 * np.matvec(gravity.rotate_tensor(about["R_be"], unit), about["positions"][0])
    assert np.allclose(moved[:, 0], expected, atol=1e-3 * np.abs(expected).max())
    size = {"linear_z": Parameter(1e-10, None, "m s-2"), "tau": Parameter(300.0, None, "s")}
    memory = Entry("unknown:drag", "linear, a memory of component x, tau 300 s", size)
    for one in (entry, memory):
        assert sum(np.sum(rows**2) for rows in observed.response(one)) > 100
    drag = about["non_gravitational_b"][:, 0] - about["non_gravitational_b"][:, 0].mean()
    drag, kept = drag / np.abs(drag).max(), np.exp(-5.0 / 300.0)
    remembered = lfilter([1 - kept], [1, -kept], drag, zi=[kept * drag[0]])[0]
    moved = observed.without([memory])["linear"].values - products["ingest"]["linear"].values
    assert np.allclose((moved[:, 1] - moved[:, 0])[:, 2], 1e-10 * remembered, atol=1e-16)
    size = {"torque_z_cosine": Parameter(1e-7, None, "N m")}
    wave = observed.without([Entry("unknown:latitude", "torque, wave of 4 times its argument", size)])["torque"].values
    assert np.ptp(wave[:, 2]) == pytest.approx(2e-7, 1e-2)
    shapes = {form: shape for _, form, shape in responses.drivers(observed.about)}
    quiet = observed.made["linear"].models[2].density(np.array([4 / 5670]))
    linear = products["gradient"]["linear_b"].copy(deep=True)
    linear.values[:, 0, 2] += 1e-10 * shapes["wave of 4 times its argument"][:, 0]
    forced = observations.observe(products | {"gradient": products["gradient"].assign(linear_b=linear)}, **settings)
    with_force = forced.made["linear"].models[2].density(np.array([4 / 5670]))
    assert with_force < 10 * quiet  # as noise it makes it 1e5 times as large


def test_one_sensor_still_shows_a_bias_of_its_angular_readings(rng, tmp_path):
    """Recovery: without a second sensor attitude and torque are looked at."""
    simulated(tmp_path, rng, {"gradient.angular_bias": {"x": 5e-11}}, sensors="1")
    assert causes(discovered(tmp_path, "--set", "discovery_level=0.0001")) == ["gradient.angular_bias"]
    latest = next((tmp_path / "products" / "latest").iterdir()) / "gradient_torque.gradient" / "meta.json"
    before, how = latest.resolve(), ("--engine", "inline", "--set", "field_degree=20")
    assert gravcal("run", "gradient_torque", "--data", tmp_path / "level1", *how) == 0
    assert latest.resolve() == before  # the links lead to the calibration, not to what was searched


def test_means_are_of_the_samples_that_are_there():
    """Analytic: nothing where none is."""
    values = np.array([1.0, np.nan, 3.0, 5.0, np.nan, np.nan, 7.0])
    assert np.array_equal(noise.means(values, 2), [1.0, 4.0, np.nan], equal_nan=True)
