"""Figures of the page of a ranging calibration, like figures 2 to 10 of the source paper."""

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend

OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = {"range": ("µm", 1e6), "range_rate": ("nm/s", 1e9), "range_acceleration": ("nm/s²", 1e9)}
NAMES = {"range": "range", "range_rate": "range rate", "range_acceleration": "range acceleration"}
SHADE = {"color": COLOURS["yellow"], "alpha": 0.35, "linewidth": 0}


def angles(pointed):
    """Pitch and yaw of both satellites over the record, and the first wiggle of each."""
    figure, panels = grid(2, 2, 3.4, margins={"hspace": 0.42, "wspace": 0.16}, width_ratios=[1.9, 1])
    time, angle = pointed["time"].values, np.degrees(pointed["angle"].values)
    hour = (time - time[0]) / 3600
    start, stop = pointed["start"].values, pointed["stop"].values
    for k, letter in enumerate(pointed.attrs["satellites"]):
        wide, near = panels[k]
        own = np.flatnonzero(pointed["satellite_index"].values == k)
        for m in own:
            wide.axvspan((start[m] - time[0]) / 3600, (stop[m] - time[0]) / 3600, **SHADE)
        centre = start[own[0]] if own.size else time[0] + 1000
        inside = (time > centre - 120) & (time < centre + 1130)
        for axis, (name, colour) in enumerate((("pitch", "blue"), ("yaw", "vermilion"))):
            wide.plot(hour[::15], angle[k, ::15, axis], color=COLOURS[colour], label=name, linewidth=0.6)
            near.plot(time[inside] - centre, angle[k, inside, axis], color=COLOURS[colour])
        wide.set_title(f"GRACE-{letter}, line of sight in the satellite, °")
        near.set_title("first wiggle" if own.size else "detail")
    panels[1, 0].set_xlabel("hours of the record")
    panels[1, 1].set_xlabel("s from the slew" if len(start) else "s")
    legend(figure, panels[0, 0], 2)
    return figure


def series(solved):
    """Ranging minus orbit and model in one pitch and one yaw wiggle, all observables."""
    first = solved[0]
    chosen = [np.flatnonzero(first["axis_index"].values == axis) for axis in (0, 1)]
    chosen = [own[0] for own in chosen if own.size]
    if not chosen or not first["time_kbr"].size:
        return None
    figure, panels = grid(3, len(chosen), 4.6, margins={"hspace": 0.5, "wspace": 0.16})
    for row, one in enumerate(solved):
        for column, k in enumerate(chosen):
            _wiggle(panels[row, column], one, k)
    for panel in panels[-1]:
        panel.set_xlabel("s")
    legend(figure, panels[0, 0], 3)
    return figure


def _wiggle(panel, one, k):
    """One wiggle: data, model, and their difference magnified by a power of ten; lines open at gaps."""
    name, own = one.attrs["observable"], one["arc"].values == k
    unit, factor = UNITS[name]
    time = one["time_kbr"].values[own]
    seen, model = factor * one["detrended"].values[own], factor * one["modelled"].values[own]
    if not time.size:
        return
    gaps = np.flatnonzero(np.diff(time) > 20) + 1
    time, seen, model = (np.insert(v, gaps, np.nan) for v in (time - time[0], seen, model))
    left, span = seen - model, np.nanmax(model) - np.nanmin(model)
    power = 10 ** max(int(np.floor(np.log10(0.6 * span / max(np.nanmax(left) - np.nanmin(left), 1e-12)))), 0)
    panel.plot(time, seen, color=COLOURS["sky"], linewidth=1.6, label="ranging minus orbit")
    panel.plot(time, model, color=COLOURS["black"], linewidth=0.6, label="phase centres")
    panel.plot(
        time, power * left - 1.1 * span, color=COLOURS["vermilion"], linewidth=0.5, label="difference, magnified"
    )
    letter = one.attrs["satellites"][int(one["satellite_index"].values[k])]
    axis = ("pitch", "yaw")[int(one["axis_index"].values[k])]
    panel.set_title(f"{NAMES[name]}, {unit}: {letter} {axis}, difference × {power}")


