"""The site of the documentation builds without a warning, needs no network, and what it says to type works."""

import os
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from commands import gravcal

from flows.calibration import known

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(bash|toml|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
TYPED = ("first_steps", "adding_a_satellite", "adding_an_event", "adding_an_effect", "adding_a_calibration")
ENDLESS = ("gravcal browse", "gravcal serve")  # they go on until they are ended
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "object": "data"}


class Loads(HTMLParser):
    """Addresses that a page makes the browser ask for."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        """Note what the tag loads; a link that only names a relation loads nothing."""
        known = dict(attributes)
        if tag == "link" and known.get("rel") not in ("stylesheet", "icon", "preload"):
            return
        if known.get(LOADED.get(tag)):
            self.found.append(known[LOADED[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the site, built as `make docs` does it."""
    out = tmp_path_factory.mktemp("site")
    command = (sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", DOCS, out / "html")
    done = subprocess.run([*map(str, command), "-d", str(out / "trees")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


def test_every_page_is_in_the_site_and_needs_no_network(site):
    """Contract: each page of docs, README and changes, one for each calibration reached from the first, the pictures.

    Scripts, styles, fonts and pictures come from the site itself.
    """
    built = {path.stem for path in site.glob("*.html")}
    assert {path.stem for path in DOCS.glob("*.md")} <= built
    assert "Eight calibrations, one chain" in (site / "overview.html").read_text()
    assert list((site / "_images").glob("*.png"))
    first = (site / "index.html").read_text()
    assert [name for name in known() if f'href="{name}.html"' not in first] == []
    for page in site.glob("*.html"):
        seen = Loads()
        seen.feed(page.read_text())
        assert seen.found
        assert not [address for address in seen.found if re.match(r"(https?:)?//", address)], page.name
    for style in site.rglob("*.css"):
        assert not re.findall(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", style.read_text()), style.name


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
                assert gravcal(*shlex.split(line)[1:]) == 0, line
        elif not line.startswith(ENDLESS):
            command = (sys.executable, "-c", line) if language == "python" else ("bash", "-c", line)
            known = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"} | exported
            done = subprocess.run(command, cwd=folder, env=known, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("page", TYPED)
def test_what_a_page_says_works_in_an_empty_folder(page, tmp_path):
    """Contract: every block of shell, TOML and Python of the page, in order, without a change."""
    folder, exported = tmp_path / "empty", {}
    folder.mkdir()
    blocks = BLOCK.findall((DOCS / f"{page}.md").read_text())
    assert blocks
    for language, text in blocks:
        perform(language, text, folder, exported)
