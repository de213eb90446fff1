"""What a ranging calibration delivers: the result document, the page, vector files and sequence-of-events lines."""

from __future__ import annotations

import json

import numpy as np

from gravcal.calibrations.building import build
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre.checks import of_result
from gravcal.calibrations.kbr_phase_centre.schemas import REPORT
from gravcal.report import documents, kbr_phase_centre, kbr_phase_centre_page
from gravcal.report.plain import gps_text
from gravcal.store import product
from gravcal.store.schemas import validate


def report(*products, event, settings, published, nominal_m):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, combine, pointing, noise, routine, checks and three solve
    event : str
    settings : mapping of all parameters
    published : {section: list of printed records}
    nominal_m : (2, 3) m, phase centres of the catalogue

    Returns
    -------
    dataset : Dataset, "kbr_phase_centre.report"
    files : {name: text}
    """
    combined, pointed, measured, described, checked, *solved = products
    provenance = {"products": {name: product.digest_as_read(d)[:12] for name, d in _named(products).items()}}
    arguments = {"event": event, "provenance": provenance, "settings": settings}
    document = kbr_phase_centre.document(combined, pointed, measured, described, **arguments)
    checked = of_product(checked)
    if document["status"] in documents.WITH_RESULT:
        tests = {name: one["p"] for name, one in document["consistency"]["manoeuvres"].items()}
        checked += of_result(combined, tests, nominal_m, settings)
    document = documents.judged(document, products, checked)
    validate(document)
    files = {"result.json": json.dumps(document, indent=1, allow_nan=False) + "\n"}
    files |= kbr_phase_centre.vector_files(document, gps_text(document["record"]["start"])[:10])
    files["report.html"] = kbr_phase_centre_page.page(document, (pointed, measured, solved), published, files)
    return _dataset(document), files


def _named(products):
    """Products by the stage that made them."""
    names = [
        "combine",
        "pointing",
        "noise",
        "routine",
        "checks",
        *(f"solve.{d.attrs['observable']}" for d in products[5:]),
    ]
    return dict(zip((f"kbr_phase_centre.{n}" for n in names), products, strict=True))


def _dataset(document):
    """Adopted phase centres and their errors, NaN where not determined."""
    blocks = list(document.get("adopted", {}).get("satellites", {}).values()) or [{}, {}]
    number = lambda one, key: [np.nan if v is None else 1e-3 * v for v in one.get(key, [None] * 3)]  # noqa: E731
    values = {
        "centre": [number(one, "phase_centre_mm") for one in blocks],
        "sigma": [number(one, "sigma_mm") for one in blocks],
    }
    return build(REPORT, values, status=document["status"], event=document["event"])
