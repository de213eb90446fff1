"""Report page of a centre-of-mass event: one self-contained HTML text."""

from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_result_figures as results
from gravcal.report import com_offset_tables as tables
from gravcal.report.figures import image
from gravcal.report.pages import render
from gravcal.report.plain import AXES, gps_text
from gravcal.report.words import key_of, plus_minus

SIGNS = {True: "✓", False: "✗", None: "?"}
MOODS = {True: "good", False: "bad", None: ""}


def page(document, products, published, vcm=None):
    """Page of one event.

    Parameters
    ----------
    document : dict of `gravcal.report.com_offset.document`
    products : mapping of "detect", "align", "field", "attitude", "survey" to their Dataset, "solve" and
        "angular_acceleration" to the four Datasets; what is missing leaves out its figure
    published : {section: records} of the catalogue for this event, {} where nothing is printed
    vcm : str or None, result line

    Returns
    -------
    html : str
    """
    given = dict(products)
    for name in ("solve", "angular_acceleration"):
        given[name] = {one.attrs["variant"]: one for one in given.get(name) or ()}
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
    adopted = document["adopted"]["variant"] or "mtq"
    solved = given["solve"].get(adopted)
    known = tables.printed_manoeuvres(document, published)
    hollow = " Hollow: printed values." if known else ""
    source = {n: key_of(document, n) for n in ("combine", "align", "attitude", "field", f"solve.{adopted}")}
    estimates = (results.estimates, document, known), source["combine"]
    linear = (figures.linear_accelerations, solved, given.get("detect")), source[f"solve.{adopted}"]
    spectra = (results.spectra, solved), source[f"solve.{adopted}"]
    angular = (figures.angular_accelerations, given["angular_acceleration"], given.get("detect"))
    torquers = (figures.torquers, *(given.get(n) for n in ("align", "attitude", "detect"))), source["attitude"]
    residual = (figures.attitude, given.get("attitude")), source["attitude"]
    field = (figures.field, given.get("field"), given.get("align")), source["field"]
    captions = _captions(adopted, hollow)
    return [
        _section(
            "Result",
            [tables.combined(document, published)],
            [_figure(*estimates, *captions["estimates"])],
            _result_notes(document, published),
        ),
        _section("Agreement and field check", [tables.agreement(document), tables.field(document)], []),
        _section("Every manoeuvre", [tables.manoeuvres(document, published)], []),
        _section(
            "Linear acceleration", [], [_figure(*spectra, *captions["spectra"]), _figure(*linear, *captions["linear"])]
        ),
        _section(
            "Angular acceleration and time",
            [tables.instruments(document)],
            [_figure(angular, key_of(document, "angular_acceleration"), *captions["angular"])],
            _inertia_notes(document),
        ),
        _section(
            "Torquers and attitude",
            [],
            [_figure(*torquers, *captions["torquers"]), _figure(*residual, *captions["attitude"])],
        ),
        _section("Magnetic field", [], [_figure(*field, *captions["field"])]),
    ]


def _captions(adopted, hollow):
    """Title and caption of every figure."""
    return {
        "estimates": (
            "offset of every manoeuvre",
            "Offset of every manoeuvre from four angular accelerations, error bars one standard deviation. Bands: "
            f"adopted offset ({adopted}) with its error and its total error.{hollow}",
        ),
        "linear": (
            "linear acceleration of every manoeuvre",
            "Linear acceleration of every manoeuvre, low-passed and drift removed: measured, modelled with "
            f"{adopted}, and their difference shifted down.",
        ),
        "spectra": (
            "spectra of residuals",
            "Residuals of all manoeuvres against the noise that weighted them; the modelled signal for scale.",
        ),
        "angular": (
            "four angular accelerations",
            "Four angular accelerations about the axis turned: three periods, and their distance from the torquers' in "
            "every half period.",
        ),
        "torquers": (
            "torquer currents",
            "Torquer currents as sent down, and the angular acceleration they make in the modelled field.",
        ),
        "attitude": ("attitude residuals", "Star camera minus fitted dynamics, one fit between two dotted lines."),
        "field": (
            "magnetic field",
            "Magnetic field as measured and modelled, and their difference; dashed: bias; numbers are windows.",
        ),
        "roll": (
            "roll acceleration",
            "Roll acceleration seen by the star camera, and torquer current times field times the slope of the fit.",
        ),
    }


def _result_notes(document, published):
    """What the numbers of the result mean."""
    notes = [
        "The error is that of the noise as measured, delays and scales estimated along; the total error in brackets "
        "also holds that of inertia and dipole per current. Adopted: " + document["adopted"]["rule"]
    ]
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
    captions = _captions("", "")
    field = _figure(
        (figures.field, given.get("field"), given.get("align")), key_of(document, "field"), *captions["field"]
    )
    attitude = _figure((figures.attitude, given.get("attitude")), key_of(document, "attitude"), *captions["attitude"])
    roll = _figure((results.roll, given.get("survey")), key_of(document, "survey"), *captions["roll"])
    return [
        _section("Magnetic field", [tables.field(document)], [field]),
        _section("Attitude", [], [attitude], [_attitude_note(document)]),
        _section("Torque against roll acceleration", [], [roll], [_roll_note(document)]),
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


def _figure(drawing, source, title, caption):
    """Figure with its caption; without image where a product is missing."""
    shown = None if any(item is None for item in drawing) else image(*drawing)
    return {"image": shown, "source": source, "title": title, "caption": caption}


def _numbered(sections):
    """Sections whose figures are numbered in order."""
    number = 0
    for section in sections:
        for one in section["figures"]:
            number += one["image"] is not None
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
