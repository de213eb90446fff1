"""The wheel holds everything and runs where the project's folder is not."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("gravcal", "tasks", "flows", "catalog")
OTHERS = ("pyproject.toml", "README.md", "LICENSE")


def run(*command, cwd, expect=0, **environment):
    """Output of a command that sees neither the project's folder nor this process's settings."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "GRAVCAL"))}
    settings = kept | {name: str(value) for name, value in environment.items()}
    how = {"cwd": cwd, "env": settings, "capture_output": True, "text": True}
    done = subprocess.run([str(word) for word in command], **how, check=False)
    assert done.returncode == expect, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the wheel, built from a copy with the build tools that are installed, without network."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in OTHERS:
        shutil.copy(ROOT / name, source / name)
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, source, cwd=source)
    (built,) = out.glob("gravcal-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Return an environment with the wheel; what it depends on comes from the present one, nothing is downloaded."""
    folder = tmp_path_factory.mktemp("installed") / "env"
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    run(
        *(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--disable-pip-version-check"),
        *("--no-index", "--no-deps", wheel),
        cwd=folder,
    )
    paths = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}  # their own .pth files are not followed
    inside = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip()
    (Path(inside) / "dependencies.pth").write_text("\n".join(sorted(paths)) + "\n")
    return folder / "bin"


@pytest.mark.long
def test_every_file_of_the_packages_is_in_the_wheel_which_runs_from_another_folder(wheel, installed, tmp_path):
    """Contract: tables of readers, catalogue, schemas, coefficients and templates are shipped; no tests, no benchmarks.

    Four packages, the licence and the record of the wheel; help, catalogue, a small simulation and its calibration.
    """
    names = set(zipfile.ZipFile(wheel).namelist())
    files = [path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file()]
    wanted = {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    assert {".py", ".toml", ".csv", ".json", ".shc", ".html", ".css", ".js"} <= {Path(name).suffix for name in wanted}
    assert not wanted - names
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == set(PACKAGES)
    assert any(name.endswith("licenses/LICENSE") for name in names)
    python, gravcal = installed / "python", installed / "gravcal"
    store = {"GRAVCAL_PRODUCTS": tmp_path / "products"}
    assert "gravcal run com_offset" in run(gravcal, "--help", cwd=tmp_path)
    where = run(python, "-c", "import gravcal, flows, catalog; print(gravcal.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(installed.parent)
    asked = "from gravcal import catalog; print(catalog.event('grace-c-2020-02-01').date)"
    assert run(python, "-c", asked, cwd=tmp_path).strip() == "2020-02-01"
    short = ("--set", "duration_s=1800")  # of a calibration that compiles nothing, which in a new place takes 20 s
    run(gravcal, "simulate", "magnetometer", "--out", "day", *short, cwd=tmp_path, **store)
    said = run(gravcal, "run", "magnetometer", "--data", "day", "--engine", "inline", cwd=tmp_path, **store)
    assert "delivered" in said
    assert "report.html" in said
