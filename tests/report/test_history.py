"""Results over the years, beside printed values and mass trims."""

import datetime

import pytest

from flows.calibration import load
from gravcal.browse import timeline
from gravcal.browse.timeline import Point
from gravcal.report import history

DAY = datetime.datetime(2020, 2, 1, 12)


def point(axis="x", mood="good", **changed):
    """Value of GRACE-C on 2020-02-01."""
    known = {"satellite": "C", "panel": axis, "unit": "µm", "date": DAY, "value": 106.0, "sigma": 8.0}
    return Point(**known | {"event": "grace-c-2020-02-01", "mood": mood, "said": ""} | changed)


def made(points):
    """History of GRACE-C with trims and printed values."""
    trims = [("C", one) for one in timeline.trims("C")]
    return history.history("Offset", [*points, *timeline.printed_points(load("com_offset"), "C")], trims, 100.0)


def test_the_history_holds_every_printed_event_and_trim_and_each_unit_its_table():
    """Published: 20 rows of Table 9 and four trims of Table 4, ours in a row of its own beside that of its day.

    A trim stands between the events it separates; a row is what JSON can hold; 1e-5 and micrometres of one satellite.
    """
    rows, html = made([point()])
    assert sum(row["kind"] == "printed" for row in rows) == 3 * 20
    assert [row["value"] for row in rows if row["kind"] == "trim"] == [103.0, -30.0, -113.0, -32.0]
    at = [row["value"] for row in rows if row["quantity"] == "x" and row["event"] == "grace-c-2020-02-01"]
    assert sorted(at) == [106.0, 107.0]
    assert "−333.1 ± 0.9" in html
    dates = [row["date"] for row in rows]
    assert dates == sorted(dates)
    assert all(isinstance(value, (str, float, int, type(None))) for row in rows for value in row.values())
    scale = point("k x", unit="m s-2 V-1", value=1.2345e-5, sigma=1.2e-9, satellite="T")
    _, html = history.history("Sensor", [point("offset x", satellite="T"), scale])
    assert html.count("<table") == 2
    assert "1.234e-05 ± 1.2e-09" in html


@pytest.mark.parametrize("mood", ["questionable", "simulated", "mixed"])
def test_what_is_no_measured_delivery_has_a_row_and_mark_of_its_own(mood):
    """Contract: named in its row and in the picture, never one line with what was measured."""
    rows, html = made([point(), point(mood=mood)])
    own = [row["kind"] for row in rows if row["event"] == "grace-c-2020-02-01" and row["quantity"] == "x"]
    assert sorted(own) == sorted(["measured", "printed", mood])
    assert f'<td class="word ">{history.MARKS[mood][2]}</td>' in html
    assert html != made([point(), point()])[1]
