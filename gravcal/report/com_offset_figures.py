"""Figures of a centre-of-mass event: field, torquers, attitude, angular and linear acceleration."""

import numpy as np

from gravcal.report.com_offset_parts import KINDS
from gravcal.report.drawing import Look, Panel, boxes, dots, level, limits, line, steps, upright
from gravcal.report.drawing_frame import drawn, framed, legend, note
from gravcal.report.drawing_looks import COMPONENT, DASHED, DOTTED, OVERLAY, VARIANT_LOOK
from gravcal.report.figures import COLOURS
from gravcal.report.plain import AXES

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
BORDER = Look(COLOURS["grey"], width=0.5, dash=DOTTED)
THIN = Look(COLOURS["grey"], width=0.5)
FIELD = {
    "magnetometer": Look(COLOURS["orange"], 0, shape="circle", size=2.2),
    "IGRF": Look(COLOURS["black"], 0.7),
    "bias": Look(COLOURS["vermilion"], dash=DASHED),
}
LINEAR = {
    "measured": Look(COLOURS["sky"], 1.4),
    "model": Look(COLOURS["black"], 0.7),
    "difference, shifted": Look(COLOURS["vermilion"], 0.7),
}
FROM_EDGE = "time from the first edge (s)"
PERIOD_S = 12.0


