"""Figures of one or two products and of results over the years: drawn by Bokeh, data at the resolution of the view."""

import base64
import csv
import dataclasses
import datetime
import io
from dataclasses import dataclass

import numpy as np
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, HoverTool, Label, OpenURL, Range1d, Span, TapTool
from bokeh.plotting import figure as bokeh_figure

from gravcal.browse import series, store_index, timeline
from gravcal.report.plain import gps_text
from gravcal.store.results import rounded

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")  # Okabe and Ito, 2008
VIEWS = ("overlay", "difference", "spectrum")
DRAWN = 6  # series of one product, at most
MANY = 4_000_000  # samples; of more, only the first series is drawn unasked
GAPS = 0.5  # share of the axis that gaps may fill before the page says what to do
FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Arial, sans-serif"
GREY = "#5a5a5a"
SHOWN = {"@date": "datetime"}
#: Colour, mark, its size and filling by verdict, and by origin where not all was measured; a diamond is drawn smaller.
MOODS = {
    "good": ("#009E73", "circle", 9, None),
    "bad": ("#D55E00", "triangle", 9, None),
    "plain": (GREY, "square", 9, None),
    "questionable": ("#000000", "x", 9, None),
    "simulated": ("#7b52ab", "diamond", 14, None),
    "mixed": ("#7b52ab", "diamond_cross", 14, None),
    "printed": ("#0072B2", "circle", 7, "white"),
}
TOOLS = {
    "tools": "xpan,box_zoom,xwheel_zoom,reset,save",
    "active_drag": "xpan",
    "active_scroll": "xwheel_zoom",
    "sizing_mode": "stretch_width",
}


@dataclass(frozen=True)
class Wish:
    """What a figure shows."""

    #: key, variable: product and its variable
    key: str
    variable: str
    columns: tuple[int, ...] = ()  #: numbers of the series, empty: those that are quick to draw
    other: str = ""  #: key of a second product with the same variable, or empty
    view: str = "overlay"  #: one of VIEWS
    from_start: bool = False  #: whether each product's coordinate counts from its own begin
    without_gaps: bool = False  #: whether samples stand side by side, whatever lies between them


@dataclass(frozen=True)
class Trace:
    """One line: label, its data, shift of its coordinate, number of product and column."""

    label: str
    whole: series.Series
    shift: float
    product: int
    column: int


class Missing(LookupError):
    """A product, variable or column that is not there, or not to be plotted."""


def ready():
    """Try what draws, so that the first figure comes as fast as the others."""
    drawn = _empty("time", "", "")
    drawn.line([0.0, 1.0], [0.0, 1.0])
    json_item(drawn)


def chosen(variable, columns=()):
    """Numbers of the series that are drawn: those wished, else the first ones."""
    wished = tuple(number for number in columns if 0 <= number < len(variable.columns))
    if wished:
        return wished[:DRAWN]
    length = variable.shape[variable.axis]
    return tuple(range(min(len(variable.columns), DRAWN if length * DRAWN <= MANY else 1)))


def figure(wish: Wish) -> dict:
    """Figure with its data, as Bokeh's embed_item takes it."""
    made, said = _spectra(wish) if wish.view == "spectrum" else _lines(wish)
    return json_item(made) | {"said": said}


def data(wish: Wish, start: float, stop: float) -> dict[str, dict[str, str]]:
    """Data of the lines of a figure between two places of its axis: little-endian doubles as base64, by name."""
    traces, kind, _, _ = _traces(wish)
    bounds = [(_undrawn(start, kind) - one.shift, _undrawn(stop, kind) - one.shift) for one in traces]
    views = [series.view(one.whole, *bound) for one, bound in zip(traces, bounds, strict=True)]
    return {
        f"line-{number}": {"x": _packed(_drawn(x + one.shift, kind)), "y": _packed(y)}
        for number, (one, (x, y)) in enumerate(zip(traces, views, strict=True))
    }


