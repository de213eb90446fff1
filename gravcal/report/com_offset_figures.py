"""Figures of a centre-of-mass event: field, torquers, attitude, angular and linear acceleration."""

import numpy as np

from gravcal.report.com_offset_parts import KINDS
from gravcal.report.drawing import (
    DASH_DOT,
    DASHED,
    DOTTED,
    Look,
    Panel,
    boxes,
    dots,
    level,
    limits,
    line,
    placed,
    steps,
    upright,
)
from gravcal.report.drawing_frame import drawn, framed, legend, note
from gravcal.report.figures import COLOURS
from gravcal.report.plain import AXES

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
VARIANT_LOOK = {
    "mtq": Look(COLOURS["black"], shape="circle"),
    "acc_calibrated": Look(COLOURS["vermilion"], shape="square"),
    "acc": Look(COLOURS["sky"], dash=DASHED, shape="triangle"),
    "sca": Look(COLOURS["purple"], dash=DASH_DOT, shape="diamond"),
}
OVERLAY_WIDTH = {"mtq": 2.4, "acc_calibrated": 1.1, "acc": 0.9, "sca": 1.0}
COMPONENT = {
    "x": Look(COLOURS["blue"]),
    "y": Look(COLOURS["orange"]),
    "z": Look(COLOURS["green"], dash=DASHED),
}
THIN = Look(COLOURS["grey"], width=0.5)
BORDER = Look(COLOURS["grey"], width=0.5, dash=DOTTED)
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
    scaled = {"measured_b": 1e6, "model_b": 1e6, "difference_b": 1e9}
    series = {name: np.where(used, scale * checked[name].values, np.nan) for name, scale in scaled.items()}
    looks = {"magnetometer": Look(COLOURS["orange"], 0, shape="circle", size=2.2), "IGRF": Look(COLOURS["black"], 0.7)}
    parts = [legend(looks | {"bias": Look(COLOURS["vermilion"], dash=DASHED)})]
    for row, places in enumerate(boxes(3, 2, 330)):
        last = {"x_numbers": row == 2} | (
            {"x_label": "minutes of record, windows joined end to end"} if row == 2 else {}
        )
        model, measured = series["model_b"][:, row], series["measured_b"][:, row]
        left = Panel(places[0], (ends[0], ends[-1]), limits(model, measured, margin=0.1))
        step = max(1, time.size // 500)
        marks = dots(left, time[::step], measured[::step], looks["magnetometer"]) + line(
            left, time, model, looks["IGRF"]
        )
        parts.append(
            _windows(left, ends, marks, row == 0, {"y_label": f"B_{AXES[row]} (µT)", "title": "field in SRF"} | last)
        )
        right = Panel(places[1], left.x, limits(series["difference_b"][:, row], margin=0.1))
        marks = line(right, time, series["difference_b"][:, row], Look(COLOURS["blue"], 0.7))
        marks += level(right, 1e9 * float(checked["bias"].values[row]), Look(COLOURS["vermilion"], dash=DASHED))
        words = {"y_label": f"ΔB_{AXES[row]} (nT)", "title": "magnetometer minus IGRF"} | last
        parts.append(_windows(right, ends, marks, row == 0, words))
    return drawn(330, "magnetic field", *parts)
