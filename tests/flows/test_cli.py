"""The command line: exit codes, documents, errors on one screen, and what it must not import."""

import json
import subprocess
import sys

import pytest

from flows import cli
from gravcal.data import housekeeping
from gravcal.errors import EstimationError


def gravcal(*arguments):
    """Exit code of a command run in this process."""
    sys.argv = ["gravcal", *map(str, arguments)]
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


def test_a_run_delivers_a_document(fakecal, capsys):
    """Contract: exit code 0, JSON in the file, table on the screen."""
    path = fakecal / "out" / "result.json"
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline", "--json", path) == 0
    assert json.loads(path.read_text())["total"] == 2.0 * 2 * sum(range(7))
    assert "fake-1: delivered" in capsys.readouterr().out


def test_a_document_on_standard_output_is_alone_there(fakecal, capsys):
    """Contract: '-' means standard output and nothing else is printed there."""
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["status"] == "delivered"


def test_exit_codes_tell_what_happened(fakecal, capsys):
    """Contract: 3 nothing to calibrate, 1 error with status failed in the document, 2 wrong usage."""
    here = ("run", "fakecal", "--data", fakecal, "--engine", "inline")
    assert gravcal(*here, "--set", "gain=-1") == 3
    path = fakecal / "failed.json"
    assert gravcal(*here, "--set", "gain=0", "--json", path) == 1
    failed = json.loads(path.read_text())
    assert (failed["status"], failed["error"]["kind"], failed["error"]["facts"]["limit"]) == (
        "failed",
        "EstimationError",
        1,
    )
    assert gravcal("run", "fakecal", "unheard", "--engine", "inline") == 1
    assert gravcal("run", "fakecal") == 2
    assert gravcal("discover", "attitude", "--data", fakecal, "--model", path) == 2  # a view takes no model
    assert gravcal("run", "fakecal", "fake-1", "--data", fakecal) == 2
    assert gravcal("run", "fakecla", "fake-1") == 2
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "other") == 2
    assert gravcal("run", "fakecal", "--data", fakecal, "--set", "gain") == 2
    assert gravcal("detect", "fakecal", "--data", fakecal) == 3


def test_an_unknown_setting_is_answered_with_a_suggestion(fakecal, capsys):
    """Contract: one screen: where, found, expected, remedy; no trace."""
    assert gravcal("run", "fakecal", "--data", fakecal, "--set", "gian=1") == 2
    said = capsys.readouterr().err
    assert "gain" in said
    assert "Traceback" not in said
    assert said.count("\n") < 10
    assert gravcal("run", "fakecal", "--data", fakecal, "--set", "gain=high") == 2
    assert "expected a" in capsys.readouterr().err


def test_a_plan_says_what_a_setting_would_cost(fakecal, capsys):
    """Contract: reuse, run and why; computes nothing."""
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline") == 0
    before = housekeeping.folders()
    capsys.readouterr()
    assert gravcal("plan", "fakecal", "--data", fakecal, "--set", "gain=3", "--json", "-") == 0
    steps = json.loads(capsys.readouterr().out)
    assert [(step["action"], step["reasons"]) for step in steps] == [("reuse", []), ("run", ["gain: 2.0 -> 3.0"])]
    assert housekeeping.folders() == before


def test_the_store_can_be_looked_at(fakecal, pipeline, capsys):
    """Contract: list, show, history, rebuild, verify, prune."""
    assert gravcal("run", "fakecal", "--data", fakecal, "--engine", "inline") == 0
    name = f"fake-1/{pipeline.name}.scale.one"
    capsys.readouterr()
    assert gravcal("products", "list") == 0
    assert name in capsys.readouterr().out
    assert gravcal("products", "show", name) == 0
    shown = capsys.readouterr().out
    assert "a value" in shown
    assert "gain" in shown
    assert gravcal("history", name) == 0
    assert str(pipeline.raw) in capsys.readouterr().out
    assert gravcal("rebuild", name) == 0
    assert "equal, bit for bit" in capsys.readouterr().out
    assert gravcal("products", "verify") == 0
    assert gravcal("products", "prune") == 0
    assert gravcal("products", "show", "nothing") == 1
    ref = housekeeping.resolve(name).ref
    ref.path.write_bytes(b"damaged")
    assert gravcal("products", "verify") == 1


def test_simulate_passes_what_was_said(fakecal):
    """Contract: seed, truth file, effects and settings reach the simulator."""
    out = fakecal / "sim"
    options = (
        "--out",
        out,
        "--seed",
        7,
        "--truth",
        "t.json",
        "--effect",
        "timing.delay.value_s=0.5",
        "--set",
        "gain=3",
    )
    assert gravcal("simulate", "fakecal", *options) == 0
    assert (out / "said.json").read_text() == "[7, 't.json', {'timing.delay.value_s': 0.5}, {'gain': '3'}]"
    assert gravcal("simulate", "fakecal", "--out", out, "--effect", "a.b=many") == 2


def test_an_unforeseen_error_leaves_its_trace_in_a_file(fakecal, monkeypatch, capsys, store_folder):
    """Contract: no trace on the screen."""
    from flows import command

    monkeypatch.setattr(command, "chosen", lambda *_: 1 / 0)
    assert gravcal("run", "fakecal", "--data", fakecal) == 1
    said = capsys.readouterr().err
    assert "ZeroDivisionError" in said
    assert "Traceback" not in said
    assert "Traceback" in (store_folder / "last-error.txt").read_text()


def test_help_is_quick_and_imports_nothing_heavy():
    """Contract: no numerical library is loaded, which is what makes it quick."""
    code = (
        "import sys; sys.argv = ['gravcal', '--help']\n"
        "from flows import cli\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'prefect', 'xarray', 'numpy', 'dask', 'numba', 'scipy', 'polars', 'matplotlib', 'rich'} & "
        "set(sys.modules)\n"
        "sys.stderr.write(' '.join(sorted(heavy)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert "gravcal demo" in done.stdout


def test_facts_that_json_cannot_hold_are_left_out():
    """Contract: a failed document is always valid JSON."""
    from flows import command

    document = command.failed("c", "e", EstimationError("m", good=1.5, bad=object(), nan=float("nan")))
    assert document["error"]["facts"] == {"good": 1.5}
    json.dumps(document, allow_nan=False)
