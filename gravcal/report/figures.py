"""Figures of the reports: one style, colours that the colour-blind tell apart, bytes that depend on the data alone."""

import base64
import io

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

WIDTH_IN = 7.0
#: Okabe and Ito, Color Universal Design, 2008.
COLOURS = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "green": "#009E73",
    "yellow": "#F0E442",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "purple": "#CC79A7",
    "grey": "#8A8A8A",
}
AXIS = {
    "x": {"color": COLOURS["blue"]},
    "y": {"color": COLOURS["orange"]},
    "z": {"color": COLOURS["green"], "linestyle": "--"},
}
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # no search for room above the ticks: a tenth of the drawing time
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "lines.linewidth": 0.9,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
    "svg.hashsalt": "gravcal",
    "svg.fonttype": "path",
    "path.simplify": True,
}


def grid(rows, columns, height_in, **options):
    """Figure, height in inches, and its panels, always a (rows, columns) array of Axes.

    Options are those of Figure.subplots, and `margins`, {"left", "right", "top", "bottom", "hspace", "wspace"}.
    """
    margins = options.pop("margins", {})
    figure = Figure(figsize=(WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    ends = {"top": 1 - 0.36 / height_in, "bottom": 0.38 / height_in}
    figure.subplots_adjust(**({"left": 0.085, "right": 0.99} | ends | margins))
    return figure, panels


def legend(figure, panels, columns):
    """Legend of the panels (Axes, or an array of them) above all, to the right, in so many columns; each name once."""
    known = {}
    for panel in [panels] if hasattr(panels, "plot") else panels.ravel():
        handles, labels = panel.get_legend_handles_labels()
        known = dict(zip(labels, handles, strict=True)) | known
    top = 1 - 0.02 / figure.get_figheight()
    place = {"ncols": columns, "loc": "upper right", "bbox_to_anchor": (0.995, top), "borderpad": 0.0}
    figure.legend(known.values(), known.keys(), **place)


def thinned(x, y, most=800):
    """Curve (n,), (n,) with the lowest and highest point of each of `most` / 2 groups, where it has more points.

    A group without a known value, NaN in y, keeps one NaN, so that gaps stay open.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.size <= most:
        return x, y
    size = -(-x.size // (most // 2))
    rows = np.pad(y, (0, -x.size % size), constant_values=np.nan).reshape(-1, size)
    first = np.arange(len(rows)) * size
    ends = [first + np.argmin(np.where(np.isnan(rows), np.inf, sign * rows), axis=1) for sign in (1, -1)]
    kept = np.sort(np.stack(ends, axis=1), axis=1).ravel()
    return x[kept], y[kept]


def number_windows(panel, ends):
    """Dotted lines where windows that are joined end to end meet, and their numbers at the upper edge."""
    for end in ends[1:-1]:
        panel.axvline(end, color=COLOURS["grey"], linewidth=0.5, linestyle=":")
    if len(ends) > 2 and panel.get_title(loc="left"):
        for number, (start, stop) in enumerate(zip(ends[:-1], ends[1:], strict=True), start=1):
            place = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "top"}
            panel.annotate(str(number), ((start + stop) / 2, 0.99), fontsize=6, color="#767676", **place)


def image(draw, *given) -> str | None:
    """Figure that a function draws as a data address (SVG) for a page; None if there is nothing to show."""
    with matplotlib.rc_context(STYLE):
        figure = draw(*given)
        if figure is None:
            return None
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
