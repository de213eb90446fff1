"""Result document of a centre-of-mass event: what was found, how well, and whether it may be used."""

import numpy as np

from gravcal.report import com_offset_parts as parts
from gravcal.report import com_offset_verdict as verdicts
from gravcal.report.documents import WITH_RESULT
from gravcal.report.plain import as_plain
from gravcal.store.schemas import VERSION

#: Products of which an event has one; of "solve" and "angular_acceleration" it has one for each variant.
SINGLE = ("combine", "attitude", "field", "survey", "detect", "align", "checks")


def document(products, *, event, provenance, settings):
    """Document of one event, ready for JSON.

    Parameters
    ----------
    products : {name: Dataset} for the names of `SINGLE`, and "solve": {variant: Dataset}; "combine" is None without a
        manoeuvre, "survey" may be
    event : str
    provenance : mapping, "products" {stage: key} and what else is known
    settings : mapping, all parameters; requirement_um, accuracy_um, consistency_level are used here

    Returns
    -------
    document : dict of plain values
    """
    detected, combined = products["detect"], products["combine"]
    instruments = parts.instruments(products["attitude"], products["field"], detected, settings)
    head = {
        "schema_version": VERSION,
        "status": "no_manoeuvre",
        "calibration": "com_offset",
        "event": event,
        "direction": "proof_mass_to_com",
    }
    measured = {
        "record": parts.record(detected),
        "field_check": instruments["field_check"],
        "attitude": instruments["attitude"],
        "roll_response": None if detected.sizes["manoeuvre"] else parts.roll_response(products["survey"], settings),
    }
    tail = {"settings": as_plain(settings), "provenance": as_plain(provenance)}
    if detected.sizes["manoeuvre"] == 0 or combined is None:
        reason = f"No manoeuvre in the torquer currents{parts.span_text(detected)}: nothing to calibrate."
        return head | {"verdict": {"text": reason}, "manoeuvres": []} | measured | tail
    return (
        head | _estimates(combined, list(products["solve"].values()), instruments, detected, settings) | measured | tail
    )


def _estimates(combined, solved, instruments, detected, settings):
    """Everything that needs a manoeuvre."""
    variants = parts.variants(combined)
    adopted = verdicts.adopted(variants)
    found = any(item is not None for block in variants.values() for item in block["offset_um"])
    level = float(settings["consistency_level"])
    consistency = verdicts.consistency(combined, adopted["variant"], level)
    return {
        "status": "delivered" if found else "failed",
        "verdict": verdicts.verdict(variants, adopted, consistency, settings),
        "method": combined.attrs.get("method", "gravcal"),
        "adopted": adopted,
        "variants": variants,
        "manoeuvres": parts.manoeuvres(combined, detected, instruments["manoeuvres"]),
        "delays_s": instruments["delays_s"],
        "scales": instruments["scales"],
        "consistency": consistency,
        "noise": parts.noise(solved),
    }


def page(document, products, published=None, vcm=None):
    """Page of one event, one self-contained HTML text.

    Parameters
    ----------
    document : dict of `document`
    products : as for `document`, and "angular_acceleration"; what is missing or None leaves out its figures
    published : {section: records} as the catalogue gives them for this event; None where nothing was printed
    vcm : line of `vcm_line`, or None
    """
    from gravcal.report import com_offset_page

    return com_offset_page.page(document, products, published or {}, vcm)


def vcm_line(document, satellite):
    """Adopted offset as a line of the sequence-of-events file, in force from the end of the last manoeuvre.

    Parameters
    ----------
    document : dict of `document`
    satellite : letter

    Returns
    -------
    line : str, a comment unless all data were measured; None unless all three components of the adopted variant are
        determined
    """
    from gravcal.io.vcm import commented, vector_line

    found = vcm_vector(document)
    if found is None:
        return None
    time, vector, sigma = found
    name = document["adopted"]["variant"]
    errors = " ".join(f"{item:.2f}" for item in sigma)
    doubt = " QUESTIONABLE" if document["status"] == "questionable" else ""
    line = vector_line(time, satellite, vector, comment=f"{document['event']} {name} sigma_um {errors}{doubt}")
    return line if document["origin"] == "measured" else commented(line, document["origin"])


def vcm_vector(document):
    """Whole GPS second from which the adopted offset holds, its vector and error; None unless all is determined.

    Parameters
    ----------
    document : dict of `document`

    Returns
    -------
    time : float, s
    vector_b : (3,) m, proof mass to centre of mass
    sigma_um : (3,) um, total
    """
    if document["status"] not in WITH_RESULT or document["adopted"]["variant"] is None:
        return None
    block = document["variants"][document["adopted"]["variant"]]
    if any(item is None for item in block["offset_um"]):
        return None
    stop = max(one["stop"] for one in document["manoeuvres"])
    return float(np.ceil(stop)), [1e-6 * item for item in block["offset_um"]], block["sigma_total_um"]
