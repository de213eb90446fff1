"""Drawings of the reports as SVG text: lines, points, bands in panels. Quick to make, sharp on paper.

Lengths are hundredths of an inch on paper 7 inch wide; marks are placed on a grid ten times finer, in whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

WIDTH = 700
FINE = 10
FAR = 100_000  # beyond every panel, in steps of the fine grid
USUAL = 4096  # steps between points of a line


@dataclass(frozen=True)
class Look:
    """How a series is drawn.

    Attributes
    ----------
    colour : of COLOURS
    width : of the line, 0 for none
    dash : lengths drawn and left out in turn
    shape : of the points: "circle", "square", "triangle", "diamond", or "" for none
    size : of the points
    hollow : bool, points not filled
    """

    colour: str
    width: float = 0.9
    dash: tuple[float, ...] = ()
    shape: str = ""
    size: float = 4.0
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """Rectangle of a drawing with its scales.

    Attributes
    ----------
    box : left, top, width, height
    x, y : first and last value
    log : bool, both scales logarithmic
    """

    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    log: bool = False


def boxes(rows: int, columns: int, height: float, **margins: float) -> list[list[tuple]]:
    """Boxes of equal panels, row by row.

    Parameters
    ----------
    rows, columns : number of panels
    height : of the drawing
    margins : "left", "right", "top", "bottom", "across" and "down" between panels, where they differ from the usual
    """
    room = {"left": 58, "right": 8, "top": 34, "bottom": 40, "across": 58, "down": 12} | margins
    wide = (WIDTH - room["left"] - room["right"] - (columns - 1) * room["across"]) / columns
    high = (height - room["top"] - room["bottom"] - (rows - 1) * room["down"]) / rows
    lefts = [room["left"] + i * (wide + room["across"]) for i in range(columns)]
    tops = [room["top"] + i * (high + room["down"]) for i in range(rows)]
    return [[(round(a, 1), round(b, 1), round(wide, 1), round(high, 1)) for a in lefts] for b in tops]


def limits(*series, margin: float = 0.06) -> tuple[float, float]:
    """Smallest and largest value of some series with a margin either side.

    Parameters
    ----------
    series : arrays, NaN where nothing is known
    margin : share of the range
    """
    known = [np.asarray(one, dtype=float).ravel() for one in series]
    known = np.concatenate([np.zeros(0), *(one[np.isfinite(one)] for one in known)])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = margin * (high - low) or margin * abs(high) or 1.0
    return low - room, high + room


def placed(panel: Panel, x, y) -> tuple[np.ndarray, np.ndarray]:
    """Places on the fine grid, from the panel's upper left corner.

    Parameters
    ----------
    panel : Panel
    x, y : (n,)
    """
    _, _, width, height = panel.box
    across = _share(x, panel.x, panel.log) * FINE * width
    down = (1 - _share(y, panel.y, panel.log)) * FINE * height
    return np.clip(across, -FAR, FAR), np.clip(down, -FAR, FAR)


def _share(values, ends, log):
    """Position between the ends, 0 to 1."""
    values = np.asarray(values, dtype=float)
    if log:
        with np.errstate(divide="ignore", invalid="ignore"):
            values, ends = np.log10(values), np.log10(ends)
    return (values - ends[0]) / (ends[1] - ends[0])


def line(panel: Panel, x, y, look: Look) -> str:
    """Line through points in order of x, broken where a value is missing.

    Parameters
    ----------
    panel : Panel
    x, y : (n,)
    look : Look
    """
    across, down = placed(panel, x, y)
    known = np.isfinite(across) & np.isfinite(down)
    turns = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    drawn = "".join(_path(_thinned(np.stack([across[a:b], down[a:b]], axis=1))) for a, b in turns.reshape(-1, 2))
    return _stroked(drawn, look)


def _path(points):
    """Path through whole numbers (n, 2)."""
    points = np.rint(points).astype(int)
    first, rest = points[0], np.diff(points, axis=0).ravel()
    usual = rest.size == 0 or np.abs(rest).max() <= USUAL
    words = _usual()[rest + USUAL].tolist() if usual else map(str, rest.tolist())
    return f"M{first[0]} {first[1]}l{' '.join(words) or '0 0'}"


@lru_cache(maxsize=1)
def _usual():
    """Text of the steps that nearly all lines take; looking it up takes a sixth of the time of writing it."""
    return np.array([str(step) for step in range(-USUAL, USUAL + 1)], dtype=object)


def _thinned(points):
    """Lowest and highest point of every unit across, where there are more."""
    count = int((points[-1, 0] - points[0, 0]) / FINE) + 1
    each = len(points) // max(count, 1)
    if each < 3:
        return points
    whole = len(points) // each * each
    groups = points[:whole].reshape(-1, each, 2)
    ends = np.sort(np.stack([groups[:, :, 1].argmin(axis=1), groups[:, :, 1].argmax(axis=1)], axis=1), axis=1)
    return np.concatenate([groups[np.arange(len(groups))[:, None], ends].reshape(-1, 2), points[-1:]])


def _stroked(path, look):
    """Path drawn as a line."""
    dash = f' stroke-dasharray="{" ".join(f"{FINE * d:g}" for d in look.dash)}"' if look.dash else ""
    return f'<path d="{path}" stroke="{look.colour}" stroke-width="{FINE * look.width:g}"{dash}/>' if path else ""


def steps(panel: Panel, x, y, look: Look) -> str:
    """Values held from each point to the next.

    Parameters
    ----------
    panel : Panel
    x, y : (n,)
    look : Look
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    kept = np.flatnonzero(np.concatenate([[True], (y[1:] != y[:-1]) | np.isnan(y[1:])])) if y.size else []
    at = np.append(x[kept], x[-1:])
    return line(panel, np.repeat(at, 2)[1:-1], np.repeat(y[kept], 2), look)


