"""Page of a discovery in measured data: verdict, findings, what is left, facts, and figures of every search."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from gravcal.report import discovery as words
from gravcal.report import discovery_figures as figures
from gravcal.report import discovery_measured_tables as tables
from gravcal.report import pages
from gravcal.report.discovery import POWER

TITLES = {
    "published_table": "printed offsets of single manoeuvres against one offset for all",
}
#: Lower scale of short records where it is not time, and where it begins.
ORDER = {"published_table": ("manoeuvre, in printed order", 0.0)}


def page(document: dict, found: Mapping[str, xr.Dataset]) -> str:
    """Page of a view of measured data.

    Parameters
    ----------
    document : of the discovery form, with "view", "facts" and "notes"
    found : {label of the search: Dataset of kind discovery}
    """
    provenance = document["provenance"]
    keys = [("gravcal", provenance["gravcal"]), ("seed of the noise drawn", str(provenance["seed"]))]
    keys += [(f"file {i}", name) for i, name in enumerate(provenance["files"], 1)]
    settings = [(k, str(v)) for k, v in sorted(provenance["settings"].items())]
    level = provenance["settings"]["level"]
    view, searches = document["view"], ", ".join(found)
    subtitle = f"{TITLES.get(view, view)}; {searches}; level {level} for everything tried together"
    content = {"document": document, "verdict": words.verdict(document), "sections": _sections(document, found)}
    return pages.render("discovery.html", subtitle=subtitle, settings=settings, provenance=keys, **content)


def _sections(document, found):
    axis = ORDER.get(document["view"], ())
    several = len(found) > 1
    each = [(f"{label}: " if several else "", one) for label, one in found.items()]
    excess = [(figures.power, (one, "block"), head + POWER_OF_BLOCKS) for head, one in each]
    excess += [(figures.spectra, (one,), head + SPECTRA_OF_BLOCKS) for head, one in each]
    rest = [_rest(head, one, axis) for head, one in each]
    no_result = document["calibration_change"]["reason"]
    return sections_of(
        [
            ("What is wrong", [WRONG], [tables.adequacy(document)], excess),
            ("The cause", [CAUSE], [tables.findings(document), tables.rivals(document)], rest),
            ("What this data cannot show", [], [tables.hidden(document)], []),
            ("What remains unexplained", [], [tables.unexplained(document)], []),
            ("What was tried", [], [tables.tried(document)], []),
            ("Facts and notes", [*document["notes"], f"{CHANGE}: {no_result}."], [tables.facts(document)], []),
        ],
        f"view {document['view']}",
    )


def _rest(head, found, axis):
    """Residual of the channel and block that the extension helps most; every row of a short record."""
    if figures.strongest(found) or (found["component"].values < 3).sum() >= 3 * figures.CURVE:
        return figures.residuals, (found,), f"{head}{REST}"
    return figures.scattered, (found, *axis), f"{head}{ROWS}"


WRONG = (
    "What was measured less what the model says is divided by its noise, so that records that are described to their "
    "noise have power 1 everywhere. The chance of a search is that of the most unusual number among all channels, "
    "blocks, bands, candidates, lines and steps, set against noise drawn through the same fit."
)
CAUSE = (
    "Before is the model without extension, after that with everything that was named. A cause is named only if its "
    "chance is below the level and if it also gains on blocks that it was not fitted to (held out). Causes that are "
    "tied gain alike on these data, which cannot tell them apart."
)
CHANGE = "No calibration result is changed by this"
POWER_OF_BLOCKS = POWER.replace("a manoeuvre", "a block")
SPECTRA_OF_BLOCKS = "Spectra of the residuals over that of noise, mean over blocks; the dashed line is noise."
REST = "The channel and block that the extension helps most; mean over five samples, noise has unit variance."
ROWS = "Residual of every row in units of its noise; the scales on the left and on the right differ."


def sections_of(parts, source) -> list[dict]:
    """Sections that have a table or a figure, the figures numbered.

    Parameters
    ----------
    parts : (title, notes, tables, (function, arguments, caption) of every figure); what is empty is left out
    source : what the figures were drawn from
    """
    sections = []
    for title, notes, held, drawings in parts:
        drawn = [pages.figure(draw, *given, source=source, title=title, caption=text) for draw, given, text in drawings]
        made = pages.section(title, held, drawn, [note for note in notes if note])
        if made["tables"] or made["figures"]:
            sections.append(made)
    return pages.numbered(sections)
