"""Looks of the angular accelerations and of components: told apart by colour, by line and by point."""

from dataclasses import replace

from gravcal.report.drawing import Look
from gravcal.report.figures import COLOURS

DASHED, DOTTED, DASH_DOT = (4.0, 1.8), (1.0, 1.8), (5.0, 1.6, 1.0, 1.6)
VARIANT_LOOK = {
    "mtq": Look(COLOURS["black"], shape="circle"),
    "acc_calibrated": Look(COLOURS["vermilion"], shape="square"),
    "acc": Look(COLOURS["sky"], dash=DASHED, shape="triangle"),
    "sca": Look(COLOURS["purple"], dash=DASH_DOT, shape="diamond"),
}
WIDTHS = {"mtq": 2.4, "acc_calibrated": 1.1, "acc": 0.9, "sca": 1.0}
#: Without points, wide below and thin above, so that all four are seen where they coincide.
OVERLAY = {name: replace(look, width=WIDTHS[name], shape="") for name, look in VARIANT_LOOK.items()}
COMPONENT = {
    "x": Look(COLOURS["blue"]),
    "y": Look(COLOURS["orange"]),
    "z": Look(COLOURS["green"], dash=DASHED),
}
