"""Pages of the views of measured data, from invented records and from the printed table."""

import re
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest
from commands import gravcal

from flows import discover_measured
from gravcal import catalog
from gravcal.discovery import product
from gravcal.report import discovery, discovery_measured
from gravcal.store.schemas import validate

CHOSEN = catalog.parameters("discover_measured")
VIEW = "published_table"
EMPTY = {"meta", "path", "rect", "img", "br"}


class Balanced(HTMLParser):
    """Tags that are open; what is closed must have been opened last."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids = [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):  # noqa: ARG002 - given by the parser
        """Open a tag that has an end."""
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        """Close the tag that was opened last."""
        if tag not in EMPTY:
            assert self.open.pop() == tag


def records(rng, amplitude):
    """Four blocks of three axes with a signal of two parameters: its cause, one that looks alike, one that does not."""
    blocks, columns = [], []
    for k in range(4):
        time = 1000.0 * k + np.arange(10)
        columns.append(np.tile(np.stack([np.ones(10), np.sin(time / 7)], axis=1), (3, 1)))
        rows = columns[-1] @ np.array([amplitude, -amplitude]) + rng.standard_normal(30)
        plain = {"shared": np.zeros((30, 0)), "own": np.zeros((30, 0)), "label": f"from {time[0]:.0f} s"}
        where = {"channel": np.repeat("offset", 30), "axis": np.repeat(np.arange(3), 10), "time": np.tile(time, 3)}
        blocks.append(plain | where | {"observed": rows})
    words = {"form": "", "names": ["even", "wave"], "units": ["1", "1"], "columns": columns}
    causes = [{"cause": "accelerometer.current_leak"} | words, {"cause": "accelerometer.scale"} | words]
    other = {"names": ["slow"], "units": ["m"], "columns": [c[:, 1:] ** 2 for c in columns]}
    return blocks, [*causes, {"cause": "accelerometer.misalignment", "form": ""} | other]


@cache
def made(amplitude=5.0, origin="measured"):
    """Document and products of an invented view with two searches."""
    rng = np.random.default_rng(20200201)
    found = [(letter, discover_measured.searched(*records(rng, amplitude), CHOSEN)) for letter in "AB"]
    facts = {letter: {"noise_nt": [12.5, 13.0], "gains": list(range(20)), "seconds": 290.0} for letter in "AB"}
    prepared = {"calibration": "com_offset", "event": "grace-ab-2014-01-15", "files": ["MAG1B_A.dat"], "facts": facts}
    prepared |= {"origin": origin}
    prepared |= {"said": "nothing is adopted", "notes": ["A note with <angle> brackets."]}
    document = discover_measured.document(VIEW, prepared, found, CHOSEN)
    return document, {label: product.dataset(result, {}, ()) for label, result in found}


def test_a_view_has_its_page():
    """Contract: verdict first, causes with what is tied, parameters with units, every section, facts and notes."""
    document, found = made()
    validate(document)
    html = discovery_measured.page(document, found)
    assert not Balanced(html).open
    body = html[html.index("<body>") :]
    assert body.index("Found in A, B:") < body.index("<h1>")
    for one in document["findings"]:
        assert one["tied_with"]
        for text in (one["cause"], *one["tied_with"], *(discovery.scaled(p)[0] for p in one["parameters"].values())):
            assert text in body
    for text in ("held out", "cannot be told from", "What remains unexplained", "nothing beyond noise", "12.5, 13"):
        assert text in body
    for text in ("20 from 0 to 19", "A note with &lt;angle&gt; brackets.", "nothing is adopted", "MAG1B_A.dat"):
        assert text in body


def test_a_view_of_simulated_files_says_so_first():
    """Contract: in the document, in the verdict of terminal and page, and in a banner."""
    document, found = made(origin="simulated")
    assert document["origin"] == "simulated"
    assert discovery.verdict(document).startswith("SIMULATED. Found")
    body = discovery_measured.page(document, found).partition("<body>")[2]
    assert body.index('class="origin">Simulated') < body.index("SIMULATED. Found") < body.index("<h1>")


def test_figures_of_every_search():
    """Contract: the best residual of each search, numbered; all rows where the record is short."""
    html = discovery_measured.page(*made())
    assert html.count("<figure>") == 2
    assert re.findall(r"<b>Figure (\d+)\.</b>", html) == ["1", "2"]
    assert html.count("</b> A: ") == html.count("</b> B: ") == 1


def test_a_page_without_findings_says_so():
    """Contract: no table of findings, no figure of what an extension helps; the limits are named all the same."""
    html = discovery_measured.page(*made(amplitude=0.0))
    assert "nothing is named" in html
    assert "Findings, in the order" not in html
    assert "of the listed causes is tied with another" in html
    assert html.count("<figure>") == 2


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Page of the printed table as the command writes it, and what the command said."""
    path = tmp_path_factory.mktemp("pages") / "below" / "table.html"
    assert gravcal("discover", "published_table", "--out", path) == 0
    return path.read_text()


def test_the_command_writes_the_page_of_the_printed_table(printed):
    """Published: Table 7 of the source paper: a leak of the current, tied with one of the angular acceleration."""
    assert not Balanced(printed).open
    assert re.search(r'class="verdict">Found in .*: accelerometer.current_leak', printed)
    assert "cannot be told from accelerometer.angular_leak" in printed
    assert printed.count("<figure>") == 4  # one a variant
    assert all(f"</b> {variant}: Residual" in printed for variant in ("mtq", "acc_calibrated", "acc", "sca"))


def test_the_page_needs_nothing_from_outside(printed):
    """Contract: one file without addresses, scripts or style sheets elsewhere."""
    assert [word for word in ("://", "<script", "<link", "url(") if word in printed] == []
    assert printed.count("<img") == printed.count('<img src="data:')
    assert len(printed) < 2e6


def test_a_verdict_names_the_search_only_where_there_are_several():
    """Contract: one search, no letter."""
    document, _ = made()
    one = document | {"gain": {"A": document["gain"]["A"]}, "findings": [document["findings"][0]]}
    assert discovery.verdict(one).startswith("Found: ")