def table(wish: Wish, start=None, stop=None) -> str:
    """CSV of the lines of a figure, every sample between two places of its axis; of a spectrum all of it.

    ValueError where that are more samples than `MANY`.
    """
    traces, kind, along, unit = _traces(wish)
    rows = []
    if wish.view == "spectrum":
        for one in traces:
            rows += [(one.label, f, d) for f, d in zip(*series.spectrum(one.whole)[:2], strict=True)]
        return _csv_of(("series", "frequency (Hz)", f"density of {unit}, Hz-1/2"), rows)
    heads = ("series", *(("GPS time (s)", "calendar (GPS)") if kind == "time" else (along,)), unit)
    for one in traces:
        ends = [None if place is None else _undrawn(place, kind) - one.shift for place in (start, stop)]
        x, y = series.samples(one.whole, *ends, most=MANY // 4)
        stamps = [(t, gps_text(t, 3)) if kind == "time" else (t,) for t in (x + one.shift).tolist()]
        rows += [(one.label, *stamp, value) for stamp, value in zip(stamps, y.tolist(), strict=True)]
    return _csv_of(heads, rows)


def _csv_of(heads, rows):
    """Rows as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return text.getvalue()


def _traces(wish):
    """Lines of a figure; kind and label of the axis along; unit."""
    own, variable = _asked(wish.key, wish.variable)
    coordinate, kind, label = _along(own, variable, wish)
    numbers = chosen(variable, wish.columns)
    traces = [_trace(own, variable, number, 0, wish) for number in numbers]
    if wish.other:
        other, second = _asked(wish.other, wish.variable)
        more = [_trace(other, second, number, 1, wish) for number in numbers if number < len(second.columns)]
        traces = _differences(traces, more, wish) if wish.view == "difference" else traces + more
    if wish.from_start and coordinate is not None:
        kind, label = "value", "time since the start (s)" if kind == "time" else f"{label}, from its start"
    return traces, kind, label, f"{variable.name} ({variable.units or '1'})"


def _asked(key, name):
    """Path of a product and its variable."""
    found = store_index.entry(key)
    variable = series.find(found.ref.path, name) if found else None
    if variable is None or not variable.plottable:
        raise Missing(f"{key[:12]} {name}: found no numbers along an axis")
    return found.ref.path, variable


def _along(path, variable, wish):
    """Coordinate that a figure runs along, its kind and its label."""
    if wish.without_gaps:
        return None, "index", f"{variable.dims[variable.axis]} (number of the sample, gaps left out)"
    return series.coordinate(path, variable)


def _trace(path, variable, number, product, wish):
    """One line of one product."""
    coordinate, _, _ = _along(path, variable, wish)
    whole = series.series(series.column(path, variable, number), coordinate)
    name, origin = variable.columns[number] or variable.name, store_index.origin(path)
    name = name if origin in ("", "measured") else f"{name} ({origin})"
    mark = f"{'AB'[product]} {name}" if wish.other else name
    return Trace(mark, whole, -float(whole.x[0]) if wish.from_start else 0.0, product, number)


def _differences(first, second, wish):
    """Lines of the first product minus those of the second."""
    found = []
    for one, other in zip(first, second, strict=False):
        shift = float(one.whole.x[0] - other.whole.x[0]) if wish.from_start else 0.0
        x, y = series.difference(one.whole, other.whole, shift)
        if x.size:
            whole = series.Series(x, y)
            names = dict.fromkeys(trace.label[2:] for trace in (one, other))
            found.append(Trace(f"A - B {' - '.join(names)}", whole, one.shift, 0, one.column))
    return found


def _lines(wish):
    """Figure of lines along the coordinate, and a sentence on what was left out."""
    traces, kind, along, unit = _traces(wish)
    drawn = _empty(kind, along, f"difference of {unit}" if wish.view == "difference" and wish.other else unit)
    ends = [(one.whole.x[0] + one.shift, one.whole.x[-1] + one.shift) for one in traces]
    low, high = (_drawn(np.array([f(side) for f, side in zip((min, max), zip(*ends, strict=True), strict=True)]), kind)
                 if ends else (0.0, 1.0))  # fmt: skip
    drawn.x_range.update(start=low, end=high, reset_start=low, reset_end=high)
    for number, one in enumerate(traces):
        x, y = series.view(one.whole)
        source = ColumnDataSource({"x": _drawn(x + one.shift, kind), "y": y}, name=f"line-{number}")
        _add(drawn, source, one, number)
    _finish(drawn, traces)
    return drawn, _said(traces)


def _spectra(wish):
    """Figure of amplitude spectral densities, and how they were computed."""
    traces, kind, along, unit = _traces(dataclasses.replace(wish, without_gaps=False))
    seconds = kind == "time" or along.endswith("(s)")
    scale = "frequency (Hz)" if seconds else "cycles per unit of the axis"
    drawn = _empty("log", scale, f"{unit[:-1]} Hz-1/2)" if seconds else unit)
    sentences = []
    for number, one in enumerate(traces):
        frequency, density, said = series.spectrum(one.whole)
        _add(drawn, ColumnDataSource({"x": frequency, "y": density}), one, number)
        sentences.append(said)
    _finish(drawn, traces)
    return drawn, "; ".join(dict.fromkeys(sentences))


def _empty(kind, along, unit):
    """Figure without lines in the look of the pages."""
    scales = {"time": {"x_axis_type": "datetime"}, "log": {"x_axis_type": "log", "y_axis_type": "log"}}.get(kind, {})
    ranges = {} if kind == "log" else {"x_range": Range1d()}
    drawn = bokeh_figure(name="figure", height=430, **TOOLS, **scales, **ranges)
    drawn.xaxis.axis_label, drawn.yaxis.axis_label = along, unit
    return styled(drawn)


def styled(drawn):
    """The same figure in the look of the pages."""
    drawn.toolbar.logo = drawn.outline_line_color = None
    for axis in (drawn.xaxis, drawn.yaxis):
        axis.axis_label_text_font, axis.major_label_text_font = FONT, FONT
        axis.axis_label_text_font_style, axis.axis_label_text_font_size = "normal", "12px"
        axis.major_label_text_color, axis.axis_label_text_color = GREY, "#1a1a1a"
        axis.axis_line_color, axis.major_tick_line_color, axis.minor_tick_line_color = GREY, GREY, None
    drawn.grid.grid_line_color = "#e6e6e6"
    return drawn


def _add(drawn, source, trace, number):
    """One line; the second product is dashed."""
    colour = COLOURS[trace.column % len(COLOURS)]
    dash = "solid" if trace.product == 0 else [5, 3]
    drawn.line("x", "y", source=source, color=colour, line_dash=dash, line_width=1.2, legend_label=trace.label,
               name=f"glyph-{number}")  # fmt: skip


def _finish(drawn, traces):
    """Legend above the figure, a click hides a line; a cross-hair shows values."""
    if traces:
        drawn.add_layout(drawn.legend[0], "above")
        drawn.legend.orientation, drawn.legend.click_policy = "horizontal", "hide"
        drawn.legend.border_line_color, drawn.legend.label_text_font = None, FONT
        drawn.legend.label_text_font_size, drawn.legend.padding, drawn.legend.margin = "12px", 0, 4
    stamp = type(drawn.x_scale).__name__ == "LinearScale" and type(drawn.xaxis[0]).__name__ == "DatetimeAxis"
    tips = [("", "@x{%F %T.%3N}"), ("GPS s", "@s{0.000}")] if stamp else [("", "@x{0.000000}")]
    tips.append(("", "@y{%.6g}"))
    drawn.add_tools(
        HoverTool(tooltips=tips, formatters={"@y": "printf"} | ({"@x": "datetime"} if stamp else {}), mode="mouse")
    )


def _said(traces):
    """How many samples stand behind the picture."""
    if not traces:
        return "The two products do not overlap. Count both from their start, or choose another."
    count = sum(one.whole.x.size for one in traces)
    said = f"{count:,} samples in {len(traces)} series; a point stands for the range of all samples it covers"
    gaps = 1 - min(one.whole.filled() for one in traces)
    return f'{said}. Gaps fill {100 * gaps:.0f} % of the axis: tick "without gaps".' if gaps > GAPS else said


def _drawn(x, kind):
    """Coordinate as the axis draws it: milliseconds for time."""
    return (x + series.UNIX_OF_EPOCH_S) * 1e3 if kind == "time" else x


def _undrawn(x, kind):
    """Coordinate of a place on the axis."""
    return x / 1e3 - series.UNIX_OF_EPOCH_S if kind == "time" else x


def _packed(values):
    """Doubles as base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


def over_years(calibration, satellite: str) -> dict | None:
    """Panels over time of one satellite, as Bokeh's embed_item takes them; None where there is no result."""
    own = [point for point in timeline.points(calibration) if point.satellite == satellite]
    if not own:
        return None
    said, orders = timeline.printed_points(calibration, satellite), timeline.levels(calibration)
    trimmed = timeline.trims(satellite) if calibration.trims else []
    panels = list(dict.fromkeys((point.panel, point.unit) for point in own))
    drawn, shared = [], {}
    for panel, unit in panels:
        one = _panel(f"{panel}\n({unit})", shared, (panel, unit) == panels[-1], "log" if panel in orders else "linear")
        shared = {"x_range": one.x_range}
        _values(one, [point for point in [*own, *said] if point.panel == panel])
        for trim in (trim for trim in trimmed if trim.axis == panel):
            _trim(one, trim)
        if panel in orders:
            values = [point.value for point in own if point.panel == panel]
            _level(one, *orders[panel], max(values))
        drawn.append(one)
    return json_item(column(drawn, sizing_mode="stretch_width"))


def _panel(label, shared, last, scale):
    """Empty panel of the time line."""
    axes = {"x_axis_type": "datetime", "y_axis_type": scale} | shared
    one = bokeh_figure(height=190 if last else 160, **TOOLS, **axes)
    if not shared:
        one.x_range.default_span = 365 * 86400e3  # ms, where there is one event only
    one.yaxis.axis_label, one.xaxis.visible = label, last
    one.add_tools(TapTool(callback=OpenURL(url="/event/@event", same_tab=True)))
    return styled(one)


def _points_of(own):
    """Points as columns for Bokeh."""
    known = {name: [getattr(point, name) for point in own] for name in ("date", "value", "event", "said")}
    spread = [point.sigma or 0.0 for point in own]
    bounds = {"low": [p.value - s for p, s in zip(own, spread, strict=True)],
              "high": [p.value + s for p, s in zip(own, spread, strict=True)]}  # fmt: skip
    return known | bounds | {"told": [rounded(point.value, point.sigma).replace("+-", "±") for point in own]}


def _values(panel, own):
    """Values with their errors, ours and printed; form and colour say the verdict."""
    for mood, (colour, marker, size, fill) in MOODS.items():
        source = ColumnDataSource(_points_of([point for point in own if point.mood == mood]))
        panel.segment("date", "low", "date", "high", source=source, color=colour, line_width=1.6)
        look = {"marker": marker, "size": size, "line_color": colour, "fill_color": fill or colour}
        marks = panel.scatter("date", "value", source=source, **look)
        of = [("printed" if mood == "printed" else "", "@event"), ("", "@date{%F}")]
        tips = [*of, ("value", "@told"), ("", "@said")]
        panel.add_tools(HoverTool(renderers=[marks], tooltips=tips, formatters=SHOWN))


def _trim(panel, trim):
    """A mass trim as a line, dashed where the printed series confirms it, dotted where not."""
    when = datetime.datetime.combine(trim.date, datetime.time(), datetime.UTC).timestamp() * 1e3
    panel.add_layout(Span(location=when, dimension="height", line_color=GREY,
                          line_dash="dashed" if trim.confirmed else "dotted"))  # fmt: skip
    panel.add_layout(Label(x=when, y=4, y_units="screen", text=f" trim {trim.trim_um:+.0f} µm",
                           text_font_size="10px", text_font=FONT, text_color=GREY))  # fmt: skip


def _level(panel, value, text, largest):
    """A printed order of magnitude as a line, always within the picture."""
    panel.y_range = Range1d(value / 5, 5 * max(value, largest))
    panel.add_layout(Span(location=value, dimension="width", line_color="#0072B2", line_dash="dashed"))
    panel.add_layout(Label(x=4, x_units="screen", y=value, y_offset=3, text=text, text_font_size="10px",
                           text_font=FONT, text_color="#0072B2"))  # fmt: skip
