"""The README and the pages of docs say what is there: snippets run, commands exist, links lead somewhere."""

import contextlib
import io
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

from flows.cli import app
from gravcal import catalog

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.\d+")
INVENTED = "grace-c-2020-03-01"  # day of the simulation; a page shows how to add it
TOLERANCE_UM = 0.6  # half a sigma of x; what moves more deserves another README


def blocks(page, language):
    """Fenced blocks of a page in one language."""
    return [text for found, text in BLOCK.findall(page.read_text()) if found == language]


def command_lines():
    """Every `gravcal ...` of the shell blocks with the page it stands on."""
    for page in PAGES:
        for line in "".join(blocks(page, "bash")).splitlines():
            words = shlex.split(line, comments=True)
            while words and "=" in words[0]:
                words = words[1:]
            if words and words[0] == "gravcal":
                yield pytest.param(words[1:], id=f"{page.name}: {' '.join(words)}")


@pytest.mark.parametrize("words", list(command_lines()))
def test_every_command_line_exists(words):
    """Contract: command, options, settings, events and effects of a printed line are known."""
    from gravcal.effects import effect

    command = get_command(app)
    while hasattr(command, "commands") and words:
        command = command.commands[words[0]]
        words = words[1:]
    options = {name for parameter in command.params for name in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= options
    calibration = next((word for word in words if (ROOT / "flows" / f"{word}.py").is_file()), None)
    for option, value in zip(words, words[1:], strict=False):
        name, _, given = value.partition("=")
        if option == "--set":
            simulated = command.name == "simulate"
            catalog.parameters(f"simulate_{calibration}" if simulated else calibration).with_settings({name: given})
        if option == "--effect":
            slug, _, parameter = name.rpartition(".")
            assert parameter in [one.name for one in effect(slug).parameters]
        if value.startswith("grace-c-") and option == calibration and value != INVENTED:
            assert catalog.event(value).calibration == calibration


def test_make_has_every_target_named():
    """Contract: each `make TARGET` of the pages is in the Makefile."""
    named = {name for page in PAGES for name in re.findall(r"(?:^    |`)make (\w+)", page.read_text(), re.MULTILINE)}
    assert {"demo", "test"} <= named
    assert named <= set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    """Contract: relative links and the paths in code marks that name a file of the project exist."""
    text = page.read_text()
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^):]+)\)", text)]
    paths = re.findall(r"`((?:gravcal|catalog|flows|tasks|tests|docs)/[\w./-]+)`", text)
    missing = [link for link in links if link and not (page.parent / link).exists()]
    assert not missing + [path for path in paths if not (ROOT / path).exists()]


def test_every_setting_of_the_method_page_exists():
    """Contract: the table of settings names all parameters of com_offset and no other."""
    table = (ROOT / "docs" / "com_offset.md").read_text().partition("## Settings")[2].partition("## Limits")[0]
    rows = [row for row in table.splitlines() if row.startswith("| ") and "`" in row]
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == set(tomllib.loads((ROOT / "catalog" / "parameters" / "com_offset.toml").read_text()))


def test_the_pages_name_no_erratum_that_is_not_listed():
    """Contract: an erratum cited anywhere in the code stands in docs/equations.md."""
    listed = set(re.findall(r"\*\*([CKST]-\d+)\*\*", (ROOT / "docs" / "equations.md").read_text()))
    sources = [path for top in ("gravcal", "catalog", "docs") for path in (ROOT / top).rglob("*.*")]
    texts = [path.read_text() for path in sources if path.suffix in (".py", ".toml", ".md")]
    cited = {name for text in texts for name in re.findall(r"errat(?:um|a) ([CKST]-\d+)", text)}
    assert cited <= listed


def test_the_python_lines_print_what_the_readme_says(tmp_path, monkeypatch):
    """Recovery: the snippets of the pages run one after the other in an empty folder; printed offsets are repeated."""
    monkeypatch.chdir(tmp_path)
    readme = PAGES[0]
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(blocks(readme, "python")[0], {})
    promised = [[float(n) for n in NUMBER.findall(line)] for line in blocks(readme, "text")[1].splitlines()]
    printed = [[float(n) for n in NUMBER.findall(line)] for line in said.getvalue().splitlines()]
    assert printed == [pytest.approx(row, abs=TOLERANCE_UM) for row in promised]  # um
    demo = {
        line.split()[0]: [float(n) for n in NUMBER.findall(line)] for line in blocks(readme, "text")[0].splitlines()
    }
    assert [row[0] for row in printed] == pytest.approx(demo["acc_calibrated"][0:6:2], abs=TOLERANCE_UM)  # um
    assert [row[2] for row in printed] == demo["truth"]
    with contextlib.redirect_stdout(io.StringIO()):
        for page in PAGES:
            for snippet in blocks(page, "python")[page == readme :]:
                exec(snippet, {})
