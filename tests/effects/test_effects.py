"""Every effect of the catalogue: neutral, differentiable, documented, and right in sign."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal
from scipy.spatial.transform import Rotation

from gravcal import catalog
from gravcal.effects import CHANNELS, Context, accelerometer, catalogue, effect, sensors, torque
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.ranging import RIPPLE
from gravcal.physics import sensing

SLUGS = sorted(catalogue())
COUNT = 50


def context(seed=1, count=COUNT):
    """Everything an effect of any family may look at, sizes as in orbit; extras of the ranging family too."""
    rng = np.random.default_rng(seed)
    time = 6.3e8 + np.sort(rng.uniform(0, 100, count))
    gradient = rng.standard_normal((count, 3, 3)) * 1e-6
    square = 27.5 * np.sign(np.sin(2 * np.pi * (time - time[0] - 3.3) / 12))[:, None] * np.array([1.0, 0.02, -0.01])
    extra = {"mass": 580.0, "non_gravitational_b": 6e-8 * rng.standard_normal((count, 3))}
    extra |= {"angle": 0.03 * rng.standard_normal((count, 2, 2))}
    extra |= {"antenna_correction": np.full(count, 2.9), "line_of_sight_b": rng.standard_normal((count, 2, 3))}
    extra |= {"antenna_x": np.array([1.4, 1.4]), "argument": rng.uniform(0, 6, count)}
    extra |= {"nominal_impulse_b": 1e-3 * rng.standard_normal((count, 3))}
    extra |= {"radiation_b": 3e-8 * rng.standard_normal((count, 3)), "warmth": rng.uniform(0, 1, count)}
    extra |= {"volts": rng.standard_normal((count, 6)), "displacement_b": 1e-6 * rng.standard_normal((count, 3))}
    extra |= {"positions": np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.02]])}
    extra |= {"tesseral_b": 1e-6 * rng.standard_normal((count, 2, 3, 3))}
    extra |= {"axis_b": rng.standard_normal((count, 3)), "heads_b": 1e-4 * rng.standard_normal((count, 3))}
    extra |= {"range": 2e5 + 100 * rng.standard_normal(count), "range_rate": rng.standard_normal(count)}
    extra |= {"correction_band": 1e-6 * (np.arange(5 * count).reshape(count, 5) % 7 - 3)}
    return Context(
        time=time,
        rate_b=1e-3 * rng.standard_normal((count, 3)),
        rate_dot_b=1e-5 * rng.standard_normal((count, 3)),
        gradient_b=gradient + np.swapaxes(gradient, 1, 2),
        dipole_b=square,
        field_b=4e-5 * rng.standard_normal((count, 3)),
        linear_b=1e-7 * rng.standard_normal((count, 3)),
        angular_b=1e-5 * rng.standard_normal((count, 3)),
        inertia_b=np.diag([110.0, 580.0, 650.0]),
        start=np.array([time[0] + 1.0, time[0] + 60.0]),
        stop=np.array([time[0] + 40.0, time[0] + 99.0]),
        epoch=time[0],
        extra=extra,
    )


def generic(entry, scene):
    """Values away from neutral: priors, one after the other with changing sign; times inside the record."""
    values = np.array([p.prior_sigma * (1 + 0.1 * i) * (-1) ** i for i, p in enumerate(entry.parameters)])
    for i, p in enumerate(entry.parameters):
        if p.name == "time":
            values[i] = scene.time[COUNT // 2] + 1e-2
        if p.name in ("limit", "tau", "damping"):
            values[i] = abs(values[i]) * 5
        if p.name == "period":
            values[i] = 1.1 * p.neutral
    return values


def test_every_effect_is_stated_in_full_and_once():
    """Contract: family.name, parameters with unit, meaning and prior, names unique, a reference; none hides another."""
    every = [one.slug for one in (*accelerometer.EFFECTS, *sensors.EFFECTS, *sensors.TIMING, *torque.EFFECTS)]
    assert len(every) == len(set(every) & set(SLUGS))
    for slug, entry in catalogue().items():
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*\.[a-z]+(_[a-z0-9]+)*", slug)
        assert entry.reference
        names = [p.name for p in entry.parameters]
        assert len(names) == len(set(names)) >= 1
        assert all(p.unit and p.meaning and 0 < p.prior_sigma < np.inf for p in entry.parameters)


@pytest.mark.parametrize("slug", SLUGS)
def test_neutral_values_add_nothing(slug):
    """Analytic: at the neutral values the contribution is zero, of the shape of the channel."""
    entry, scene = effect(slug), context()
    added = entry.contribution(scene, entry.values({}))
    scalar = CHANNELS[entry.channel] == "s" or entry.channel == "range"
    each = (len(scene.extra["positions"]),) if "_each_" in entry.channel else ()
    assert np.shape(added) == ((COUNT,) if scalar else (COUNT, *each, (6 if entry.channel == "electrode_v" else 3)))
    assert_allclose(added, 0.0, atol=0)


@pytest.mark.parametrize("slug", SLUGS)
def test_columns_are_derivatives_of_the_contribution(slug):
    """Analytic: central differences with another step, at a point away from neutral."""
    entry, scene = effect(slug), context()
    at = generic(entry, scene)
    columns = entry.columns(scene, at)
    for i, p in enumerate(entry.parameters):
        step = np.zeros(at.size)
        step[i] = 3e-4 * p.prior_sigma
        found = entry.contribution(scene, at + step) - entry.contribution(scene, at - step)
        slope = found / (2 * step[i])
        size = np.abs(slope).max(initial=0.0)
        assert_allclose(columns[..., i], slope, atol=1e-5 * size, rtol=1e-3)  # 100 s of a tone off by 0.1 mHz


@pytest.mark.parametrize("slug", [s for s in SLUGS if effect(s).linear])
def test_what_is_called_linear_is(slug):
    """Analytic: the contribution of a sum is the sum of the contributions."""
    entry, scene = effect(slug), context()
    one, other = generic(entry, scene), generic(entry, scene)[::-1] * 0.7
    both = entry.contribution(scene, one + other)
    parts = entry.contribution(scene, one) + entry.contribution(scene, other)
    assert_allclose(both, parts, atol=1e-12 * np.abs(parts).max())  # rounding


def test_an_offset_is_felt_by_its_tensor_and_a_moving_one_by_the_coriolis_term():
    """Analytic: f = (M - G) p with p = -offset; p moves at speed v, zero at mid manoeuvre: t T v + 2 w x v."""
    scene, speed, offset = context(), np.array([1e-7, -2e-7, 3e-7]), np.array([1.07e-4, -4e-5, 1.2e-5])
    tensor = sensing.offset_tensor(scene.rate_b, scene.rate_dot_b, scene.gradient_b)
    found = effect("accelerometer.offset").contribution(scene, offset)
    assert_allclose(found, -tensor @ offset, rtol=1e-12, atol=1e-24)
    found = effect("accelerometer.moving_offset").contribution(scene, speed)
    middle = (scene.start + scene.stop) / 2
    for k in (0, 20, COUNT - 1):
        elapsed = scene.time[k] - middle[np.argmin(np.abs(scene.time[k] - middle))]
        expected = -(elapsed * tensor[k] @ speed + 2 * np.cross(scene.rate_b[k], speed))
        assert_allclose(found[k], expected, rtol=1e-10)


SIGNS = {
    "torque.dipole_gain": ({"rod_x": 0.1}, [2.75, 0, 0]),
    "torque.dipole_misalignment": ({"angle_z": 0.01}, [0, 0.275, 0]),
    "torque.saturation": ({"limit": 20.0}, [-7.5, 0, 0]),
    "torque.residual_dipole": ({"y": 0.3}, [0, 0.3, 0]),
    "torque.constant": ({"z": 1e-6}, [0, 0, 1e-6]),
    "torque.aerodynamic": ({"arm_x": 0.01}, [0, -580 * 0.01 * 3e-8, 580 * 0.01 * 2e-8]),
    "torque.eddy_current": ({"coefficient": 100.0}, [-100 * 1e-3 * 16e-10, 0, 0]),
    "torque.thruster_firings": ({"share_z": 0.5}, [0, 0, 4e-4]),
    "accelerometer.scale": ({"y": 0.1}, [0, 2e-8, 0]),
    "accelerometer.misalignment": ({"angle_z": 0.01}, [2e-9, -1e-9, 0]),
    "accelerometer.quadratic": ({"x": 10.0}, [1e-13, 0, 0]),
    "accelerometer.current_leak": ({"z_from_x": 1e-11}, [0, 0, 2.75e-10]),
    "accelerometer.angular_leak": ({"x_from_y": 1e-4}, [2e-9, 0, 0]),
    "accelerometer.bias_drift": ({"x": 1e-12}, [0, 0, 0]),
    "accelerometer.angular_scale": ({"y": 0.05}, [0, 1e-6, 0]),
    "magnetometer.bias": ({"x": 5e-7}, [5e-7, 0, 0]),
    "magnetometer.scale": ({"z": 0.01}, [0, 0, 4e-7]),
    "magnetometer.misalignment": ({"angle_x": 0.01}, [0, 4e-7, 0]),
    "magnetometer.nonorthogonality": ({"yz": 0.01}, [0, 4e-7, 0]),
    "magnetometer.temperature_bias": ({"x": 2e-8}, [1e-8, 0, 0]),  # in half of the warmth of a long day
    "magnetometer.temperature_scale": ({"z": 1e-3}, [0, 0, 2e-8]),
    "attitude.star_camera_misalignment": ({"angle_y": 1e-4}, [0, 1e-4, 0]),
    "attitude.star_camera_heads": ({"share": 0.5}, [1e-5, -2e-5, 0]),
}


@pytest.mark.parametrize("slug", sorted(SIGNS))
def test_signs_are_as_stated(slug):
    """Analytic: by hand, for a dipole 27.5 A m2 along x in a field of 40 uT along z, one number each."""
    fields = {"time": 1.0, "dipole_b": [27.5, 0, 0], "field_b": [0, 0, 4e-5], "rate_b": [1e-3, 0, 0]}
    fields |= {"linear_b": [1e-7, 2e-7, 3e-7], "angular_b": [1e-5, 2e-5, 3e-5]}
    scene = Context(**{name: np.array([value]) for name, value in fields.items()})
    extra = {"mass": 580.0, "non_gravitational_b": np.array([[1e-8, 2e-8, 3e-8]]), "warmth": np.array([0.5])}
    extra |= {"nominal_impulse_b": np.array([[1e-4, 2e-4, 8e-4]]), "heads_b": np.array([[2e-5, -4e-5, 0]])}
    scene = replace(scene, epoch=1.0, extra=extra)
    given, expected = SIGNS[slug]
    entry = effect(slug)
    if slug == "accelerometer.misalignment":  # axes turned by +v read R^T a = a - v x a
        assert_allclose(np.cross(scene.linear_b[0], [0, 0, 0.01]), expected)
    assert_allclose(entry.contribution(scene, entry.values(given))[0], expected, rtol=1e-12, atol=1e-22)


def test_a_tone_a_step_a_lag_and_a_late_tag_are_what_they_say():
    """Analytic: sine from the first epoch on; step from its time on; late everywhere the same; a drift grows.

    First-order lag of one step, sampled finely: -step exp(-t / tau) after it, nothing before.
    """
    scene = context()
    for slug in ("timing.accelerometer_delay", "timing.star_camera_delay", "timing.magnetometer_delay"):
        assert_allclose(effect(slug).contribution(scene, [0.3]), 0.3)
    drift = effect("timing.clock_drift").contribution(scene, [1e-6])
    assert_allclose(np.diff(drift), 1e-6 * np.diff(scene.time), rtol=1e-6)
    elapsed = scene.time - scene.time[0]
    tone = effect("accelerometer.stray_tone").contribution(scene, [0.1, 1e-10, 0, 2e-10, 0.5])
    assert_allclose(tone, np.sin(0.2 * np.pi * elapsed + 0.5)[:, None] * [1e-10, 0, 2e-10], atol=1e-24)
    step = effect("accelerometer.bias_step").contribution(scene, [1e-9, 0, 0, scene.time[10]])
    assert_allclose(step[:, 0], np.where(np.arange(COUNT) >= 10, 1e-9, 0))
    time = np.arange(0, 3, 0.01)
    dipole = np.where(time[:, None] >= 1.0, [27.5, 0, 0], 0.0)
    found = effect("torque.dipole_lag").contribution(Context(time=time, dipole_b=dipole), [0.2])
    after = time >= 1.0
    assert_allclose(found[~after], 0.0, atol=1e-12)
    assert_allclose(found[after, 0], -27.5 * np.exp(-(time[after] - 1.0) / 0.2), rtol=1e-9)


TIME = np.arange(5.0)
ANGLE = np.zeros((5, 2, 2))
ANGLE[:, 0, 0] = RIPPLE * np.arange(5) / 4
LINE = np.tile([[1.0, 0.0, 0.02], [1.0, 0.01, 0.0]], (5, 1, 1))
EXTRA = {"angle": ANGLE, "range": np.full(5, 2e5), "range_rate": np.full(5, 0.5), "antenna_correction": np.full(5, 2.9)}
EXTRA |= {"line_of_sight_b": LINE, "antenna_x": np.array([1.4, 1.5]), "argument": np.pi / 2 * TIME, "warmth": TIME / 4}
EXTRA["correction_band"] = np.outer(np.arange(5), [0, 1, 0, 0, 0])
CONTEXT = Context(time=TIME, extra=EXTRA)
HALF = np.array([0, -(1 - 0.5**0.5), -1, -1 - 0.5**0.5, -2])  # half a wave of a cosine, less one


@pytest.mark.parametrize(
    ("slug", "given", "expected"),
    [
        ("ranging.multipath", {"pitch_a": 2e-6}, 2e-6 * np.array([0, 1, 0, -1, 0])),
        ("ranging.multipath", {"cosine_pitch_a": 1e-6, "period": 2 * RIPPLE}, 1e-6 * HALF),
        ("ranging.phase_break", {"size": 0.01, "time": 2.5}, [0, 0, 0, 0.01, 0.01]),
        ("ranging.delay", {"delay": 1e-3}, np.full(5, -5e-4)),
        ("ranging.scale", {"excess": 1e-8}, np.full(5, 2e-3)),
        ("ranging.antenna_correction", {"share": 0.5}, np.full(5, -1.45)),
        ("attitude.star_camera_noise", {"share_10_20_mhz": 0.5}, 0.5 * np.arange(5)),
        ("ranging.phase_centre", {"z_a": 1e-3, "x_b": 1e-3}, np.full(5, -0.00102)),
        ("ranging.phase_centre_drift", {"z_a": 1e-8, "x_b": 1e-8}, -1.02e-8 * TIME),
        ("ranging.phase_centre_curvature", {"pitch_a": 1e-3, "yaw_b": 1e-2}, np.full(5, 1.4e-6)),
        ("ranging.slow_orbit_error", {"cosine": 1e-3}, [1e-3, -1e-3, 1e-3, -1e-3, 1e-3]),
        ("ranging.star_camera_misalignment", {"pitch_a": 1e-3, "yaw_b": 1e-3}, np.full(5, 1.445e-5 - 2.3e-12)),
        ("ranging.once_per_revolution", {"sine": 1e-3}, [0, 1e-3, 0, -1e-3, 0]),
        ("ranging.thermal", {"swing": 4e-5}, 1e-5 * TIME),
    ],
)
def test_an_effect_adds_what_its_law_says(slug, given, expected):
    """Analytic: each law at numbers done by hand."""
    entry = effect(slug)
    assert_allclose(entry.contribution(CONTEXT, entry.values(given)), expected, atol=1e-18)


def test_turned_star_cameras_move_the_antenna_by_their_whole_turn():
    """Independent evaluation: rotations by scipy of a tenth of a radian, of which the square counts."""
    turn, arms = np.array([[0.0, 0.03, -0.09], [0.0, 0.05, 0.1]]), np.outer(EXTRA["antenna_x"], [1.0, 0.0, 0.0])
    found = effect("ranging.star_camera_misalignment").contribution(CONTEXT, turn[:, 1:].ravel())
    assert_allclose(found, -np.einsum("nka,ka->n", LINE, Rotation.from_rotvec(turn).apply(arms) - arms), atol=1e-15)


AREA, GAP, ARM = [2.395e-4, 2.054e-4, 2.056e-4], [6.20e-5, 7.70e-5, 7.50e-5], [10.45e-3] * 3
INERTIA = [1.9440e-5, 1.0328e-5, 1.0328e-5]


def pushed(mass, preload):
    """Accelerations and angular ones (6, 6) per volt: an electrode pushes with 2 e0 S V_P / D^2 at its arm.

    Erratum T-4 reads Table 1: four equal electrodes along x, one pair along y, two halves of the total along z.
    """
    area = np.array([AREA[0]] * 3 + [AREA[1]] + [AREA[2] / 2] * 2)
    count, axis, gap = np.array([2, 1, 1, 1, 1, 1]), np.array([0, 0, 0, 1, 2, 2]), np.array(GAP)
    force = count * 2 * 8.8541878128e-12 * area * preload / gap[axis] ** 2
    sign = np.array([[0, 0, 0, 0, 1, -1], [0, 1, -1, 0, 0, 0], [1, -1, -1, 0, 0, 0]])
    linear = (axis == np.arange(3)[:, None]) * force / mass
    return np.concatenate([linear, sign * force * np.array(ARM)[:, None] / np.array(INERTIA)[:, None]])


def test_the_electrodes_give_the_printed_nominal_factors_and_combinations():
    """Published: 10.3390/rs15153817, Table 4, nominal, with V_P and M of erratum T-4, within its 0.5 %; Table 3.

    beta_x 4.42e-3 gives k_z 1.14e-4 with 10.45 mm and 1.49e-4 with 8.00 mm (erratum T-5).
    """
    matrix = pushed(0.0698, 34.15)
    found = np.abs(matrix).max(axis=1) / np.abs(electrodes.READOUT).max(axis=1)
    printed = {r.labels["factor"]: r.value[0] for r in catalog.published("inertial_sensor")["scale_factors"]}
    names = ("k_x", "k_y", "k_z", "beta_x", "beta_y", "beta_z")
    assert_allclose(found, [printed[name] for name in names], rtol=5e-3)
    assert_allclose(matrix, found[:, None] * electrodes.READOUT, rtol=1e-12, atol=1e-18)
    printed = [r.value for r in catalog.published("inertial_sensor")["actuation"]]
    assert_allclose(electrodes.READOUT, np.array(printed, dtype=float), atol=0)
    ratio = electrodes.linear_over_angular(0.0698, INERTIA, ARM)
    assert_allclose(found[[2, 0, 0]], ratio * found[3:], rtol=1e-12)  # k_z by beta_x, k_x by beta_y and beta_z
    both = [4.42e-3 * electrodes.linear_over_angular(0.072, INERTIA, [arm, 1, 1])[0] for arm in (10.45e-3, 8.00e-3)]
    assert_allclose(both, [1.14e-4, 1.49e-4], atol=0.5e-6)  # last printed digit


def test_what_is_mounted_elastically_follows_as_its_equation_says():
    """Independent evaluation: exact exponential of a held mean by scipy; a drive that lasts is read whole."""
    time, (frequency, damping) = np.arange(0.0, 60.0, 0.5), (0.31, 0.02)
    drive, own = np.sign(np.sin(time[:, None] * [0.5, 0.31])), 2 * np.pi * frequency
    system = signal.cont2discrete(([own**2], [1, 2 * damping * own, own**2]), 0.5)[:2]
    expected = signal.lfilter(np.squeeze(system[0]), system[1], (drive + np.roll(drive, -1, axis=0)) / 2, axis=0)
    assert_allclose(accelerometer.deflection(time, drive, frequency, damping), expected, atol=1e-10)
    lasting = accelerometer.deflection(np.arange(0.0, 3e3), np.ones((3000, 1)), frequency, damping)
    assert_allclose(lasting[-1], 1.0, rtol=1e-9)
