"""Report of a day of attitude thrusters: its product, its result document, and the page."""

import numpy as np

from gravcal.report.figures import COLOURS, grid
from gravcal.report.named_parameters import Page
from gravcal.report.pages import Section, figure

NOTES = (
    "Gains are in units of lever arm x force x time on of the thruster table, with the moments of inertia of the "
    "catalogue; control reacts to firings, and its torquers are not observed: a torque free to change every knot "
    "stands for them, aerodynamics, radiation and gravity gradient.",
    "The delay is that of the tags of the firings, positive where they are late. A delay of the star camera of the "
    "other sign looks the same: only the difference shows.",
)
WRONG = (
    "Noise is measured in stretches without firings, which are quieter than the rest of the day. What firings moved to "
    "wrong times gain shows by how much: all variances are multiplied by it.",
)


def content(products):
    """Facts of the record, and what follows the result."""
    found = products["estimate"]
    facts = {
        "firings": int(found["firings"]),
        "chi_square_gained_by_firings": float(found["gain"]),
        "inflation": float(found["inflation"]),
        "quiet_epochs": int(products["noise"]["samples"]),
        "cameras": [int(head) for head in np.unique(products["align"]["head"].values)],
        "seconds": float(np.ptp(products["align"]["time"].values)),
    }
    return facts, [
        Section("What is estimated", notes=NOTES),
        Section("Errors", figures=[_wrong_times], notes=WRONG),
    ]


@figure(
    "estimate",
    caption="Chi-square that firings gain at wrong times, three parameters each; the dashed line is their mean.",
)
def _wrong_times(found):
    labels = {"xlabel": "shift of all firings, s", "ylabels": ["chi-square gained"]}
    figure, ((panel,),) = grid(1, 1, 2.2, **labels)
    gained = found["shifted_gain"].values
    panel.stem(found["shift"].values, gained, linefmt=COLOURS["blue"], basefmt=" ", markerfmt="o")
    panel.axhline(gained.mean(), color=COLOURS["vermilion"], linestyle="--")
    panel.set_ylim(0, None)
    return figure


PAGE = Page(
    "thrusters",
    "Attitude thrusters",
    "Gain of the impulses and delay of the tags",
    ("estimate", "noise", "align", "checks"),
    content,
)
