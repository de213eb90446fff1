"""Figures of a centre-of-mass event, like those of 10.3390/rs14164030: from field and torquers to the estimates."""

import numpy as np

from gravcal.report.com_offset_parts import KINDS
from gravcal.report.figures import AXIS, COLOURS, VARIANTS, grid, legend, number_windows, thinned
from gravcal.report.plain import AXES

WIDTHS = {"mtq": 2.4, "acc_calibrated": 1.1, "acc": 0.9, "sca": 1.0}  # wide below, thin above: all four are seen
LINEAR = {
    "measured": {"color": COLOURS["sky"], "linewidth": 1.4},
    "model": {"color": COLOURS["black"], "linewidth": 0.6},
    "difference, shifted": {"color": COLOURS["vermilion"], "linewidth": 0.6},
}
FROM_EDGE = "time from the first edge (s)"
PERIOD_S = 12.0
SPREAD = 0.24  # of the angular accelerations about the place of their manoeuvre
STEP_S = 0.5  # of the grid of a solution


def field(checked, aligned):
    """Measured field and model in the body, and their difference, the windows joined end to end.

    Parameters
    ----------
    checked : Dataset, "com_offset.field"
    aligned : Dataset, "com_offset.align"
    """
    used = (checked["used"].values != 0)[:, None]
    time, ends = _joined(checked["time_mag"].values, aligned["window_start"].values, aligned["window_stop"].values)
    measured, model = (1e6 * np.where(used, checked[name].values, np.nan) for name in ("measured_b", "model_b"))
    difference = 1e9 * np.where(used, checked["difference_b"].values, np.nan)
    figure, panels = grid(3, 2, 3.4, sharex=True, margins={"wspace": 0.2, "hspace": 0.14})
    panels[0, 0].set_title("field in SRF")
    panels[0, 1].set_title("magnetometer minus IGRF")
    thin = slice(None, None, max(1, time.size // 500))
    for row, axis in enumerate(AXES):
        left, right = panels[row]
        left.plot(
            time[thin],
            measured[thin, row],
            ".",
            color=COLOURS["orange"],
            markersize=2.2,
            label="magnetometer",
            rasterized=True,
        )
        left.plot(*thinned(time, model[:, row]), color=COLOURS["black"], linewidth=0.7, label="IGRF")
        right.plot(*thinned(time, difference[:, row]), color=COLOURS["blue"], linewidth=0.7)
        bias = 1e9 * float(checked["bias"].values[row])
        right.axhline(bias, color=COLOURS["vermilion"], linestyle="--", label="bias")
        number_windows(left, ends)
        number_windows(right, ends)
        left.set_ylabel(f"B$_{axis}$ (µT)")
        right.set_ylabel(f"ΔB$_{axis}$ (nT)")
    for panel in panels[-1]:
        panel.set_xlabel("minutes of record, windows joined end to end")
    legend(figure, panels[0], 3)
    return figure


def torquers(aligned, smoothed, detected):
    """Torquer currents and the angular acceleration they make, one row for each manoeuvre.

    Parameters
    ----------
    aligned, smoothed, detected : Dataset, "com_offset.align", "com_offset.attitude", "com_offset.detect"
    """
    figure, (left, right) = _rows(detected, 2, 0.55)
    left.set_title("torquer current (mA)")
    right.set_title("angular acceleration by the torquers (µrad s$^{-2}$)")
    margin = 12.0
    for row, (start, length) in enumerate(_spans(detected)):
        since = aligned["time_mag"].values - start
        near = (since > -margin) & (since < length + margin)
        _stacked(left, row, since[near], aligned["current_b"].values[near].T, AXIS, steps=True)
        inside = smoothed["acc_manoeuvre"].values == row
        made = 1e6 * smoothed["magnetic_b"].values[inside].T
        _stacked(right, row, smoothed["time_acc"].values[inside] - start, made, AXIS)
    legend(figure, left, 3)
    return figure


def linear_accelerations(solved, detected):
    """Measured and modelled linear acceleration with their difference, one row for each manoeuvre.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    detected : Dataset, "com_offset.detect"
    """
    figure, panels = _rows(detected, 3, 0.72)
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    for axis, panel in enumerate(panels):
        panel.set_title(f"f$_{AXES[axis]}$ (nm s$^{{-2}}$)")
        for row, (start, _) in enumerate(_spans(detected)):
            own = index == row
            if not own.any():
                continue
            reading, model = (1e9 * solved[name].values[own, axis] for name in ("reading", "model"))
            size = max(np.abs(reading).max(), np.abs(model).max(), 1e-3)
            curves = (reading, model, reading - model - 1.3 * size)
            _stacked(panel, row, time[own] - start, curves, LINEAR, size=size)
    legend(figure, panels[0], 3)
    return figure


def _rows(detected, columns, height_in):
    """Figure with panels side by side, in each one row for every manoeuvre, named at the left."""
    count = detected.sizes["manoeuvre"]
    names = [f"{i + 1} {KINDS[int(kind)]}" for i, kind in enumerate(detected["kind"].values)]
    figure, panels = grid(1, columns, 0.75 + height_in * count, sharey=True, margins={"wspace": 0.14, "right": 0.95})
    panels[0, 0].set_yticks(-np.arange(count), names)
    panels[0, 0].set_ylim(-count + 0.45, 0.55)
    for panel in panels[0]:
        panel.set_xlabel(FROM_EDGE)
        panel.tick_params(axis="y", length=0)
    return figure, panels[0]


def _spans(detected):
    """Start and length of every manoeuvre."""
    return list(zip(detected["start"].values, detected["stop"].values - detected["start"].values, strict=True))


def _stacked(panel, row, since, curves, styles, steps=False, size=None):
    """Curves of one manoeuvre in its row, scaled to fill it; their largest size stands at the right."""
    size = np.nanmax(np.abs(np.stack(curves)), initial=0.0) if size is None else size
    known = np.concatenate([one[np.isfinite(one)] for one in curves] or [[0.0]])
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    scale = 0.9 / (high - low or 1.0)
    for (name, style), values in zip(styles.items(), curves, strict=True):
        x, y = (since, values) if steps else thinned(since, values, 500)
        shown = {"linewidth": 0.8} | style | ({"drawstyle": "steps-post"} if steps else {})
        panel.plot(x, -row + scale * (y - (low + high) / 2), label=name if row == 0 else None, **shown)
    place = {"xycoords": ("axes fraction", "data"), "ha": "left", "va": "center", "annotation_clip": False}
    panel.annotate(f"±{size:.3g}", (1.005, -row), fontsize=6, color="#767676", **place)


def attitude(smoothed):
    """Star camera minus fitted dynamics, the manoeuvres joined end to end.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    """
    index, time = smoothed["sca_manoeuvre"].values, smoothed["time_sca"].values
    if time.size == 0:
        return None
    spans = [time[index == i][[0, -1]] for i in np.unique(index)]
    ends = np.concatenate([[0.0], np.cumsum([stop - start + 1 for start, stop in spans])])
    joined = np.concatenate([time[index == i] - spans[n][0] + ends[n] for n, i in enumerate(np.unique(index))])
    residual = 1e6 * smoothed["sca_residual_b"].values
    figure, panels = grid(3, 1, 2.6, sharex=True, sharey=True, margins={"hspace": 0.12})
    panels[0, 0].set_title("star camera minus dynamics")
    for row, (panel,) in enumerate(panels):
        panel.axhline(0, color=COLOURS["grey"], linewidth=0.5)
        panel.plot(joined, residual[:, row], ".", color=COLOURS["blue"], markersize=1.4, rasterized=True)
        number_windows(panel, ends)
        panel.set_ylabel(f"{AXES[row]} (µrad)")
    panels[-1, 0].set_xlabel("seconds of fitted record, joined end to end")
    return figure


def angular_accelerations(angular, detected):
    """The four angular accelerations over three periods, and how far each is from the torquers' in every half period.

    Parameters
    ----------
    angular : {variant: Dataset, "com_offset.angular_acceleration"}
    detected : Dataset, "com_offset.detect"
    """
    kinds = detected["kind"].values.astype(int)
    chosen = [int(np.flatnonzero(kinds == kind)[0]) for kind in range(3) if (kinds == kind).any()]
    if not chosen or "mtq" not in angular:
        return None
    names = [name for name in VARIANTS if name in angular]
    room = {"wspace": 0.16, "hspace": 0.28}
    figure, panels = grid(len(chosen), 2, 0.9 + 1.1 * len(chosen), sharex="col", margins=room)
    for (left, right), manoeuvre in zip(panels, chosen, strict=True):
        kind = kinds[manoeuvre]
        edges = (detected["edge_lower"].values[manoeuvre] + detected["edge_upper"].values[manoeuvre]) / 2
        series = {name: _about(angular[name], manoeuvre, kind, edges[0]) for name in names}
        for name, (since, values) in series.items():
            inside = (since >= 2) & (since <= 2 + 3 * PERIOD_S)
            style = VARIANTS[name] | {"marker": "", "linewidth": WIDTHS[name], "label": name}
            left.plot(since[inside], values[inside], **style)
        left.set_ylabel(f"ω̇$_{AXES[kind]}$ (µrad s$^{{-2}}$)")
        left.set_title(f"manoeuvre {manoeuvre + 1}, {KINDS[kind]}")
        _half_periods(right, series, edges[np.isfinite(edges)] - edges[0])
    panels[0, 1].set_title("minus mtq, mean of each half period")
    for panel in panels[-1]:
        panel.set_xlabel(FROM_EDGE)
    legend(figure, panels[0, 0], 4)
    return figure


def _about(angular, manoeuvre, axis, start):
    """Time since an epoch and angular acceleration (µrad s-2) about one axis in one manoeuvre, mean removed."""
    inside = angular["acc_manoeuvre"].values == manoeuvre
    values = 1e6 * angular["rate_dot_b"].values[inside, axis]
    mean = np.nanmean(values) if np.isfinite(values).any() else 0.0
    return angular["time_acc"].values[inside] - start, values - mean


def _half_periods(panel, series, edges):
    """Difference to the torquers in every half period, the second round an edge left out."""
    time, torquer = series["mtq"]
    bounds = np.searchsorted(time, np.stack([edges[:-1] + 0.8, edges[1:] - 0.8]))
    for name in [name for name in series if name != "mtq"]:
        difference = series[name][1] - torquer
        means = [np.mean(difference[a:b]) if b > a else np.nan for a, b in bounds.T]
        panel.plot((edges[1:] + edges[:-1]) / 2, means, **VARIANTS[name] | {"linewidth": 0.6, "markersize": 2.4})


def _joined(time, start, stop):
    """Times of several windows laid end to end (min), and where they meet."""
    start, order = np.sort(start), np.argsort(start)
    stop = np.asarray(stop)[order]
    begin = np.concatenate([[0.0], np.cumsum(stop - start)])
    index = np.clip(np.searchsorted(start, time, side="right") - 1, 0, start.size - 1)
    return (time - start[index] + begin[index]) / 60, begin / 60


def spectra(solved):
    """Density of the residuals beside the noise as measured, and of the modelled signal.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    """
    pieces = _pieces(solved)
    if not pieces:
        return None
    reading, model = solved["reading"].values, solved["model"].values
    frequency, residual = _density(reading - model, pieces)
    _, signal = _density(model, pieces)
    stated = np.sqrt(solved["noise_density"].values)
    low = np.nanmin([np.nanmin(stated), np.nanpercentile(residual, 5)])
    figure, panels = grid(1, 3, 2.6, sharex=True, sharey=True, margins={"wspace": 0.06, "right": 0.98})
    for axis, panel in enumerate(panels[0]):
        panel.loglog(frequency, signal[:, axis], color=COLOURS["sky"], label="modelled signal")
        panel.loglog(frequency, residual[:, axis], color=COLOURS["vermilion"], linewidth=0.8, label="residual")
        style = {"color": COLOURS["black"], "linewidth": 1.3, "label": "noise as measured"}
        panel.loglog(solved["frequency"].values, stated[axis], **style)
        panel.set(title=f"f$_{AXES[axis]}$", xlabel="frequency (Hz)", xlim=(frequency[1], 1.0))
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
    power = 2 * STEP_S * np.mean(parts, axis=0) / np.sum(taper**2)
    return np.fft.rfftfreq(length, STEP_S)[1:], np.sqrt(power)[1:]


def estimates(document, printed):
    """Every manoeuvre's estimate with its error, the adopted offset as a band, printed values hollow.

    Parameters
    ----------
    document : dict of `gravcal.report.com_offset.document`
    printed : {(manoeuvre, variant): record} of `com_offset_tables.printed_manoeuvres`
    """
    manoeuvres = document["manoeuvres"]
    adopted = document["variants"].get(document["adopted"]["variant"])
    names = list(document["variants"])
    figure, panels = grid(3, 1, 4.6, sharex=True, margins={"hspace": 0.1})
    panels[0, 0].set_title("offset, proof mass to CoM")
    for row, (panel,) in enumerate(panels):
        if adopted is not None and adopted["offset_um"][row] is not None:
            value, sigma, total = (adopted[name][row] for name in ("offset_um", "sigma_um", "sigma_total_um"))
            panel.axhspan(value - total, value + total, color=COLOURS["yellow"], alpha=0.3, lw=0, label="total error")
            panel.axhspan(value - sigma, value + sigma, color=COLOURS["orange"], alpha=0.45, lw=0, label="adopted")
            panel.axhline(value, color=COLOURS["orange"], linewidth=0.6)
        for name, shift in zip(names, np.linspace(-SPREAD, SPREAD, len(names)), strict=True):
            blocks = [one["variants"][name] for one in manoeuvres]
            value, sigma = (np.array([b[key][row] for b in blocks], dtype=float) for key in ("offset_um", "sigma_um"))
            style = VARIANTS[name] | {"linestyle": "none", "markersize": 3.2}
            place = np.arange(len(manoeuvres)) + shift
            panel.errorbar(place, value, sigma, label=name, elinewidth=0.9, capsize=1.5, **style)
            known = [printed.get((i, name)) for i in range(len(manoeuvres))]
            known = np.array([None if one is None else one.value[row] for one in known], dtype=float)
            if np.isfinite(known).any():
                panel.plot(place, known, **style | {"markersize": 5.2, "markerfacecolor": "none"})
        panel.set_ylabel(f"{AXES[row]} (µm)")
    labels = [f"{i} {one['kind']}\n{one['latitude_class'] or ''}" for i, one in enumerate(manoeuvres, start=1)]
    panel.set_xticks(np.arange(len(manoeuvres)), labels)
    panel.set_xlim(-0.6, len(manoeuvres) - 0.4)
    legend(figure, panels[0, 0], 2 + len(names))
    return figure


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
    figure, panels = grid(1, 1, 2.0)
    panel = panels[0, 0]
    style = {"color": COLOURS["orange"], "marker": "o", "markersize": 2.2, "linewidth": 0.6, "label": "star camera"}
    panel.plot(time - time[0], 1e6 * rate, **style)
    panel.plot(time - time[0], 1e6 * slope * impulse, color=COLOURS["black"], label="torquers")
    panel.set(xlabel="time (s)", ylabel="ω$_x$ (µrad s$^{-1}$)")
    legend(figure, panel, 2)
    return figure
