"""The site of the documentation builds without a warning and needs no network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from flows.calibration import known

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
#: Addresses that a page makes the browser ask for; a link that only names a relation loads nothing.
LOADED = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*?\ssrc="([^"]*)|<object\b[^>]*?\sdata="([^"]*)"""
    r"""|<link\b(?=[^>]*\srel="(?:stylesheet|icon|preload))[^>]*?\shref="([^"]*)"""
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder of the site, built as `make docs` does it."""
    out = tmp_path_factory.mktemp("site")
    command = (sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", DOCS, out / "html")
    done = subprocess.run([*map(str, command), "-d", str(out / "trees")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


@pytest.mark.long
def test_every_page_is_in_the_site_and_needs_no_network(site):
    """Contract: docs, README, changes, pictures, a page a calibration; scripts, styles and fonts are of the site."""
    assert {path.stem for path in DOCS.glob("*.md")} <= {path.stem for path in site.glob("*.html")}
    assert "Eight calibrations, one chain" in (site / "overview.html").read_text()
    assert list((site / "_images").glob("*.png"))
    first = (site / "index.html").read_text()
    assert [name for name in known() if f'href="{name}.html"' not in first] == []
    for page in site.glob("*.html"):
        loaded = ["".join(found) for found in LOADED.findall(page.read_text())]
        assert len(loaded) > 5
        assert not [address for address in loaded if re.match(r"(https?:)?//", address)], page.name
    for style in site.rglob("*.css"):
        assert not re.findall(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", style.read_text()), style.name
