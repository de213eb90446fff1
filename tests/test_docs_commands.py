"""Every command line of the README and of the pages of docs is typed, on simulated days.

Placeholders are filled in (DIR, FOLDER, EVENT, FILE), runs go without Prefect. Some pages are typed as a whole, in an
empty folder. The lines for a Prefect server of one's own are typed by tests/flows/test_serve.py.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import commands
import pytest
import typer

from benchmarks import __main__ as benchmarks
from flows import cli

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TYPED_AS_A_PAGE = ("first_steps", "adding_a_satellite", "adding_an_event", "adding_an_effect", "adding_a_calibration")
SHORT = {  # days that take less time than those that the pages speak of
    "com_offset": ("--set", "manoeuvres=pitch_high,roll_high"),
    "kbr_phase_centre": ("--set", "phase_step_s=1.0", "--set", "quiet_s=900"),
    "inertial_sensor": ("--set", "roll_s=13000", "--set", "swing_at_s=900"),
    "gradient_torque": ("--set", "duration_s=3000"),
}
DAYS = {  # what is simulated for --data DIR by calibration, for the event that the pages show, and for --data day
    "com_offset": ("com_offset", "--set", "date=2020-02-01"),
    "kbr_phase_centre": ("kbr_phase_centre", "--set", "date=2020-09-17"),
    "inertial_sensor": ("inertial_sensor",),
    "gradient_torque": ("gradient_torque",),
    "shown": ("com_offset",),
    "day": ("com_offset", "--effect", "torque.dipole_gain.rod_y=0.03"),
}
EVENT = "grace-c-2020-02-01"
#: Lines whose words are read and no more, and the tests that do what they say.
READ = {
    "python -m benchmarks": "tests/test_published_methods.py",
    "gravcal serve": "tests/flows/test_serve.py",
    "gravcal browse": "tests/browse",
    "gravcal fetch": "tests/io/test_fetch.py",
    "--limits": "tests/flows/test_cli.py, with magnetometer",
    "discover com_offset EVENT --model": "tests/calibrations/com_offset/test_model_error.py",
    "discover thrusters": "tests/calibrations/test_thrusters.py, of the other satellite on that day",
    "discover magnetometer": "tests/calibrations/test_magnetometer.py, on that day",
    "discover ranging": "tests/calibrations/test_ranging_days.py, on that day",
}


def lines():
    """Every command of the blocks of shell, with the page it stands on, each once."""
    found = {}
    for page in PAGES:
        for _, text in commands.blocks(page, "bash") if page.stem not in TYPED_AS_A_PAGE else ():
            for line in text.splitlines():
                words = shlex.split(line, comments=True)
                if words:
                    found.setdefault(shlex.join(words), page.name)
    return found


def kind(line):
    """How a line is typed."""
    if any(mark in line for mark in READ):
        return "read"
    return "prefect" if "prefect" in line else "plain"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with a store that all lines share, and an archive with nothing in it but one file."""
    folder = tmp_path_factory.mktemp("typed")
    (folder / "products").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("GRAVCAL_PRODUCTS", str(folder / "products"))
        gravcal("run", "com_offset", "--data", simulated(folder, "shown"), "--engine", "inline")
        for what_if in (("lowpass_hz=0.3",), ("noise_order=25", "--as", "slower")):  # what the pages compare
            gravcal("run", "com_offset", "--data", folder / "shown", "--engine", "inline", "--set", *what_if)
    return folder


@pytest.fixture
def typing(place, monkeypatch):
    """Return a function that types one line in that folder; what it printed."""
    monkeypatch.chdir(place)
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(place / "products"))
    monkeypatch.setenv("GRAVCAL_DATA", str(place / "com_offset"))

    def type_(line, *more):
        words = filled(shlex.split(line), place)
        while "=" in words[0]:
            name, _, value = words.pop(0).partition("=")
            monkeypatch.setenv(name, value)
        assert words.pop(0) == "gravcal"
        engine = () if "--engine" in words or words[0] not in ("run", "discover") else ("--engine", "inline")
        short = SHORT.get(words[1], ()) if words[0] == "simulate" else ()
        return gravcal(*words, *engine, *short, *more)

    return type_


