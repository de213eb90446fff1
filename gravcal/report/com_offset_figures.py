"""Figures of a centre-of-mass event: field, torquers, attitude, angular and linear acceleration."""

import numpy as np

from gravcal.report.com_offset_parts import KINDS
from gravcal.report.figures import COLOURS, grid, legend
from gravcal.report.plain import AXES

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
VARIANT_STYLE = {
    "mtq": {"color": COLOURS["black"], "linestyle": "-", "marker": "o"},
    "acc_calibrated": {"color": COLOURS["vermilion"], "linestyle": "-", "marker": "s"},
    "acc": {"color": COLOURS["sky"], "linestyle": "--", "marker": "^"},
    "sca": {"color": COLOURS["purple"], "linestyle": "-.", "marker": "D"},
}
COMPONENT = {
    "x": {"color": COLOURS["blue"], "linestyle": "-"},
    "y": {"color": COLOURS["orange"], "linestyle": "-"},
    "z": {"color": COLOURS["green"], "linestyle": "--"},
}
PERIOD_S = 12.0


def field(checked, aligned):
    """Measured field and model in the body, and their difference, the windows joined end to end.

    Parameters
    ----------
    checked : Dataset, "com_offset.field"
    aligned : Dataset, "com_offset.align"
    """
    figure, panels = grid(3, 2, 3.3, sharex=True, margins={"hspace": 0.16, "wspace": 0.24})
    used = checked["used"].values != 0
    time, ends = _joined(checked["time_mag"].values, aligned["window_start"].values, aligned["window_stop"].values)
    measured, model = 1e6 * checked["measured_b"].values, 1e6 * checked["model_b"].values
    difference = 1e9 * checked["difference_b"].values
    step = max(1, time.size // 600)
    for row, axis in enumerate(AXES):
        left, right = panels[row]
        mark = {"linestyle": "none", "marker": ".", "markersize": 4, "color": COLOURS["orange"]}
        left.plot(time[::step], np.where(used, measured[:, row], np.nan)[::step], label="magnetometer", **mark)
        left.plot(time, np.where(used, model[:, row], np.nan), color=COLOURS["black"], linewidth=0.6, label="IGRF")
        right.plot(time, np.where(used, difference[:, row], np.nan), color=COLOURS["blue"], linewidth=0.6)
        bias = 1e9 * float(checked["bias"].values[row])
        right.axhline(bias, color=COLOURS["vermilion"], linewidth=0.9, linestyle="--", label="bias")
        left.set_ylabel(f"$B_{axis}$ (µT)")
        right.set_ylabel(f"$\\Delta B_{axis}$ (nT)")
        for panel in (left, right):
            _separate(panel, ends, numbered=row == 0)
    panels[0, 1].set_title("magnetometer minus IGRF")
    panels[0, 0].set_title("field in SRF")
    legend(figure, panels[0, 0], 2)
    _label_bottom(panels, "minutes of record, windows joined end to end")
    return figure


def torquers(aligned, smoothed, detected):
    """Torquer currents and the angular acceleration they make, one row for each manoeuvre.

    Parameters
    ----------
    aligned, smoothed, detected : Dataset, "com_offset.align", "com_offset.attitude", "com_offset.detect"
    """
    count = detected.sizes["manoeuvre"]
    figure, panels = grid(count, 2, 0.5 + 0.61 * count, sharex=True, margins={"hspace": 0.22, "wspace": 0.2})
    index = smoothed["acc_manoeuvre"].values
    for row, (start, stop) in enumerate(zip(detected["start"].values, detected["stop"].values, strict=True)):
        mag = aligned["time_mag"].values
        near = (mag > start - 12) & (mag < stop + 12)
        own = index == row
        for column, axis in enumerate(AXES):
            panels[row, 0].step(
                mag[near] - start,
                aligned["current_b"].values[near, column],
                where="post",
                linewidth=0.8,
                label=f"{axis}",
                **COMPONENT[axis],
            )
            panels[row, 1].plot(
                smoothed["time_acc"].values[own] - start,
                1e6 * smoothed["magnetic_b"].values[own, column],
                linewidth=0.8,
                **COMPONENT[axis],
            )
        panels[row, 0].set_ylabel(f"{row + 1} {KINDS[int(detected['kind'].values[row])]}")
    panels[0, 0].set_title("torquer current (mA)")
    panels[0, 1].set_title("angular acceleration by the torquers (µrad s$^{-2}$)")
    legend(figure, panels[0, 0], 3)
    _label_bottom(panels, "time from the first edge (s)")
    return figure


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
    figure, panels = grid(3, 1, 2.5, sharex=True, margins={"hspace": 0.18})
    residual = 1e6 * smoothed["sca_residual_b"].values
    limit = 1.15 * np.nanmax(np.abs(residual))
    for row, axis in enumerate(AXES):
        panel = panels[row, 0]
        panel.plot(joined, residual[:, row], ".", markersize=2, color=COLOURS["blue"])
        panel.axhline(0, color=COLOURS["black"], linewidth=0.5)
        panel.set_ylabel(f"{axis} (µrad)")
        panel.set_ylim(-limit, limit)
        _separate(panel, ends, numbered=row == 0)
    panels[0, 0].set_title("star camera minus dynamics")
    _label_bottom(panels, "seconds of fitted record, joined end to end")
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
    margins = {"hspace": 0.34, "wspace": 0.2}
    figure, panels = grid(len(chosen), 2, 0.7 + 1.1 * len(chosen), sharex="col", margins=margins)
    for row, manoeuvre in enumerate(chosen):
        kind = kinds[manoeuvre]
        edges = (detected["edge_lower"].values[manoeuvre] + detected["edge_upper"].values[manoeuvre]) / 2
        series = {name: _about(angular[name], manoeuvre, kind) for name in names}
        _overlay(panels[row, 0], series, edges[0])
        _half_periods(panels[row, 1], series, edges[np.isfinite(edges)])
        panels[row, 0].set_ylabel(f"$\\dot\\omega_{AXES[kind]}$ (µrad s$^{{-2}}$)")
        panels[row, 0].set_title(f"manoeuvre {manoeuvre + 1}, {KINDS[kind]}", fontsize=7.5, pad=2)
        panels[row, 1].set_title("minus mtq, mean of each half period", fontsize=7.5, pad=2)
    legend(figure, panels[0, 0], 4)
    _label_bottom(panels, "time from the first edge (s)")
    return figure


def _about(angular, manoeuvre, axis):
    """Epochs and angular acceleration (µrad s-2) about one axis in one manoeuvre, mean removed."""
    inside = angular["acc_manoeuvre"].values == manoeuvre
    values = 1e6 * angular["rate_dot_b"].values[inside, axis]
    return angular["time_acc"].values[inside], values - np.nanmean(values) if np.isfinite(values).any() else values


def _overlay(panel, series, start):
    """Three periods of every series."""
    for name, (time, values) in series.items():
        since = time - start - 2
        inside = (since >= 0) & (since <= 3 * PERIOD_S)
        look = {k: v for k, v in VARIANT_STYLE[name].items() if k != "marker"}
        width = {"mtq": 2.2, "acc_calibrated": 1.1, "acc": 0.7, "sca": 0.9}[name]
        panel.plot(since[inside] + 2, values[inside], linewidth=width, label=name, **look)


def _half_periods(panel, series, edges):
    """Difference to the torquers in every half period, the second round an edge left out."""
    time, torquer = series["mtq"]
    middle = (edges[1:] + edges[:-1]) / 2 - edges[0]
    for name in [name for name in series if name != "mtq"]:
        difference = series[name][1] - torquer
        bounds = np.searchsorted(time, np.stack([edges[:-1] + 0.8, edges[1:] - 0.8]))
        means = [np.mean(difference[a:b]) if b > a else np.nan for a, b in bounds.T]
        panel.plot(middle, means, linewidth=0.6, markersize=2.2, **VARIANT_STYLE[name])


def linear_accelerations(solved, detected):
    """Measured and modelled linear acceleration with their difference, one row for each manoeuvre.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    detected : Dataset, "com_offset.detect"
    """
    count = detected.sizes["manoeuvre"]
    figure, panels = grid(
        count, 3, 0.5 + 0.98 * count, sharex=True, margins={"hspace": 0.2, "wspace": 0.22, "left": 0.075}
    )
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    for row in range(count):
        own = index == row
        since = time[own] - detected["start"].values[row]
        for column in range(3):
            reading, model = (1e9 * solved[name].values[own, column] for name in ("reading", "model"))
            panel = panels[row, column]
            if since.size:
                drop = 1.3 * max(np.abs(reading).max(), np.abs(model).max(), 1e-3)
                panel.plot(since, reading, color=COLOURS["sky"], linewidth=1.3, label="measured")
                panel.plot(since, model, color=COLOURS["black"], linewidth=0.7, label="model")
                panel.plot(
                    since,
                    reading - model - drop,
                    color=COLOURS["vermilion"],
                    linewidth=0.6,
                    label="difference, shifted",
                )
                panel.axhline(-drop, color=COLOURS["grey"], linewidth=0.4)
        panels[row, 0].set_ylabel(f"{row + 1} {KINDS[int(detected['kind'].values[row])]}")
    for column, axis in enumerate(AXES):
        panels[0, column].set_title(f"$f_{axis}$ (nm s$^{{-2}}$)")
    legend(figure, panels[0, 0], 3)
    _label_bottom(panels, "time from the first edge (s)")
    return figure


def _joined(time, start, stop):
    """Times of several windows laid end to end (min), and where they meet."""
    start, order = np.sort(start), np.argsort(start)
    stop = np.asarray(stop)[order]
    begin = np.concatenate([[0.0], np.cumsum(stop - start)])
    index = np.clip(np.searchsorted(start, time, side="right") - 1, 0, start.size - 1)
    return (time - start[index] + begin[index]) / 60, begin / 60


def _separate(panel, ends, numbered):
    """Thin lines where windows meet, no room left and right; their numbers inside the top edge of the first row."""
    for end in ends[1:-1]:
        panel.axvline(end, color=COLOURS["grey"], linewidth=0.5, linestyle=":")
    if numbered and len(ends) > 2:
        panel.margins(y=0.2)
        for number, middle in enumerate((ends[1:] + ends[:-1]) / 2, start=1):
            place = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "top"}
            panel.annotate(str(number), (middle, 1.0), fontsize=6.5, color=COLOURS["grey"], **place)
    panel.set_xlim(ends[0], ends[-1])


def _label_bottom(panels, text):
    """Label of the common horizontal axis."""
    for panel in panels[-1]:
        panel.set_xlabel(text)