def spectra(solved):
    """Density before and after the fit."""
    if not solved[0]["time_kbr"].size:
        return None
    figure, panels = grid(1, 3, 2.5, margins={"bottom": 0.17, "wspace": 0.24})
    for panel, one in zip(panels[0], solved, strict=True):
        name = one.attrs["observable"]
        unit, factor = UNITS[name]
        frequency = one["frequency"].values
        for key, colour, label in (("observed", "sky", "ranging minus orbit"), ("residual", "vermilion", "residual")):
            density = factor * np.sqrt(one[f"spectrum_{key}"].values)
            panel.loglog(frequency, density, color=COLOURS[colour], label=label)
        for wiggle in (4e-3, 8e-3):
            panel.axvline(wiggle, color=COLOURS["grey"], linestyle=":", linewidth=0.8)
        _plain_ticks(panel)
        panel.set_title(f"{NAMES[name]}, {unit}/√Hz")
        panel.set_xlabel("Hz")
    legend(figure, panels[0, 0], 2)
    return figure


def _plain_ticks(panel):
    """Log axes with a tick at each power of ten only."""
    panel.xaxis.minorticks_off()
    panel.yaxis.minorticks_off()


def estimates(document):
    """Both transverse components, y and z, of both satellites from every observable, estimator and wiggle."""
    figure, panels = grid(2, 2, 4.2, margins={"hspace": 0.75, "wspace": 0.2, "bottom": 0.17})
    for row, (letter, blocks) in zip(panels, document["satellites"].items(), strict=True):
        for panel, k in zip(row, (1, 2), strict=True):
            _estimate(panel, document, blocks, letter, k)
    return figure


def _estimate(panel, document, blocks, letter, k):
    """One component."""
    points = [
        (
            f"{NAMES[name]}\n{estimator}",
            blocks[name][estimator]["phase_centre_mm"][k],
            blocks[name][estimator]["sigma_mm"][k],
        )
        for name in OBSERVABLES
        for estimator in ("ls", "robust")
    ]
    for one in document["manoeuvres"]:
        if one["satellite"] == letter and one["component"] == "xyz"[k]:
            own = one["estimates_mm"]["range_rate"]
            points.append((f"{one['kind']}\nalone", own["value"], own["sigma"]))
    points = [point for point in points if point[1] is not None and point[2] is not None]
    panel.set_title(f"GRACE-{letter} {'xyz'[k]}, mm")
    adopted = document["adopted"]["satellites"][letter]
    value, sigma = adopted["phase_centre_mm"][k], adopted["sigma_mm"][k]
    if value is not None:
        panel.axhspan(value - sigma, value + sigma, **SHADE)
    for place, (label, centre, error) in enumerate(points):
        colour = "vermilion" if "alone" in label else "black" if "robust" not in label else "blue"
        panel.errorbar(place, centre, error, fmt="o", markersize=3, color=COLOURS[colour], linewidth=0.9)
    panel.set_xticks(range(len(points)), [label for label, *_ in points], fontsize=5.5, rotation=40, ha="right")


def noise(measured):
    """Density of the range noise."""
    figure, panels = grid(1, 1, 2.4, margins={"bottom": 0.17})
    panel, frequency = panels[0, 0], measured["frequency"].values
    curves = (
        ("density", "sky", "quiet data"),
        ("model", "black", "model"),
        ("in_manoeuvres", "vermilion", "in the wiggles"),
    )
    for key, colour, label in curves:
        values = measured[key].values
        if np.any(values > 0):
            panel.loglog(frequency, 1e6 * np.sqrt(values), color=COLOURS[colour], label=label)
    _plain_ticks(panel)
    panel.set_title("noise of ranging minus orbit, µm/√Hz")
    panel.set_xlabel("Hz")
    legend(figure, panel, 3)
    return figure
