"""What a discovery delivers: the result document, the page, and the extended model."""

from __future__ import annotations

import json

import xarray as xr

from gravcal.report import discovery as words
from gravcal.report import discovery_figures as figures
from gravcal.report import documents, pages
from gravcal.report.discovery_change import with_calibration
from gravcal.store import product
from gravcal.store.schemas import validate


def report(found: xr.Dataset, *combined: xr.Dataset, calibration: str, event: str, satellite: str, settings: dict):
    """Report product of a discovery and its files.

    Parameters
    ----------
    found : Dataset of kind discovery
    combined : results of the calibration before and after, if it has such
    calibration, event : names
    satellite : letters
    settings : mapping of all parameters

    Returns
    -------
    dataset : Dataset with the probabilities of adequacy
    files : {name: text}
    """
    numbers = json.loads(found.attrs["numbers"])
    if combined and "calibration_change" in numbers:
        numbers = with_calibration(numbers, calibration, *combined)
    label = product.digest_as_read(found)[:12]
    provenance = {"settings": settings, "products": {f"{calibration}.discovery": label}}
    document = words.document(numbers, calibration, event, provenance)
    document = documents.judged(document, (found, *combined), [])
    validate(document, "discovery")
    files = {"discovery.json": json.dumps(document, indent=1, allow_nan=False) + "\n"}
    extended = words.model_text(numbers, event, settings.get("model", "")) if numbers.get("findings") else ""
    if extended and "model" in settings:  # a calibration that takes one
        files["model.toml"] = extended
    files["discovery.html"] = page(found, document, label, satellite)
    names = {"before": "baseline", "after": "extended model"}
    kept = {
        f"p_{w}": ((), numbers.get(f"p_{w}", 1.0), {"units": "1", "long_name": f"probability of the {n} by chance"})
        for w, n in names.items()
    }
    return xr.Dataset(kept, attrs={"status": document["status"], "event": event}), files


def page(found: xr.Dataset, document: dict, label: str, satellite: str) -> str:
    """Page of a discovery.

    Parameters
    ----------
    found : Dataset of kind discovery
    document : its result document
    label : digest of the product; satellite : letters
    """
    sections = _sections(found, document, f"discovery {label}") if "findings" in document else []
    settings = [(k, str(v)) for k, v in sorted(document["provenance"]["settings"].items())]
    content = {"document": document, "verdict": words.verdict(document), "sections": sections, "settings": settings}
    subtitle = f"satellite {satellite}, level {document.get('level', '')} for everything tried together"
    keys = list(document["provenance"]["products"].items())
    return pages.render("discovery.html", subtitle=subtitle, provenance=keys, **content)


def _sections(found, document, source):
    drawings = [(figures.residuals, REST), (figures.readings, figures.caption(found, document["calibration"]))]
    parts = [
        (
            "What is wrong",
            f"{WRONG} {MORE.get(document['calibration'], '')}".strip(),
            [],
            [(figures.power, POWER), (figures.spectra, SPECTRA)],
        ),
        ("The cause", CAUSE, [words.findings_table(document), words.tied_table(document)], drawings),
        ("The gain", GAIN, [words.change_table(document), words.gain_table(document)], []),
        ("What this data cannot show", HIDDEN, [words.hidden_table(document)], []),
        ("What was tried", "", [words.tried_table(document)], []),
    ]
    rows = ((t, [note], tables, [(draw, (found,), text) for draw, text in drawn]) for t, note, tables, drawn in parts)
    return sections_of(rows, source)


def sections_of(parts, source) -> list[dict]:
    """Sections that have a table or a figure, the figures numbered.

    Parameters
    ----------
    parts : (title, notes, tables, (function, arguments, caption) of every figure); what is empty is left out
    source : what the figures were drawn from
    """
    sections = []
    for title, notes, tables, drawings in parts:
        drawn = [pages.figure(draw, *given, source=source, title=title, caption=text) for draw, given, text in drawings]
        made = pages.section(title, tables, drawn, [note for note in notes if note])
        if made["tables"] or made["figures"]:
            sections.append(made)
    return pages.numbered(sections)


WRONG = (
    "Every measured channel is predicted by the current model; what is left is divided by the noise as measured "
    "outside the manoeuvres, so that a channel described to its noise has power 1 everywhere. The probability in the "
    "verdict is that of the most unusual number among all channels, manoeuvres, bands, candidates, lines and steps, "
    "set against noise drawn through the same fit."
)
MORE = {
    "gradient_torque": (
        "A day is looked at in stretches of two hours, with the noise measured in the day itself: the difference of "
        "both sensors, the star camera against the angular readings, and the torque that gravity gradient and control "
        "leave."
    ),
    "inertial_sensor": (
        "A swing is looked at in even and odd stretches of ten seconds. A roll is looked at in its segments, each with "
        "amplitudes of its own; its noise is that of a fit with every form that is tried, and its constants may wander "
        "about the bias as far as they scatter about a straight line."
    ),
    "kbr_phase_centre": (
        "Range, range rate and range acceleration come from one phase; the range stands for all three. Only a tilted "
        "antenna feels the noise of the star cameras, so this part is that of the manoeuvres beside everything that a "
        "listed cause could explain."
    ),
}
CAUSE = (
    "For each cause the gain in chi-square when it is added with all baseline parameters free. A cause is named only "
    "if its chance, corrected for everything that was tried, is below the level, and if it also gains on data that it "
    "was not fitted to: manoeuvres left out one by one, or every second stretch of time for what happens in one."
)
GAIN = "The result is estimated anew with the findings free, so its error contains theirs."
HIDDEN = (
    "These causes look like the calibration parameters themselves; only other data or ground tests can exclude them."
)
POWER = "Power of the residual over that of noise; four bands a manoeuvre."
SPECTRA = "Mean over manoeuvres and axes; the dashed line is noise."
REST = "The channel and manoeuvre that the extension helps most; mean over five samples, noise has unit variance."
