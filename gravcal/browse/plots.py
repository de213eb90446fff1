"""Figures of one or two products and of results over the years: drawn by Bokeh, data at the resolution of the view."""

import base64
import datetime
import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, HoverTool, Label, OpenURL, Range1d, Span, TapTool
from bokeh.plotting import figure as bokeh_figure
from bokeh.themes import Theme

from gravcal.browse import series, store_index, timeline
from gravcal.report.figures import COLOURS
from gravcal.report.plain import csv_text, gps_text
from gravcal.store.results import rounded

LINES = [COLOURS[name] for name in ("blue", "vermilion", "green", "purple", "sky", "orange")]
VIEWS = ("overlay", "difference", "spectrum")
DRAWN = 6  # series of one product, at most
MANY = 4_000_000  # samples; of more, only the first series is drawn unasked
GAPS = 0.5  # share of the axis that gaps may fill before the page says what to do
GREY = "#5a5a5a"
#: Colour, mark, its size and filling by verdict, and by origin where not all was measured; a diamond is drawn smaller.
MOODS, TOOLS = tomllib.loads(Path(__file__).with_name("plots.toml").read_text(encoding="utf-8")).values()
THEME = Theme(Path(__file__).with_name("theme.json"))


@dataclass(frozen=True)
class Wish:
    """Request for a figure of one variable."""

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
    """One line: label, its data, shift of its coordinate, number of product and column, kind of its values."""

    label: str
    whole: series.Series
    shift: float
    product: int
    column: int
    kind: str = "value"  #: "time" of GPS seconds


def chosen(variable, columns=()):
    """Indices (at most DRAWN) of the series of a Variable to draw: of columns those that exist, else the first ones."""
    wished = tuple(number for number in columns if 0 <= number < len(variable.columns))
    if wished:
        return wished[:DRAWN]
    length = variable.shape[variable.axis]
    return tuple(range(min(len(variable.columns), DRAWN if length * DRAWN <= MANY else 1)))


def figure(wish: Wish) -> dict:
    """Figure with its data, JSON for Bokeh's embed_item, and "said": text on samples, gaps or method."""
    traces, kind, along, unit = _traces(wish)
    if wish.view == "spectrum":
        seconds = kind == "time" or along.endswith("(s)")
        drawn = _empty("log", "frequency (Hz)" if seconds else "cycles per unit of the axis")
        drawn.yaxis.axis_label = f"{unit[:-1]} Hz-1/2)" if seconds else unit
        curves = [series.spectrum(one.whole) for one in traces]
        said = "; ".join(dict.fromkeys(one[2] for one in curves))
    else:
        values = traces[0].kind if traces else "value"
        drawn = _empty(kind, along, values)
        label = f"difference of {unit}" if wish.view == "difference" and wish.other else unit
        drawn.yaxis.axis_label = f"{wish.variable} (GPS time)" if values == "time" else label
        views = [series.view(one.whole) for one in traces]
        curves = [(_drawn(x + one.shift, kind), _drawn(y, one.kind)) for one, (x, y) in zip(traces, views, strict=True)]
        extents = [_drawn(one.whole.x[[0, -1]] + one.shift, kind) for one in traces] or [(0.0, 1.0)]
        low, high = np.min(extents), np.max(extents)
        drawn.x_range.update(start=low, end=high, reset_start=low, reset_end=high)
        said = "The two products do not overlap. Count both from their start, or choose another."
    if wish.view != "spectrum" and traces:
        count, gaps = sum(one.whole.x.size for one in traces), 1 - min(one.whole.filled() for one in traces)
        said = f"{count:,} samples in {len(traces)} series; a point stands for the range of all samples it covers"
        said += f'. Gaps fill {100 * gaps:.0f} % of the axis: tick "without gaps".' if gaps > GAPS else ""
    for number, (one, (x, y, *_)) in enumerate(zip(traces, curves, strict=True)):
        name = "spectrum" if wish.view == "spectrum" else "line"
        source = ColumnDataSource({"x": x, "y": y}, name=f"{name}-{number}")
        look = {"color": LINES[one.column % len(LINES)], "line_dash": "solid" if one.product == 0 else [5, 3]}
        drawn.line("x", "y", source=source, line_width=1.2, legend_label=one.label, **look)
    if traces:
        drawn.add_layout(drawn.legend[0], "above")
    return json_item(drawn, theme=THEME) | {"said": said}


