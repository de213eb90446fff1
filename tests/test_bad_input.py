"""Damaged files through the flow of each calibration: a clear error or a true result, never a wrong number.

What a reader refuses by itself is tested beside the readers; here is what flows make of it, one kind of damage each.
"""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import seeds
from commands import gravcal, run
from independent import damage, make_event

from flows import gradient_torque, inertial_sensor, kbr_phase_centre
from gravcal.store import store
from tasks.stage import read

PRODUCTS = ("ACC1A", "SCA1B", "MAG1B", "GNI1B", "GNV1B", "TIM1B", "CLK1B")
REMEDY = re.compile(r"\b(fetch|take|put|give|check|use|correct|another|write|add|convert)\b", re.IGNORECASE)
SMALL = {  # settings of the simulated event of a calibration
    kbr_phase_centre: {"manoeuvres": "+pitch_a,-pitch_a,+yaw_a,-yaw_a", "phase_step_s": 1.0, "quiet_s": 900.0},
    inertial_sensor: {"manoeuvre": "swing"},
    gradient_torque: {"duration_s": 6000.0, "step_s": 2.0},
}


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Folder and truth of a small event of each calibration, by name."""
    root = tmp_path_factory.mktemp("bad_input")
    kinds = [("pitch", "high"), ("roll", "high")]
    made = make_event(root / "com_offset", seeds.seed("clean", 1e-4), manoeuvres=kinds, field_generation=14)
    found = {"com_offset": (root / "com_offset", made)}
    for flow, settings in SMALL.items():
        name = flow.__name__.rpartition(".")[2]
        truth = flow.CALIBRATION.simulate(root / name, seed=6, truth=None, effects={}, settings=settings)
        found[name] = root / name, truth
    return found


@pytest.fixture
def copied(clean, tmp_path, monkeypatch):
    """Function from a calibration to a copy of its folder; tests of com_offset share a store."""

    def copy(calibration):
        folder, place = clean[calibration][0], tmp_path / "files"
        shared = calibration == "com_offset"
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder.parent / "store" if shared else tmp_path / "store"))
        return shutil.copytree(folder, place)

    return copy


@pytest.fixture
def files(copied, clean):
    """Files of com_offset by product, their folder, "start" of the first manoeuvre, and the truth."""
    folder, truth = copied("com_offset"), clean["com_offset"][1]
    paths = {product: folder / Path(truth["files"][product]).name for product in PRODUCTS}
    return paths | {"folder": folder, "start": int(truth["manoeuvres"][0]["start"]), "truth": truth}


def result(folder):
    """Document of a folder, and the counts of records that the alignment marked, repeated, sorted."""
    document, _ = run("com_offset", folder)
    return document, read(store.find(document["provenance"]["products"]["com_offset.align"])).attrs


def worst(document, truth):
    """Largest error over total sigma of all determined components."""
    ratios = [
        abs(value - true) / sigma
        for variant in document["variants"].values()
        for value, sigma, true in zip(variant["offset_um"], variant["sigma_total_um"], truth["offset_um"], strict=True)
        if value is not None
    ]
    assert ratios
    return max(ratios)


def spoil_records(files):
    """Repeated, contradicting and unsorted records; missing numbers, a quaternion too long, flags without meaning.

    A record of the other satellite; fifteen seconds without accelerometer and twenty without star camera inside the
    first manoeuvre; twenty without orbit are bridged, less than the limit.
    """
    damage.put_nan(files["ACC1A"], row=4000)
    damage.unknown_flag(files["ACC1A"], row=4100)
    damage.stretch_quaternion(files["SCA1B"], row=350)
    damage.wrong_satellite(files["MAG1B"], rows=[900])
    damage.put_nan(files["GNI1B"], row=410, column=4)
    damage.drop_seconds(files["GNI1B"], files["start"] + 60, files["start"] + 80)
    damage.drop_seconds(files["ACC1A"], files["start"] + 60, files["start"] + 75)
    damage.drop_seconds(files["SCA1B"], files["start"] + 100, files["start"] + 120)
    damage.duplicate_rows(files["ACC1A"])
    damage.conflicting_rows(files["SCA1B"], row=420, column=4)
    damage.shuffle_rows(files["MAG1B"])
    damage.shuffle_rows(files["CLK1B"])
    marked = {"acc_marked": 2, "sca_marked": 2, "orbit_marked": 1, "mag_marked": 1}
    return marked | {"acc_repeated": 20, "sca_conflicting": 1}


def spoil_nothing(files):
    """The event that the tests damage is sound."""
    return {}


def spoil_telemetry(files):
    """Fifteen seconds without torquer telemetry: the manoeuvre falls into two parts."""
    damage.drop_seconds(files["MAG1B"], files["start"] + 60, files["start"] + 75)
    return {}


def spoil_much(files):
    """Two minutes without accelerometer and clock, one file of the orbit missing, the other frame in its place."""
    damage.drop_seconds(files["ACC1A"], files["start"] + 20, files["start"] + 140)
    damage.drop_seconds(files["CLK1B"], files["start"] + 20, files["start"] + 140)
    files["GNI1B"].unlink()
    return {}


HARMLESS = (spoil_nothing, spoil_records, spoil_telemetry, spoil_much)


@pytest.mark.parametrize("spoil", HARMLESS, ids=lambda f: f.__name__)
def test_damage_that_can_be_set_aside_leaves_a_true_result(files, spoil):
    """Recovery: what is bad is counted and not used; every determined component within five sigma of the truth."""
    counts = spoil(files)
    document, found = result(files["folder"])
    assert document["status"] == "delivered"
    assert worst(document, files["truth"]) < 5, f"seed {files['truth']['seed']}"
    assert {name: int(found[name]) for name in counts} == counts
    if spoil in (spoil_nothing, spoil_records):
        assert [one["gaps"] for one in document["manoeuvres"]] == [[], []]


@pytest.mark.parametrize(("product", "name", "first"), [("GNI1B", "orbit", 30), ("SCA1B", "star camera", -600)])
def test_a_manoeuvre_with_a_long_gap_is_not_used_and_says_so(files, product, name, first):
    """Contract: no interpolation over a gap beyond the limit; the other manoeuvre still gives a true result."""
    damage.drop_seconds(files[product], files["start"] + first, files["start"] + (150 if first > 0 else 600))
    document, _ = result(files["folder"])
    spoiled, sound = document["manoeuvres"]
    assert spoiled["gaps"] == [name]
    assert all(block["offset_um"] == [None] * 3 for block in spoiled["variants"].values())
    assert sound["gaps"] == []
    assert document["status"] == "delivered"
    assert worst(document, files["truth"]) < 5, f"seed {files['truth']['seed']}"


def test_a_file_that_ends_before_its_header_says_is_questionable(files):
    """Contract: a cut file is never taken for a whole one, and the verdict names it."""
    damage.drop_seconds(files["ACC1A"], files["start"] + 900, np.inf)
    document, _ = result(files["folder"])
    assert document["status"] == "questionable"
    assert f"records of {files['ACC1A'].name}" in document["verdict"]["text"]


def test_a_single_roll_does_not_give_a_wrong_joint_value(tmp_path, monkeypatch):
    """Recovery: seed 77, where the noisy equation of sca cancels the prior of x; only the roll is found."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "store"))
    kinds = [("pitch", "high"), ("roll", "high")]
    truth = make_event(tmp_path / "files", 77, manoeuvres=kinds, field_generation=14)
    pitch = next(m for m in truth["manoeuvres"] if m["kind"] == "pitch")
    spoiled = tmp_path / "files" / Path(truth["files"]["MAG1B"]).name
    damage.drop_seconds(spoiled, int(pitch["start"]) + 20, int(pitch["start"]) + 140)
    document, _ = result(tmp_path / "files")
    assert [one["kind"] for one in document["manoeuvres"]] == ["roll"]
    assert document["variants"]["sca"]["offset_um"][0] is None
    assert document["variants"]["sca"]["offset_um"][1] is not None
    assert worst(document, truth) < 5


