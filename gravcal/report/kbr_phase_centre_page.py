"""Report page of a ranging calibration: one self-contained HTML text."""

from gravcal.report import kbr_phase_centre_figures as figures
from gravcal.report import kbr_phase_centre_tables as tables
from gravcal.report.pages import figure, numbered, render, section, traced
from gravcal.report.plain import gps_text

MOODS = {True: "good", False: "bad", None: ""}
SOLVED = "solve.range, solve.range_rate, solve.range_acceleration"
CAPTIONS = {
    "angles": (
        "pointing angles",
        "Pointing of the line of sight in both satellites: left the record, wiggles shaded; right the first "
        "wiggle of each.",
    ),
    "routine": (
        "pointing angles",
        "Pointing of the line of sight in both satellites: left the record, right a part of it.",
    ),
    "series": (
        "ranging minus orbit",
        "Ranging minus orbit and the fitted phase centres in one pitch and one yaw wiggle, slow part removed from "
        "both; below, shifted down, their difference, magnified as the title says.",
    ),
    "spectra": (
        "spectra",
        "Density of ranging minus orbit in the wiggles, before and after the fit; dotted: 4 and 8 mHz, the wiggle "
        "and its second harmonic.",
    ),
    "estimates": (
        "estimates",
        "y and z of both satellites: every observable by least squares and with robust weights, then each wiggle "
        "alone; error bars one standard deviation, band the adopted value.",
    ),
    "noise": (
        "noise",
        "Noise of the range: quiet data, their model, and the residual in the wiggles, where the star camera adds its "
        "error times the tilt of the antenna.",
    ),
}


def page(document, products, published, files):
    """Page of one event.

    Parameters
    ----------
    document : dict of `gravcal.report.kbr_phase_centre.document`
    products : "pointing", "noise" and a list of three "solve" Datasets
    published : {section: list of printed records}
    files : {name: text} delivered beside the page

    Returns
    -------
    html : str
    """
    pointed, measured, solved = products
    delivered = "satellites" in document
    sections = _sections(document, pointed, measured, solved, published) if delivered else []
    if not delivered:
        sections = [_section("Pointing", [], [_figure("routine", "pointing", figures.angles, pointed)])]
    quiet = _from("routine", tables.routine(document))
    sections.append(_section("Without wiggles", quiet, [], [document["routine_pointing"]["text"]]))
    good = document["verdict"].get("accuracy_met")
    return render(
        "kbr_phase_centre.html",
        document=document,
        verdict=tables.true_units(document["verdict"]["text"]),
        mood=MOODS[good],
        subtitle=_subtitle(document),
        sections=traced(numbered(sections), document["provenance"]["products"]),
        settings=[(name, str(value)) for name, value in sorted(document["settings"].items())],
        provenance=sorted(document["provenance"]["products"].items()),
        lines=files.get("result.soe"),
    )


def _subtitle(document):
    """What was looked at."""
    span = " to ".join(gps_text(document["record"][name]) for name in ("start", "stop"))
    letters = " and ".join(document["pair"])
    return (
        f"Record {span} GPS, satellites {letters}, {document['ranging']}, {len(document['manoeuvres'])} wiggles. "
        f"Vectors from centre of mass to phase centre, in SRF."
    )


def _sections(document, pointed, measured, solved, published):
    """Sections of an event with wiggles."""
    results = _from("combine", *(tables.result(document, published, estimator) for estimator in ("ls", "robust")))
    sets = _from("combine", tables.subsets(document, published), tables.geometry(document))
    angles = _figure("angles", "pointing", figures.angles, pointed)
    spectra = [_figure("spectra", SOLVED, figures.spectra, solved), _figure("noise", "noise", figures.noise, measured)]
    return [
        _section(
            "Result",
            results,
            [_figure("estimates", "combine", figures.estimates, document)],
            document["trust"] + [one["text"] for one in document["indistinguishable_from_calibration"]],
        ),
        _section("Sub-sets and geometry", sets, []),
        _section(
            "Wiggles",
            _from("combine", tables.manoeuvres(document)),
            [angles, _figure("series", SOLVED, figures.series, solved)],
        ),
        _section("Noise", _from("noise", tables.noise(document)), spectra),
        _section("Against published vectors", _from("combine", tables.vectors(document, published)), []),
    ]


def _from(name, *own):
    """Tables with the product they were read from."""
    return [one | {"source": f"kbr_phase_centre.{name}"} for one in own if one]


def _section(title, own_tables, own_figures, notes=()):
    """Section whose notes have the signs that a page can show."""
    return section(title, own_tables, own_figures, [tables.true_units(note) for note in notes])


def _figure(name, products, draw, *given):
    title, caption = CAPTIONS[name]
    source = ", ".join(f"kbr_phase_centre.{one}" for one in products.split(", "))
    return figure(draw, *given, source=source, title=title, caption=caption)
