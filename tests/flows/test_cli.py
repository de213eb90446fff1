"""The command line: exit codes, documents, errors on one screen, and what it must not import."""

import datetime
import json
import subprocess
import sys

import pytest
from commands import gravcal

from flows import command
from gravcal.errors import EstimationError
from gravcal.store import housekeeping
from gravcal.store.schemas import validate


def test_exit_codes_tell_what_happened(fakecal, capsys, monkeypatch, store_folder):
    """Contract: 0 with JSON in the file and a table; 3 nothing to calibrate, 1 error with status failed, 2 wrong usage.

    An unknown setting is answered with a suggestion, on one screen without a trace; that of an unforeseen error is in a
    file.
    """
    here, path = ("run", "fakecal", "--data", fakecal, "--engine", "inline"), fakecal / "out" / "result.json"
    assert gravcal(*here, "--json", path) == 0
    assert json.loads(path.read_text())["total"] == 2.0 * 2 * sum(range(7))
    assert "fake-1: delivered" in capsys.readouterr().out
    assert gravcal(*here, "--set", "gain=-1") == 3
    assert gravcal("detect", "fakecal", "--data", fakecal) == 3
    assert gravcal(*here, "--set", "gain=0", "--json", path) == 1
    failed = json.loads(path.read_text())
    facts = failed["status"], failed["error"]["kind"], failed["error"]["facts"]["limit"]
    assert facts == ("failed", "EstimationError", 1)
    assert gravcal(*here, "--as", "unheard", "--json", path) == 1  # no old document stays
    assert json.loads(path.read_text())["configuration"] == "unheard"
    assert gravcal("run", "fakecal", "unheard", "--engine", "inline") == 1
    for wrong in (
        ("run", "fakecal"),
        ("run", "fakecal", "fake-1", "--data", fakecal),
        ("run", "fakecla", "fake-1"),
        ("run", "fakecal", "--data", fakecal, "--engine", "other"),
        (*here, "--set", "gain"),
        ("discover", "published_table", "--model", path),  # printed numbers take no model
    ):
        assert gravcal(*wrong) == 2
    for setting, answer in (("gian=1", "gain"), ("gain=high", "expected a")):
        capsys.readouterr()
        assert gravcal(*here, "--set", setting) == 2
        said = capsys.readouterr().err
        assert answer in said
        assert "Traceback" not in said
        assert said.count("\n") < 10
    given = EstimationError("m", good=1.5, day=datetime.date(2020, 2, 1), nan=float("nan"))
    document = command.failed("c", "e", given)  # what JSON cannot hold becomes text or null
    assert document["error"]["facts"] == {"good": 1.5, "day": "2020-02-01", "nan": None}
    json.dumps(document, allow_nan=False)
    monkeypatch.setattr(command, "chosen", lambda *_: 1 / 0)
    assert gravcal("run", "fakecal", "--data", fakecal) == 1
    said = capsys.readouterr().err
    assert "ZeroDivisionError" in said
    assert "Traceback" not in said
    assert "Traceback" in (store_folder / "last-error.txt").read_text()


def test_simulate_passes_what_was_said_and_says_the_command_that_calibrates_it(fakecal, capsys):
    """Contract: seed, truth, effects and settings reach the simulator; a folder with a blank in quotation marks."""
    out, truth = fakecal / "a day", fakecal / "a day" / "t.json"
    options = ("--seed", 7, "--truth", truth, "--effect", "timing.accelerometer_delay.delay=0.5")
    assert gravcal("simulate", "fakecal", "--out", out, *options, "--set", "gain=3") == 0
    said = (out / "said.json").read_text()
    assert said.startswith(f"[7, '{truth}', ['timing.accelerometer_delay']")
    assert said.endswith("3.0, 633787200.0]")
    assert json.loads(truth.read_text()) == {"satellite": "C", "date": "2020-02-01"}
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"1 Level-1 files of an invented event (C 2020-02-01) in {out}, 0.0 MB: said.json"
    assert said[1] == f"truth in {truth}; no run reads it"
    assert said[2] == f"calibrate: gravcal run fakecal --data '{out}' --satellite=C --date=2020-02-01"
    wrong = ("--effect", "a.b=many"), ("--effect", "timing.accelerometer_delay.delay=nan"), ("--set", "date=tomorrow")
    assert [gravcal("simulate", "fakecal", "--out", out, *one) for one in wrong] == [2, 2, 2]


