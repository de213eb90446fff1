"""A calibration from another package: installed, it is in every command without a change in the project."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tilt(tmp_path_factory):
    """Return a function that runs gravcal where the example is installed, and a folder with one invented event."""
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(ROOT / "examples" / "plugin", folder / "code")
    install = ["-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", folder / "site"]
    subprocess.run([sys.executable, *map(str, install), str(folder / "code")], check=True, capture_output=True)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)]),
        "GRAVCAL_PRODUCTS": str(folder / "store"),
    }

    def gravcal(*words, code=0):
        command = [sys.executable, "-m", "flows.cli", *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout

    gravcal("simulate", "tilt_scale", "--out", folder / "data", "--truth", folder / "truth.json", "--seed", 3)
    gravcal.folder, gravcal.environment = folder, environment
    return gravcal


def test_the_truth_comes_back_and_a_hidden_effect_is_discovered(tilt):
    """Recovery: scale and bias to four sigma, a valid document; a reading that bends with the angle, with a size."""
    document = json.loads(
        tilt("run", "tilt_scale", "--data", tilt.folder / "data", "--engine", "inline", "--json", "-")
    )
    truth = json.loads((tilt.folder / "truth.json").read_text())
    assert (document["status"], document["origin"], document["event"]) == ("delivered", "simulated", "toy-p-2026-01-01")
    for name, one in document["parameters"].items():
        assert abs(one["value"] - truth[name]) < 4 * one["sigma"]
    data, hidden = tilt.folder / "bent", 5.0  # rad-1
    tilt("simulate", "tilt_scale", "--out", data, "--set", f"curvature_per_rad={hidden}", "--set", "date=2026-01-02")
    words = ("discover", "tilt_scale", "--data", data, "--engine", "inline", "--json", "-")
    (found,) = json.loads(tilt(*words))["findings"]
    assert found["cause"] == "unknown:angle_squared"
    curvature = found["parameters"]["curvature"]
    assert abs(curvature["value"] - hidden) < 4 * curvature["sigma"]


def test_every_command_and_the_browser_know_it(tilt):
    """Contract: help, settings, plan, campaign, report, series; a setting reaches its stage and no other.

    The browser has its events, time line and chain of stages.
    """
    data = ("tilt_scale", "--data", tilt.folder / "data")
    tilt("run", *data, "--engine", "inline")
    assert "tilt_scale" in tilt("run", "--help")
    assert "turntable settles" in tilt("settings", "tilt_scale")
    assert "reuse: 1, run: 2" in tilt("plan", *data, "--set", "skip_s=120")
    assert "scale 0.01" in tilt("campaign", *data, "--workers", 0)
    assert "report.html" in tilt("report", "toy-p-2026-01-01")
    page = tilt.folder / "series.html"
    tilt("series", "tilt_scale", "--out", page)
    assert "Scale and bias of the tilt meter" in page.read_text()
    assert "expected TLT for tilt_scale" in refused(tilt, "run", "tilt_scale", "--data", ROOT / "docs")
    assert "files of tilt_scale" in refused(tilt, "run", "com_offset", "--data", tilt.folder / "data")
    code = [sys.executable, "-W", "ignore", "-c", PAGES]
    done = subprocess.run(code, capture_output=True, text=True, check=False, env=tilt.environment)
    assert done.returncode == 0, done.stderr
    for text in ("Tilt meter", "Scale and bias of the tilt meter", "tilt_scale.fit", "toy-p-2026-01-01"):
        assert text in done.stdout


def refused(tilt, *words):
    """What is said of a folder with files of another calibration."""
    command = [sys.executable, "-m", "flows.cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=tilt.environment)
    assert done.returncode in (1, 3)
    return " ".join(done.stderr.split())


PAGES = """
from starlette.testclient import TestClient
from flows.calibration import load_all
from gravcal.browse import app
client = TestClient(app.application(load_all(), hosts=("testserver",)))
print(client.get("/").text, client.get("/timeline/tilt_scale").text, client.get("/event/toy-p-2026-01-01").text)
"""