def gravcal(*words):
    """Run the command in this process; what it printed. It must deliver, the published processing with doubts."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = commands.gravcal(*words)
    assert code in ((0, 4) if "method=published" in words else (0,)), said.getvalue()
    return said.getvalue()


def simulated(place, name):
    """Folder of a simulated day."""
    if not (place / name).is_dir():
        calibration, *more = DAYS[name]
        gravcal("simulate", calibration, "--out", place / name, "--seed", "7", *more, *SHORT.get(calibration, ()))
    return place / name


def model(place):
    """Extended model of the day with a hidden effect, as discovery writes it."""
    gravcal("discover", "com_offset", "--data", simulated(place, "day"), "--engine", "inline")
    return next((place / "products").glob("objects/*/*/model.toml"))


def filled(words, place):
    """Words of a line with its placeholders filled in."""
    new = "simulate" in words
    name = next((word for word in words if word in DAYS), "com_offset")
    known = {"EVENT": lambda: EVENT, "FILE": lambda: model(place), "model.toml": lambda: model(place)}
    known["DIR"] = lambda: place / f"new-{len(list(place.iterdir()))}" if new else simulated(place, name)
    known["day"] = lambda: place / "day" if new else simulated(place, "day")
    if {EVENT, "EVENT"} & set(words) and not new:  # its files are those that GRAVCAL_DATA names
        simulated(place, "com_offset")
    made = []
    for word in words:
        head, equals, tail = word.rpartition("=")
        made.append(f"{head}{equals}{known[tail]()}" if tail in known else word)
    return made


@pytest.mark.parametrize(
    "line", [pytest.param(line, id=f"{page}: {line}") for line, page in lines().items() if kind(line) == "plain"]
)
def test_a_line_delivers(line, typing):
    """Contract: exit code 0, and something said."""
    assert typing(line)


def test_the_lines_of_fetch_name_archives_that_are_known():
    """Contract: every word after --from is a place of the table or an address."""
    from gravcal.io import fetch

    places = {re.search(r"--from (\S+)", line).group(1) for line in lines() if "--from" in line}
    assert places - set(fetch.PLACES) == {"https://..."}


def test_the_words_of_the_other_lines_are_those_of_the_command():
    """Contract: options and their types exist."""
    group = typer.main.get_command(cli.app)
    for words in (shlex.split(line) for line in lines() if kind(line) == "read" and not line.startswith("python")):
        above = group.make_context("gravcal", words[1:])
        name, command, rest = group.resolve_command(above, words[1:])
        command.make_context(name, rest, parent=above)


def test_every_benchmark_that_a_page_names_is_there():
    """Contract: `python -m benchmarks NAME ...`, in a block or in the text, names studies and options that exist."""
    found = 0
    for page in [*PAGES, ROOT / "CHANGELOG.md"]:
        for text in re.findall(r"python -m benchmarks\b([^`#]*)[`#]", page.read_text()):
            words = ["1" if word in ("N", "S") else word for word in text.split()]
            found += bool(benchmarks.options_of(words).names)
    assert found > 20


ENDLESS = ("gravcal browse", "gravcal serve")  # they go on until they are ended


def perform(language, text, folder, exported):
    """Do one block of a page in a folder, with what was exported before; commands of ours alone in this process."""
    if language == "toml":
        path = folder / re.match(r"# (\S+)", text).group(1)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return
    for line in [text] if language == "python" else filter(None, text.splitlines()):
        if line.startswith("export "):
            name, _, value = line.removeprefix("export ").partition("=")
            exported[name] = str(folder / value)
        elif line.startswith("gravcal ") and not line.startswith(ENDLESS):
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                for name, value in exported.items():
                    patch.setenv(name, value)
                gravcal(*shlex.split(line)[1:])
        elif not line.startswith(ENDLESS):
            command = (sys.executable, "-c", line) if language == "python" else ("bash", "-c", line)
            known = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"} | exported
            done = subprocess.run(command, cwd=folder, env=known, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("page", TYPED_AS_A_PAGE)
def test_what_a_page_says_works_in_an_empty_folder(page, tmp_path):
    """Contract: every block of shell, TOML and Python of the page, in order, without a change."""
    folder, exported = tmp_path / "empty", {}
    folder.mkdir()
    blocks = commands.blocks(ROOT / "docs" / f"{page}.md", "bash", "toml", "python")
    assert blocks
    for language, text in blocks:
        perform(language, text, folder, exported)
