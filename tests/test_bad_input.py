"""Damaged Level-1 files through the whole flow: a clear error or a true result, never a wrong number."""

import json
import shutil
import sys
import tarfile
from io import BytesIO
from pathlib import Path

import pytest
import seeds
from independent import damage, make_event

from flows import cli, engine
from flows import com_offset as flow
from gravcal import catalog
from gravcal.store import store
from tasks.stage import read

PRODUCTS = ("ACC1A", "SCA1B", "MAG1B", "GNI1B", "GNV1B", "TIM1B", "CLK1B")


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Folder of one event with a pitch and a roll, its truth, and a store that the tests of this file share."""
    root = tmp_path_factory.mktemp("bad_input")
    seed = seeds.seed("clean")
    kinds = [("pitch", "high"), ("roll", "high")]
    truth = make_event(root / "files", seed, manoeuvres=kinds, field_generation=14)
    return root, truth


@pytest.fixture
def files(clean, tmp_path, monkeypatch):
    """Copy of the clean files, by product, and "start" of the first manoeuvre."""
    root, truth = clean
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(root / "store"))
    folder = tmp_path / "files"
    shutil.copytree(root / "files", folder)
    return {p: folder / Path(truth["files"][p]).name for p in PRODUCTS} | {
        "folder": folder,
        "start": int(truth["manoeuvres"][0]["start"]),
        "truth": truth,
    }


def result(folder):
    """Document of a folder, and the counts of records that the alignment marked, repeated, sorted."""
    chosen = catalog.parameters("com_offset")
    document = flow.CALIBRATION.document(
        engine.run(flow.calibrate, flow.CALIBRATION.source(data=folder), chosen, engine="inline")
    )
    aligned = read(store.find(document["provenance"]["products"]["com_offset.align"]))
    return document, aligned.attrs


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


def spoil_order(files):
    """Repeated, contradicting and unsorted records."""
    damage.duplicate_rows(files["ACC1A"])
    damage.conflicting_rows(files["SCA1B"], row=400, column=4)
    damage.shuffle_rows(files["MAG1B"])
    damage.shuffle_rows(files["CLK1B"])
    return {"acc_repeated": 20, "sca_conflicting": 1, "sca_marked": 1}


def spoil_values(files):
    """Missing numbers, a quaternion too long, flags without meaning, a record of the other satellite."""
    damage.put_nan(files["ACC1A"], row=4000)
    damage.unknown_flag(files["ACC1A"], row=4100)
    damage.stretch_quaternion(files["SCA1B"], row=400)
    damage.put_nan(files["GNI1B"], row=410, column=4)
    damage.wrong_satellite(files["MAG1B"], rows=[900])
    return {"acc_marked": 2, "sca_marked": 1, "orbit_marked": 1, "mag_marked": 1}


def spoil_signs(files):
    """Half of the quaternions with the other sign: the same attitude."""
    damage.flip_quaternions(files["SCA1B"])
    return {"sca_marked": 0}


def spoil_with_gaps(files):
    """Fifteen seconds without accelerometer, twenty without star camera, inside the first manoeuvre."""
    damage.drop_seconds(files["ACC1A"], files["start"] + 60, files["start"] + 75)
    damage.drop_seconds(files["SCA1B"], files["start"] + 100, files["start"] + 120)
    return {}


def spoil_telemetry(files):
    """Fifteen seconds without torquer telemetry: the manoeuvre falls into two parts."""
    damage.drop_seconds(files["MAG1B"], files["start"] + 60, files["start"] + 75)
    return {}


def spoil_much(files):
    """Two minutes without accelerometer and clock, one file of the orbit missing, the other frame in its place."""
    damage.drop_seconds(files["ACC1A"], files["start"] + 20, files["start"] + 140)
    damage.drop_seconds(files["CLK1B"], files["start"] + 20, files["start"] + 140)
    damage.missing(files["GNI1B"])
    return {}


def spoil_most_telemetry(files):
    """Two minutes without torquer telemetry: what is left of the first manoeuvre is too short to be found."""
    damage.drop_seconds(files["MAG1B"], files["start"] + 20, files["start"] + 140)
    return {}


HARMLESS = (
    spoil_order,
    spoil_values,
    spoil_signs,
    spoil_with_gaps,
    spoil_telemetry,
    spoil_most_telemetry,
    spoil_much,
)


@pytest.mark.parametrize("spoil", HARMLESS, ids=lambda f: f.__name__)
def test_damage_that_can_be_set_aside_leaves_a_true_result(files, spoil):
    """Recovery: what is bad is counted and not used; every determined component within five sigma of the truth."""
    counts = spoil(files)
    document, found = result(files["folder"])
    assert document["status"] == "delivered"
    assert worst(document, files["truth"]) < 5, f"seed {files['truth']['seed']}"
    assert {name: int(found[name]) for name in counts} == counts


@pytest.mark.parametrize(("product", "name"), [("GNI1B", "orbit"), ("SCA1B", "star camera")])
@pytest.mark.parametrize("first", [30, -600], ids=["inside", "all of it"])
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


def test_a_short_gap_of_the_orbit_changes_nothing_that_matters(files):
    """Recovery: twenty seconds are bridged, less than the limit; the result stays true."""
    damage.drop_seconds(files["GNI1B"], files["start"] + 60, files["start"] + 80)
    document, _ = result(files["folder"])
    assert [one["gaps"] for one in document["manoeuvres"]] == [[], []]
    assert worst(document, files["truth"]) < 5, f"seed {files['truth']['seed']}"


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


HOPELESS = {
    "truncated file": (lambda f: damage.truncate_mid_line(f["ACC1A"]), "ACC1A"),
    "a word for a number": (lambda f: damage.put_text(f["GNI1B"], column=4), "GNI1B"),
    "wrong satellite": (lambda f: damage.wrong_satellite(f["SCA1B"]), "SCA1B"),
    "wrong day": (lambda f: damage.shift_day(f["MAG1B"]), "day"),
    "wrong day of a clock": (lambda f: damage.shift_day(f["TIM1B"]), "day"),
    "not UTF-8": (lambda f: damage.non_utf8(f["CLK1B"]), "CLK1B"),
    "unknown content": (lambda f: damage.unknown_content(f["ACC1A"]), "ACC1A"),
    "header only, accelerometer": (lambda f: damage.no_records(f["ACC1A"]), "ACC1A"),
    "header only, star camera": (lambda f: damage.no_records(f["SCA1B"]), "SCA1B"),
    "header only, telemetry": (lambda f: damage.no_records(f["MAG1B"]), "MAG1B"),
    "header only, orbit": (lambda f: damage.no_records(f["GNI1B"]), "GNI1B"),
    "header only, clock": (lambda f: damage.no_records(f["CLK1B"]), "CLK1B"),
    "empty file": (lambda f: damage.empty(f["TIM1B"]), "TIM1B"),
    "missing star camera": (lambda f: damage.missing(f["SCA1B"]), "SCA1B"),
    "missing telemetry": (lambda f: damage.missing(f["MAG1B"]), "MAG1B"),
    "missing orbit": (lambda f: (damage.missing(f["GNI1B"]), damage.missing(f["GNV1B"])), "GNI1B"),
    "archive that leaves its folder": (lambda f: leaving(f), "SCA1B"),
}
REMEDIES = ("Fetch", "fetch", "Take", "Put", "Give", "Check", "check", "Use", "correct", "another")


def leaving(files):
    """Put SCA1B into an archive under a name above the folder."""
    text = files["SCA1B"].read_bytes()
    files["SCA1B"].unlink()
    with tarfile.open(files["folder"] / "gracefo_1B_2020-02-01_RL04.ascii.noLRI.tgz", "w:gz") as archive:
        member = tarfile.TarInfo(f"../{files['SCA1B'].name}")
        member.size = len(text)
        archive.addfile(member, BytesIO(text))


def gravcal(*arguments):
    """Exit code of a command run in this process."""
    sys.argv = ["gravcal", *map(str, arguments)]
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


@pytest.mark.parametrize("name", sorted(HOPELESS))
def test_damage_that_cannot_be_set_aside_is_a_clear_error(files, name, capsys, tmp_path):
    """Contract: exit code 1, one screen without trace: which file, what to do; the document says failed."""
    spoil, product = HOPELESS[name]
    spoil(files)
    path = tmp_path / "result.json"
    options = ("--data", files["folder"], "--engine", "inline", "--json", path)
    assert gravcal("run", "com_offset", *options) == 1
    said = capsys.readouterr()
    text = said.out + said.err
    assert "Traceback" not in text
    assert len(said.err.splitlines()) < 24
    assert product in text
    assert any(word in text for word in REMEDIES)
    if path.exists():
        document = json.loads(path.read_text())
        assert document["status"] == "failed"
        assert "variants" not in document


def test_a_clean_event_is_delivered_and_run_again_from_the_store(files):
    """Contract: the event that the tests damage is sound; twice the same numbers."""
    first, second = (result(files["folder"])[0] for _ in range(2))
    assert worst(first, files["truth"]) < 5, f"seed {files['truth']['seed']}"
    assert first["variants"] == second["variants"]
    assert first["provenance"]["key"] == second["provenance"]["key"]
