"""Figures of a discovery: where the excess sits, spectra and series of the residuals, and readings in their unit."""

import json
from collections.abc import Mapping

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend, thinned
from gravcal.report.plain import prefixed

NAMES = ("baseline", "extended model")
LINES = dict(zip(NAMES, ({"color": COLOURS["vermilion"]}, {"color": COLOURS["blue"]}), strict=True))
POINTS = {
    "baseline": {"color": COLOURS["vermilion"], "marker": "o", "linestyle": "none"},
    "extended model": {"color": COLOURS["blue"], "marker": "s", "linestyle": "none", "markerfacecolor": "none"},
}
NOISE = {"color": COLOURS["black"], "linewidth": 0.6, "linestyle": "--"}
MEASURED = {"color": COLOURS["black"], "label": "measured"}
BINS = 24


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
        _wide(panel)
    numbers = range(each, int(blocks.max()) + 2, each)
    panel.set_xticks(numbers, [_number(found, i) for i in numbers])
    panel.set_xlabel("manoeuvre, four bands from low to high frequency")
    legend(figure, panels, 3)
    return figure


def _wide(panel):
    """Logarithmic power where it spans more than a page can show."""
    if panel.get_ylim()[1] > 30:
        panel.set_yscale("log")


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
        _wide(panel)
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


SIDES = ("measured", "simulated", "extended")
SIMULATED = LINES["baseline"] | {"label": "simulated without it"}
EXTENDED = LINES["extended model"] | {"label": "extended model"}
PHASES, STRETCHES = 40, 90  # bins of a period, and of a record
SLOW = 0.02  # of the square of what a finding adds, below which it does not change within a period
KEPT = 0.5  # of the square of what a finding adds that bins have to keep


def shown(found, number: int) -> dict | None:
    """Where a finding is shown: {"finding", "channel", "block", "axis"}; None where it helps no reading."""
    rows = json.loads(found.attrs.get("shown", "[]"))
    known = (one for one in rows if f"{one['channel']}_measured" in found)  # not that of a plugin
    return next((one for one in known if one["finding"] == number), None)


def _curves(found, one):
    """Epochs s from the first (n,), and {side: (n,)} of the axis that is shown."""
    channel = one["channel"]
    here = found[f"{channel}_finding"].values == one["finding"]
    axis = min(one["axis"], found[f"{channel}_measured"].shape[1] - 1)
    time = found[f"{channel}_time"].values[here]
    return time - time[0], {side: found[f"{channel}_{side}"].values[here, axis] for side in SIDES}


def _kept(values, index):
    """Share of the square of values that their means over bins (n,) keep, and the bins with samples."""
    good = np.isfinite(values)
    if not good.any() or not np.any(values[good]):
        return 0.0
    values = values[good] - values[good].mean()
    count = np.bincount(index[good])
    total = np.bincount(index[good], values)
    return float(np.sum(total[count > 0] ** 2 / count[count > 0]) / np.sum(values**2))


def fold(found, number: int) -> float | None:
    """Period s over which what a finding adds to its reading repeats: its own, or one of the manoeuvre; or None.

    Parameters
    ----------
    found : Dataset of kind discovery
    number : of the finding
    """
    one = shown(found, number)
    findings = json.loads(found.attrs["numbers"])["findings"]
    if one is None or not 0 <= number < len(findings):
        return None
    time, curves = _curves(found, one)
    own = findings[number]["parameters"].get("frequency", {}).get("value")
    periods = [*([1 / own] if own else []), *json.loads(found.attrs["periods"])]
    added = curves["extended"] - curves["simulated"]
    quick = {p: _quick(time, added, p) for p in periods if 3 * p < time[-1]}
    share = {p: _kept(v, _bins(time, p)) for p, v in quick.items() if np.nanvar(v) > SLOW * np.nanvar(added)}
    best = max(share, key=share.get, default=None)
    return best if best is not None and share[best] > KEPT else None


