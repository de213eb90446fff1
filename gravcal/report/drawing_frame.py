"""What stands round the marks of a drawing: scales with their numbers, titles, legends."""

from __future__ import annotations

import html
import math
import re

import numpy as np

from gravcal.report.drawing import FINE, WIDTH, Look, Panel, marked

INK, FAINT, NUMBERS = "#1a1a1a", "#e4e4e4", 9.6
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
WIDE, NARROW = "mwMW", "iljtfrI.,:;'() "  # letters far from the mean width
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def drawn(height: float, title: str, *parts: str) -> str:
    """Drawing of panels and legends, to stand in a page.

    Parameters
    ----------
    height : of the drawing
    title : what it shows, for who cannot see it
    parts : SVG text
    """
    size = f'viewBox="0 0 {WIDTH} {height:g}" font-size="10.2" fill="{INK}"'
    return f'<svg role="img" aria-label="{html.escape(title)}" {size}>{"".join(parts)}</svg>'


def framed(panel: Panel, *marks: str, **words) -> str:
    """Panel with its grid, marks, scales and words.

    Parameters
    ----------
    panel : Panel
    marks : SVG text of `gravcal.report.drawing`
    words : "title", "x_label", "y_label"; "x_numbers", whether they are written, or {value: text} to be written;
        "y_numbers", whether they are written
    """
    left, top, width, height = panel.box
    across, down = _scale(panel, words.get("x_numbers", True)), _y_scale(panel, words.get("y_numbers", True))
    x_at = {round(left + width * _part(v, panel.x, panel.log), 1): t for v, t in across.items()}
    y_at = {round(top + height * (1 - _part(v, panel.y, panel.log)), 1): t for v, t in down.items()}
    named = isinstance(words.get("x_numbers"), dict)
    grid = "".join(f"M{left:g} {y:g}h{width:g}" for y in y_at)
    grid += "" if named else "".join(f"M{x:g} {top:g}v{height:g}" for x in x_at)
    ticks = "".join(f"M{x:g} {top + height:g}v2.5" for x in x_at) + "".join(f"M{left:g} {y:g}h-2.5" for y in y_at)
    ticks += _small_ticks(panel) if panel.log else ""
    inside = f'x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}" viewBox="0 0 {FINE * width:g} '
    return (
        f'<path d="{grid}" stroke="{FAINT}" stroke-width=".5"/>'
        f'<svg {inside}{FINE * height:g}" fill="none" stroke-linejoin="round">{"".join(marks)}</svg>'
        f'<path d="M{left:g} {top:g}v{height:g}h{width:g}{ticks}" fill="none" stroke="{INK}" stroke-width=".6"/>'
        + _numbers(panel, x_at, y_at)
        + _words(panel, words)
    )


def _small_ticks(panel):
    """Ticks of a logarithmic panel between the powers of ten."""
    left, top, width, height = panel.box
    wanted = [d * f for d in 10.0 ** np.arange(-20, 20) for f in range(2, 10)]
    across = [left + width * _part(v, panel.x, True) for v in wanted if panel.x[0] <= v <= panel.x[1]]
    down = [top + height * (1 - _part(v, panel.y, True)) for v in wanted if panel.y[0] <= v <= panel.y[1]]
    return "".join(f"M{x:.1f} {top + height:g}v1.5" for x in across) + "".join(f"M{left:g} {y:.1f}h-1.5" for y in down)


def _part(value, ends, log):
    """Position between the ends, 0 to 1."""
    if log:
        value, ends = math.log10(value), tuple(map(math.log10, ends))
    return (value - ends[0]) / (ends[1] - ends[0])


def _scale(panel, numbers):
    """Texts of the lower scale by value; empty ones where they are not written."""
    if isinstance(numbers, dict):
        return numbers
    found = decades(*panel.x) if panel.log else round_numbers(*panel.x, max(2, int(panel.box[2] / 45)))
    return found if numbers else dict.fromkeys(found, "")


def _y_scale(panel, numbers):
    """Texts of the left scale by value; empty ones where they are not written."""
    found = decades(*panel.y) if panel.log else round_numbers(*panel.y, max(2, int(panel.box[3] / 18)))
    return found if numbers else dict.fromkeys(found, "")


def round_numbers(low: float, high: float, count: int) -> dict[float, str]:
    """About so many round numbers between two values, with their texts.

    Parameters
    ----------
    low, high : values
    count : how many are wanted
    """
    size = 10.0 ** math.floor(math.log10((high - low) / count))
    found = [(s, *_whole(low, high, s * size)) for s in STEPS]
    share, first, last = min(found, key=lambda one: (abs(one[2] - one[1] + 1 - count), one[1] - one[2]))
    step = share * size
    decimals = max(0, -math.floor(math.log10(step) + 1e-9) + (share == 2.5))
    texts = (f"{k * step + 0.0:.{decimals}f}".replace("-", "−") for k in range(first, last + 1))
    return dict(zip((k * step for k in range(first, last + 1)), texts, strict=True))


