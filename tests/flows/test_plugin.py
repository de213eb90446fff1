"""A calibration from another package: installed, it is in every command without a change in the project."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


#: Commands of a list one after the other in one process: exit code, output and errors of each.
COMMANDS = """
import contextlib, io, json, sys
from flows import cli
said = []
for words in json.load(sys.stdin):
    sys.argv, out, err = ["gravcal", *words], io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as ended:
            said.append([ended.code or 0, out, err])
print(json.dumps([[code, out.getvalue(), err.getvalue()] for code, out, err in said]))
"""
PAGES = """
from starlette.testclient import TestClient
from flows.calibration import load_all
from gravcal.browse import app
client = TestClient(app.application(load_all(), hosts=("testserver",)))
print(client.get("/").text, client.get("/timeline/tilt_scale").text, client.get("/event/toy-p-2026-01-01").text)
"""


@pytest.fixture(scope="module")
def tilt(tmp_path_factory):
    """Return a function that runs gravcal where the example is installed, and a folder with one invented event."""
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(ROOT / "examples" / "plugin", folder / "code")
    install = ["-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", folder / "site"]
    subprocess.run([sys.executable, *map(str, install), str(folder / "code")], check=True, capture_output=True)
    environment = os.environ | {"PYTHONPATH": f"{folder / 'site'}{os.pathsep}{ROOT}"}
    environment |= {"GRAVCAL_PRODUCTS": str(folder / "store")}

    def python(code, said=""):
        command = [sys.executable, "-W", "ignore", "-c", code]
        done = subprocess.run(command, input=said, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def gravcal(*lines, codes=(0,)):
        found = json.loads(python(COMMANDS, json.dumps([list(map(str, words)) for words in lines])))
        assert len(found) == len(lines)
        assert {code for code, *_ in found} <= set(codes), found
        return [out if code == 0 else " ".join(err.split()) for code, out, err in found]

    gravcal(("simulate", "tilt_scale", "--out", folder / "data", "--truth", folder / "truth.json", "--seed", 3))
    gravcal.folder, gravcal.python = folder, python
    return gravcal


def test_the_truth_comes_back_and_a_hidden_effect_is_discovered(tilt):
    """Recovery: scale and bias to four sigma, a valid document; a reading that bends with the angle, with a size."""
    data, hidden, inline = tilt.folder / "bent", 5.0, ("--engine", "inline", "--json", "-")  # rad-1
    said = tilt(
        ("run", "tilt_scale", "--data", tilt.folder / "data", *inline),
        ("simulate", "tilt_scale", "--out", data, "--set", f"curvature_per_rad={hidden}", "--set", "date=2026-01-02"),
        ("discover", "tilt_scale", "--data", data, *inline),
    )
    document, truth = json.loads(said[0]), json.loads((tilt.folder / "truth.json").read_text())
    assert (document["status"], document["origin"], document["event"]) == ("delivered", "simulated", "toy-p-2026-01-01")
    for name, one in document["parameters"].items():
        assert abs(one["value"] - truth[name]) < 4 * one["sigma"]
    (found,) = json.loads(said[2])["findings"]
    assert found["cause"] == "unknown:angle_squared"
    curvature = found["parameters"]["curvature"]
    assert abs(curvature["value"] - hidden) < 4 * curvature["sigma"]


def test_every_command_and_the_browser_know_it(tilt):
    """Contract: help, settings, plan, campaign, report, series, browser; a setting reaches its stage and no other."""
    data, page = ("tilt_scale", "--data", tilt.folder / "data"), tilt.folder / "series.html"
    lines = {
        ("run", *data, "--engine", "inline"): "delivered",
        ("run", "--help"): "tilt_scale",
        ("settings", "tilt_scale"): "turntable settles",
        ("plan", *data, "--set", "skip_s=120"): "reuse: 1, run: 2",
        ("campaign", *data, "--workers", 0): "scale 0.01",
        ("report", "toy-p-2026-01-01"): "report.html",
        ("series", "tilt_scale", "--out", page): str(page),
    }
    for said, expected in zip(tilt(*lines), lines.values(), strict=True):
        assert expected in said
    assert "Scale and bias of the tilt meter" in page.read_text()
    foreign = ("run", "tilt_scale", "--data", ROOT / "docs"), ("run", "com_offset", "--data", tilt.folder / "data")
    refused = tilt(*foreign, codes=(1, 3))
    assert "expected TLT for tilt_scale" in refused[0]
    assert "files of tilt_scale" in refused[1]
    shown = tilt.python(PAGES)
    for text in ("Tilt meter", "Scale and bias of the tilt meter", "tilt_scale.fit", "toy-p-2026-01-01"):
        assert text in shown
