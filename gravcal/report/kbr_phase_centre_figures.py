"""Figures of the page of a ranging calibration, like figures 2 to 10 of the source paper."""

import numpy as np

from gravcal.report.drawing import Look, Panel, band, bars, boxes, dots, limits, line, strip, upright
from gravcal.report.drawing_frame import drawn, framed, legend
from gravcal.report.drawing_looks import DASHED, DOTTED
from gravcal.report.figures import COLOURS

OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = {"range": ("µm", 1e6), "range_rate": ("nm/s", 1e9), "range_acceleration": ("nm/s²", 1e9)}
NAMES = {"range": "range", "range_rate": "range rate", "range_acceleration": "range acceleration"}
SHORT = {"range": "range", "range_rate": "rate", "range_acceleration": "acceler-\nation"}
SHADE = (COLOURS["yellow"], 0.4)
DIVISOR = Look(COLOURS["grey"], 0.7, DOTTED)
ANGLES = {"pitch": Look(COLOURS["blue"], 0.8), "yaw": Look(COLOURS["vermilion"], 0.8)}
SERIES = {
    "ranging minus orbit": Look(COLOURS["sky"], 1.8),
    "phase centres": Look(COLOURS["black"], 0.7),
    "difference, magnified": Look(COLOURS["vermilion"], 0.6),
}
SPECTRA = {"ranging minus orbit": Look(COLOURS["sky"], 1.4), "residual": Look(COLOURS["vermilion"])}
NOISE = {
    "quiet data": Look(COLOURS["sky"], 1.4),
    "model": Look(COLOURS["black"], 1.2, DASHED),
    "in the wiggles": Look(COLOURS["vermilion"]),
}
POINTS = {
    "least squares": Look(COLOURS["black"], shape="circle", size=5.0),
    "robust": Look(COLOURS["blue"], shape="square", size=5.0),
    "one wiggle alone": Look(COLOURS["vermilion"], shape="triangle", size=5.0),
}
APART = 0.14  # of least squares and robust about the place of their observable


def angles(pointed):
    """Pitch and yaw of both satellites over the record, and the first wiggle of each.

    Parameters
    ----------
    pointed : Dataset, "kbr_phase_centre.pointing"
    """
    time, angle = pointed["time"].values, np.degrees(pointed["angle"].values)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    parts = [legend({"wiggle": SHADE} | ANGLES if len(spans) else ANGLES)]
    for k, row in enumerate(boxes(2, 3, 380, across=30, down=42)):
        letter, last = pointed.attrs["satellites"][k], k == 1
        own = spans[pointed["satellite_index"].values == k]
        wide = (*row[0][:2], row[1][0] + row[1][2] - row[0][0], row[0][3])
        words = {"title": f"GRACE-{letter}, line of sight in the satellite, °"}
        words |= {"x_label": "hours of the record"} if last else {}
        parts.append(_record(wide, (time - time[0]) / 3600, angle[k], (own - time[0]) / 3600, words))
        words = {"title": "first wiggle" if own.size else "detail"}
        words |= {"x_label": "s from the slew" if own.size else "s"} if last else {}
        since = time - (own[0, 0] if own.size else time[0] + 1000)
        near = (since > -120) & (since < 1130)
        parts.append(_record(row[2], since[near], angle[k, near], own[:0], words))
    return drawn(380, "pointing angles", *parts)


def _record(box, across, angle, spans, words):
    """Panel with both angles and the wiggles as strips."""
    panel = Panel(box, (float(across[0]), float(across[-1])), limits(angle))
    marks = [strip(panel, start, stop, *SHADE) for start, stop in spans]
    marks += [line(panel, across, angle[:, axis], look) for axis, look in enumerate(ANGLES.values())]
    return framed(panel, *marks, **words)


def series(solved):
    """Ranging minus orbit and model in one pitch and one yaw wiggle, all observables.

    Parameters
    ----------
    solved : list of Dataset, "kbr_phase_centre.solve"
    """
    first = solved[0]
    chosen = [np.flatnonzero(first["axis_index"].values == axis) for axis in (0, 1)]
    chosen = [own[0] for own in chosen if own.size]
    if not chosen or not first["time_kbr"].size:
        return None
    parts = [legend(SERIES)]
    for number, (one, row) in enumerate(zip(solved, boxes(3, len(chosen), 500, down=42), strict=True)):
        words = {"x_label": "s"} if number == len(solved) - 1 else {}
        parts += [_wiggle(box, one, k, words) for box, k in zip(row, chosen, strict=True)]
    return drawn(500, "ranging minus orbit in the wiggles", *parts)


