"""Damaged files through the flows of the other calibrations: a clear error or a true result, never a wrong number."""

import json
import shutil
import sys

import h5py
import numpy as np
import pytest
from independent import damage

from flows import cli, gradient_torque, inertial_sensor, kbr_phase_centre

REMEDIES = (
    "Fetch",
    "fetch",
    "Take",
    "Put",
    "Give",
    "Check",
    "check",
    "Use",
    "Correct",
    "another",
    "Write",
    "Add",
    "Convert",
)


def gravcal(*arguments):
    """Exit code of a command run in this process."""
    sys.argv = ["gravcal", *map(str, arguments)]
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


def run(calibration, folder, path):
    """Exit code, and the document if one was written."""
    options = ("--data", folder, "--engine", "inline", "--json", path)
    code = gravcal("run", calibration, *options)
    return code, json.loads(path.read_text()) if path.exists() else None


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Folder and truth of a short event of each calibration, by name."""
    root = tmp_path_factory.mktemp("clean")
    wiggles = {"manoeuvres": "+pitch_a,-pitch_a,+yaw_a,-yaw_a", "phase_step_s": 1.0, "quiet_s": 900.0}
    swing = {"manoeuvre": "swing"}
    short = {"duration_s": 6000.0, "step_s": 2.0}
    made = {}
    for flow, settings in ((kbr_phase_centre, wiggles), (inertial_sensor, swing), (gradient_torque, short)):
        name = flow.__name__.rpartition(".")[2]
        folder = root / name
        made[name] = folder, flow.CALIBRATION.simulate(folder, seed=6, truth=None, effects={}, settings=settings)
    return made


@pytest.fixture
def files(clean, tmp_path, monkeypatch):
    """Function from a calibration to its folder, copied, and a store of its own."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "store"))

    def copied(calibration):
        folder = tmp_path / "files"
        shutil.copytree(clean[calibration][0], folder)
        return folder

    return copied


def one(folder, start):
    """The file whose name begins so."""
    return next(folder.glob(f"{start}*"))


def edit(path, name, change):
    """Change a variable of a netCDF file in place."""
    with h5py.File(path, "r+") as file:
        values = file[name][...]
        file[name][...] = change(values)


