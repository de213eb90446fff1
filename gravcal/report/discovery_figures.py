"""Figures of a discovery: where the excess sits, spectra of the residuals, residuals along time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.report.drawing import Look, Panel, band, boxes, dots, level, limits, line
from gravcal.report.drawing_frame import drawn, framed, legend
from gravcal.report.drawing_looks import DASHED
from gravcal.report.figures import COLOURS

BEFORE = Look(COLOURS["vermilion"], 0.9, shape="circle", size=4.0)
AFTER = Look(COLOURS["blue"], 0.9, shape="square", size=4.0, hollow=True)
POINTS = {"baseline": Look(COLOURS["vermilion"], 0, shape="circle", size=4.0)}
POINTS |= {"extended model": Look(COLOURS["blue"], 0, shape="square", size=4.4, hollow=True)}
LINES = {"baseline": Look(COLOURS["vermilion"], 0.9), "extended model": Look(COLOURS["blue"], 0.9)}
NOISE = Look(COLOURS["black"], 0.6, dash=DASHED)
WITHIN = (COLOURS["black"], 0.1)  # one sigma
BINS = 24
CURVE = 60  # rows of a channel and block below which they are no curve


def power(found, kind="manoeuvre"):
    """Power over expected noise of each channel, block and band, before and after.

    Parameters
    ----------
    found : Dataset of kind discovery
    kind : what the blocks are called
    """
    names = found.attrs["channels"].split()
    tested = [k for k in range(len(names)) if np.any(found["test_channel"].values == k)]
    if not tested:
        return None
    height = 46 + 92 * len(tested)
    parts = [legend(POINTS | {"noise": NOISE})]
    blocks, bands = found["test_block"].values, found["test_band"].values
    each, size = (1, 4.0) if blocks.max() < 40 else (10, 2.4)  # block that is numbered, size of the points
    for row, ((box,), k) in enumerate(zip(boxes(len(tested), 1, height, down=16), tested, strict=True)):
        here = found["test_channel"].values == k
        x = blocks[here] + 1 + (bands[here] - 1.5) * 0.18
        series = [found[f"power_{w}"].values[here] for w in ("before", "after")]
        panel = Panel(box, (0.4, blocks.max() + 1.6), limits(*series, np.array([0.8, 1.2]), margin=0.12))
        marks = [level(panel, 1.0, NOISE)]
        marks += [dots(panel, x, y, replace(look, size=size)) for y, look in zip(series, POINTS.values(), strict=True)]
        words = {"x_numbers": False}
        if row == len(tested) - 1:
            numbers = {float(i): _number(found, i) for i in range(each, int(blocks.max()) + 2, each)}
            words = {"x_label": f"{kind}, four bands from low to high frequency", "x_numbers": numbers}
        parts.append(framed(panel, *marks, y_label=names[k], **words))
    return drawn(height, "power of the residual against noise", *parts)


def _number(found, place):
    """Number of a block: that in its name, its place among all where it has none."""
    name = found.attrs["blocks"].split(", ")[place - 1]
    return name.removeprefix("manoeuvre ") if name.startswith("manoeuvre ") else str(place)


def spectra(found):
    """Spectrum of the whitened residuals of each channel, mean over manoeuvres and axes, against that of noise.

    Parameters
    ----------
    found : Dataset of kind discovery
    """
    names = found.attrs["channels"].split()
    drawn_now = [(k, *_spectrum(found, k)) for k in range(len(names))]
    drawn_now = [one for one in drawn_now if one[1] is not None]
    if not drawn_now:
        return None
    rows = (len(drawn_now) + 1) // 2
    height = 60 + 120 * rows
    parts, places = [legend(LINES | {"noise": NOISE})], [b for row in boxes(rows, 2, height, down=44) for b in row]
    for (k, frequency, before, after), box in zip(drawn_now, places, strict=False):
        panel = Panel(box, (0.0, frequency[-1]), limits(before, after, np.array([0.5, 1.5])))
        marks = [level(panel, 1.0, NOISE)]
        marks += [line(panel, frequency, y, look) for y, look in zip((before, after), LINES.values(), strict=True)]
        parts.append(framed(panel, *marks, title=names[k], x_label="frequency (Hz)", y_label="power over noise"))
    return drawn(height, "spectra of the residuals", *parts)


def _spectrum(found, channel):
    """Frequencies Hz, and mean power before and after; None where the channel has too few rows."""
    here = found["channel"].values == channel
    pairs = [(b, axis) for b in np.unique(found["block"].values[here]) for axis in range(3)]
    rows = [here & (found["block"].values == b) & (found["component"].values == axis) for b, axis in pairs]
    bins = next((n for n in (BINS, BINS // 2) if any(r.sum() >= 4 * n for r in rows)), None)
    rows = [r for r in rows if bins and r.sum() >= 4 * bins]
    if not rows:
        return None, None, None
    total = np.zeros((2, bins))
    for used in rows:
        for i, name in enumerate(("residual_before", "residual_after")):
            values = np.abs(np.fft.rfft(found[name].values[used])) ** 2 / used.sum()
            total[i] += [part.mean() for part in np.array_split(values[1:], bins)]
    step = float(np.median(np.diff(found["time_row"].values[rows[-1]])))
    return (np.arange(bins) + 0.5) / (2 * step * bins), *(total / len(rows))


def residuals(found):
    """Whitened residual of the channel and manoeuvre that the extension helps most, the three axes, smoothed.

    Parameters
    ----------
    found : Dataset of kind discovery
    """
    channel, block = found["channel"].values, found["block"].values
    drop = found["residual_before"].values ** 2 - found["residual_after"].values ** 2
    pairs = sorted({(int(c), int(b)) for c, b in zip(channel, block, strict=True)})
    pairs = [(c, b) for c, b in pairs if np.sum((channel == c) & (block == b)) >= CURVE]  # not a handful of edge times
    gains = [drop[(channel == c) & (block == b)].sum() for c, b in pairs]
    if not gains or max(gains) < 10:
        return None
    c, b = pairs[int(np.argmax(gains))]
    here = (channel == c) & (block == b)
    name = f"{found.attrs['channels'].split()[c]}, {found.attrs['blocks'].split(', ')[b]}"
    parts, start = [legend(LINES)], found["time_row"].values[here].min()
    axes = [int(axis) for axis in np.unique(found["component"].values[here])]
    height = 90 * max(len(axes), 2)
    for axis, (box,) in zip(axes, boxes(len(axes), 1, height), strict=True):
        rows = here & (found["component"].values == axis)
        time = found["time_row"].values[rows] - start
        series = [_smoothed(found[f"residual_{w}"].values[rows]) for w in ("before", "after")]
        panel = Panel(box, (0.0, float(time[-1])), limits(*series))
        marks = [line(panel, time, y, look) for y, look in zip(series, LINES.values(), strict=True)]
        words = {"x_label": "time from the first row (s)"} if axis == axes[-1] else {"x_numbers": False}
        words |= {"title": f"whitened residual of {name}"} if axis == axes[0] else {}
        parts.append(framed(panel, *marks, y_label="xyz"[axis] if len(axes) > 1 else "residual", **words))
    return drawn(height, f"residual of {name}", *parts)


def scattered(found, x_label="time from the first row (s)", origin=None):
    """Whitened residual of every row of a short record, the three axes; before and after have scales of their own.

    Parameters
    ----------
    found : Dataset of kind discovery
    x_label : of the lower scale
    origin : s, where that scale begins; None for the first row
    """
    component = found["component"].values
    axes = [int(axis) for axis in np.unique(component) if axis < 3]  # a fourth holds priors
    if not axes:
        return None
    time = found["time_row"].values - (found["time_row"].values[component < 3].min() if origin is None else origin)
    height = 60 + 74 * len(axes)
    parts = [legend({"noise, one sigma": WITHIN})]
    for axis, row in zip(axes, boxes(len(axes), 2, height), strict=True):
        here = component == axis
        for box, which, (name, look) in zip(row, ("before", "after"), POINTS.items(), strict=True):
            values = found[f"residual_{which}"].values[here]
            panel = Panel(box, limits(time[component < 3]), limits(values, np.array([-2.0, 2.0])))
            marks = [band(panel, -1.0, 1.0, *WITHIN), dots(panel, time[here], values, look)]
            words = {"x_label": x_label} if axis == axes[-1] else {"x_numbers": False}
            words |= {"title": name} if axis == axes[0] else {}
            parts.append(framed(panel, *marks, y_label=f"{'xyz'[axis]} (sigma)", **words))
    return drawn(height, "residual of every row", *parts)


def _smoothed(values):
    """Mean over five rows, scaled so that noise keeps unit variance."""
    return np.convolve(values, np.ones(5) / np.sqrt(5), mode="same")
