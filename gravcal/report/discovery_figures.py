"""Figures of a discovery: where the excess sits, spectra and series of the residuals, and readings in their unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend, thinned

NAMES = ("baseline", "extended model")
LINES = dict(zip(NAMES, ({"color": COLOURS["vermilion"]}, {"color": COLOURS["blue"]}), strict=True))
POINTS = {
    "baseline": {"color": COLOURS["vermilion"], "marker": "o", "linestyle": "none"},
    "extended model": {"color": COLOURS["blue"], "marker": "s", "linestyle": "none", "markerfacecolor": "none"},
}
NOISE = {"color": COLOURS["black"], "linewidth": 0.6, "linestyle": "--"}
MEASURED = {"color": COLOURS["black"], "label": "measured"}
PREFIXES = {"n": 1e9, "u": 1e6, "m": 1e3, "": 1.0}
BINS = 24
CURVE = 60  # rows of a channel and block below which they are no curve


def power(found):
    """Power over expected noise of each channel, block and band, before and after."""
    names = found.attrs["channels"].split()
    tested = [k for k in range(len(names)) if np.any(found["test_channel"].values == k)]
    if not tested:
        return None
    blocks, bands = found["test_block"].values, found["test_band"].values
    each, size = (1, 3.6) if blocks.max() < 40 else (10, 2.0)  # block that is numbered, size of the points
    figure, panels = grid(len(tested), 1, 0.7 + 0.95 * len(tested), sharex=True, margins={"hspace": 0.16})
    for (panel,), k in zip(panels, tested, strict=True):
        here = found["test_channel"].values == k
        place = blocks[here] + 1 + (bands[here] - 1.5) * 0.18
        panel.axhline(1.0, label="noise", **NOISE)
        for which, (name, style) in zip(("before", "after"), POINTS.items(), strict=True):
            panel.plot(place, found[f"power_{which}"].values[here], label=name, markersize=size, **style)
        panel.set_ylabel(names[k])
    numbers = range(each, int(blocks.max()) + 2, each)
    panel.set_xticks(numbers, [_number(found, i) for i in numbers])
    panel.set_xlabel("manoeuvre, four bands from low to high frequency")
    legend(figure, panels, 3)
    return figure


def _number(found, place):
    """Number of a block: that in its name, its place among all where it has none."""
    name = found.attrs["blocks"].split(", ")[place - 1]
    return name.removeprefix("manoeuvre ") if name.startswith("manoeuvre ") else str(place)


def spectra(found):
    """Spectrum of the whitened residuals of each channel, mean over manoeuvres and axes, against that of noise."""
    names = found.attrs["channels"].split()
    curves = [(name, *_spectrum(found, k)) for k, name in enumerate(names)]
    curves = [one for one in curves if one[1] is not None]
    if not curves:
        return None
    rows = (len(curves) + 1) // 2
    figure, panels = grid(rows, 2, 0.6 + 1.35 * rows, margins={"wspace": 0.16, "hspace": 0.5})
    for panel in panels.ravel()[len(curves) :]:
        panel.set_visible(False)
    for (name, frequency, *powers), panel in zip(curves, panels.ravel(), strict=False):
        panel.axhline(1.0, label="noise", **NOISE)
        for values, (label, style) in zip(powers, LINES.items(), strict=True):
            panel.plot(frequency, values, label=label, **style)
        panel.set(title=name, xlabel="frequency (Hz)", ylabel="power over noise")
    legend(figure, panels, 3)
    return figure


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


def strongest(found):
    """Channel and block whose residual the extension lowers most, both as numbers; None where it lowers none."""
    channel, block = found["channel"].values, found["block"].values
    drop = found["residual_before"].values ** 2 - found["residual_after"].values ** 2
    gains = {}
    for pair in sorted({(int(c), int(b)) for c, b in zip(channel, block, strict=True)}):
        here = (channel == pair[0]) & (block == pair[1])
        if here.sum() >= CURVE:  # not a handful of edge times
            gains[pair] = drop[here].sum()
    best = max(gains, key=gains.get, default=None)
    return best if best is not None and gains[best] >= 10 else None


def residuals(found):
    """Whitened residual of the channel and manoeuvre that the extension helps most, the three axes, smoothed."""
    if strongest(found) is None:
        return None
    c, b = strongest(found)
    here = (found["channel"].values == c) & (found["block"].values == b)
    start = found["time_row"].values[here].min()
    axes = [int(axis) for axis in np.unique(found["component"].values[here])]
    figure, panels = grid(len(axes), 1, 0.4 + 0.8 * max(len(axes), 2), sharex=True, margins={"hspace": 0.16})
    for axis, (panel,) in zip(axes, panels, strict=True):
        rows = here & (found["component"].values == axis)
        for which, (name, style) in zip(("before", "after"), LINES.items(), strict=True):
            values = np.convolve(found[f"residual_{which}"].values[rows], np.ones(5) / np.sqrt(5), mode="same")
            panel.plot(*thinned(found["time_row"].values[rows] - start, values), label=name, **style)
        panel.set_ylabel("xyz"[axis] if len(axes) > 1 else "residual")
    names = found.attrs["channels"].split()[c], found.attrs["blocks"].split(", ")[b]
    panels[0, 0].set_title(f"whitened residual of {', '.join(names)}")
    panel.set_xlabel("time from the first row (s)")
    legend(figure, panels, 2)
    return figure


CAPTION = (
    "Reading of the channel and block that the extension helps most, drift and start values fitted with either model; "
    "Δ is measured less simulated."
)
ALONE = "Reading of the channel and block of the least likely band; Δ is measured less simulated."
REBUILT = " The measured reading is that of the records without the findings, with these added in their linear form."
PLAIN = " Its mean is left out."


def shown(found) -> tuple[str, dict[str, np.ndarray]] | None:
    """Channel and its readings, {"measured", "baseline", "extended": (n, a)}; None where the product holds none."""
    names = [str(n) for n in found.data_vars if str(n).endswith("_measured")]
    if not names:
        return None
    channel = names[0].removesuffix("_measured")
    parts = ("measured", "baseline", "extended")
    return channel, {p: found[f"{channel}_{p}"].values for p in parts if f"{channel}_{p}" in found}


def caption(found, readings_of: Mapping[str, str]) -> str:
    """Caption of the figure of readings; `readings_of` says {channel: text} what they are."""
    known = shown(found)
    text = CAPTION if known and "extended" in known[1] else ALONE
    text += readings_of.get(known[0], PLAIN) if known else ""
    return text + (REBUILT if "rebuilt" in found.attrs else "")


def readings(found):
    """Measured and simulated readings of each axis against time in a prefix of their unit, the differences below."""
    if shown(found) is None:
        return None
    channel, parts = shown(found)
    measured, unit = parts.pop("measured"), found[f"{channel}_measured"].attrs["units"]
    time = found["time_reading"].values - found["time_reading"].values[0]
    styles = {part: LINES[name] | {"label": name} for part, name in zip(("baseline", "extended"), NAMES, strict=True)}
    axes = measured.shape[1]
    figure, panels = grid(2 * axes, 1, 0.7 + 1.6 * axes, sharex=True, margins={"hspace": 0.2, "left": 0.1})
    for axis in range(axes):
        letter = "xyz"[axis] if axes > 1 else channel
        curves = [(MEASURED, measured[:, axis])] + [(styles[p], v[:, axis]) for p, v in parts.items()]
        rest = [(styles[p], measured[:, axis] - v[:, axis]) for p, v in parts.items()]
        for panel, name, series in zip(panels[2 * axis :, 0], (letter, f"Δ{letter}"), (curves, rest), strict=False):
            size = np.nanmax(np.abs([v for _, v in series]), initial=0.0)
            prefix = next((p for p, f in reversed(PREFIXES.items()) if size * f >= 1), "n")
            for style, values in series:
                panel.plot(*thinned(time, PREFIXES[prefix] * values), **style)
            panel.set_ylabel(f"{name} ({prefix}{unit})")
    panels[0, 0].set_title(", ".join(dict.fromkeys([channel, _block(found, channel)])))
    panels[-1, 0].set_xlabel("time from the first sample (s)")
    legend(figure, panels, 3)
    return figure


def _block(found, channel):
    """Name of the block whose rows of the channel have the epochs of the readings."""
    here = np.flatnonzero(found["channel"].values == found.attrs["channels"].split().index(channel))
    away = np.abs(found["time_row"].values[here] - float(found["time_reading"].values[0]))
    return found.attrs["blocks"].split(", ")[int(found["block"].values[here[np.argmin(away)]])]