def test_a_run_without_data_says_so(tmp_path, monkeypatch, capsys):
    """Contract: exit code 3 and a document with status no_data, for an event and for a folder; not for a wrong path."""
    monkeypatch.setenv("GRAVCAL_DATA", str(tmp_path))
    path = tmp_path / "out.json"
    for where in (
        ("grace-c-2020-02-01",),
        ("--data", tmp_path),
        ("--data", tmp_path, "--satellite", "C", "--date", "2020-02-01"),
    ):
        assert gravcal("run", "com_offset", *where, "--engine", "inline", "--json", path) == 3
        document = json.loads(path.read_text())
        validate(document)
        assert (document["status"], document["error"]["kind"]) == ("no_data", "NoDataError")
        path.unlink()
    assert capsys.readouterr().err.startswith("no data: ")
    many = ("com_offset", "--satellite", "C", "--data", tmp_path, "--json", path)
    for words in (("discover", *many, "--joint"), ("campaign", *many)):
        assert gravcal(*words) == 3
        assert json.loads(path.read_text())["status"] == "no_data"
        path.unlink()
    assert gravcal("run", "com_offset", "--data", tmp_path / "absent", "--engine", "inline") == 1
    assert gravcal("run", "com_offset", tmp_path, "--engine", "inline") == 2  # a folder and no event
    (tmp_path / "KBR1B_2020-02-01_Y_04.txt").write_text("")
    (tmp_path / "SCA1B_2020-02-01_C_04.txt").write_text("")
    assert gravcal("run", "com_offset", "grace-c-2020-02-01", "--engine", "inline") == 1  # some are there


def test_the_store_can_be_looked_at(fakecal, pipeline, capsys):
    """Contract: a product is made again equal; damage is found; what is not there is an error."""
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline") == 0
    name = f"fake-1/{pipeline.name}.scale.one"
    assert gravcal("rebuild", name) == 0
    assert "equal in every number" in capsys.readouterr().out
    assert gravcal("products", "verify") == 0
    assert gravcal("products", "show", "nothing") == 1
    housekeeping.resolve(name).ref.path.write_bytes(b"damaged")
    assert gravcal("products", "verify") == 1
    assert gravcal("rebuild", name) == 1


def test_help_is_quick_and_imports_nothing_heavy():
    """Contract: no numerical library is loaded, which is what makes it quick."""
    code = (
        "import sys; sys.argv = ['gravcal', '--help']\n"
        "from flows import cli\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'prefect', 'xarray', 'dask', 'numba', 'scipy', 'polars', 'matplotlib', 'rich'} & "
        "set(sys.modules)\n"
        "sys.stderr.write(' '.join(sorted(heavy)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert "gravcal demo" in done.stdout


def ranging_files(folder):
    """Folder with the names of ranging files of GRACE-FO on one day."""
    folder.mkdir()
    for name in ("KBR1B_2020-09-10_Y_04.txt", "SCA1B_2020-09-10_C_04.txt", "GNI1B_2020-09-10_C_04.txt"):
        (folder / name).write_text("")
    return folder


def test_files_of_another_calibration_are_named_with_it(tmp_path, capsys):
    """Contract: what was found, which calibration reads it, what was expected."""
    assert gravcal("run", "com_offset", "--data", ranging_files(tmp_path / "level1")) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "(files of kbr_phase_centre, ranging and routine); expected ACC1A for com_offset" in said
    assert "found GNI1B, KBR1B, SCA1B" in said
    assert "Run one of these on it" in said


def test_a_satellite_or_day_that_is_not_there_is_said_with_those_that_are(tmp_path, capsys):
    """Contract: letters that no event can have and days that no calendar has are wrong usage, others are not found."""
    folder = ranging_files(tmp_path / "level1")
    for wrong, said in (
        (("com_offset", "--satellite", "X"), "--satellite X: expected C or D"),
        (("kbr_phase_centre", "--date", "2020-13-01"), "2020-13-01 is no day of the calendar, expected YYYY-MM-DD"),
    ):
        assert gravcal("run", *wrong, "--data", folder) == 2
        assert said in " ".join(capsys.readouterr().err.split())
    for wrong in (("--satellite", "AB"), ("--date", "2020-12-01")):
        assert gravcal("run", "kbr_phase_centre", "--data", folder, *wrong) == 3
        assert "found KBR1B of Y on 2020-09-10; expected KBR1B or LRI1B o" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    "text",
    [
        b"effect = [[",
        b"effect = [3]",
        b"effect = 3",
        b"effect = " + b"[" * 5000,
        b"\xff\xfe",
        b"[[effect]]\ncause = 3",
        b"[[effect]]\ncause = 'accelerometer.stray_tone'\nparameters = {}\nwaves = [{ start = nan, channel = 'a' }]",
        b"[[effect]]\ncause = 'accelerometer.stray_tone'\nparameters = {}\n[result]\nunit = 'mile'",
        b"[[effect]]\ncause = 'timing.accelerometer_delay'\nparameters.delay = {value = 1" + b"0" * 400 + b"}",
        b"[[effect]]\ncause = 'timing.accelerometer_delay'\nparameters.delay = {value = 20, unit = 'ms'}",
        b"[[effect]]\ncause = 'timing.accelerometer_delay'\nfrom = '2020-7-1'\nparameters.delay = {value = 1}",
    ],
)
def test_a_malformed_model_is_one_clear_line(text, tmp_path, capsys):
    """Bad input: file, what was found, what was expected; no trace."""
    model = tmp_path / "model.toml"
    model.write_bytes(text)
    assert gravcal("run", "kbr_phase_centre", "--data", ranging_files(tmp_path / "level1"), "--model", model) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert said.startswith(f"error: {model}: ")
    assert "found" in said
    assert "expected" in said
    assert "trace" not in said