def cut_bytes(path):
    """Keep the first half of the bytes."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def without_variable(path, name):
    """Take a variable out of a netCDF file."""
    with h5py.File(path, "r+") as file:
        del file[name]


HOPELESS = {
    "kbr truncated": ("kbr_phase_centre", lambda f: damage.truncate_mid_line(one(f, "KBR1B")), "KBR1B"),
    "kbr wrong satellite": (
        "kbr_phase_centre",
        lambda f: damage.wrong_satellite(one(f, "SCA1B_2020-09-10_C")),
        "SCA1B",
    ),
    "kbr wrong day": ("kbr_phase_centre", lambda f: damage.shift_day(one(f, "GNI1B_2020-09-10_D")), "day"),
    "kbr header only": ("kbr_phase_centre", lambda f: damage.no_records(one(f, "KBR1B")), "KBR1B"),
    "kbr empty": ("kbr_phase_centre", lambda f: damage.empty(one(f, "GNI1B_2020-09-10_C")), "GNI1B"),
    "kbr no ranging": ("kbr_phase_centre", lambda f: damage.missing(one(f, "KBR1B")), "KBR1B"),
    "kbr no orbit": ("kbr_phase_centre", lambda f: damage.missing(one(f, "GNI1B_2020-09-10_D")), "GNI1B"),
    "is1 truncated": ("inertial_sensor", lambda f: cut_bytes(one(f, "IS1")), "IS1"),
    "is1 empty": ("inertial_sensor", lambda f: damage.empty(one(f, "IS1")), "IS1"),
    "att missing": ("inertial_sensor", lambda f: damage.missing(one(f, "ATT")), "ATT"),
    "orb missing": ("inertial_sensor", lambda f: damage.missing(one(f, "ORB")), "ORB"),
    "is1 wrong day": ("inertial_sensor", lambda f: edit(one(f, "IS1"), "time", lambda t: t + 86400), "day"),
    "orb wrong day": ("inertial_sensor", lambda f: edit(one(f, "ORB"), "time", lambda t: t + 86400), "day"),
    "is1 without a voltage": ("inertial_sensor", lambda f: without_variable(one(f, "IS1"), "V_y"), "V_y"),
    "is1 all missing": ("inertial_sensor", lambda f: edit(one(f, "IS1"), "V_x1", lambda v: v * np.nan), "voltages"),
    "sgrs truncated": ("gradient_torque", lambda f: cut_bytes(one(f, "SGRS")), "SGRS"),
    "sgrs empty": ("gradient_torque", lambda f: damage.empty(one(f, "SGRS")), "SGRS"),
    "sgrs missing": ("gradient_torque", lambda f: damage.missing(one(f, "SGRS")), "SGRS"),
    "sgrs wrong day": ("gradient_torque", lambda f: edit(one(f, "SGRS"), "time", lambda t: t + 86400), "day"),
    "sgrs without a variable": ("gradient_torque", lambda f: without_variable(one(f, "SGRS"), "angular"), "angular"),
    "sgrs in kilometres": (
        "gradient_torque",
        lambda f: edit(one(f, "SGRS"), "position", lambda p: p / 1e3),
        "position",
    ),
    "sgrs no attitude": ("gradient_torque", lambda f: edit(one(f, "SGRS"), "q", lambda q: q * np.nan), "star camera"),
}


@pytest.mark.parametrize("name", sorted(HOPELESS))
def test_damage_that_cannot_be_set_aside_is_a_clear_error(files, name, capsys, tmp_path):
    """Contract: exit code 1, one screen without trace: which file, what to do; the document says failed."""
    calibration, spoil, product = HOPELESS[name]
    folder = files(calibration)
    spoil(folder)
    code, document = run(calibration, folder, tmp_path / "result.json")
    said = capsys.readouterr()
    without = name == "sgrs missing"  # its only file: no data, which is no failure
    assert code == (3 if without else 1)
    assert "report it" not in said.err
    assert len(said.err.splitlines()) < 24
    assert product in said.err + said.out
    assert any(word in said.err for word in REMEDIES)
    assert document is None or document["status"] == ("no_data" if without else "failed")


def shuffled(path):
    """Put the records of a netCDF file out of order and repeat some."""
    with h5py.File(path, "r+") as file:
        size = file["time"].size
        order = np.arange(size)
        order[100:140] = order[100:140][::-1]
        order[300:310] = order[290:300]
        for name, item in file.items():
            if item.ndim and item.shape[0] == size:
                file[name][...] = item[...][order]


def with_missing(path, name, rows):
    """Some values that are not numbers."""
    edit(path, name, lambda v: np.where(np.isin(np.arange(len(v)), rows).reshape(-1, *[1] * (v.ndim - 1)), np.nan, v))


def spoil_ranging(folder):
    """Unsorted, repeated, missing values, the other sign of the quaternion."""
    damage.shuffle_rows(one(folder, "SCA1B_2020-09-10_C"))
    damage.duplicate_rows(one(folder, "GNI1B_2020-09-10_C"))
    damage.flip_quaternions(one(folder, "SCA1B_2020-09-10_D"))
    damage.put_nan(one(folder, "KBR1B"), row=700, column=2)


def errors_of_ranging(document, truth):
    """Errors over sigma of A, whose wiggles these are."""
    found = document["adopted"]["satellites"]["C"]
    return (np.array(found["phase_centre_mm"]) - truth["phase_centre_mm"]["C"]) / np.array(found["sigma_mm"])


def spoil_swing(folder):
    """Unsorted and repeated records, missing samples, before and in the swing."""
    shuffled(one(folder, "IS1"))
    shuffled(one(folder, "ATT"))
    with_missing(one(folder, "IS1"), "V_z1", [4500, 4501])
    with_missing(one(folder, "ATT"), "q", [1900, 1901])


def errors_of_swing(document, truth):
    """Errors over sigma of the offset."""
    found = document["swing"]["com_to_test_mass_um"]
    return (np.array(found["value"]) - truth["com_to_test_mass_um"]) / np.array(found["sigma"])


def spoil_day(folder):
    """Unsorted and repeated records, missing readings, attitudes and places."""
    path = one(folder, "SGRS")
    shuffled(path)
    for name, row in (("linear", 200), ("angular", 400), ("q", 600), ("position", 800)):
        with_missing(path, name, [row, row + 1])


def errors_of_day(document, truth):
    """Error of the centre of pressure over sigma."""
    found = document["centre_of_pressure_m"]
    return (np.array(found["value"]) - truth["centre_of_pressure_m"]) / np.array(found["sigma"])


HARMLESS = {
    "kbr_phase_centre": (spoil_ranging, errors_of_ranging),
    "inertial_sensor": (spoil_swing, errors_of_swing),
    "gradient_torque": (spoil_day, errors_of_day),
}


@pytest.mark.parametrize("calibration", sorted(HARMLESS))
def test_damage_that_can_be_set_aside_leaves_a_true_result(clean, files, calibration, tmp_path):
    """Recovery: what is bad is not used; every determined component within five sigma of the truth."""
    spoil, errors = HARMLESS[calibration]
    folder = files(calibration)
    spoil(folder)
    code, document = run(calibration, folder, tmp_path / "result.json")
    assert (code, document["status"]) == (0, "delivered")
    assert np.all(np.abs(errors(document, clean[calibration][1])) < 5)