def _quick(time, values, period):
    """Values (n,) less their mean over a period about each sample, NaN where that is not whole."""
    width = max(1, round(period / float(np.median(np.diff(time)))))
    good, box = np.isfinite(values), np.ones(width)
    total, count = (np.convolve(v, box, "same") for v in (np.where(good, values, 0.0), good.astype(float)))
    left = values - total / np.maximum(count, 1)
    left[: width // 2] = left[values.size - width // 2 :] = np.nan
    return left


def _bins(time, period):
    """Bin (n,) of each epoch in a period: as many bins as have a sample each."""
    for count in range(PHASES, 1, -1):
        index = np.minimum((time % period * (count / period)).astype(int), count - 1)
        if np.unique(index).size == count:
            break
    return index


def reading(found, number: int, period: float | None):
    """Reading that a finding helps most, measured and simulated, and what either model leaves of it.

    Parameters
    ----------
    found : Dataset of kind discovery
    number : of the finding, -1 where none was named
    period : s, over which it is folded, or None
    """
    one = shown(found, number)
    if one is None:
        return None
    time, curves = _curves(found, one)
    curves = {side: _quick(time, v, period) for side, v in curves.items()} if period else curves
    measured = curves["measured"]
    models = [(curves["simulated"], SIMULATED), (curves["extended"], EXTENDED)]
    models = [model for model in models if np.isfinite(model[0]).any()]
    place, index = _places(time, models[-1][0] - (models[0][0] if len(models) > 1 else measured), period)
    whole = found[f"{one['channel']}_measured"]
    axis = f" {'xyz'[one['axis']]}" if whole.shape[1] > 1 else ""
    rows = {
        f"{one['channel']}{axis}": [*models, (measured, MEASURED)],
        "difference": [(measured - values, style) for values, style in models],
    }
    figure, panels = grid(2, 1, 3.0, sharex=True, margins={"hspace": 0.12, "left": 0.1})
    for (panel,), (label, series) in zip(panels, rows.items(), strict=True):
        means = [(*_means(values, index, place.size), style) for values, style in series]
        factor, unit = prefixed(max(float(np.nanmax(np.abs(mean))) for mean, *_ in means), whole.attrs["units"])
        for mean, error, style in means:
            points = place.size < time.size and (label == "difference" or style is MEASURED)
            _draw(panel, place, factor * mean, factor * error, style, points)
        panel.set_ylabel(f"{label} ({unit})")
    panels[1, 0].axhline(0.0, **NOISE)
    panels[1, 0].set_xlabel("time from the first sample (s)" if period is None else "phase (s)")
    legend(figure, panels, 3)
    return figure


def _places(time, added, period):
    """Abscissae (m,) s of bins, and the bin (n,) of each sample: of a period, of the record, or every sample alone."""
    if period is not None:
        count = max(index := _bins(time, period)) + 1
        return (np.arange(count) + 0.5) * period / count, index
    index = np.minimum((time / time[-1] * STRETCHES).astype(int), STRETCHES - 1)
    if time.size > 4 * STRETCHES and _kept(added, index) > KEPT:
        return (np.arange(STRETCHES) + 0.5) * time[-1] / STRETCHES, index
    return time, np.arange(time.size)


def _means(values, index, count):
    """Means (count,) over bins, and their errors by the scatter inside; NaN where there is no sample."""
    good = np.isfinite(values)
    number = np.bincount(index[good], minlength=count).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(index[good], values[good], count) / number
        square = np.bincount(index[good], (values[good] - mean[index[good]]) ** 2, count)
        return mean, np.sqrt(square / (number - 1) / number)


def _draw(panel, x, y, error, style, points):
    """Means with their errors, or a line."""
    if points:
        bars = {"linestyle": "none", "marker": ".", "markersize": 3.5, "elinewidth": 0.6}
        panel.errorbar(x, y, error if style is not MEASURED else None, **style, **bars)
    else:
        panel.plot(*thinned(x, y), **style)


def caption(found, number: int, period: float | None, readings_of: Mapping[str, str]) -> str:
    """Caption of the figure of a finding; `readings_of` says {channel: text} what the readings are."""
    one = shown(found, number)
    if one is None:
        return ""
    what = f"Finding {number + 1}" if number >= 0 else "The least likely band"
    said = f"{what}: {one['channel']} reading, {one['block']}."
    said += f" Folded over {period:.4g} s, without what changes in longer times." if period else ""
    said += " Above the reading, below what is measured less what either model simulates; bars: error of a mean."
    said += readings_of.get(one["channel"], " Its mean is left out.")
    return said + (REBUILT if "rebuilt" in found.attrs else "")


REBUILT = " The measured reading is that of the records without the findings, with these added in their linear form."
