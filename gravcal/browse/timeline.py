"""Results over the years: one panel for each component, with errors, verdicts, mass trims and printed values."""

import datetime
import re
from dataclasses import dataclass

from gravcal import catalog
from gravcal.browse import plots, store_index
from gravcal.errors import CatalogError

SHOWN = {"@date": "datetime", "@value": "printf", "@sigma": "printf"}
EPOCH = datetime.datetime(2000, 1, 1, 12)
#: Colour and mark by verdict, and by origin where not all was measured.
MOODS = {"good": ("#009E73", "circle"), "bad": ("#D55E00", "triangle"), "plain": ("#5a5a5a", "square"),
         "questionable": ("#000000", "x"), "simulated": ("#7b52ab", "diamond"),
         "mixed": ("#7b52ab", "diamond_cross")}  # fmt: skip
RESULTS = ("delivered", "questionable")


@dataclass(frozen=True)
class Point:
    """One value with its error: ours or printed."""

    satellite: str
    panel: str
    unit: str
    date: datetime.datetime
    value: float
    sigma: float | None
    event: str
    mood: str
    said: str


def points(calibration) -> list[Point]:
    """Values of all reports of a calibration."""
    found = []
    for row in store_index.results():
        if row["calibration"] != calibration.name or (row["document"] or {}).get("status") not in RESULTS:
            continue
        mood = "questionable" if row["document"]["status"] == "questionable" else row["mood"]
        mood = mood if row["origin"] == "measured" else row["origin"]
        date = _date(row["document"], row["event"])
        for one in calibration.result(row["document"]):
            if one.value is not None:
                place = one.satellite or _letters(row["event"]), one.name, one.unit.replace("um", "µm")
                sigma = one.sigma_total or one.sigma
                found.append(Point(*place, date, one.value, sigma, row["event"], mood, row["said"]))
    return sorted(found, key=lambda point: (point.date, point.event))


def printed_points(calibration, satellite: str) -> list[Point]:
    """Printed values of the catalogue, in the units of ours."""
    try:
        name = catalog.satellite(satellite).name
    except CatalogError:
        return []
    sections, found = catalog.published(calibration.name) if calibration.printed else {}, []
    for section, values in calibration.printed.items():
        for one in sections.get(section, ()):
            date = _printed_date(one, name)
            rows = values(one) if date else ()
            event = one.events[0] if one.events else ""
            found += [
                Point(satellite, *row[:2], date, *row[2:4], event, "printed", f"{row[4]}{one.source}") for row in rows
            ]
    return found


def levels(calibration) -> dict[str, tuple[float, str]]:
    """Printed orders of magnitude without a date: value and text by panel."""
    if not calibration.levels:
        return {}
    scalars = {one.name: one.value[0] for one in catalog.published(calibration.name)["scalars"]}
    return {
        panel: (scalars[name], f"printed: order of {scalars[name]:.0e} m s-2")
        for panel, name in calibration.levels.items()
    }


def trims(satellite: str):
    """Mass trims of the catalogue for one satellite, () where it knows none."""
    try:
        return catalog.trims(satellite)
    except CatalogError:
        return ()


def figure(calibration, satellite: str) -> dict | None:
    """Panels over time of one satellite, as Bokeh's embed_item takes them; None where there is no result."""
    from bokeh.embed import json_item
    from bokeh.layouts import column

    own = [point for point in points(calibration) if point.satellite == satellite]
    if not own:
        return None
    said, orders = printed_points(calibration, satellite), levels(calibration)
    trimmed = trims(satellite) if calibration.trims else []
    panels = list(dict.fromkeys((point.panel, point.unit) for point in own))
    drawn, shared = [], {}
    for panel, unit in panels:
        one = _panel(f"{panel}\n({unit})", shared, (panel, unit) == panels[-1], "log" if panel in orders else "linear")
        shared = {"x_range": one.x_range}
        _errors(one, [point for point in own if point.panel == panel])
        _printed(one, [point for point in said if point.panel == panel])
        for trim in (trim for trim in trimmed if trim.axis == panel):
            _trim(one, trim)
        if panel in orders:
            values = [point.value for point in own if point.panel == panel]
            _level(one, *orders[panel], max(values))
        drawn.append(one)
    return json_item(column(drawn, sizing_mode="stretch_width"))


def _letters(event):
    """Letters of the satellites in the name of an event; a satellite named in full gives its own."""
    parts = event.split("-")
    known = (catalog.satellite(name) for name in catalog.names("satellites"))
    own = [one.letter for one in known if event.startswith(f"{one.name}-")]
    return own[0] if own else (parts[1].upper() if len(parts) > 1 else "?")


