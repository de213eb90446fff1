"""Report page of a centre-of-mass event: one self-contained HTML text."""

import functools

from gravcal.report import com_offset_drawings
from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_result_figures as results
from gravcal.report import com_offset_tables as tables
from gravcal.report.pages import render
from gravcal.report.plain import AXES, gps_text
from gravcal.report.words import key_of, plus_minus

CAPTIONS = {
    "estimates": "Offset of every manoeuvre from four angular accelerations, error bars one standard deviation. Bands: "
    "adopted offset ({adopted}) with its error and its total error.{hollow}",
    "linear": "Linear acceleration of every manoeuvre, low-passed and drift removed: measured, modelled with "
    "{adopted}, and their difference shifted down.",
    "spectra": "Residuals of all manoeuvres against the noise that weighted them; the modelled signal for scale.",
    "angular": "Four angular accelerations about the axis turned: three periods, and their distance from the "
    "torquers' in every half period.",
    "torquers": "Torquer currents as sent down, and the angular acceleration they make in the modelled field.",
    "attitude": "Star camera minus fitted dynamics, one fit between two dotted lines.",
    "field": "Magnetic field as measured and modelled, and their difference; dashed: bias; numbers are windows.",
    "roll": "Roll acceleration seen by the star camera, and torquer current times field times the slope of the fit.",
}
#: Stage whose product a figure shows.
STAGES = {
    "estimates": "combine",
    "angular": "angular_acceleration",
    "torquers": "attitude",
    "attitude": "attitude",
    "field": "field",
    "roll": "survey",
}
SIGNS = {True: "✓", False: "✗", None: "?"}
MOODS = {True: "good", False: "bad", None: ""}


def page(document, products, published, vcm=None):
    """Page of one event.

    Parameters
    ----------
    document : dict of `gravcal.report.com_offset.document`
    products : mapping of "detect", "figures", "survey" to their Dataset, "solve" to the four Datasets; what is missing
        leaves out its figures
    published : {section: records} of the catalogue for this event, {} where nothing is printed
    vcm : str or None, result line

    Returns
    -------
    html : str
    """
    given = dict(products) | {"figures": com_offset_drawings.texts(products.get("figures"))}
    given["solve"] = {one.attrs["variant"]: one for one in given.get("solve") or ()}
    delivered = "variants" in document
    sections = _sections(document, given, published) if delivered else _survey_sections(document, given)
    return render(
        "com_offset.html",
        document=document,
        verdict=_true_units(document["verdict"]["text"]),
        mood=MOODS[_good(document)],
        subtitle=_subtitle(document),
        badges=_badges(document) if delivered else [],
        sections=_numbered(sections),
        settings=_flat(document["settings"]),
        provenance=_flat(document["provenance"]),
        vcm=vcm,
    )


def _true_units(text):
    """Text of the terminal with the signs that a page can show."""
    return text.replace("+-", "±").replace(" um", " µm").replace(" -", " −")


def _good(document):
    """Whether the whole verdict is good; None where it is not asked."""
    verdict = document["verdict"]
    if "requirement" not in verdict:
        return None
    return verdict["accuracy_met"] and verdict["consistent"] is not False


def _subtitle(document):
    """What was looked at and how."""
    span = [document["record"][name] for name in ("start", "stop")]
    when = "" if None in span else f"Record {gps_text(span[0])} to {gps_text(span[1])} GPS. "
    if "variants" not in document:
        return when
    kinds = [one["kind"] for one in document["manoeuvres"]]
    counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("pitch", "roll", "yaw") if kind in kinds)
    return (
        f"{when}{len(kinds)} manoeuvres ({counted}). Vectors from proof mass to centre of mass, in SRF. "
        f"Noise from {document['noise']['source']}."
    )


def _badges(document):
    """The four answers, in words and signs as well as colours."""
    verdict, status = document["verdict"], document["status"] == "delivered"
    adopted = document["adopted"]["variant"] or "no variant"
    found = [{"title": "delivered" if status else "not delivered", "good": status, "text": f"adopted: {adopted}"}]
    if "requirement" in verdict:
        own = verdict["requirement"]
        words = ", ".join(f"{axis} {word}" for axis, word in zip(AXES, own, strict=True))
        inside = False if "exceeds" in own else True if set(own) == {"within"} else None
        found.append({"title": f"offset ≤ {verdict['requirement_um']:g} µm", "good": inside, "text": words})
        sigma = document["variants"][adopted]["sigma_total_um"]
        words = ", ".join("–" if s is None else f"{s:.1f}" for s in sigma)
        title = f"accuracy ≤ {verdict['accuracy_um']:g} µm"
        found.append({"title": title, "good": verdict["accuracy_met"], "text": f"total error x, y, z: {words} µm"})
        tests = document["consistency"]
        words = f"manoeuvres {tests['manoeuvres']['verdict']}, angular acc. {tests['variants']['verdict']}"
        found.append({"title": "consistent", "good": verdict["consistent"], "text": words})
    return [one | {"sign": SIGNS[one["good"]], "mood": MOODS[one["good"]]} for one in found]