def data(wish: Wish, start: float, stop: float) -> dict[str, dict[str, str]]:
    """{"line-k": {"x", "y"}} of a figure between two coordinates as drawn: little-endian doubles as base64."""
    traces, kind, _, _ = _traces(wish)
    bounds = [(_undrawn(start, kind) - one.shift, _undrawn(stop, kind) - one.shift) for one in traces]
    views = [series.view(one.whole, *bound) for one, bound in zip(traces, bounds, strict=True)]
    packed = lambda values: base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()  # noqa: E731
    return {
        f"line-{number}": {"x": packed(_drawn(x + one.shift, kind)), "y": packed(_drawn(y, one.kind))}
        for number, (one, (x, y)) in enumerate(zip(traces, views, strict=True))
    }


def table(wish: Wish, start=None, stop=None) -> str:
    """CSV of the lines of a figure, every sample between two places of its axis; of a spectrum all, and its method."""
    traces, kind, along, unit = _traces(wish)
    rows = []
    if wish.view == "spectrum":
        curves = [(one.label, *series.spectrum(one.whole)) for one in traces]
        rows = [(label, f, d) for label, *curve, _ in curves for f, d in zip(*curve, strict=True)]
        said = "".join(f"# {text}\n" for text in dict.fromkeys(text for *_, text in curves))
        return said + csv_text(("series", "frequency (Hz)", f"density of {unit}, Hz-1/2"), rows)
    timed = bool(traces) and traces[0].kind == "time"
    heads = ("series", *(("GPS time (s)", "calendar (GPS)") if kind == "time" else (along,)), unit)
    heads += (f"{wish.variable}, calendar (GPS)",) * timed
    for one in traces:
        bounds = [None if place is None else _undrawn(place, kind) - one.shift for place in (start, stop)]
        x, y = series.samples(one.whole, *bounds, most=MANY // 4)
        stamps = [(t, gps_text(t, 3)) if kind == "time" else (t,) for t in (x + one.shift).tolist()]
        values = [(t, gps_text(t, 3) if np.isfinite(t) else "") if timed else (t,) for t in y.tolist()]
        rows += [(one.label, *stamp, *value) for stamp, value in zip(stamps, values, strict=True)]
    return csv_text(heads, rows)


def _traces(wish):
    """([Trace], kind of the x axis ("time", "value", "index"), its label, "variable (unit)") of a figure."""
    wish = replace(wish, without_gaps=False) if wish.view == "spectrum" else wish
    own, variable = _asked(wish.key, wish.variable)
    coordinate, kind, label = _along(own, variable, wish)
    numbers = chosen(variable, wish.columns)
    traces = [_trace(own, variable, number, 0, wish) for number in numbers]
    if wish.other:
        other, second = _asked(wish.other, wish.variable)
        traces += [_trace(other, second, number, 1, wish) for number in numbers if number < len(second.columns)]
    if wish.other and wish.view == "difference":
        pairs, traces = zip(traces[: len(numbers)], traces[len(numbers) :], strict=False), []
        for one, two in pairs:
            shift = float(one.whole.x[0] - two.whole.x[0]) if wish.from_start else 0.0
            x, y = series.difference(one.whole, two.whole, shift)
            names = " - ".join(dict.fromkeys(trace.label[2:] for trace in (one, two)))
            traces += [Trace(f"A - B {names}", series.Series(x, y), one.shift, 0, one.column)] if x.size else []
    if wish.from_start and coordinate:
        kind, label = "value", "time since the start (s)" if kind == "time" else f"{label}, from its start"
    return traces, kind, label, f"{variable.name} ({variable.units or '1'})"


def _asked(key, name):
    """(path, Variable) of a product (key) and variable (name); `Missing` if it cannot be plotted."""
    entry = store_index.entry(key)
    variable = series.listed(entry.ref.path).get(name) if entry else None
    if variable is None or not variable.plottable:
        raise series.Missing(f"{key[:12]} {name}: found no numbers along an axis")
    return entry.ref.path, variable


def _along(path, variable, wish):
    """(name of the coordinate of the x axis, "" for sample numbers; its kind; its label)."""
    if wish.without_gaps:
        return "", "index", f"{variable.dims[variable.axis]} (number of the sample, gaps left out)"
    return series.coordinate(path, variable)


def _trace(path, variable, number, product, wish):
    """Trace of series ``number`` of a variable; product: 0, or 1 for the second one of a Wish."""
    coordinate, _, _ = _along(path, variable, wish)
    whole = series.series(path, variable.name, number, coordinate)
    name, origin = variable.columns[number] or variable.name, store_index.origin(path)
    name = name if origin in ("", "measured") else f"{name} ({origin})"
    mark = f"{'AB'[product]} {name}" if wish.other else name
    kind = "time" if wish.view != "spectrum" and series.is_time(path, variable.name) else "value"
    return Trace(mark, whole, -float(whole.x[0]) if wish.from_start else 0.0, product, number, kind)


def _empty(kind, along, values="value"):
    """Bokeh figure without lines; kinds of its x and y axis; hovering shows values."""
    axes = {"time": {"x_axis_type": "datetime"}, "log": {"x_axis_type": "log", "y_axis_type": "log"}}.get(kind, {})
    ranges = {} if kind == "log" else {"x_range": Range1d()}
    axes |= {"y_axis_type": "datetime"} if values == "time" else {}
    drawn = bokeh_figure(name="figure", height=430, x_axis_label=along, **TOOLS, **axes, **ranges)
    tips = [("", "@x{%F %T.%3N}"), ("GPS s", "@s{0.000}")] if kind == "time" else [("", "@x{0.000000}")]
    tips += [("", "@y{%F %T.%3N}"), ("GPS s", "@t{0.000}")] if values == "time" else [("", "@y{%.6g}")]
    formats = {"@x": "datetime"} if kind == "time" else {}
    formats["@y"] = "datetime" if values == "time" else "printf"
    drawn.add_tools(HoverTool(tooltips=tips, formatters=formats, mode="mouse"))
    return drawn


def _drawn(x, kind):
    """Coordinate as drawn: GPS s become ms past 1970-01-01 for kind "time", others stay."""
    return (x + series.UNIX_OF_EPOCH_S) * 1e3 if kind == "time" else x


def _undrawn(x, kind):
    """Coordinate from a position on the axis, inverse of `_drawn`."""
    return x / 1e3 - series.UNIX_OF_EPOCH_S if kind == "time" else x


def over_years(calibration, satellite: str) -> dict | None:
    """Panels over time of the results of one satellite, JSON for Bokeh's embed_item; None without results."""
    ours = [point for point in timeline.points(calibration) if point.satellite == satellite]
    if not ours:
        return None
    points, printed_levels = [*ours, *timeline.printed_points(calibration, satellite)], timeline.levels(calibration)
    trims = timeline.trims(satellite) if calibration.trims else []
    panels = list(dict.fromkeys((point.panel, point.unit) for point in ours))
    drawn, axes = [], {"x_axis_type": "datetime"}
    for panel, unit in panels:
        last = (panel, unit) == panels[-1]
        scale = "log" if panel in printed_levels else "linear"
        one = bokeh_figure(height=190 if last else 160, y_axis_type=scale, **TOOLS, **axes)
        one.yaxis.axis_label, one.xaxis.visible = f"{panel}\n({unit})", last
        one.add_tools(TapTool(callback=OpenURL(url="/event/@event", same_tab=True)))
        axes = {"x_range": one.x_range, "x_axis_type": "datetime"}
        of_panel = [point for point in points if point.panel == panel]
        frame = pd.DataFrame([asdict(point) for point in of_panel])
        spread = frame["sigma"].astype(float).fillna(0.0)
        frame["low"], frame["high"] = frame["value"] - spread, frame["value"] + spread
        frame["told"] = [rounded(point.value, point.sigma).replace("+-", "±") for point in of_panel]
        frame["printed"] = ["printed" if point.mood == "printed" else "" for point in of_panel]
        frame[["colour", "marker", "size", "filled"]] = [MOODS[point.mood] for point in of_panel]
        source = ColumnDataSource(frame.to_dict("list"))
        one.segment("date", "low", "date", "high", source=source, color="colour", line_width=1.6)
        look = {"marker": "marker", "size": "size", "line_color": "colour", "fill_color": "filled"}
        marks = one.scatter("date", "value", source=source, **look)
        tips = [("@printed", "@event"), ("", "@date{%F}"), ("value", "@told"), ("", "@said")]
        one.add_tools(HoverTool(renderers=[marks], tooltips=tips, formatters={"@date": "datetime"}))
        for trim in (trim for trim in trims if trim.axis == panel):
            trim_ms = datetime.datetime.combine(trim.date, datetime.time(), datetime.UTC).timestamp() * 1e3
            dash = "dashed" if trim.confirmed else "dotted"  # where the printed series does not confirm it
            one.add_layout(Span(location=trim_ms, dimension="height", line_color=GREY, line_dash=dash))
            text = f" trim {trim.trim_um:+.0f} µm"
            one.add_layout(Label(x=trim_ms, y=4, y_units="screen", text=text, text_color=GREY))
        if panel in printed_levels:
            level, text = printed_levels[panel]
            one.y_range = Range1d(level / 5, 5 * max([level, *(point.value for point in ours if point.panel == panel)]))
            one.add_layout(Span(location=level, dimension="width", line_color="#0072B2", line_dash="dashed"))
            one.add_layout(Label(x=4, x_units="screen", y=level, y_offset=3, text=text, text_color="#0072B2"))
        drawn.append(one)
    drawn[0].x_range.default_span = 365 * 86400e3  # ms, where there is one event only
    return json_item(column(drawn, sizing_mode="stretch_width"), theme=THEME)
