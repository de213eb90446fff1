"""Figures of what a centre-of-mass event gives: residual spectra, and the estimates of every manoeuvre."""

from dataclasses import replace

import numpy as np

from gravcal.report.drawing import Look, Panel, band, bars, boxes, dots, level, limits, line
from gravcal.report.drawing_frame import drawn, framed, legend
from gravcal.report.drawing_looks import VARIANT_LOOK
from gravcal.report.figures import COLOURS
from gravcal.report.plain import AXES

SPECTRA = {
    "modelled signal": Look(COLOURS["sky"]),
    "residual": Look(COLOURS["vermilion"], 0.8),
    "noise as measured": Look(COLOURS["black"], 1.3),
}
BANDS = {"total error": (COLOURS["yellow"], 0.30), "adopted": (COLOURS["orange"], 0.45)}
ROLL = {"star camera": Look(COLOURS["orange"], 0.6, shape="circle", size=3.0), "torquers": Look(COLOURS["black"])}
SPREAD = 0.24  # of the angular accelerations about the place of their manoeuvre


def spectra(solved):
    """Density of the residuals beside the noise as measured, and of the modelled signal.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    """
    reading, model = solved["reading"].values, solved["model"].values
    pieces = _pieces(solved)
    if not pieces:
        return None
    frequency, residual = _density(reading - model, pieces)
    _, signal = _density(model, pieces)
    stated = np.sqrt(solved["noise_density"].values)
    low = np.nanmin([np.nanmin(stated), np.nanpercentile(residual, 5)])
    y = (float(low / 5), float(3 * np.nanmax(signal)))
    parts, label = [legend(SPECTRA)], {"y_label": "density (m s⁻² / √Hz)"}
    for column, box in enumerate(boxes(1, 3, 250, across=14)[0]):
        panel = Panel(box, (float(frequency[1]), 1.0), y, log=True)
        series = (frequency, signal[:, column]), (frequency, residual[:, column])
        series += ((solved["frequency"].values, stated[column]),)
        marks = [line(panel, *one, look) for one, look in zip(series, SPECTRA.values(), strict=True)]
        words = {"title": f"f_{AXES[column]}", "x_label": "frequency (Hz)", "y_numbers": column == 0}
        parts.append(framed(panel, *marks, **words, **label))
        label = {}
    return drawn(250, "spectra", *parts)


def _pieces(solved):
    """Samples of every manoeuvre whose grid has no gap."""
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    found = [np.flatnonzero(index == one) for one in np.unique(index)]
    return [own for own in found if own.size > 64 and np.ptp(np.diff(time[own])) < 1e-6]


def _density(values, pieces):
    """One-sided amplitude density (m, 3), mean of the manoeuvres, tapered by a cosine bell."""
    length = min(own.size for own in pieces)
    taper = np.hanning(length)
    parts = [np.abs(np.fft.rfft(taper[:, None] * values[own[:length]], axis=0)) ** 2 for own in pieces]
    step = 0.5
    power = 2 * step * np.mean(parts, axis=0) / np.sum(taper**2)
    return np.fft.rfftfreq(length, step)[1:], np.sqrt(power)[1:]


def estimates(document, printed):
    """Every manoeuvre's estimate with its error, the adopted offset as a band, printed values hollow.

    Parameters
    ----------
    document : dict of the event
    printed : {(manoeuvre index, variant): Published}
    """
    manoeuvres = document["manoeuvres"]
    adopted = document["variants"].get(document["adopted"]["variant"])
    names = list(document["variants"])
    looks = {name: replace(VARIANT_LOOK[name], width=0.9, dash=()) for name in names}
    parts, titled = [legend(BANDS | looks)], {"title": "offset, proof mass to CoM"}
    labels = [f"{i} {one['kind']}\n{one['latitude_class'] or ''}" for i, one in enumerate(manoeuvres, start=1)]
    x = (-0.6, len(manoeuvres) - 0.4)
    for row, (box,) in enumerate(boxes(3, 1, 460, down=14, bottom=34)):
        series = {name: _points(manoeuvres, name, row) for name in names}
        known = {name: _printed(printed, name, row, len(manoeuvres)) for name in names}
        ends = [value + sign * sigma for value, sigma in series.values() for sign in (-1, 1)]
        panel = Panel(box, x, limits(*ends, *known.values(), _adopted(adopted, row)))
        marks = [_band(panel, adopted, row)]
        for name, shift in zip(names, np.linspace(-SPREAD, SPREAD, len(names)), strict=True):
            marks += _estimates(panel, np.arange(len(manoeuvres)) + shift, series[name], known[name], looks[name])
        numbers = dict(enumerate(labels)) if row == 2 else dict.fromkeys(range(len(labels)), "")
        parts.append(framed(panel, *marks, y_label=f"{AXES[row]} (µm)", x_numbers=numbers, **titled))
        titled = {}
    return drawn(460, "estimates", *parts)


def _adopted(block, row):
    """Ends of the band of the adopted offset."""
    if block is None or block["offset_um"][row] is None:
        return []
    return [block["offset_um"][row] + sign * block["sigma_total_um"][row] for sign in (-1, 1)]


def _band(panel, block, row):
    """Adopted offset with one and with the total standard deviation."""
    if block is None or block["offset_um"][row] is None:
        return ""
    value, sigma, total = (block[name][row] for name in ("offset_um", "sigma_um", "sigma_total_um"))
    strips = [
        band(panel, value - half, value + half, *look)
        for half, look in zip((total, sigma), BANDS.values(), strict=True)
    ]
    return "".join(strips) + level(panel, value, Look(COLOURS["orange"], 0.6))


def _points(manoeuvres, name, row):
    """Estimates of one angular acceleration and their errors, NaN where not determined."""
    blocks = [one["variants"][name] for one in manoeuvres]
    return tuple(np.array([block[key][row] for block in blocks], dtype=float) for key in ("offset_um", "sigma_um"))


def _printed(printed, name, row, count):
    """Printed values of the same manoeuvres, NaN where there is none."""
    known = [printed.get((i, name)) for i in range(count)]
    return np.array([None if one is None else one.value[row] for one in known], dtype=float)


def _estimates(panel, place, series, known, look):
    """Marks of one angular acceleration: error bars, points, hollow ones for what was printed."""
    value, sigma = series
    hollow = replace(look, hollow=True, size=1.6 * look.size)
    return [
        bars(panel, place, value - sigma, value + sigma, look),
        dots(panel, place, value, look),
        dots(panel, place, known, hollow),
    ]


def roll(survey):
    """Roll rate of a record without manoeuvre beside the torquers' share, both with a quadratic drift removed.

    Parameters
    ----------
    survey : Dataset, "com_offset.survey"
    """
    time = survey["time_sca"].values
    slope = float(survey["slope"].values)
    if time.size == 0 or not np.isfinite(slope):
        return None
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), 2)
    rate, impulse = (
        y - drift @ np.linalg.lstsq(drift, y, rcond=None)[0]
        for y in (survey["roll_rate"].values, survey["roll_impulse"].values)
    )
    since, seen, made = time - time[0], 1e6 * rate, 1e6 * slope * impulse
    panel = Panel(boxes(1, 1, 200)[0][0], limits(since, margin=0.03), limits(seen, made))
    marks = [line(panel, since, seen, ROLL["star camera"]), dots(panel, since, seen, ROLL["star camera"])]
    marks.append(line(panel, since, made, ROLL["torquers"]))
    words = {"y_label": "ω_x (µrad s⁻¹)", "x_label": "time (s)"}
    return drawn(200, "roll", legend(ROLL), framed(panel, *marks, **words))