def _date(document, event):
    """Date of a result: that of its first manoeuvre, else that in the event's name."""
    starts = [one["start"] for one in document.get("manoeuvres") or [] if one.get("start") is not None]
    if starts:
        return EPOCH + datetime.timedelta(seconds=min(starts))
    found = re.search(r"\d{4}-\d{2}-\d{2}", event)
    return datetime.datetime.fromisoformat(found.group()) if found else EPOCH


def _printed_date(one, name):
    """Date of a printed value if it belongs to a satellite, else None: its own, else that of its event."""
    own = [event for event in one.events if event.startswith(name)]
    if one.labels.get("satellite", name) != name or (one.events and not own):
        return None
    found = re.search(r"\d{4}-\d{2}(-\d{2})?", one.labels.get("date") or (own[0] if own else ""))
    return datetime.datetime.fromisoformat(found.group() + ("" if found.group(1) else "-01")) if found else None


def _panel(label, shared, last, scale):
    """Empty panel of the time line."""
    from bokeh.models import TapTool
    from bokeh.models.callbacks import OpenURL
    from bokeh.plotting import figure as new

    axes = {"x_axis_type": "datetime", "y_axis_type": scale} | shared
    one = new(height=190 if last else 160, **plots.TOOLS, **axes)
    if not shared:
        one.x_range.default_span = 365 * 86400e3  # ms, where there is one event only
    one.yaxis.axis_label, one.xaxis.visible = label, last
    one.add_tools(TapTool(callback=OpenURL(url="/event/@event", same_tab=True)))
    return plots.styled(one)


def _columns(own):
    """Points as columns for Bokeh."""
    known = {name: [getattr(point, name) for point in own] for name in ("date", "value", "event", "said")}
    spread = [point.sigma or 0.0 for point in own]
    bounds = {"low": [p.value - s for p, s in zip(own, spread, strict=True)],
              "high": [p.value + s for p, s in zip(own, spread, strict=True)]}  # fmt: skip
    return known | bounds | {"sigma": [point.sigma for point in own]}


def _errors(panel, own):
    """Our values with their errors; form and colour say the verdict."""
    from bokeh.models import ColumnDataSource, HoverTool

    for mood, (colour, marker) in MOODS.items():
        source = ColumnDataSource(_columns([point for point in own if point.mood == mood]))
        panel.segment("date", "low", "date", "high", source=source, color=colour, line_width=1.6)
        size = 14 if "diamond" in marker else 9  # a diamond is drawn smaller than the others
        marks = panel.scatter("date", "value", source=source, marker=marker, size=size, color=colour, line_color=colour)
        tips = [("", "@event"), ("", "@date{%F}"), ("value", "@value{%.6g} ± @sigma{%.2g}"), ("", "@said")]
        panel.add_tools(HoverTool(renderers=[marks], tooltips=tips, formatters=SHOWN))


def _printed(panel, said):
    """Printed values, hollow."""
    from bokeh.models import ColumnDataSource, HoverTool

    source = ColumnDataSource(_columns(said))
    panel.segment("date", "low", "date", "high", source=source, color="#0072B2")
    marks = panel.scatter("date", "value", source=source, marker="circle", size=7, fill_color="white",
                          line_color="#0072B2")  # fmt: skip
    tips = [("printed", "@date{%F}"), ("value", "@value{%.6g} ± @sigma{%.2g}"), ("", "@said")]
    panel.add_tools(HoverTool(renderers=[marks], tooltips=tips, formatters=SHOWN))


def _trim(panel, trim):
    """A mass trim as a line, dashed where the printed series confirms it, dotted where not."""
    from bokeh.models import Label, Span

    when = datetime.datetime.combine(trim.date, datetime.time(), datetime.UTC).timestamp() * 1e3
    panel.add_layout(Span(location=when, dimension="height", line_color=plots.GREY,
                          line_dash="dashed" if trim.confirmed else "dotted"))  # fmt: skip
    panel.add_layout(Label(x=when, y=4, y_units="screen", text=f" trim {trim.trim_um:+.0f} µm",
                           text_font_size="10px", text_font=plots.FONT, text_color=plots.GREY))  # fmt: skip


def _level(panel, value, text, largest):
    """A printed order of magnitude as a line, always within the picture."""
    from bokeh.models import Label, Range1d, Span

    panel.y_range = Range1d(value / 5, 5 * max(value, largest))
    panel.add_layout(Span(location=value, dimension="width", line_color="#0072B2", line_dash="dashed"))
    panel.add_layout(Label(x=4, x_units="screen", y=value, y_offset=3, text=text, text_font_size="10px",
                           text_font=plots.FONT, text_color="#0072B2"))  # fmt: skip
