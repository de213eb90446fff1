"""Inputs that contradict each other and results that cannot be: an error or questionable, never delivered."""

import shutil
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from independent import worlds
from inertial_events import ROLL, SWING, run, simulated

from gravcal.calibrations.inertial_sensor import align, bias, page
from gravcal.errors import GravcalError
from gravcal.store.schemas import validate


@pytest.fixture
def copied(both, shared_store, tmp_path, monkeypatch):  # noqa: ARG001 - what is not spoiled is found in the store
    """Copy of the folder with both days; the page is left out."""
    monkeypatch.setattr(page, "page", lambda *_, **__: "")
    return shutil.copytree(both[0], tmp_path / "files")


def spoil(folder, product, names, change, day=SWING):
    """Change variables of one file together."""
    with h5py.File(folder / f"{product}_{day}_T_01.nc", "r+") as file:
        for name, values in zip(names, change(*(file[name][...] for name in names)), strict=True):
            file[name][...] = values


def held(values):
    """The same with a tenth of the record frozen."""
    start, stop = int(0.45 * len(values)), int(0.55 * len(values))
    return (np.concatenate([values[:start], np.repeat(values[start : start + 1], stop - start, 0), values[stop:]]),)


def zero(step):
    """Function that puts 72 s to zero."""

    def changed(values):
        values[int(0.3 * len(values)) :][: int(72 / step)] = 0.0
        return (values,)

    return changed


def exchanged(first, second):
    """Each in place of the other."""
    return second, first


def components(first, second):
    """Function that exchanges two components of each variable."""

    def changed(*columns):
        for values in columns:
            values[:, [first, second]] = values[:, [second, first]]
        return columns

    return changed


def times(factor):
    """Function that changes unit or sign."""
    return lambda values: (factor * values,)


def turned(values):
    """The other sign for 62 samples of quiet data, as seen once among mutated files: offset 4.6 total sigma off."""
    start = int(0.25 * len(values))
    values[start : start + 62] *= -1
    return (values,)


def late(time):
    """Tags two minutes late."""
    return (time + 120,)


