"""Figures of the reports: one style, colours safe for colour-blind readers, bytes that depend on the data alone."""

import base64
import io
import tomllib
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

WIDTH_IN = 7.0
LOOKS = tomllib.loads(Path(__file__).with_name("figures.toml").read_text(encoding="utf-8"))
COLOURS = LOOKS["colours"]
AXIS = {axis: {"color": COLOURS[name]} for axis, name in zip("xyz", ("blue", "orange", "green"), strict=True)}
AXIS["z"]["linestyle"] = "--"
#: Mark, colour and label by what a value is; no line joins ours.
MARKS = {name: (mark, COLOURS[colour], label) for name, (mark, colour, label) in LOOKS["marks"].items()}
#: How every spectrum on a page is made; how long the stretches are, and how many, follows.
HANN = "Spectra: periodograms under a Hann window"
BARE = "Spectra: periodograms without a window"
STYLE = matplotlib.rc_params_from_file(Path(__file__).with_name("report.mplstyle"), use_default_template=False)


def grid(rows, columns, height_in, *, xlabel="", ylabels=(), titles=(), margins=None, **options):
    """(Figure of a height in inches, (rows, columns) array of Axes).

    The label of x stands under the last row, those of y at the first column, titles above the panels in order. Margins
    {"left", "right", "top", "bottom", "hspace", "wspace"} and other options are those of Figure.subplots.
    """
    figure = Figure(figsize=(WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    ends = {"left": 0.085, "right": 0.98, "top": 1 - 0.36 / height_in, "bottom": 0.38 / height_in}
    figure.subplots_adjust(**(ends | (margins or {})))
    for panel in panels[-1]:
        panel.set_xlabel(xlabel)
    for panel, label in zip(panels[:, 0], ylabels, strict=False):
        panel.set_ylabel(label)
    for panel, title in zip(panels.ravel(), titles, strict=False):
        panel.set_title(title)
    return figure, panels


def bars(panel, x, y, sigma, **style):
    """Draw values y with error bars sigma (None: no bars) as points at x; style as of Axes.errorbar."""
    look = {"marker": "o", "markersize": 3.8, "linestyle": "none", "elinewidth": 0.9, "capsize": 2}
    panel.errorbar(x, y, sigma, **(look | style))


def opened(x, y, gap):
    """x, y (n,) with NaN inserted where x increases by more than a gap, so that no line bridges it."""
    jumps = np.flatnonzero(np.diff(x) > gap) + 1
    return np.insert(np.asarray(x, dtype=float), jumps, np.nan), np.insert(np.asarray(y, dtype=float), jumps, np.nan)


def density(pieces, step):
    """Frequency (m,) Hz, one-sided amplitude density (m, ...), Hann window, mean power of pieces (n, ...), step s."""
    pieces = [np.asarray(piece, dtype=float) for piece in pieces]
    length = len(pieces[0])
    taper = np.hanning(length)
    power = [np.abs(np.fft.rfft(taper * piece.T)).T ** 2 for piece in pieces]
    scale = np.sqrt(2 * step / np.sum(taper**2))
    return np.fft.rfftfreq(length, step)[1:], scale * np.sqrt(np.mean(power, axis=0))[1:]


def thinned(x, y, most=800):
    """x, y reduced to the lowest and highest point of each of `most` / 2 groups, where there are more than `most`.

    A group without a known value, NaN in y, keeps one NaN, so that gaps stay open.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.size <= most:
        return x, y
    size = -(-x.size // (most // 2))
    rows = np.pad(y, (0, -x.size % size), constant_values=np.nan).reshape(-1, size)
    first = np.arange(len(rows)) * size
    extremes = [first + np.argmin(np.where(np.isnan(rows), np.inf, sign * rows), axis=1) for sign in (1, -1)]
    kept = np.sort(np.stack(extremes, axis=1), axis=1).ravel()
    return x[kept], y[kept]


def joined(time, start, stop):
    """Times (n,) s with windows (start, stop) laid end to end from 0, and the edges (windows + 1,) s of these."""
    order = np.argsort(start)
    start, stop = np.asarray(start)[order], np.asarray(stop)[order]
    ends = np.concatenate([[0.0], np.cumsum(stop - start)])
    index = np.clip(np.searchsorted(start, time, side="right") - 1, 0, start.size - 1)
    return time - start[index] + ends[index], ends


def number_windows(panel, ends):
    """Dotted lines where windows that are joined end to end meet, and their numbers at the upper edge."""
    for end in ends[1:-1]:
        panel.axvline(end, color=COLOURS["grey"], linewidth=0.5, linestyle=":")
    if len(ends) > 2 and panel.get_title(loc="left"):
        for number, (start, stop) in enumerate(zip(ends[:-1], ends[1:], strict=True), start=1):
            place = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "top"}
            panel.annotate(str(number), ((start + stop) / 2, 0.99), fontsize=6, color="#767676", **place)


def image(draw, *inputs) -> str | None:
    """Data URL (SVG) of the figure that ``draw(*inputs)`` returns, for a page; None if that returns None.

    Above its panels, to the right, stands a legend of all, each name once, unless a panel has its own.
    """
    with matplotlib.rc_context(STYLE):
        figure, known = draw(*inputs), {}
        if figure is None:
            return None
        for panel in figure.axes:
            for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
                known.setdefault(label, handle)
        if known and not any(panel.get_legend() for panel in figure.axes):
            place = {"bbox_to_anchor": (0.995, 1 - 0.02 / figure.get_figheight()), "borderpad": 0.0}
            figure.legend(known.values(), known.keys(), ncols=len(known), loc="upper right", **place)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def over_time(labels):
    """Figure with one panel below the other, labels those of y, and its panels (n,), for values over the years."""
    look = {"ylabels": labels, "margins": {"hspace": 0.12, "left": 0.11}}
    drawn, panels = grid(len(labels), 1, 0.6 + 1.5 * len(labels), sharex=True, **look)
    for panel in panels[:, 0]:
        panel.margins(y=0.12)
    return drawn, panels[:, 0]


def mark(panel, kind, points, label=None):
    """Draw points (date, value, sigma or None) of a kind of `MARKS`; printed ones are hollow and joined."""
    form, colour, name = MARKS[kind]
    look = {"markerfacecolor": "white", "linestyle": "-", "capsize": 0} if kind == "printed" else {}
    if points:
        dates, values, sigmas = zip(*points, strict=True)
        spread = [sigma or 0.0 for sigma in sigmas]
        bars(panel, dates, values, spread, color=colour, marker=form, linewidth=0.7, label=label or name, **look)
