"""Readings in their own units: rebuilt from whitened rows, beside what either model simulates."""

from dataclasses import replace

import commands
import numpy as np
import pytest
from numpy.testing import assert_allclose

from flows import com_offset, discover
from gravcal import catalog
from gravcal.calibrations.com_offset.observations import observe
from gravcal.discovery.driver import clearest, variables
from gravcal.discovery.rounds import Choice, search
from gravcal.estimation.noise import whiten
from gravcal.estimation.outcome import Shown
from gravcal.estimation.records import Block, Candidate
from tasks import stage

CHOICE = Choice(0.005, 9.0, 4, "case.step", {})
PARTS = ("measured", "simulated", "extended")


def result(amplitude, *, listed=True):
    """Search in two blocks of two channels; a signal is in the second channel of the second block."""
    rng, blocks, columns = np.random.default_rng(6), [], []
    for k in range(2):
        wave = np.tile(np.sin(np.arange(120) / (9 + k)), 2) * np.repeat([0.01, 1.0], 120) * (1 + k)
        where = {"channel": np.repeat(["angular", "linear"], 120), "axis": np.zeros(240, dtype=int)}
        rows = {"observed": rng.standard_normal(240) + amplitude * wave, "time": np.tile(np.arange(120.0), 2)}
        blocks.append(
            Block(f"block {k}", global_columns=np.zeros((240, 0)), local_columns=np.ones((240, 1)), **where, **rows)
        )
        columns.append(wave[:, None])
    noise = [rng.standard_normal((240, 1)) for _ in columns]
    found = [Candidate("case.noise", "", ["size"], ["1"], noise)]
    found += [Candidate("case.wave", "", ["size"], ["1"], columns)] if listed else []
    return search(blocks, found, replace(CHOICE, excess=False), np.random.default_rng(1))


def doubled(channel, index, rows):  # noqa: ARG001 - all that a calibration is given
    """Reading whose noise is 2 units white, on a model of a constant 5."""
    part = rows[120:] if channel == "linear" else rows[:120]
    return np.arange(120.0), np.full((120, 1), 5.0), 2 * part.T[:, :, None]


def test_what_a_finding_helps_most_is_shown_or_the_least_likely_band():
    """Contract: channel and block with the signal, none in its place; measured less simulated is the residual.

    Of a signal that no candidate holds measured and baseline, no extended model; clean data show nothing.
    """
    found = result(2.0)
    without = [found.before.rest]  # there is one finding
    places = clearest(found, ("angular", "linear"), 0.005, without)
    assert places == [Shown(0, "linear", "block 1", 0)]
    (first,) = clearest(found, ("angular", "linear"), 0.005, without, [(True, False)])
    assert (first.channel, first.block) == ("linear", "block 0")  # of what acts nowhere else
    shown = variables(found, places, doubled, without)
    difference = {p: shown["linear_measured"] - shown[f"linear_{p}"] for p in PARTS[1:]}
    assert_allclose(difference["simulated"][:, 0], 2 * found.before.rest[1][120:], atol=1e-12)  # rounding
    assert_allclose(difference["extended"][:, 0], 2 * found.after.rest[1][120:], atol=1e-12)
    assert abs(shown["linear_measured"].mean()) < 1e-12
    assert clearest(found, ("angular",), 0.005, without) == []
    found = result(2.0, listed=False)
    assert not found.findings
    places = clearest(found, ("angular", "linear"), 0.005, [])
    assert places == [Shown(-1, "linear", "block 1", 0)]
    assert np.isnan(variables(found, places, doubled, [])["linear_extended"]).all()
    clean = result(0.0)
    assert clearest(clean, ("angular", "linear"), 1e-4, []) == []
    assert variables(clean, [], doubled, []) == {}


def discovered(folder, effects):
    """Products of the baseline, the product of the discovery, and the observations of a simulated day."""
    commands.simulated("com_offset", folder / "day", 7, effects, manoeuvres="pitch_high,roll_high,yaw_low")
    source, chosen = com_offset.CALIBRATION.source(data=folder / "day"), catalog.parameters("com_offset")
    made = {name: stage.read(ref) for name, ref in com_offset.DISCOVERY.baseline(source, chosen).items()}
    observed = observe(made, **com_offset.scene_settings(source, chosen) | chosen.for_stage("discovery"))
    assert len(observed.blocks) == len(observed.views) + 1
    heard = []
    with stage.using(stage.inline, lambda _call, _state, ref: heard.append(ref)):
        discover.flow_of("com_offset")(source, chosen)
    return made, stage.read([ref for ref in heard if ref.kind == "com_offset.discovery"][-1]), observed


