"""Views of measured data on simulated records: hidden firings, leaks and steps found, clean data silent."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import measured
from flows import discover as flow
from flows import engine
from gravcal import catalog
from gravcal.calibrations import schemas
from gravcal.calibrations.magnetometer import observations as magnetometer
from gravcal.calibrations.published_table import observations as table
from gravcal.calibrations.schemas import build
from gravcal.calibrations.thrusters import model
from gravcal.calibrations.thrusters import observations as thrusters
from gravcal.discovery.driver import Limits, discover
from gravcal.estimation.quantities import result_of
from gravcal.physics import frames
from gravcal.store.schemas import validate

RNG_LEVEL = 5 * 1e-4  # of all its draws, see seeds.py

START, HOURS = 443016000.0, 2.0
INERTIA = np.diag([105.0, 570.0, 640.0])  # not that of the catalogue
NOISE = np.array([20e-6, 80e-6, 80e-6])  # rad, as measured with both cameras


def flown(rng, epochs, impulse_b):
    """Attitudes (n, 4) every 5 s: Euler's equations in steps of 1 s, slow control torques, kicks at the epochs."""
    count = int(3600 * HOURS)
    kicks = np.zeros((count, 3))
    np.add.at(kicks, np.rint(epochs - START).astype(int), impulse_b)
    phase, period = rng.uniform(0, 2 * np.pi, (4, 3)), rng.uniform(300, 3000, (4, 3))
    wave = np.sin(2 * np.pi * np.arange(count)[:, None, None] / period + phase)
    torque = np.sum(2e-5 * wave * 300 / period, axis=1)
    rate, turn, kept = np.array([0.0, -1.12e-3, 0.0]), Rotation.from_rotvec(rng.normal(size=3)), []
    inverse = np.linalg.inv(INERTIA)
    for k in range(count):
        if k % 5 == 0:
            kept.append(turn)
        rate = rate + inverse @ (kicks[k] + torque[k] - np.cross(rate, INERTIA @ rate))
        turn = turn * Rotation.from_rotvec(rate)
    noise = Rotation.from_rotvec(NOISE * rng.standard_normal((len(kept), 3)))
    return (Rotation.concatenate(kept) * noise).as_quat(scalar_first=True)


def schedule(rng):
    """Firings in half of the time, none in the other: epochs (k,) and nominal impulses (k, 3)."""
    spans = START + 300 + 600 * np.arange(0, int(6 * HOURS) - 1)
    epochs = np.concatenate([s + np.sort(rng.choice(np.arange(5, 295), 12, replace=False)) for s in spans])
    axis = rng.integers(0, 3, epochs.size)
    impulse = np.zeros((epochs.size, 3))
    impulse[np.arange(epochs.size), axis] = rng.choice([-1, 1], epochs.size) * np.array([1e-3, 2e-3, 2e-3])[axis]
    return epochs, impulse


def findings(observed):
    """Findings of a search at a chance of false names of one in ten thousand, {cause: finding}."""
    numbers = result_of(discover(observed, Limits(1e-4, 9.0, 4, 900.0, 20140115)))
    return {one["cause"]: one for one in numbers["findings"]}


def searched(quaternion, epochs, impulse):
    """Findings in invented attitude."""
    time, minutes = START + 5.0 * np.arange(len(quaternion)), START + 60.0 * np.arange(-1, 60 * HOURS + 2)
    angle = 1.1e-3 * (minutes - START)
    around = np.stack([np.cos(angle), np.sin(angle), 0.1 + 0 * angle], axis=1)
    values = {"time": time, "quaternion": frames.continuous(quaternion), "head": 4 + np.zeros(time.size, int)}
    values |= {"quality": 5e-5 + 0 * time, "step": 5.0, "firing": epochs, "impulse_b": impulse, "velocity_error": 0.0}
    values |= {"time_orbit": minutes, "position_i": 6.8e6 * around, "field_i": 3e-5 * around[:, ::-1]}
    aligned, chosen = build(schemas.of("thrusters.toml")["align"], values), catalog.parameters("thrusters")
    products = {"align": aligned, "noise": model.quiet_noise(aligned, **chosen.for_stage("noise"))}
    inertia = np.diag([110.49, 580.67, 649.69])
    return findings(thrusters.observe(products, inertia=inertia, **chosen.for_stage("observe")))


def test_hidden_firings_are_named_with_their_size(rng):
    """Recovery: share of the nominal impulses on roll within 4 sigma of the moment of inertia's ratio."""
    epochs, impulse = schedule(rng)
    share = rng.uniform(1.5, 3.0)  # gains of 80 and more, whatever the slow torques
    found = searched(flown(rng, epochs, share * impulse), epochs, impulse)
    assert next(iter(found)) == "torque.thruster_firings"
    first = found["torque.thruster_firings"]
    assert first["heldout_gain"]["chi2"] > 0
    expected, roll = share * 110.49 / 105.0, first["parameters"]["share_x"]
    assert abs(roll["value"] - expected) < 4 * roll["sigma"] + 0.02 * expected  # kicks are spread over 1 s
    assert not found.keys() & {"torque.constant", "attitude.star_camera_misalignment"}


def test_quiet_attitude_names_nothing(rng):
    """Recovery: firings in the telemetry that did not turn the satellite."""
    epochs, impulse = schedule(rng)
    assert searched(flown(rng, epochs, 0 * impulse), epochs, impulse) == {}