def _whole(low, high, step):
    """First and last multiple of a step between two values."""
    return math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)


def decades(low: float, high: float) -> dict[float, str]:
    """Powers of ten between two values, with their texts; every other where there are many.

    Parameters
    ----------
    low, high : positive
    """
    powers = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
    powers = powers[:: 1 + len(powers) // 6]
    return {10.0**p: f"{10.0**p:g}" if -3 < p < 4 else f"10{str(p).translate(RAISED)}" for p in powers}


def _numbers(panel, x_at, y_at):
    """Numbers of both scales."""
    left, top, _, height = panel.box
    below = [_stacked(x, top + height + 12, t) for x, t in x_at.items() if t]
    beside = [f'<text x="{left - 5:g}" y="{y + 3.4:.1f}" text-anchor="end">{t}</text>' for y, t in y_at.items() if t]
    return f'<g font-size="{NUMBERS}">{"".join(below + beside)}</g>'


def _stacked(x, y, text):
    """Centred text, its lines below each other."""
    lines = (f'<tspan x="{x:g}" dy="{11 * (i > 0)}">{html.escape(t)}</tspan>' for i, t in enumerate(text.split("\n")))
    return f'<text x="{x:g}" y="{y:g}" text-anchor="middle">{"".join(lines)}</text>'


def _words(panel, words):
    """Title above, labels below and beside."""
    left, top, width, height = panel.box
    found = []
    if words.get("title"):
        found.append(f'<text x="{left:g}" y="{top - 5:g}">{lowered(words["title"])}</text>')
    if words.get("x_label"):
        text = lowered(words["x_label"])
        found.append(f'<text x="{left + width / 2:.1f}" y="{top + height + 28:g}" text-anchor="middle">{text}</text>')
    if words.get("y_label"):
        x, y = max(left - 46, 11), top + height / 2
        turned = f'transform="translate({x:g} {y:.1f}) rotate(-90)" text-anchor="middle"'
        found.append(f"<text {turned}>{lowered(words['y_label'])}</text>")
    return "".join(found)


def lowered(text: str) -> str:
    """SVG text with the letter after each "_" below the line.

    Parameters
    ----------
    text : plain
    """
    lower = r'<tspan dy="2.4" font-size="7.4">\1</tspan><tspan dy="-2.4">&#8203;</tspan>'
    return re.sub(r"_(\w)", lower, html.escape(text))


def legend(entries: dict[str, Look | tuple[str, float]], top: float = 12.0) -> str:
    """Names of the looks, from the right edge of the drawing to the left; a band is its colour and opacity.

    Parameters
    ----------
    entries : {name: Look or (colour, opacity)}
    top : height of the middle of the line
    """
    right, parts = WIDTH - 8.0, []
    for name, look in reversed(entries.items()):
        right -= sum(8.8 if c in WIDE else 3.9 if c in NARROW else 5.9 for c in name)
        parts.append(f'<text x="{right:.1f}" y="{top + 3.4:g}">{html.escape(name)}</text>')
        parts.append(_sample(look, right - 24, top))
        right -= 38
    return f'<g font-size="{NUMBERS}">{"".join(reversed(parts))}</g>'


def _sample(look, x, y):
    """Short piece of a look."""
    if isinstance(look, tuple):
        return f'<rect x="{x:.1f}" y="{y - 4:g}" width="18" height="8" fill="{look[0]}" fill-opacity="{look[1]:g}"/>'
    dash = f' stroke-dasharray="{" ".join(f"{d:g}" for d in look.dash)}"' if look.dash else ""
    drawn_line = f'<path d="M{x:.1f} {y:g}h18" stroke="{look.colour}" stroke-width="{look.width:g}"{dash}/>'
    point = marked([(round(x + 9, 1), y)], look) if look.shape else ""
    return (drawn_line if look.width else "") + point


def note(panel: Panel, value: float, text: str) -> str:
    """Small grey text at the upper edge of a panel.

    Parameters
    ----------
    panel : Panel
    value : on the lower scale
    text : plain
    """
    left, top, width, _ = panel.box
    x = left + width * _part(value, panel.x, panel.log)
    return f'<text x="{x:.1f}" y="{top + 8:g}" font-size="9" fill="#767676" text-anchor="middle">{text}</text>'