def field(checked, aligned):
    """Measured field and model in the body, and their difference, the windows joined end to end.

    Parameters
    ----------
    checked : Dataset, "com_offset.field"
    aligned : Dataset, "com_offset.align"
    """
    used = (checked["used"].values != 0)[:, None]
    time, ends = _joined(checked["time_mag"].values, aligned["window_start"].values, aligned["window_stop"].values)
    units = {"measured_b": 1e6, "model_b": 1e6, "difference_b": 1e9}
    series = {name: np.where(used, unit * checked[name].values, np.nan) for name, unit in units.items()}
    titles = ({"title": "field in SRF"}, {"title": "magnetometer minus IGRF"})
    parts = [legend(FIELD)]
    for row, (left, right) in enumerate(boxes(3, 2, 330, across=66)):
        words = _outer(row, 3, "minutes of record, windows joined end to end")
        axis, own = AXES[row], {name: values[:, row] for name, values in series.items()}
        panel = Panel(left, (ends[0], ends[-1]), limits(own["model_b"], own["measured_b"], margin=0.12))
        thin = slice(None, None, max(1, time.size // 500))
        marks = [dots(panel, time[thin], own["measured_b"][thin], FIELD["magnetometer"])]
        marks.append(line(panel, time, own["model_b"], FIELD["IGRF"]))
        parts.append(_windows(panel, ends, marks, words | {"y_label": f"B_{axis} (µT)"} | titles[0]))
        panel = Panel(right, panel.x, limits(own["difference_b"], margin=0.12))
        marks = [line(panel, time, own["difference_b"], Look(COLOURS["blue"], 0.7))]
        marks.append(level(panel, 1e9 * float(checked["bias"].values[row]), FIELD["bias"]))
        parts.append(_windows(panel, ends, marks, words | {"y_label": f"ΔB_{axis} (nT)"} | titles[1]))
        titles = ({}, {})
    return drawn(330, "magnetic field", *parts)


def _windows(panel, ends, marks, words):
    """Panel with dotted lines where windows meet; in the first row, which has a title, with their numbers."""
    numbers = ""
    if "title" in words and len(ends) > 2:
        middles = (ends[1:] + ends[:-1]) / 2
        numbers = "".join(note(panel, middle, str(i)) for i, middle in enumerate(middles, start=1))
    return framed(panel, upright(panel, ends[1:-1], BORDER), *marks, **words) + numbers


def _outer(row, rows, label):
    """Numbers and label of the lower scale for the last row only."""
    return {"x_label": label} if row == rows - 1 else {"x_numbers": False}


def torquers(aligned, smoothed, detected):
    """Torquer currents and the angular acceleration they make, one row for each manoeuvre.

    Parameters
    ----------
    aligned, smoothed, detected : Dataset, "com_offset.align", "com_offset.attitude", "com_offset.detect"
    """
    count = detected.sizes["manoeuvre"]
    height = 80 + 61 * count
    parts, index = [legend(COMPONENT)], smoothed["acc_manoeuvre"].values
    x = (-12.0, float(np.nanmax(detected["stop"].values - detected["start"].values)) + 12.0)
    own = ("torquer current (mA)", "angular acceleration by the torquers (µrad s⁻²)")
    titles = [{"title": title} for title in own]
    for row, (left, right) in enumerate(boxes(count, 2, height, across=50)):
        words, start = _outer(row, count, FROM_EDGE), float(detected["start"].values[row])
        mag = aligned["time_mag"].values - start
        near = (mag > x[0]) & (mag < x[1])
        current, inside = aligned["current_b"].values[near], index == row
        made = 1e6 * smoothed["magnetic_b"].values[inside]
        panel = Panel(left, x, limits(current, margin=0.1))
        marks = [steps(panel, mag[near], current[:, i], COMPONENT[axis]) for i, axis in enumerate(AXES)]
        name = f"{row + 1} {KINDS[int(detected['kind'].values[row])]}"
        parts.append(framed(panel, *marks, **words, **titles[0], y_label=name))
        panel, since = Panel(right, x, limits(made, margin=0.1)), smoothed["time_acc"].values[inside] - start
        marks = [line(panel, since, made[:, i], COMPONENT[axis]) for i, axis in enumerate(AXES)]
        parts.append(framed(panel, *marks, **words, **titles[1]))
        titles = ({}, {})
    return drawn(height, "torquers", *parts)


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
    limit = 1.15 * np.nanmax(np.abs(residual))
    parts, titled = [], {"title": "star camera minus dynamics"}
    for row, (box,) in enumerate(boxes(3, 1, 250, top=22)):
        panel = Panel(box, (0.0, ends[-1]), (-limit, limit))
        marks = [
            level(panel, 0, THIN),
            dots(panel, joined, residual[:, row], Look(COLOURS["blue"], shape="circle", size=1.5)),
        ]
        words = _outer(row, 3, "seconds of fitted record, joined end to end") | titled
        parts.append(_windows(panel, ends, marks, words | {"y_label": f"{AXES[row]} (µrad)"}))
        titled = {}
    return drawn(250, "attitude", *parts)


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
    height = 90 + 112 * len(chosen)
    parts = [legend({name: OVERLAY[name] for name in names})]
    for row, (left, right) in enumerate(boxes(len(chosen), 2, height, down=24)):
        manoeuvre, kind = chosen[row], kinds[chosen[row]]
        edges = (detected["edge_lower"].values[manoeuvre] + detected["edge_upper"].values[manoeuvre]) / 2
        series = {name: _about(angular[name], manoeuvre, kind, edges[0]) for name in names}
        edges = edges[np.isfinite(edges)] - edges[0]
        words, axis = _outer(row, len(chosen), FROM_EDGE), AXES[kind]
        titles = f"manoeuvre {manoeuvre + 1}, {KINDS[kind]}", "minus mtq, mean of each half period"
        shown = {name: _periods(*one) for name, one in series.items()}
        panel = Panel(left, (1.0, 3 + 3 * PERIOD_S), limits(*(y for _, y in shown.values())))
        marks = [line(panel, *one, OVERLAY[name]) for name, one in shown.items()]
        parts.append(framed(panel, *marks, **words, y_label=f"ω̇_{axis} (µrad s⁻²)", title=titles[0]))
        parts.append(_half_periods(right, series, edges, words | {"title": titles[1]}))
    return drawn(height, "angular accelerations", *parts)


def _about(angular, manoeuvre, axis, start):
    """Time since an epoch and angular acceleration (µrad s-2) about one axis in one manoeuvre, mean removed."""
    inside = angular["acc_manoeuvre"].values == manoeuvre
    values = 1e6 * angular["rate_dot_b"].values[inside, axis]
    mean = np.nanmean(values) if np.isfinite(values).any() else 0.0
    return angular["time_acc"].values[inside] - start, values - mean


def _periods(since, values):
    """Three periods of a series."""
    inside = (since >= 2) & (since <= 2 + 3 * PERIOD_S)
    return since[inside], values[inside]


def _half_periods(box, series, edges, words):
    """Panel with the difference to the torquers in every half period, the second round an edge left out."""
    time, torquer = series["mtq"]
    middle = (edges[1:] + edges[:-1]) / 2
    bounds = np.searchsorted(time, np.stack([edges[:-1] + 0.8, edges[1:] - 0.8]))
    means = {}
    for name in [name for name in series if name != "mtq"]:
        difference = series[name][1] - torquer
        means[name] = np.array([np.mean(difference[a:b]) if b > a else np.nan for a, b in bounds.T])
    panel = Panel(box, limits(edges, margin=0.03), limits(*means.values()))
    marks = []
    for name, values in means.items():
        look = VARIANT_LOOK[name]
        marks += [line(panel, middle, values, Look(look.colour, 0.6, look.dash))]
        marks += [dots(panel, middle, values, Look(look.colour, shape=look.shape, size=2.8))]
    return framed(panel, *marks, **words)


def linear_accelerations(solved, detected):
    """Measured and modelled linear acceleration with their difference, one row for each manoeuvre.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    detected : Dataset, "com_offset.detect"
    """
    count = detected.sizes["manoeuvre"]
    height = 80 + 98 * count
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    x = (-6.0, float(np.nanmax(detected["stop"].values - detected["start"].values)) + 6.0)
    parts, titles = [legend(LINEAR)], [{"title": f"f_{axis} (nm s⁻²)"} for axis in AXES]
    for row, places in enumerate(boxes(count, 3, height, left=54, across=36, down=13)):
        own, words = index == row, _outer(row, count, FROM_EDGE)
        since = time[own] - detected["start"].values[row]
        reading, model = (1e9 * solved[name].values[own] for name in ("reading", "model"))
        named = {"y_label": f"{row + 1} {KINDS[int(detected['kind'].values[row])]}"}
        for column, box in enumerate(places):
            series = since, reading[:, column], model[:, column]
            parts.append(_linear(box, x, series, words | titles[column] | (named if column == 0 else {})))
        titles = [{}] * 3
    return drawn(height, "linear acceleration", *parts)


def _linear(box, x, series, words):
    """Panel of one component in one manoeuvre, the difference below."""
    since, reading, model = series
    if not since.size:
        return framed(Panel(box, x, (-1.0, 1.0)), **words)
    drop = 1.3 * max(np.abs(reading).max(), np.abs(model).max(), 1e-3)
    curves = dict(zip(LINEAR, (reading, model, reading - model - drop), strict=True))
    panel = Panel(box, x, limits(*curves.values()))
    marks = [level(panel, -drop, THIN), *(line(panel, since, y, LINEAR[name]) for name, y in curves.items())]
    return framed(panel, *marks, **words)


def _joined(time, start, stop):
    """Times of several windows laid end to end (min), and where they meet."""
    start, order = np.sort(start), np.argsort(start)
    stop = np.asarray(stop)[order]
    begin = np.concatenate([[0.0], np.cumsum(stop - start)])
    index = np.clip(np.searchsorted(start, time, side="right") - 1, 0, start.size - 1)
    return (time - start[index] + begin[index]) / 60, begin / 60
