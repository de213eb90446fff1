"""Figures of the page of a ranging calibration, like figures 2 to 10 of the source paper."""

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend, thinned

OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = {"range": ("µm", 1e6), "range_rate": ("nm/s", 1e9), "range_acceleration": ("nm/s²", 1e9)}
NAMES = {"range": "range", "range_rate": "range rate", "range_acceleration": "range acceleration"}
SHORT = {"range": "range", "range_rate": "rate", "range_acceleration": "acceler-\nation"}
SHADE = {"color": COLOURS["yellow"], "alpha": 0.4, "linewidth": 0}
ANGLES = {"pitch": COLOURS["blue"], "yaw": COLOURS["vermilion"]}
SERIES = {
    "ranging minus orbit": {"color": COLOURS["sky"], "linewidth": 1.8},
    "phase centres": {"color": COLOURS["black"], "linewidth": 0.7},
    "difference, magnified": {"color": COLOURS["vermilion"], "linewidth": 0.6},
}
SPECTRA = {
    "ranging minus orbit": {"color": COLOURS["sky"], "linewidth": 1.4},
    "residual": {"color": COLOURS["vermilion"]},
}
NOISE = {
    "quiet data": {"color": COLOURS["sky"], "linewidth": 1.4},
    "model": {"color": COLOURS["black"], "linewidth": 1.2, "linestyle": "--"},
    "in the wiggles": {"color": COLOURS["vermilion"]},
}
POINTS = {
    "least squares": {"color": COLOURS["black"], "marker": "o"},
    "robust": {"color": COLOURS["blue"], "marker": "s"},
    "one wiggle alone": {"color": COLOURS["vermilion"], "marker": "^"},
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
    figure, panels = grid(2, 2, 3.8, width_ratios=(2, 1), margins={"wspace": 0.12, "hspace": 0.34})
    for k, (left, right) in enumerate(panels):
        own = spans[pointed["satellite_index"].values == k]
        left.set_title(f"GRACE-{pointed.attrs['satellites'][k]}, line of sight in the satellite, °")
        right.set_title("first wiggle" if own.size else "detail")
        for start, stop in (own - time[0]) / 3600:
            left.axvspan(start, stop, label="wiggle", **SHADE)
        since = time - (own[0, 0] if own.size else time[0] + 1000)
        near = (since > -120) & (since < 1130)
        for axis, (name, colour) in enumerate(ANGLES.items()):
            left.plot(*thinned((time - time[0]) / 3600, angle[k, :, axis]), color=colour, linewidth=0.8, label=name)
            right.plot(since[near], angle[k, near, axis], color=colour, linewidth=0.8)
    left.set_xlabel("hours of the record")
    right.set_xlabel("s from the slew" if own.size else "s")
    legend(figure, panels, 3)
    return figure


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
    figure, panels = grid(3, len(chosen), 5.0, margins={"wspace": 0.14, "hspace": 0.36})
    for row, one in zip(panels, solved, strict=True):
        for panel, k in zip(row, chosen, strict=True):
            _wiggle(panel, one, k)
    for panel in panels[-1]:
        panel.set_xlabel("s")
    legend(figure, panels, 3)
    return figure


def _wiggle(panel, one, k):
    """One wiggle: data, model, and their difference magnified by a power of ten; lines open at gaps."""
    name, own = one.attrs["observable"], one["arc"].values == k
    unit, factor = UNITS[name]
    time = one["time_kbr"].values[own]
    if not time.size:
        return
    seen, model = factor * one["detrended"].values[own], factor * one["modelled"].values[own]
    gaps = np.flatnonzero(np.diff(time) > 20) + 1
    time, seen, model = (np.insert(v, gaps, np.nan) for v in (time - time[0], seen, model))
    left, span = seen - model, np.nanmax(model) - np.nanmin(model)
    power = 10 ** max(int(np.floor(np.log10(0.6 * span / max(np.nanmax(left) - np.nanmin(left), 1e-12)))), 0)
    for values, (label, style) in zip((seen, model, power * left - 1.1 * span), SERIES.items(), strict=True):
        panel.plot(*thinned(time, values), label=label, **style)
    letter = one.attrs["satellites"][int(one["satellite_index"].values[k])]
    axis = tuple(ANGLES)[int(one["axis_index"].values[k])]
    panel.set_title(f"{NAMES[name]}, {unit}: {letter} {axis}, difference × {power}")


def spectra(solved):
    """Density before and after the fit.

    Parameters
    ----------
    solved : list of Dataset, "kbr_phase_centre.solve"
    """
    if not solved[0]["time_kbr"].size:
        return None
    figure, panels = grid(1, 3, 2.5, margins={"left": 0.065, "wspace": 0.24})
    for panel, one in zip(panels[0], solved, strict=True):
        unit, factor = UNITS[one.attrs["observable"]]
        density = [factor * np.sqrt(one[f"spectrum_{key}"].values) for key in ("observed", "residual")]
        panel.set_title(f"{NAMES[one.attrs['observable']]}, {unit}/√Hz")
        _densities(panel, one["frequency"].values, dict(zip(SPECTRA, density, strict=True)), SPECTRA)
    legend(figure, panels, 2)
    return figure


def _densities(panel, frequency, curves, styles):
    """Logarithmic panel of densities with the frequencies of the wiggle."""
    for divisor in (4e-3, 8e-3):
        panel.axvline(divisor, color=COLOURS["grey"], linewidth=0.7, linestyle=":")
    for name, values in curves.items():
        panel.loglog(frequency, np.where(values > 0, values, np.nan), label=name, **styles[name])
    panel.set(xlabel="Hz", xlim=(frequency[0], frequency[-1]))


def estimates(document):
    """Both transverse components, y and z, of both satellites from every observable, estimator and wiggle.

    Parameters
    ----------
    document : dict of `gravcal.report.kbr_phase_centre.document`
    """
    figure, panels = grid(2, 2, 4.2, margins={"wspace": 0.14, "hspace": 0.42, "bottom": 0.09})
    for row, (letter, blocks) in zip(panels, document["satellites"].items(), strict=True):
        for panel, k in zip(row, (1, 2), strict=True):
            _estimate(panel, document, letter, blocks, k)
    legend(figure, panels, 4)
    return figure


def _estimate(panel, document, letter, blocks, k):
    """One component: the adopted value as a band, every observable by both estimators, then each wiggle alone."""
    points, labels = [], [SHORT[name] for name in OBSERVABLES]
    for place, name in enumerate(OBSERVABLES):
        for shift, estimator, kind in ((-APART, "ls", "least squares"), (APART, "robust", "robust")):
            own = blocks[name][estimator]
            points.append((place + shift, own["phase_centre_mm"][k], own["sigma_mm"][k], kind))
    for one in document["manoeuvres"]:
        if one["satellite"] == letter and one["component"] == "xyz"[k]:
            own = one["estimates_mm"]["range_rate"]
            points.append((len(labels), own["value"], own["sigma"], "one wiggle alone"))
            labels.append(f"{one['kind'].replace('-', '−')}\nalone")
    adopted = document["adopted"]["satellites"][letter]
    value, sigma = adopted["phase_centre_mm"][k], adopted["sigma_mm"][k]
    if value is not None:
        panel.axhspan(value - sigma, value + sigma, label="adopted", **SHADE)
    for place, centre, error, kind in points:
        if centre is not None and error is not None:
            style = POINTS[kind] | {"markersize": 4, "linestyle": "none", "elinewidth": 0.9, "capsize": 1.5}
            panel.errorbar([place], [centre], [error], label=kind, **style)
    panel.set_xticks(range(len(labels)), labels)
    panel.set(title=f"GRACE-{letter} {'xyz'[k]}, mm", xlim=(-0.6, len(labels) - 0.4))


def noise(measured):
    """Density of the range noise.

    Parameters
    ----------
    measured : Dataset, "kbr_phase_centre.noise"
    """
    keys = dict(zip(NOISE, ("density", "model", "in_manoeuvres"), strict=True))
    known = {n: 1e6 * np.sqrt(measured[key].values) for n, key in keys.items() if np.any(measured[key].values > 0)}
    figure, panels = grid(1, 1, 2.4)
    panels[0, 0].set_title("noise, µm/√Hz")
    _densities(panels[0, 0], measured["frequency"].values, known, NOISE)
    legend(figure, panels, 3)
    return figure
