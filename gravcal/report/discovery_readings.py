"""Figure of a discovery in the units of the instrument: what was measured, what either model simulates, differences."""

from __future__ import annotations

import numpy as np

from gravcal.report.discovery_figures import LINES
from gravcal.report.drawing import Look, Panel, boxes, limits, line
from gravcal.report.drawing_frame import drawn, framed, legend
from gravcal.report.figures import COLOURS

MEASURED = Look(COLOURS["black"], 0.9)
MODELS = dict(zip(("baseline", "extended"), LINES.items(), strict=True))  # part of the product: name, look
PREFIXES = {"n": 1e9, "u": 1e6, "m": 1e3, "": 1.0}
CAPTION = (
    "Reading of the channel and block that the extension helps most, drift and start values fitted with either model; "
    "Δ is measured less simulated."
)
ALONE = "Reading of the channel and block of the least likely band; Δ is measured less simulated."
REBUILT = " The measured reading is that of the records without the findings, with these added in their linear form."


FILTERED = " It is low-passed like in the solution; its mean is left out."
WHAT = {
    ("com_offset", "linear"): FILTERED,
    ("com_offset", "angular"): FILTERED,
    ("com_offset", "attitude"): " It is the rotation from a satellite whose torquers are off; its mean is left out.",
    ("gradient_torque", "linear"): " It is the difference of both sensors; its mean is left out.",
    ("inertial_sensor", "roll"): " Straight pieces lie between the segments; its mean is left out.",
    ("kbr_phase_centre", "range"): " The distance of the orbits is taken off, and the mean.",
}
PLAIN = " Its mean is left out."


def shown(found) -> tuple[str, dict[str, np.ndarray]] | None:
    """Channel and its readings, {"measured", "baseline", "extended": (n, a)}; None where the product holds none.

    Parameters
    ----------
    found : Dataset of kind discovery
    """
    names = [str(n) for n in found.data_vars if str(n).endswith("_measured")]
    if not names:
        return None
    channel = names[0].removesuffix("_measured")
    parts = ("measured", *MODELS)
    return channel, {p: found[f"{channel}_{p}"].values for p in parts if f"{channel}_{p}" in found}


def caption(found, calibration: str) -> str:
    """Caption of the figure.

    Parameters
    ----------
    found : Dataset of kind discovery
    calibration : name
    """
    known = shown(found)
    text = CAPTION if known and "extended" in known[1] else ALONE
    text += WHAT.get((calibration, known[0]), PLAIN) if known else ""
    return text + (REBUILT if "rebuilt" in found.attrs else "")


def readings(found):
    """Measured and simulated readings of each axis against time, the differences below.

    Parameters
    ----------
    found : Dataset of kind discovery
    """
    if shown(found) is None:
        return None
    channel, parts = shown(found)
    measured, unit = parts.pop("measured"), found[f"{channel}_measured"].attrs["units"]
    time = found["time_reading"].values - found["time_reading"].values[0]
    axes = measured.shape[1]
    height = 74 + 164 * axes
    rows = [box for (box,) in boxes(2 * axes, 1, height, left=66)]
    looks = {MODELS[p][0]: MODELS[p][1] for p in parts}
    drawings = [legend({"measured": MEASURED} | looks)]
    title = ", ".join(dict.fromkeys([channel, _block(found, channel)]))
    for axis in range(axes):
        letter = "xyz"[axis] if axes > 1 else channel
        curves = [(MEASURED, measured[:, axis])] + [(MODELS[p][1], v[:, axis]) for p, v in parts.items()]
        rest = [(MODELS[p][1], measured[:, axis] - v[:, axis]) for p, v in parts.items()]
        for below, series in enumerate((curves, rest)):
            last = axis == axes - 1 and below
            words = {"x_label": "time from the first sample (s)"} if last else {"x_numbers": False}
            words |= {"title": title} if axis == 0 and not below else {}
            name = f"{'Δ' * below}{letter}"
            drawings.append(_panel(rows[2 * axis + below], time, series, (name, unit), words))
    return drawn(height, f"readings of {title}", *drawings)


def _panel(box, time, series, named, words):
    """Curves in a prefix of the unit that suits them."""
    name, unit = named
    values = np.concatenate([v for _, v in series])
    size = np.nanmax(np.abs(values), initial=0.0)
    prefix = next((p for p, f in reversed(PREFIXES.items()) if size * f >= 1), "n")
    panel = Panel(box, (0.0, float(time[-1])), limits(PREFIXES[prefix] * values))
    marks = [line(panel, time, PREFIXES[prefix] * v, look) for look, v in series]
    return framed(panel, *marks, y_label=f"{name} ({prefix}{unit})", **words)


def _block(found, channel):
    """Name of the block whose rows of the channel have the epochs of the readings."""
    here = np.flatnonzero(found["channel"].values == found.attrs["channels"].split().index(channel))
    away = np.abs(found["time_row"].values[here] - float(found["time_reading"].values[0]))
    return found.attrs["blocks"].split(", ")[int(found["block"].values[here[np.argmin(away)]])]
