"""Figures of what a centre-of-mass event gives: residual spectra, and the estimates of every manoeuvre."""

import numpy as np

from gravcal.report.com_offset_figures import VARIANT_STYLE
from gravcal.report.figures import COLOURS, grid, legend
from gravcal.report.plain import AXES


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
    figure, panels = grid(1, 3, 2.5, sharex=True, sharey=True, margins={"wspace": 0.08, "right": 0.985})
    frequency, residual = _density(reading - model, pieces)
    _, signal = _density(model, pieces)
    stated = np.sqrt(solved["noise_density"].values)
    for column, axis in enumerate(AXES):
        panel = panels[0, column]
        panel.loglog(frequency, signal[:, column], color=COLOURS["sky"], linewidth=0.9, label="modelled signal")
        panel.loglog(frequency, residual[:, column], color=COLOURS["vermilion"], linewidth=0.8, label="residual")
        noise = {"color": COLOURS["black"], "linewidth": 1.2, "label": "noise as measured"}
        panel.loglog(solved["frequency"].values, stated[column], **noise)
        panel.set_title(f"$f_{axis}$")
        panel.set_xlabel("frequency (Hz)")
        panel.set_xlim(frequency[1], 1.0)
    low = np.nanmin([np.nanmin(stated), np.nanpercentile(residual, 5)])
    panels[0, 0].set_ylim(low / 5, 3 * np.nanmax(signal))
    panels[0, 0].set_ylabel("density (m s$^{-2}$ Hz$^{-1/2}$)")
    legend(figure, panels[0, 0], 3)
    return figure


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
    manoeuvres, adopted = document["manoeuvres"], document["adopted"]["variant"]
    figure, panels = grid(3, 1, 4.6, sharex=True, margins={"hspace": 0.12})
    names = list(document["variants"])
    place = dict(zip(names, np.linspace(-0.24, 0.24, len(names)), strict=True))
    for row, axis in enumerate(AXES):
        panel = panels[row, 0]
        _band(panel, document["variants"].get(adopted), row)
        for name in names:
            _points(panel, manoeuvres, name, row, place[name])
            _printed(panel, printed, name, row, place[name], len(manoeuvres))
        panel.set_ylabel(f"{axis} (µm)")
        panel.grid(axis="x", visible=False)
    labels = [f"{i} {one['kind']}\n{one['latitude_class'] or ''}" for i, one in enumerate(manoeuvres, start=1)]
    panels[-1, 0].set_xticks(range(len(manoeuvres)), labels)
    panels[-1, 0].set_xlim(-0.6, len(manoeuvres) - 0.4)
    panels[0, 0].set_title("offset, proof mass to CoM")
    legend(figure, panels[0, 0], 6)
    return figure


def _band(panel, block, row):
    """Adopted offset with one and with the total standard deviation."""
    if block is None or block["offset_um"][row] is None:
        return
    value, sigma, total = (block[name][row] for name in ("offset_um", "sigma_um", "sigma_total_um"))
    panel.axhspan(value - total, value + total, color=COLOURS["yellow"], alpha=0.30, linewidth=0, label="total error")
    panel.axhspan(value - sigma, value + sigma, color=COLOURS["orange"], alpha=0.45, linewidth=0, label="adopted")
    panel.axhline(value, color=COLOURS["orange"], linewidth=0.6)


def _points(panel, manoeuvres, name, row, place):
    """Estimates of one angular acceleration."""
    values = [one["variants"][name] for one in manoeuvres]
    known = [i for i, block in enumerate(values) if block["offset_um"][row] is not None]
    look = VARIANT_STYLE[name]
    panel.errorbar(
        [i + place for i in known],
        [values[i]["offset_um"][row] for i in known],
        yerr=[values[i]["sigma_um"][row] for i in known],
        linestyle="none",
        marker=look["marker"],
        color=look["color"],
        markersize=3.2,
        elinewidth=0.9,
        capsize=1.5,
        label=name,
    )


def _printed(panel, printed, name, row, place, count):
    """Printed values of the same manoeuvres, hollow."""
    known = [(i, printed[i, name]) for i in range(count) if (i, name) in printed]
    known = [(i, one) for i, one in known if one.value[row] is not None]
    panel.plot(
        [i + place for i, _ in known],
        [one.value[row] for _, one in known],
        linestyle="none",
        marker=VARIANT_STYLE[name]["marker"],
        markerfacecolor="none",
        markeredgecolor=VARIANT_STYLE[name]["color"],
        markersize=5.5,
        markeredgewidth=0.6,
    )


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
    figure, panels = grid(1, 1, 2.0)
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), 2)
    clean = [
        y - drift @ np.linalg.lstsq(drift, y, rcond=None)[0]
        for y in (survey["roll_rate"].values, survey["roll_impulse"].values)
    ]
    panel, since = panels[0, 0], time - time[0]
    dots = {"color": COLOURS["orange"], "marker": "o", "markersize": 2.5, "linewidth": 0.6}
    panel.plot(since, 1e6 * clean[0], label="star camera", **dots)
    panel.plot(since, 1e6 * slope * clean[1], color=COLOURS["black"], label="torquers")
    panel.set_ylabel("$\\omega_x$ (µrad s$^{-1}$)")
    panel.set_xlabel("time (s)")
    legend(figure, panel, 2)
    return figure