CONTRADICTIONS = {
    "position x and y": ("ORB", ["position"], components(0, 1)),
    "position zero": ("ORB", ["position"], zero(1.0)),
    "velocity in km/s": ("ORB", ["velocity"], times(1e-3)),
    "orbit late": ("ORB", ["time"], late),
    "sign of V_y": ("IS1", ["V_y"], times(-1)),
    "V_z1 of the other sign for six seconds": ("IS1", ["V_z1"], turned),
    "V_z1 and V_z2": ("IS1", ["V_z1", "V_z2"], exchanged),
    "V_y and V_x3": ("IS1", ["V_y", "V_x3"], exchanged),
    "V_y frozen": ("IS1", ["V_y"], held),
    "V_x1 zero": ("IS1", ["V_x1"], zero(0.1)),
    "voltages late": ("IS1", ["time"], late),
    "attitude components": ("ATT", ["q"], components(1, 2)),
    "attitude zero": ("ATT", ["q"], zero(0.25)),
    "roll, sign of V_x1": ("IS1", ["V_x1"], times(-1), ROLL),
    "roll, V_z1 in mV": ("IS1", ["V_z1"], times(1e3), ROLL),
    "roll, voltages late": ("IS1", ["time"], late, ROLL),
    "roll, attitude components": ("ATT", ["q"], components(2, 3), ROLL),
    "roll, attitude lost": ("ATT", ["q"], times(0), ROLL),
    "roll, V_x2 and V_x3": ("IS1", ["V_x2", "V_x3"], exchanged, ROLL),
    "roll, orbit x and z": ("ORB", ["position", "velocity"], components(0, 2), ROLL),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_what_contradicts_itself_is_an_error_or_questionable(copied, name):
    """Contract: a number that rests on such files is never delivered without a word."""
    spoil(copied, *CONTRADICTIONS[name])
    try:
        document, _ = run(copied)
    except GravcalError:
        return
    validate(document)
    assert document["status"] == "questionable"
    failed = [one["name"] for one in document["checks"] if not one["passed"]]
    assert all(one in document["verdict"]["text"] for one in failed)


def test_a_clean_event_keeps_to_every_check(delivered):
    """Recovery: swing and roll, every check there and none failed."""
    assert delivered["document"]["status"] == "delivered"
    assert [one["passed"] for one in delivered["document"]["checks"]] == [True] * 23


def test_scales_that_nothing_contradicts_leave_offset_and_status(copied, delivered):
    """Contract: ten percent on all voltages of both days is what a scale factor is; documented as not detectable."""
    for day in (SWING, ROLL):
        for name in ("V_x1", "V_x2", "V_x3", "V_y", "V_z1", "V_z2"):
            spoil(copied, "IS1", [name], times(1.1), day)
    document, _ = run(copied, k_y=2.7e-4 / 1.1)
    assert document["status"] == "delivered"
    before, after = (one["swing"]["adopted"]["value"] for one in (delivered["document"], document))
    assert np.allclose(after, before, atol=5)  # um, k_z of the drag in the noise


def test_a_world_of_other_code_keeps_to_every_check(tmp_path):
    """Recovery: a swing of the independent simulator."""
    folder = worlds.make("swing", 3, tmp_path)
    document, _ = run(folder / "data", arm_x_mm=8.0, k_y=3e-4)
    assert [one["name"] for one in document["checks"] if not one["passed"]] == []


def test_the_adopted_offset_has_the_smallest_total_error(tmp_path):
    """Recovery: k_y 11 % off makes z with a_y wrong; the solution without it is adopted, printed, judged, used."""
    truth = simulated(tmp_path, 2, k_y=3e-4, offset_um=[-140.0, 627.75, -2500.0])
    document, _ = run(tmp_path)
    swing, adopted = document["swing"], document["swing"]["adopted"]
    total = {name: np.linalg.norm(swing[name]["sigma_total"]) for name in page.OFFSETS}
    error = {name: np.abs(np.subtract(swing[name]["value"], truth["com_to_test_mass_um"]))[2] for name in page.OFFSETS}
    assert adopted["solution"] == min(total, key=total.get) == "com_to_test_mass_without_y_um"
    assert error["com_to_test_mass_without_y_um"] < error["com_to_test_mass_um"] / 3
    assert {k: adopted[k] for k in ("value", "sigma", "sigma_total")} == swing[adopted["solution"]]
    text = document["verdict"]["text"]
    assert f"{adopted['value'][2]:.0f} +- {adopted['sigma_total'][2]:.0f} um (without a_y)" in text
    assert f"+- {document['roll']['bias']['sigma_total'][0]:.0e}, b_z" in text


def test_requirements_are_judged_on_the_total_error():
    """Analytic: noise far below the claim, total above it: not met."""
    k = {"value": 5e-4, "sigma": 1e-6, "sigma_total": 2e-5}
    offset = {"solution": page.OFFSETS[0], "value": [-100.0, 600.0, -900.0], "sigma": [9.0, 6.0, 6.0]}
    bias_x = {"value": [-2.6e-4, None, 3e-6], "sigma": [9e-10, None, 1e-9], "sigma_total": [8.6e-6, None, 1e-7]}
    roll = {"bias": bias_x, "segments": 9, "segments_found": 9}
    swing = {"k": {"x": k, "y": None, "z": k}, "adopted": offset | {"sigma_total": [9.0, 30.0, 86.0]}}
    text = page.verdict({"status": "delivered", "swing": swing, "roll": roll})
    assert "b_x -2.60000e-04 +- 9e-06" in text
    assert "-900 +- 86 um" in text
    claims = "k 4 % (not met, 1 %), offset in y and z 9.6 % (not met, 3 %), bias 3.3 % (not met, 0.1 %)"
    assert f"Total error against the claim of the paper: {claims}" in text


@pytest.mark.parametrize("segments", [3, 11])
def test_the_noise_of_z_is_that_of_white_noise_of_known_density(segments):
    """Recovery: 3.2e-9 m s-2 Hz-1/2 at 10 Hz through bins and spectra, to 2 %; half a percent is a standard error."""
    rng, density, k = np.random.default_rng(8), 3.2e-9, 1.14e-4
    count, power = 250 * segments, []
    time = 5.0 + 10.0 * np.arange(count)
    c, s, o, e = (np.cos(time / 115), np.sin(time / 115), 0 * time, 0 * time + 1)
    record = {
        "time": time,
        "R_bo": np.stack([c, o, -s, o, e, o, s, o, c], axis=-1).reshape(-1, 3, 3),
        "rate_b": np.broadcast_to([0.0, 1 / 115, 0.0], (count, 3)),
        "gradient_b": np.broadcast_to(1.2e-6 * np.diag([2.0, -1.0, -1.0]), (count, 3, 3)),
    }
    sensor = SimpleNamespace(k=np.array([1.0, 1.0, k]), offset=np.zeros(3))
    solved = SimpleNamespace(used=np.ones(segments, dtype=bool))
    limits = bias.Limits(step_s=10.0, segment_s=2500.0, uniformity=1.0, share=0.0)
    for _ in range(120 // segments):
        volts = np.zeros((100 * count, 3))
        volts[:, 2] = density * np.sqrt(5.0) / k * rng.standard_normal(100 * count)
        record["linear_volt"], _ = align.clipped_means(0.1 * np.arange(100 * count), volts, 10.0 * np.arange(count + 1))
        power.append(page.z_noise(**bias.spectra(record, solved, sensor, k, limits)))
    for name in ("before_m_s2_rthz", "after_m_s2_rthz"):
        assert np.sqrt(np.mean([one[name] ** 2 for one in power])) == pytest.approx(density, rel=0.02)
