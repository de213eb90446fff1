"""Report of a day of attitude thrusters: its product, its result document, and the page."""

from dataclasses import replace

import numpy as np

from gravcal.report.figures import COLOURS
from gravcal.report.named_parameters import Page, by_part, document, parameter_table
from gravcal.report.pages import Section, words

WORDS = words(__file__, "page.toml")


def content(products):
    """Facts {name: number} of the record, and the sections of the page after the result; products {stage: Dataset}."""
    estimate = products["estimate"]
    facts = {
        "firings": int(estimate["firings"]),
        "chi_square_gained_by_firings": float(estimate["gain"]),
        "inflation": float(estimate["inflation"]),
        "quiet_epochs": int(products["noise"]["samples"]),
        "cameras": [int(head) for head in np.unique(products["align"]["head"].values)],
        "seconds": float(np.ptp(products["align"]["time"].values)),
    }
    return facts, [
        Section("What is estimated", notes=WORDS.notes["estimated"]),
        Section("Errors", figures=[_wrong_times], notes=[WORDS.note("wrong_times")]),
        _heads(products),
    ]


def _heads(products):
    """Section on the heads of the star camera."""
    heads = more(products)[0]["heads"]
    if heads["parameters"] is None:
        return Section("Heads of the star camera", notes=[f"Not determined: {heads['said']}."])
    caption = "Heads of the star camera, with their errors by noise."
    tables = [replace(parameter_table(heads["parameters"], "heads"), caption=caption)]
    return Section(
        "Heads of the star camera", tables, [replace(by_part, reads=["heads"])], [heads["said"], *WORDS.notes["heads"]]
    )


def more(products):
    """Bias and noise of the heads for the document, null with the reason where they are not known, and no sentence."""
    heads = products.get("heads")
    if heads is None or not heads["parameter"].size:
        text = "no SCA1A" if heads is None else "SCA1A has no block of time with two heads"
        return {"heads": {"said": text, "parameters": None}}, ""
    chi2, dof = float(heads["agreement_chi2"]), int(heads["agreement_dof"])
    text = f"From {int(heads['blocks'])} blocks; parts disagree with chi-square {chi2:.1f} of {dof} by noise alone."
    text += "" if np.isfinite(heads["value"]).all() else " Attitudes are too rare for the fast band."
    return {"heads": {"said": text} | document(heads)}, ""


@WORDS.figure("estimate")
def _wrong_times(panel, estimate):  # chi-square gained by firings at each wrong time, and its mean
    gained = estimate["shifted_gain"].values
    panel.stem(estimate["shift"].values, gained, linefmt=COLOURS["blue"], basefmt=" ", markerfmt="o")
    panel.axhline(gained.mean(), color=COLOURS["vermilion"], linestyle="--")
    panel.set_ylim(0, None)


PAGE = Page(
    "thrusters",
    "Attitude thrusters",
    "Gain of the impulses and delay of the tags",
    ("estimate", "noise", "align", "checks", "heads"),
    content,
    more,
)
