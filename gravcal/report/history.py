"""Results of a calibration over the years with printed values and mass trims: rows and page."""

import datetime

from gravcal.report import pages
from gravcal.report.figures import COLOURS, MARKS, image, mark, over_time
from gravcal.report.plain import plus_minus, signed


def history(title, points, trims=(), band=None):
    """[row dict, by satellite and date] and HTML page of values; like Table 9 and Figure 12 of 10.3390/rs14164030.

    Points, ours and printed, have satellite, panel, unit, date, value, sigma, event, mood (a key of MARKS, any other:
    measured) and said (of printed ones the source); trims are (satellite, Trim); a band is drawn about zero.
    """
    rows = []
    for one in points:
        kind, date = one.mood if one.mood in MARKS else "measured", one.date.date().isoformat()
        where = {"satellite": one.satellite, "date": date, "event": one.event, "kind": kind}
        rows.append(where | {"quantity": one.panel, "unit": one.unit, "value": one.value, "sigma": one.sigma})
    for satellite, one in trims:
        label = f"mass trim, {'' if one.confirmed else 'not '}confirmed by the printed series"
        where = {"satellite": satellite, "date": one.date.isoformat(), "event": label, "kind": "trim"}
        rows.append(where | {"quantity": one.axis, "unit": "µm", "value": one.trim_um, "sigma": None})
    rows.sort(key=lambda row: (row["satellite"], row["date"], row["kind"] == "trim", row["event"]))
    parts = []
    for satellite in dict.fromkeys(row["satellite"] for row in rows):
        own = [row for row in rows if row["satellite"] == satellite]
        parts.append({"satellite": satellite, "figure": image(_draw, own, band), "tables": tables(own)})
    dates = sorted(row["date"] for row in rows)
    sources = {p.said for p in points if p.mood == "printed"} | {one.source for _, one in trims}
    content = {"title": title, "span": f"{dates[0]} to {dates[-1]}", "sources": "; ".join(sorted(sources))}
    return rows, pages.render("history.html", parts_of=parts, **content)


def tables(rows):
    """[Table], one a unit, of the rows of a satellite: a row for each date, event and kind, a column a quantity."""
    by_unit = []
    for unit in dict.fromkeys(row["unit"] for row in rows):
        own = [row for row in rows if row["unit"] == unit]
        names, by_event = list(dict.fromkeys(row["quantity"] for row in own if row["kind"] != "trim")), {}
        for row in own:
            cells_of = by_event.setdefault((row["date"], row["event"], row["kind"]), {})
            cells_of[row["quantity"]] = _text(row)
        cells = [
            [date, event, MARKS[kind][2] if kind in MARKS else kind, *(cells_of.get(name, "") for name in names)]
            for (date, event, kind), cells_of in by_event.items()
        ]
        heads = ["date", "event", "", *(f"{name} ({unit})" for name in names)]
        by_unit.append(pages.Table("Value ± error, ours and as printed.", heads, cells, words=(0, 1, 2)))
    return by_unit


def _text(row):
    """Text of value and sigma of a row, printed ones with the printed digits; trims without sigma."""
    value, sigma = row["value"], row["sigma"]
    if row["kind"] == "trim":
        return signed(value, 0)
    if sigma is None or abs(value) + sigma < 1e-2:
        return f"{value:.4g}" + (f" ± {sigma:.2g}" if sigma is not None else "")
    return plus_minus(value, sigma, digits=(1 if sigma >= 0.1 else 2) if row["kind"] == "printed" else None)


def _draw(rows, band):
    """Figure with a panel for each quantity over time: ours filled, printed hollow, trims as lines; band about zero."""
    names = list(dict.fromkeys((row["quantity"], row["unit"]) for row in rows if row["kind"] != "trim"))
    drawn, panels = over_time([f"{name} ({unit})" for name, unit in names])
    for panel, (name, _) in zip(panels, names, strict=True):
        if band:
            panel.axhspan(-band, band, color=COLOURS["sky"], alpha=0.13, linewidth=0, label="requirement")
        of_panel = [row | {"date": datetime.date.fromisoformat(row["date"])} for row in rows if row["quantity"] == name]
        for kind in MARKS:
            mark(panel, kind, [(row["date"], row["value"], row["sigma"]) for row in of_panel if row["kind"] == kind])
        for row in (row for row in of_panel if row["kind"] == "trim"):
            confirmed = "not confirmed" not in row["event"]
            panel.axvline(row["date"], color=COLOURS["black"], linewidth=0.9, linestyle="--" if confirmed else ":")
            place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "xytext": (3, -3)}
            text = f"trim {signed(row['value'], 0)}" + ("" if confirmed else ", not confirmed")
            panel.annotate(text, (row["date"], 1.0), va="top", fontsize=6.5, **place)
    return drawn
