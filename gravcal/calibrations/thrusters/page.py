"""Report of a day of attitude thrusters: its product, its result document, and the page."""

from dataclasses import replace

import numpy as np

from gravcal.report.figures import COLOURS, grid
from gravcal.report.named_parameters import Page, by_part, document, parameter_table
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
HEADS = (
    "Heads against each other: the bias is the turn of the SRF by a head, mounted as QSA1B says, against that by the "
    "first. Noise is about the axes of each head, z its line of sight, as the root of a mean density: slow from 5 to "
    "100 mHz, fast from there to Nyquist.",
    "Two heads leave open what noise, the same about all axes, is of which: variances across the lines of sight are "
    "then told apart by being positive and alike to a factor of 2.5, and have errors that say so. Of three heads each "
    "is seen. Proven on simulated records: no measured day of SCA1A was at hand.",
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
        _heads(products),
    ]


def _heads(products):
    """Section on the heads of the star camera."""
    told = more(products)[0]["heads"]
    if told["parameters"] is None:
        return Section("Heads of the star camera", notes=[f"Not determined: {told['said']}."])
    caption = "Heads of the star camera, with their errors by noise."
    tables = [replace(parameter_table(told["parameters"], "heads"), caption=caption)]
    return Section("Heads of the star camera", tables, [replace(by_part, reads=["heads"])], [told["said"], *HEADS])


def more(products):
    """Bias and noise of the heads as named parameters, null with the reason where they are not known."""
    found = products.get("heads")
    if found is None or not found["parameter"].size:
        said = "no SCA1A" if found is None else "SCA1A has no block of time with two heads"
        return {"heads": {"said": said, "parameters": None}}, ""
    chi2, dof = float(found["agreement_chi2"]), int(found["agreement_dof"])
    said = f"From {int(found['blocks'])} blocks; parts disagree with chi-square {chi2:.1f} of {dof} by noise alone."
    said += "" if np.isfinite(found["value"]).all() else " Attitudes are too rare for the fast band."
    return {"heads": {"said": said} | document(found)}, ""


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
    ("estimate", "noise", "align", "checks", "heads"),
    content,
    more,
)