def dots(panel: Panel, x, y, look: Look) -> str:
    """Points with the shape of a look.

    Parameters
    ----------
    panel : Panel
    x, y : (n,)
    look : Look
    """
    across, down = (np.atleast_1d(part) for part in placed(panel, x, y))
    known = np.isfinite(across) & np.isfinite(down)
    at = np.rint(np.stack([across, down], axis=1)[known]).astype(int).tolist()
    return marked(at, look, FINE)


def marked(at: list, look: Look, scale: float = 1) -> str:
    """Shapes at places.

    Parameters
    ----------
    at : list of (x, y)
    look : Look
    scale : of the grid
    """
    if not at:
        return ""
    r = round(scale * look.size / 2, 1)
    outline = {
        "circle": f"m{-r:g} 0a{r:g} {r:g} 0 1 0 {2 * r:g} 0a{r:g} {r:g} 0 1 0 {-2 * r:g} 0z",
        "square": f"m{-r:g} {-r:g}h{2 * r:g}v{2 * r:g}h{-2 * r:g}z",
        "triangle": f"m0 {-1.15 * r:g}l{1.15 * r:g} {2 * r:g}h{-2.3 * r:g}z",
        "diamond": f"m0 {-1.3 * r:g}l{1.3 * r:g} {1.3 * r:g}l{-1.3 * r:g} {1.3 * r:g}l{-1.3 * r:g} {-1.3 * r:g}z",
    }[look.shape]
    path = "".join(f"M{x:g} {y:g}{outline}" for x, y in at)
    fill = "none" if look.hollow else look.colour
    edge = f' stroke="{look.colour}" stroke-width="{0.6 * scale:g}"' if look.hollow else ' stroke="none"'
    return f'<path d="{path}" fill="{fill}"{edge}/>'


def bars(panel: Panel, x, low, high, look: Look) -> str:
    """Upright bars with short ends, such as errors.

    Parameters
    ----------
    panel : Panel
    x, low, high : (n,)
    look : Look
    """
    across, top = placed(panel, x, high)
    _, bottom = placed(panel, x, low)
    cap = 2 * FINE
    known = np.isfinite(across) & np.isfinite(top) & np.isfinite(bottom)
    rows = np.rint(np.stack([across, top, bottom], axis=1)[known]).astype(int).tolist()
    path = "".join(f"M{a - cap} {t}h{2 * cap}m{-cap} 0V{b}m{-cap} 0h{2 * cap}" for a, t, b in rows)
    return _stroked(path, look)


def level(panel: Panel, value: float, look: Look) -> str:
    """Line across the panel.

    Parameters
    ----------
    panel : Panel
    value : scalar
    look : Look
    """
    return line(panel, panel.x, [value, value], look)


def upright(panel: Panel, values, look: Look) -> str:
    """Lines from top to bottom of the panel.

    Parameters
    ----------
    panel : Panel
    values : sequence
    look : Look
    """
    return "".join(line(panel, [value, value], panel.y, look) for value in values)


def band(panel: Panel, low: float, high: float, colour: str, opacity: float) -> str:
    """Coloured strip across the panel.

    Parameters
    ----------
    panel : Panel
    low, high : values
    colour : of COLOURS
    opacity : 0 to 1
    """
    _, (top, bottom) = placed(panel, [panel.x[0]] * 2, [high, low])
    size = f'width="{FINE * panel.box[2]:g}" height="{max(bottom - top, 1):.0f}"'
    return f'<rect x="0" y="{top:.0f}" {size} fill="{colour}" fill-opacity="{opacity:g}"/>'


def strip(panel: Panel, start: float, stop: float, colour: str, opacity: float) -> str:
    """Coloured strip from top to bottom of the panel.

    Parameters
    ----------
    panel : Panel
    start, stop : values
    colour : of COLOURS
    opacity : 0 to 1
    """
    (left, right), _ = placed(panel, [start, stop], [panel.y[0]] * 2)
    size = f'width="{max(right - left, 1):.0f}" height="{FINE * panel.box[3]:g}"'
    return f'<rect x="{left:.0f}" y="0" {size} fill="{colour}" fill-opacity="{opacity:g}"/>'
