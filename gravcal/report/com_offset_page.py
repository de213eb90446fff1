"""Report page of a centre-of-mass event: one self-contained HTML text."""

import functools

from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_tables as tables
from gravcal.report.figures import VARIANTS
from gravcal.report.pages import figure, numbered, render, section
from gravcal.report.plain import AXES, gps_text
from gravcal.report.words import key_of, plus_minus

CAPTIONS = {
    "estimates": "Offset of every manoeuvre from four angular accelerations, error bars one standard deviation. Bands: "
    "adopted offset ({adopted}) with its error and its total error.{hollow}",
    "linear": "Linear acceleration of every manoeuvre, low-passed and drift removed: measured, modelled with "
    "{adopted}, and their difference shifted down. Each row has its own scale; its largest value stands at the right.",
    "spectra": "Residuals of all manoeuvres against the noise that weighted them; the modelled signal for scale.",
    "angular": "Four angular accelerations about the axis turned: three periods, and their distance from the "
    "torquers' in every half period.",
    "torquers": "Torquer currents as sent down, and the angular acceleration they make in the modelled field. Each row "
    "has its own scale; its largest value stands at the right.",
    "attitude": "Star camera minus fitted dynamics, one fit between two dotted lines.",
    "field": "Magnetic field as measured and modelled, and their difference; dashed: bias; numbers are windows.",
    "roll": "Roll acceleration seen by the star camera, and torquer current times field times the slope of the fit.",
}
#: Stage whose product a figure shows.
STAGES = {
    "estimates": "combine",
    "angular": " ".join(f"angular_acceleration.{name}" for name in VARIANTS),
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
    products : {name: Dataset}, {name: {variant: Dataset}} for "solve" and "angular_acceleration"; what is missing
        leaves out its figures
    published : {section: records} of the catalogue for this event, {} where nothing is printed
    vcm : str or None, result line

    Returns
    -------
    html : str
    """
    delivered = "variants" in document
    sections = _sections(document, products, published) if delivered else _survey_sections(document, products)
    return render(
        "com_offset.html",
        document=document,
        verdict=_true_units(document["verdict"]["text"]),
        mood=MOODS[_good(document)],
        subtitle=_subtitle(document),
        badges=_badges(document) if delivered else [],
        sections=numbered(sections),
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
    verdict = document["verdict"]
    adopted = document["adopted"]["variant"] or "no variant"
    found = [{"title": document["status"], "good": document["status"] == "delivered", "text": f"adopted: {adopted}"}]
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
        section(
            "Result", [tables.combined(document, published)], draw("estimates"), _result_notes(document, published)
        ),
        section("Agreement and field check", [tables.agreement(document), tables.field(document)], []),
        section("Every manoeuvre", [tables.manoeuvres(document, published)], []),
        section("Linear acceleration", [], draw("spectra", "linear")),
        section(
            "Angular acceleration and time",
            [tables.instruments(document)],
            draw("angular"),
            _inertia_notes(document),
        ),
        section("Torquers and attitude", [], draw("torquers", "attitude")),
        section("Magnetic field", [], draw("field")),
    ]


def _figures(document, products, known, *names):
    """Figures by name, each with its caption and the stage that it was read from."""
    adopted = (document.get("adopted") or {}).get("variant") or "mtq"
    solved, get = (products.get("solve") or {}).get(adopted), products.get
    drawn = {
        "estimates": (figures.estimates, document, known),
        "spectra": (figures.spectra, solved),
        "linear": (figures.linear_accelerations, solved, get("detect")),
        "roll": (figures.roll, get("survey")),
        "angular": (figures.angular_accelerations, get("angular_acceleration"), get("detect")),
        "torquers": (figures.torquers, get("align"), get("attitude"), get("detect")),
        "attitude": (figures.attitude, get("attitude")),
        "field": (figures.field, get("field"), get("align")),
    }
    stages = dict.fromkeys(("spectra", "linear"), f"solve.{adopted}") | STAGES
    words = {"adopted": adopted, "hollow": " Hollow: printed values." if known else ""}
    return [
        figure(
            *drawn[name],
            source=", ".join(key_of(document, stage) for stage in stages[name].split()),
            title=name,
            caption=CAPTIONS[name].format(**words),
        )
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
        section("Magnetic field", [tables.field(document)], draw("field")),
        section("Attitude", [], draw("attitude"), [_attitude_note(document)]),
        section("Torque against roll acceleration", [], draw("roll"), [_roll_note(document)]),
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
