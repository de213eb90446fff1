"""The site of the documentation builds without a warning and needs no network."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

from flows.calibration import known

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
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