def _sections(document, given, published):
    """Sections of an event with manoeuvres."""
    known = tables.printed_manoeuvres(document, published)
    draw = functools.partial(_figures, document, given, known)
    return [
        _section(
            "Result", [tables.combined(document, published)], draw("estimates"), _result_notes(document, published)
        ),
        _section("Agreement and field check", [tables.agreement(document), tables.field(document)], []),
        _section("Every manoeuvre", [tables.manoeuvres(document, published)], []),
        _section("Linear acceleration", [], draw("spectra", "linear")),
        _section(
            "Angular acceleration and time",
            [tables.instruments(document)],
            draw("angular"),
            _inertia_notes(document),
        ),
        _section("Torquers and attitude", [], draw("torquers", "attitude")),
        _section("Magnetic field", [], draw("field")),
    ]


def _figures(document, given, known, *names):
    """Figures by name, each with its caption and the stage that it was read from."""
    adopted = (document.get("adopted") or {}).get("variant") or "mtq"
    solved = given["solve"].get(adopted)
    own = {
        "estimates": (results.estimates, document, known),
        "spectra": (results.spectra, solved),
        "linear": (figures.linear_accelerations, solved, given.get("detect")),
        "roll": (results.roll, given.get("survey")),
    }
    stages = dict.fromkeys(("spectra", "linear"), f"solve.{adopted}") | STAGES
    words = {"adopted": adopted, "hollow": " Hollow: printed values." if known else ""}
    return [
        {
            "drawing": _drawn(*own[name]) if name in own else given["figures"].get(name),
            "source": key_of(document, stages[name]),
            "title": name,
            "caption": CAPTIONS[name].format(**words),
        }
        for name in names
    ]


def _result_notes(document, published):
    """What the numbers of the result mean."""
    notes = [
        "The error is that of the noise as measured, delays and scales estimated along; the total error in brackets "
        "also holds that of inertia and dipole per current. Adopted: " + document["adopted"]["rule"]
    ]
    if document["settings"].get("model"):
        notes.append("Effects of an extended model were taken out of the records; both errors hold those of the model.")
    if document.get("method", "gravcal") == "published":
        notes.append("Method published: row selection and formal errors of the paper, for comparison only.")
    sources = sorted({one.source for name in ("combined", "manoeuvres") for one in published.get(name, ())})
    if sources:
        notes.append(f"Printed: {'; '.join(sources)}. Printed errors are formal and several times too small.")
    return notes


def _inertia_notes(document):
    """Principal moments seen in the attitude, where they were estimated."""
    found = document["scales"].get("inertia")
    if found is None or found["value"] == [None] * 3:
        return []
    told = [
        f"{axis} {plus_minus(value, sigma, digits=3)}"
        for axis, value, sigma in zip(AXES, found["value"], found["sigma"], strict=True)
    ]
    return [f"Principal moments of inertia over the catalogue, from the attitude: {', '.join(told)}."]


def _survey_sections(document, given):
    """Sections of a record without manoeuvre: what could be measured all the same."""
    draw = functools.partial(_figures, document, given, {})
    return [
        _section("Magnetic field", [tables.field(document)], draw("field")),
        _section("Attitude", [], draw("attitude"), [_attitude_note(document)]),
        _section("Torque against roll acceleration", [], draw("roll"), [_roll_note(document)]),
    ]


def _attitude_note(document):
    """Attitude residual in words."""
    residual = document["attitude"]
    rms = ", ".join("–" if item is None else f"{item:.2f}" for item in residual["rms_urad"])
    return f"Star camera minus fitted dynamics, rms x, y, z: {rms} µrad, {residual['samples']} samples."


def _roll_note(document):
    """Slope of roll acceleration in words."""
    response = document["roll_response"]
    if response is None:
        return "Too little torque or time to measure it."
    measured = plus_minus(response["value"], response["sigma"], digits=4)
    text = f"Roll acceleration for current times field: {measured} rad s⁻² mA⁻¹ T⁻¹"
    if response["expected"]:
        text += f", expected {plus_minus(response['expected']['value'], response['expected']['sigma'], digits=4)}"
    return f"{text}, {response['samples']} samples."


def _section(title, own_tables, own_figures, notes=()):
    return {"title": title, "tables": own_tables, "figures": own_figures, "notes": list(notes)}


def _drawn(draw, *given):
    """Figure; none where a product is missing."""
    return None if any(item is None for item in given) else draw(*given)


def _numbered(sections):
    """Sections whose figures are numbered in order."""
    number = 0
    for section in sections:
        for one in section["figures"]:
            number += one["drawing"] is not None
            one["number"] = number
    return sections


def _flat(values, before=""):
    """Names and texts of nested settings or provenance; long digests shortened."""
    rows = []
    for name, value in sorted(values.items()):
        if isinstance(value, dict):
            rows += _flat(value, f"{name}: " if name not in ("products", "inputs") else "")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f"{before}{name}", text if len(text) < 60 else f"{text[:16]}…"))
    return rows
