"""History of the centre of mass over events."""

import base64

from gravcal.data import catalog
from gravcal.report.com_offset_history import history


def made(documents):
    """History of GRACE-C with trims and printed values."""
    return history(documents, catalog.trims("C"), catalog.published("com_offset")["history"])


def test_the_history_holds_every_printed_event_and_trim(document):
    """Published: 20 rows of Table 9 and four trims of Table 4; ours stands beside the printed value of its day."""
    rows, _, html = made([document])
    assert sum(row["printed"] is not None for row in rows) == 20
    assert [row["trim"].trim_um for row in rows if row["trim"]] == [103.0, -30.0, -113.0, -32.0]
    own = [row for row in rows if row["ours"]]
    assert len(own) == 1
    assert own[0]["printed"].value == (107.0, 3.6, 11.5)
    assert "−333.1 ± 0.9" in html


def test_rows_are_in_order_of_time(document):
    """Contract: a trim stands between the events it separates."""
    rows, _, _ = made([document])
    dates = [row["date"] for row in rows]
    assert dates == sorted(dates)


def test_an_event_that_delivered_nothing_is_left_out(document, quiet_document):
    """Contract: only delivered offsets are in the series."""
    rows, _, _ = made([quiet_document, document])
    assert sum(row["ours"] is not None for row in rows) == 1


def test_the_figure_is_the_same_every_time(document):
    """Contract: no random identifiers, no date in the SVG."""
    first, second = (made([document])[1] for _ in range(2))
    assert first == second
    assert first.startswith("data:image/svg+xml;base64,")
    assert b"<dc:date>" not in base64.b64decode(first.split(",")[1])


def test_no_event_at_all_gives_an_empty_history():
    """Contract: nothing to show is no error."""
    rows, _, html = history([])
    assert rows == []
    assert "no event" in html