def field(rng, bias=0.0, leak=0.0, count=60):
    """Minutes of a magnetometer with bias and a leak of the y rod into x."""
    time = 10.0 * np.arange(count)
    angle = 1.1e-3 * time + rng.uniform(0, 6)
    model = 3e-5 * np.stack([np.cos(angle), 0.2 + 0 * angle, np.sin(angle)], axis=1)
    dipole = 4 * rng.standard_normal((count, 3))
    slope = np.gradient(model, time, axis=0)
    measured = model + 5e-9 * rng.standard_normal((count, 3)) + bias
    measured[:, 0] += leak * dipole[:, 1]
    axis = np.stack([np.sin(angle), 0.1 + 0 * angle, np.cos(angle)], axis=1)
    values = {"time": time, "measured_b": measured, "model_b": model, "slope_b": slope, "dipole_b": dipole}
    values |= {"axis_b": axis / np.linalg.norm(axis, axis=1, keepdims=True), "step": 10.0}
    values |= {"rate_b": 0 * model, "warmth": 0 * time, "camera_late": 0.0, "attitude_jump": 0.0, "velocity_error": 0.0}
    return build(schemas.of("magnetometer.toml")["align"], values)


def test_bias_and_leak_of_a_magnetometer_are_named(rng):
    """Recovery: bias of 300 nT and a leak of 20 nT per A m2: both, nothing else, within 5 sigma; of noise nothing."""
    settings = catalog.parameters("magnetometer").for_stage("observe")
    records = field(rng), field(rng, bias=3e-7, leak=2e-8)
    clean, found = (findings(magnetometer.observe({"align": one}, **settings)) for one in records)
    assert clean == {}
    assert set(found) == {"magnetometer.bias", "magnetometer.current_leak"}
    leak = found["magnetometer.current_leak"]["parameters"]["x_from_y"]
    assert abs(leak["value"] - 2e-8) < 5 * leak["sigma"]


def table_findings(rng, leak):
    """Findings in a table of one offset whose a_y follows the y rod, errors of 0.3 to 3 um, inertia 5 % off."""
    about = (tuple(np.diag(INERTIA)), 27.5, 14)
    offset, found = np.array([107e-6, 4e-6, 12e-6]), []
    kinds = [("pitch", "low"), ("pitch", "high"), ("pitch", "high"), ("roll", "high"), ("roll", "high")]
    for order, key in enumerate([*kinds, ("yaw", "low"), ("yaw", "low")], 1):
        arc = table.arc(*key, 1, about)
        reading = np.zeros((len(arc.dipole_b), 3, 1))
        reading[:, 1, 0] = leak * arc.dipole_b[:, 1]
        sigma = np.array([1.5e-6, 0.8e-6, 0.8e-6])
        value = offset + arc.answer(reading)[:, 0] + sigma * rng.standard_normal(3)
        if key[0] != "yaw":
            value[{"pitch": 1, "roll": 0}[key[0]]] = np.nan
        words = {"order": order, "kind": key[0], "latitude_class": key[1]}
        found.append(words | {"value": value, "sigma": np.where(np.isfinite(value), sigma, np.nan)})
    return findings(table.Table(found, ((110.49, 580.67, 649.69), 27.5, 14)))


def test_a_leak_into_one_channel_explains_a_table_that_one_offset_does_not(rng):
    """Recovery: 3e-12 m s-2 per A m2: current leak, or what is tied with it; nothing with errors as large as stated."""
    assert table_findings(rng, 0.0) == {}
    cause, first = next(iter(table_findings(rng, 3e-12).items()))
    assert "accelerometer.current_leak" in {cause, *first["tied_with"]}


LEAST = ("mtq", 3.7, (858, 35, 106, 57)), ("sca", 2.7, (713, 27, 78, 33))  # variant, factor, chi-square


@pytest.mark.parametrize(("variant", "factor", "chi2"), LEAST)
def test_the_published_table_asks_for_one_coupling_and_no_lag_or_scale(variant, factor, chi2, tmp_path, monkeypatch):
    """Published: Table 7: one offset leaves chi-square above 700, one angular coupling 35, the y rod into a_y 106.

    The current of the x rod into a_z leaves 57, and evidence does not set it apart; a lag or a scale is out.
    """
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path))
    study = flow.STUDIES["published_table"]
    chosen = catalog.parameters(study.name).with_settings({"variant": variant})
    document = flow.document(engine.run(flow.flow_of(study.name), study, chosen, engine="inline"))
    validate(document)
    assert (document["adequate_before"], document["adequate_after"]) == (False, True)
    found, tried = document["findings"], {row["cause"]: row["chi2"] for row in document["tried"]}
    assert found[0]["cause"] == "accelerometer.angular_leak"
    assert list(found[0]["parameters"]) in (["y_from_z"], ["z_from_y"])
    assert "accelerometer.current_leak" in found[0]["tied_with"]
    assert 0 < document["weighed"][0]["log_odds"] - document["weighed"][1]["log_odds"] < np.log(100)
    assert tried["timing.accelerometer_delay"] < 1
    assert tried["accelerometer.scale"] < 0.6 * chi2[0]
    printed = table.observe({}, **study.discovery.settings(study, chosen))
    assert table.repeatability(printed.rows)[0] == pytest.approx(factor, abs=0.05)
    forms = [("", ""), ("accelerometer.angular_leak", "y_from_z"), ("accelerometer.current_leak", "y_from_y")]
    for (slug, name), left in zip([*forms, ("accelerometer.current_leak", "z_from_x")], chi2, strict=True):
        assert measured.left(printed, slug, name) == pytest.approx(left, abs=1)
    yaws, pitches = (measured.apart(printed, more) for name, more in measured.STUDY["more"].items() if "45" in name)
    assert yaws < 1.1 * measured.apart(printed) < 0.6 * pitches  # the current is the same at both latitudes
