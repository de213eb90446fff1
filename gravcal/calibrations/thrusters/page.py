"""Report of a day of attitude thrusters: its product, its result document, and the page."""

from __future__ import annotations

import numpy as np

from gravcal.report import named_parameters
from gravcal.report.figures import COLOURS, grid
from gravcal.report.pages import Figure, Section

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


def report(*products, event, settings):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, "estimate", "noise", "align", "checks"
    event : str
    settings : mapping of all parameters
    """
    named = dict(zip(("estimate", "noise", "align", "checks"), products, strict=True))
    found = named["estimate"]
    facts = {
        "firings": int(found["firings"]),
        "chi_square_gained_by_firings": float(found["gain"]),
        "inflation": float(found["inflation"]),
        "quiet_epochs": int(named["noise"]["samples"]),
        "cameras": [int(head) for head in np.unique(named["align"]["head"].values)],
        "seconds": float(np.ptp(named["align"]["time"].values)),
    }
    caption = "Chi-square that firings gain at wrong times, three parameters each; the dashed line is their mean."
    sections = [
        Section("What is estimated", notes=NOTES),
        Section("Errors", (), [Figure(draw_wrong_times, ("estimate",), caption)], WRONG),
    ]
    heading, verdict = "Attitude thrusters", "Gain of the impulses and delay of the tags"
    named_as = {"calibration": "thrusters", "event": event, "settings": settings, "heading": heading}
    return named_parameters.report(named, **named_as, verdict=verdict, facts=facts, sections=sections)


def draw_wrong_times(found):
    """Chi-square gained by firings at every wrong time.

    Parameters
    ----------
    found : Dataset, "thrusters.estimate"
    """
    figure, ((panel,),) = grid(1, 1, 2.2)
    gained = found["shifted_gain"].values
    panel.stem(found["shift"].values, gained, linefmt=COLOURS["blue"], basefmt=" ", markerfmt="o")
    panel.axhline(gained.mean(), color=COLOURS["vermilion"], linestyle="--")
    panel.set(xlabel="shift of all firings, s", ylabel="chi-square gained", ylim=(0, None))
    return figure