def one(folder, start):
    """The file whose name begins so."""
    return next(folder.glob(f"{start}*"))


def edited(start, name, change):
    """Damage that changes a variable of the file whose name begins so."""
    return lambda folder: damage.netcdf(one(folder, start), [name], lambda values: [change(values)])


def damaged(how, *starts):
    """Damage of the files whose names begin so."""
    return lambda folder: [how(one(folder, start)) for start in starts]


HOPELESS = {  # calibration, damage, what the message has to name
    "wrong satellite": ("com_offset", damaged(damage.wrong_satellite, "SCA1B"), "SCA1B"),
    "missing orbit": ("com_offset", damaged(Path.unlink, "GNI1B", "GNV1B"), "GNI1B"),
    "kbr no ranging": ("kbr_phase_centre", damaged(Path.unlink, "KBR1B"), "KBR1B"),
    "is1 wrong day": ("inertial_sensor", edited("IS1", "time", lambda t: t + 86400), "day"),
    "is1 all missing": ("inertial_sensor", edited("IS1", "V_x1", lambda v: v * np.nan), "voltages"),
    "att missing": ("inertial_sensor", damaged(Path.unlink, "ATT"), "ATT"),
    "sgrs missing": ("gradient_torque", damaged(Path.unlink, "SGRS"), "SGRS"),
    "sgrs in kilometres": ("gradient_torque", edited("SGRS", "position", lambda p: p / 1e3), "position"),
    "sgrs no attitude": ("gradient_torque", edited("SGRS", "q", lambda q: q * np.nan), "star camera"),
}