def shown(found, channel):
    """Measured, baseline and extended readings, all known."""
    values = [found[f"{channel}_{p}"].values for p in PARTS]
    assert all(np.isfinite(v).any() for v in values)
    return values


@pytest.mark.long
def test_a_leak_is_seen_in_the_linear_reading_and_attitude_and_field_give_theirs(tmp_path):
    """Recovery: the low-passed reading itself; differences whitened are the residuals; the extension is nearer in y.

    The field as measured; the rotation by the torquers as fitted, and what the fit left.
    """
    made, found, observed = discovered(tmp_path, {"accelerometer.current_leak": {"y_from_x": 6e-12}})
    views = observed.views
    measured, baseline, extended = shown(found, "linear")
    (k,) = [k for k, v in enumerate(views) if np.array_equal(v.operator.time, found["linear_time"].values)]
    direct = views[k].operator(np.nan_to_num(made["align"]["linear_b"].values[views[k].rows]))
    valid = np.isfinite(measured).all(axis=1)
    assert_allclose(measured[valid], (direct - np.nanmean(direct, axis=0))[valid], atol=1e-14)  # m s-2, noise 1e-10
    here = (found["block"].values == k) & (found["channel"].values == 0)
    inside, models = np.isin(views[k].times["linear"], found["linear_time"].values), views[k].noise["linear"]
    known = max(model.reflection.size for model in models)  # from where on the pads, which are not shown, do not matter
    for simulated, name in ((baseline, "residual_before"), (extended, "residual_after")):
        white = [whiten(models[a], (measured - simulated)[:, a], valid)[known:] for a in range(3)]
        left = found[name].values[here].reshape(3, -1)[:, inside]
        assert_allclose(white, left[:, known:], atol=1e-6)  # of a sigma
    rms = [np.sqrt(np.nanmean((measured - simulated)[:, 1] ** 2)) for simulated in (baseline, extended)]
    assert rms[1] < 0.9 * rms[0]
    view, record = views[1], observed.blocks[1].observed[:, None]
    time, model, (rest,) = observed.reading("magnetometer", 1, record)
    good = np.isfinite(rest).all(axis=1)
    rows = np.searchsorted(made["field"]["time_mag"].values, time[good])
    assert_allclose((model + rest)[good], made["field"]["measured_b"].values[rows], atol=1e-9)  # T, of 3e-5
    time, model, (rest,) = observed.reading("attitude", 1, record)
    good, index = view.window.good, view.index
    left = made["attitude"]["sca_residual_b"].values[made["attitude"]["sca_manoeuvre"].values == index]
    scale = np.nan_to_num(made["attitude"]["torque_scale"].values[index], nan=1.0)
    assert_allclose((model + rest)[good], left + (view.scale_attitude @ scale)[good], atol=1e-12)  # rad
    assert np.isnan(rest[~good]).all()


@pytest.mark.long
def test_a_strong_effect_is_rebuilt_in_the_records_without_it(tmp_path):
    """Recovery: a rod 3 % stronger; the rebuilt angular reading is the measured one to a part of the effect."""
    made, found, observed = discovered(tmp_path, {"torque.dipole_gain": {"rod_y": 0.03}})
    assert found.attrs["rebuilt"] == 1
    measured, baseline, extended = shown(found, "angular")
    time = found["angular_time"].values
    near = min(observed.views, key=lambda v: abs(v.operator.time[0] - time[0]))
    direct = near.operator(np.nan_to_num(made["align"]["angular_b"].values[near.rows]))
    direct = direct - np.nanmean(direct, axis=0)
    same = np.stack([np.interp(time, near.operator.time, c) for c in direct.T], axis=1)
    assert np.nanstd((measured - same)[:, 0]) < 0.1 * np.nanstd((extended - baseline)[:, 0])
    assert np.nanstd((measured - extended)[:, 0]) < 0.3 * np.nanstd((measured - baseline)[:, 0])