@pytest.mark.parametrize("place", ["", "file/result.json"])
def test_a_document_that_cannot_be_written_stops_the_run_before_it_begins(place, fakecal, capsys, store_folder):
    """Bad input: a folder, a folder that is a file; wrong usage, nothing computed; looking changes nothing.

    An older document stays until there is a new one; a run that is wrong usage leaves no empty one.
    """
    old, new = fakecal / "file", fakecal / "new.json"
    old.write_text("kept")
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline", "--json", f"{fakecal}/{place}") == 2
    assert "cannot be written" in " ".join(capsys.readouterr().err.split())
    assert not list(store_folder.glob("objects/*/*"))
    for path in (old, new):
        assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "other", "--json", path) == 2
    assert old.read_text() == "kept"
    assert not new.exists()


@pytest.fixture
def minutes(tmp_path, monkeypatch):
    """Folder with five minutes of a magnetometer with a hidden bias, made on the command line."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    words = "--seed", 4, "--effect", "magnetometer.bias.x=5e-7", "--set", "duration_s=300"
    assert gravcal("simulate", "magnetometer", "--out", tmp_path / "data", *words) == 0
    return tmp_path


def test_detection_limits_are_one_stage_that_is_kept(minutes, capsys):
    """Contract: the search is not repeated, a second call makes nothing, nor does a campaign with the same."""
    words, alone = ("magnetometer", "--data", minutes / "data"), ("--engine", "inline", "--json", "-")
    kinds = lambda: sorted(entry.ref.stage for entry in housekeeping.entries(newest_only=False))  # noqa: E731
    made = lambda: json.loads(capsys.readouterr().out)  # noqa: E731
    capsys.readouterr()
    assert gravcal("discover", *words, *alone) == 0
    first, before = made(), kinds()
    assert "limits" not in first
    assert gravcal("discover", *words, "--limits", *alone, "--out", minutes / "page.html") == 0
    document, after = made(), kinds()
    assert sorted(after) == sorted([*before, "magnetometer.discovery.limits", "magnetometer.discovery_report"])
    assert [document[name] for name in ("findings", "gain")] == [first[name] for name in ("findings", "gain")]
    assert {"magnetometer.scale", "timing.magnetometer_delay"} <= {one["cause"] for one in document["limits"]}
    assert any(one["size"] and one["confirmed"] is not None for one in document["limits"])
    assert "named from" in (minutes / "page.html").read_text()
    assert gravcal("campaign", *words, "--limits", "--workers", 0, "--json", "-") == 0
    (row,) = made()["events"]
    assert (row["made"], row["status"]) == (0, "delivered")
    assert row["verdict"] == document["verdict"]["text"]
    assert kinds() == after