@pytest.mark.parametrize("name", sorted(HOPELESS))
def test_damage_that_cannot_be_set_aside_is_a_clear_error(copied, name, capsys, tmp_path):
    """Contract: exit code 1, one screen without trace: which file, what to do; the document says failed."""
    calibration, spoil, product = HOPELESS[name]
    folder, path = copied(calibration), tmp_path / "result.json"
    spoil(folder)
    without = name == "sgrs missing"  # its only file: no data, which is no failure
    options = ("--data", folder, "--engine", "inline", "--json", path)
    assert gravcal("run", calibration, *options) == (3 if without else 1)
    said = capsys.readouterr()
    text = said.out + said.err
    assert "Traceback" not in text
    assert "report it" not in said.err
    assert len(said.err.splitlines()) < 24
    assert product in text
    assert REMEDY.search(text)
    if path.exists():
        document = json.loads(path.read_text())
        assert document["status"] == ("no_data" if without else "failed")
        assert "variants" not in document


def test_ranging_that_can_be_set_aside_leaves_a_true_result(clean, copied):
    """Recovery: unsorted, repeated and missing values, the other sign of the quaternion; C, whose wiggles these are."""
    folder = copied("kbr_phase_centre")
    damage.shuffle_rows(one(folder, "SCA1B_2020-09-10_C"))
    damage.duplicate_rows(one(folder, "GNI1B_2020-09-10_C"))
    damage.flip_quaternions(one(folder, "SCA1B_2020-09-10_D"))
    damage.put_nan(one(folder, "KBR1B"), row=700, column=2)
    document, _ = run("kbr_phase_centre", folder)
    assert document["status"] == "delivered"
    found, truth = document["adopted"]["satellites"]["C"], clean["kbr_phase_centre"][1]["phase_centre_mm"]["C"]
    assert np.all(np.abs(np.subtract(found["phase_centre_mm"], truth)) < 5 * np.array(found["sigma_mm"]))
