"""Result document of a ranging calibration: what was found, how well, and whether it may be used."""

import numpy as np

from gravcal.report import kbr_phase_centre_parts as parts
from gravcal.report.documents import WITH_RESULT
from gravcal.report.plain import as_plain, chi_square_test, numbers
from gravcal.store.schemas import VERSION

OBSERVABLES = ("range", "range_rate", "range_acceleration")
ESTIMATORS = ("ls", "robust")


def document(combined, pointed, measured, described, *, event, provenance, settings):
    """Document of one event, ready for JSON.

    Parameters
    ----------
    combined : Dataset, "kbr_phase_centre.combine"
    pointed : Dataset, "kbr_phase_centre.pointing"
    measured : Dataset, "kbr_phase_centre.noise"
    described : Dataset, "kbr_phase_centre.routine"
    event : str
    provenance : mapping
    settings : mapping, all parameters

    Returns
    -------
    document : dict of plain values
    """
    head = {
        "schema_version": VERSION,
        "status": "no_manoeuvre",
        "calibration": "kbr_phase_centre",
        "event": event,
        "direction": "com_to_phase_centre",
    }
    around = {
        "pair": pointed.attrs["satellites"],
        "ranging": pointed.attrs["ranging"],
        "record": {"start": float(pointed["time"].values[0]), "stop": float(pointed["time"].values[-1])},
        "noise": parts.noise(measured),
        "routine_pointing": parts.routine(described, pointed),
    }
    tail = {"settings": as_plain(settings), "provenance": as_plain(provenance)}
    if pointed.sizes["manoeuvre"] == 0:
        reason = "No wiggle in the pointing angles of either satellite: nothing to calibrate."
        return head | {"verdict": {"text": reason}, "manoeuvres": []} | around | tail
    return head | _estimates(combined, pointed, settings) | around | tail


def _estimates(combined, pointed, settings):
    """Everything that needs a wiggle."""
    satellites = parts.satellites(combined)
    adopted = parts.adopted(combined, satellites)
    found = any(item is not None for block in adopted["satellites"].values() for item in block["phase_centre_mm"])
    tests = {
        name: chi_square_test(combined["arcs_chi2"].values[k], combined["arcs_dof"].values[k])
        for k, name in enumerate(OBSERVABLES)
    }
    return {
        "status": "delivered" if found else "failed",
        "verdict": parts.verdict(adopted, tests[adopted["observable"]], settings),
        "method": combined.attrs["method"],
        "satellites": satellites,
        "adopted": adopted,
        "manoeuvres": parts.manoeuvres(combined, pointed),
        "subsets": parts.subsets(combined),
        "geometry": parts.geometry(combined, pointed),
        "consistency": {"manoeuvres": tests, "scatter_between_manoeuvres_mm": parts.scatter(combined)},
        "sigma0": {name: numbers(combined["sigma0"].values[k, 0]) for k, name in enumerate(OBSERVABLES)},
        "trust": parts.trust(combined),
        "indistinguishable_from_calibration": parts.INDISTINGUISHABLE,
    }


def vector_files(document, date):
    """Vector files and lines of the sequence-of-events file of the adopted result.

    Parameters
    ----------
    document : dict of `document`
    date : "YYYY-MM-DD"

    Returns
    -------
    files : {name: text}; "VKB1B_date_letter_04.txt" and "result.soe"; only what is determined in x, y and z; unless all
        data were measured no vector file and comments for lines
    """
    if document["status"] not in WITH_RESULT:
        return {}
    from gravcal.io.vcm import commented, vector_line

    said = "QUESTIONABLE " if document["status"] == "questionable" else ""
    time, files, lines = float(np.ceil(max(one["stop"] for one in document["manoeuvres"]))), {}, []
    for letter, block in document["adopted"]["satellites"].items():
        if any(item is None for item in block["phase_centre_mm"]):
            continue
        vector = [1e-3 * item for item in block["phase_centre_mm"]]
        errors = " ".join(f"{1e3 * item:.2f}" for item in block["sigma_mm"])
        comment = f"{said}{document['event']} {document['adopted']['observable']} sigma_um {errors}"
        lines.append(vector_line(time, letter, vector, name="VKB", comment=comment))
        if document["origin"] != "measured":
            lines[-1] = commented(lines[-1], document["origin"])
            continue
        name = f"VKB1B_{date}_{letter}_{'02' if letter in 'AB' else '04'}.txt"
        files[name] = _vector_text(name, time, letter, vector, said + document["event"])
    return files | ({"result.soe": "\n".join(lines) + "\n"} if lines else {})


def _vector_text(name, time, letter, vector, event):
    """Text of a vector file."""
    import tempfile
    from pathlib import Path

    from gravcal.io.vcm import write_vector_file

    with tempfile.TemporaryDirectory() as folder:
        return write_vector_file(Path(folder) / name, [time], letter, [vector], source=event).read_text()