def _wiggle(box, one, k, words):
    """One wiggle: data, model, and their difference magnified by a power of ten; lines open at gaps."""
    name, own = one.attrs["observable"], one["arc"].values == k
    unit, factor = UNITS[name]
    time = one["time_kbr"].values[own]
    seen, model = factor * one["detrended"].values[own], factor * one["modelled"].values[own]
    if not time.size:
        return framed(Panel(box, (0.0, 1.0), (-1.0, 1.0)), **words)
    gaps = np.flatnonzero(np.diff(time) > 20) + 1
    time, seen, model = (np.insert(v, gaps, np.nan) for v in (time - time[0], seen, model))
    left, span = seen - model, np.nanmax(model) - np.nanmin(model)
    power = 10 ** max(int(np.floor(np.log10(0.6 * span / max(np.nanmax(left) - np.nanmin(left), 1e-12)))), 0)
    curves = (seen, model, power * left - 1.1 * span)
    panel = Panel(box, limits(time, margin=0.01), limits(*curves))
    letter = one.attrs["satellites"][int(one["satellite_index"].values[k])]
    axis = ("pitch", "yaw")[int(one["axis_index"].values[k])]
    title = f"{NAMES[name]}, {unit}: {letter} {axis}, difference × {power}"
    marks = [line(panel, time, curve, look) for curve, look in zip(curves, SERIES.values(), strict=True)]
    return framed(panel, *marks, title=title, **words)


def spectra(solved):
    """Density before and after the fit.

    Parameters
    ----------
    solved : list of Dataset, "kbr_phase_centre.solve"
    """
    if not solved[0]["time_kbr"].size:
        return None
    parts = [legend(SPECTRA)]
    for box, one in zip(boxes(1, 3, 240, left=46, across=44)[0], solved, strict=True):
        unit, factor = UNITS[one.attrs["observable"]]
        density = [factor * np.sqrt(one[f"spectrum_{key}"].values) for key in ("observed", "residual")]
        title = f"{NAMES[one.attrs['observable']]}, {unit}/√Hz"
        parts.append(_densities(box, one["frequency"].values, dict(zip(SPECTRA.values(), density, strict=True)), title))
    return drawn(240, "spectra", *parts)


def _densities(box, frequency, curves, title):
    """Logarithmic panel of densities with the frequencies of the wiggle."""
    ends = np.concatenate([values[values > 0] for values in curves.values()])
    panel = Panel(
        box, (float(frequency[0]), float(frequency[-1])), (float(ends.min()) / 2, 2 * float(ends.max())), True
    )
    marks = [upright(panel, (4e-3, 8e-3), DIVISOR)]
    marks += [line(panel, frequency, np.where(values > 0, values, np.nan), look) for look, values in curves.items()]
    return framed(panel, *marks, title=title, x_label="Hz")


def estimates(document):
    """Both transverse components, y and z, of both satellites from every observable, estimator and wiggle.

    Parameters
    ----------
    document : dict of `gravcal.report.kbr_phase_centre.document`
    """
    parts = [legend({"adopted": SHADE} | POINTS)]
    for row, (letter, blocks) in zip(boxes(2, 2, 400, down=58), document["satellites"].items(), strict=True):
        parts += [_estimate(box, document, (letter, blocks), k) for box, k in zip(row, (1, 2), strict=True)]
    return drawn(400, "estimates", *parts)


def _estimate(box, document, satellite, k):
    """One component."""
    letter, blocks = satellite
    points = _points(blocks, k)
    labels = dict(enumerate(SHORT[name] for name in OBSERVABLES))
    for one in document["manoeuvres"]:
        if one["satellite"] == letter and one["component"] == "xyz"[k]:
            own = one["estimates_mm"]["range_rate"]
            labels[len(labels)] = f"{one['kind'].replace('-', '−')}\nalone"
            points.append((len(labels) - 1, own["value"], own["sigma"], "one wiggle alone"))
    points = [point for point in points if point[1] is not None and point[2] is not None]
    adopted = document["adopted"]["satellites"][letter]
    ends = [v + sign * s for _, v, s, _ in points for sign in (-1, 1)]
    panel = Panel(box, (-0.6, len(labels) - 0.4), limits(ends))
    value, sigma = adopted["phase_centre_mm"][k], adopted["sigma_mm"][k]
    marks = [] if value is None else [band(panel, value - sigma, value + sigma, *SHADE)]
    for place, centre, error, kind in points:
        marks.append(bars(panel, [place], [centre - error], [centre + error], POINTS[kind]))
        marks.append(dots(panel, [place], [centre], POINTS[kind]))
    return framed(panel, *marks, title=f"GRACE-{letter} {'xyz'[k]}, mm", x_numbers=labels)


def _points(blocks, k):
    """Place, value, error and kind of every observable and estimator."""
    found = []
    for place, name in enumerate(OBSERVABLES):
        for shift, estimator, kind in ((-APART, "ls", "least squares"), (APART, "robust", "robust")):
            own = blocks[name][estimator]
            found.append((place + shift, own["phase_centre_mm"][k], own["sigma_mm"][k], kind))
    return found


def noise(measured):
    """Density of the range noise.

    Parameters
    ----------
    measured : Dataset, "kbr_phase_centre.noise"
    """
    keys = dict(zip(NOISE, ("density", "model", "in_manoeuvres"), strict=True))
    known = {
        name: 1e6 * np.sqrt(measured[key].values) for name, key in keys.items() if np.any(measured[key].values > 0)
    }
    curves = {NOISE[name]: values for name, values in known.items()}
    panel = _densities(boxes(1, 1, 240)[0][0], measured["frequency"].values, curves, "noise, µm/√Hz")
    return drawn(240, "noise", legend({name: NOISE[name] for name in known}), panel)
