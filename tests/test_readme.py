"""The README and the pages of docs say what is there: snippets run, links lead somewhere; test_docs_commands types."""

import contextlib
import io
import re
import tomllib
from pathlib import Path

import pytest
from commands import blocks

from flows.calibration import known

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NUMBER = re.compile(r"[-+]?\d+\.\d+")
TOLERANCE_UM = 0.6  # half a sigma of x; what moves more deserves another README


def test_targets_settings_errata_and_extras_that_pages_name_exist():
    """Contract: `make TARGET`, the table of com_offset, errata in the code, extras."""
    named = {name for page in PAGES for name in re.findall(r"(?:^    |`)make (\w+)", page.read_text(), re.MULTILINE)}
    assert {"demo", "test"} <= named
    assert named <= set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    table = (ROOT / "docs" / "com_offset.md").read_text().partition("## Settings")[2].partition("## Limits")[0]
    rows = [row for row in table.splitlines() if row.startswith("| ") and "`" in row]
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == set(tomllib.loads((ROOT / "catalog" / "parameters" / "com_offset.toml").read_text()))
    listed = set(re.findall(r"\*\*([CKST]-\d+)\*\*", (ROOT / "docs" / "equations.md").read_text()))
    sources = [path for top in ("gravcal", "catalog", "docs") for path in (ROOT / top).rglob("*.*")]
    texts = [path.read_text() for path in sources if path.suffix in (".py", ".toml", ".md")]
    assert {name for text in texts for name in re.findall(r"errat(?:um|a) ([CKST]-\d+)", text)} <= listed
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    wanted = {name for page in PAGES for name in re.findall(r"gravcal\[(\w+)\]", page.read_text())}
    assert {"slurm", "kubernetes"} <= wanted <= set(extras)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file(page):
    """Contract: relative links and the paths in code marks that name a file of the project exist."""
    text = page.read_text()
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^):]+)\)", text)]
    paths = re.findall(r"`((?:gravcal|catalog|flows|tasks|tests|docs)/[\w./-]+)`", text)
    missing = [link for link in links if link and not (page.parent / link).exists()]
    assert not missing + [path for path in paths if not (ROOT / path).exists()]


def test_the_readme_needs_no_paper_to_be_read():
    """Contract: no number of an erratum, no power of ten without a unit; what is proven on which data is a table."""
    text = PAGES[0].read_text()
    assert not re.findall(r"\b[CKST]-\d+\b|errat", text)
    assert not re.findall(r"10\^-?\d+(?! (?:m|um|nT|rad|kg|s)\b)", text)
    screen = text.partition("## ")[0]
    assert all(f"docs/images/{name}.png" in screen for name in ("report", "discovery"))
    proven = text.partition("## What is proven")[2]
    assert all(f"`{name}`" in proven.partition("\n## ")[0] for name in known() if name != "routine")


def test_the_python_lines_print_what_the_readme_says(tmp_path, monkeypatch):
    """Recovery: the snippets of the pages run one after the other in an empty folder; printed offsets are repeated."""
    monkeypatch.chdir(tmp_path)
    readme = PAGES[0]
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(blocks(readme, "python")[0][1], {})
    promised = [[float(n) for n in NUMBER.findall(line)] for line in blocks(readme, "text")[1][1].splitlines()]
    printed = [[float(n) for n in NUMBER.findall(line)] for line in said.getvalue().splitlines()]
    assert printed == [pytest.approx(row, abs=TOLERANCE_UM) for row in promised]  # um
    lines = blocks(readme, "text")[0][1].splitlines()
    demo = {line.split()[0]: [float(n) for n in NUMBER.findall(line)] for line in lines}
    assert [row[0] for row in printed] == pytest.approx(demo["sca"][0:6:2], abs=TOLERANCE_UM)  # um
    assert [row[2] for row in printed] == demo["truth"]
    with contextlib.redirect_stdout(io.StringIO()):
        for page in PAGES:
            for _, snippet in blocks(page, "python")[page == readme :]:
                exec(snippet, {})
