"""Common parts of all result documents: origin and configuration of the data, checks, and the resulting status."""

import json
from collections.abc import Mapping, Sequence

from gravcal.calibrations import checks as checking
from gravcal.report.plain import as_plain
from gravcal.store import location, product
from gravcal.store.product import MEASURED, foreword, listed, origins_together
from gravcal.store.schemas import VERSION, validate

#: Statuses of documents that hold a result.
WITH_RESULT = ("delivered", "questionable")


def delivered(calibration, body: Mapping, products: Mapping, checks: Sequence, *, event, settings) -> dict:
    """Result document, `judged` and valid, from its body: "status", "verdict" and the other entries of its schema.

    Products are {stage or "stage.variant": Dataset or None}. A discovery, of some "kind", has its settings in the
    provenance; its own digests go before those of the products.
    """
    head = {"schema_version": VERSION, "calibration": calibration, "event": event}
    digests = {f"{calibration}.{n}": product.digest(one)[:12] for n, one in products.items() if one is not None}
    provenance = {"products": digests} | body.get("provenance", {})
    settings = {"settings": as_plain(settings)}
    tail = {"provenance": provenance | settings} if "kind" in body else settings | {"provenance": provenance}
    document = judged(head | as_plain(body) | tail, list(products.values()), checks)
    validate(document)
    return document


def text(document: Mapping) -> str:
    """JSON text of a document, with a line end."""
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def judged(document: Mapping, products: Sequence, checks: Sequence[checking.Check]) -> dict:
    """New document with origin, configuration and checks; a result with a failed check becomes questionable.

    The document as the calibration made it has "status", "settings" and, if it has one, "verdict" {"text"}; the
    products, Datasets, are those that the report reads.
    """
    origin = origins_together(one.attrs.get("origin", "") for one in products if one is not None) or MEASURED
    for name, records, declared in (one.rsplit(None, 2) for one in listed("cut", products)):
        of_all = f"records of {name} over those that its header declares", int(records) / int(declared)
        checks = [*checks, checking.at_least(*of_all, 1.0, "1")]
    failed = [one for one in checks if not one.passed]
    status = "questionable" if failed and document["status"] == "delivered" else document["status"]
    warning = f"QUESTIONABLE: {'; '.join(map(said, failed))}. " if failed else ""
    verdict = document.get("verdict")
    new_verdict = {"verdict": verdict | {"text": foreword(origin) + warning + verdict["text"]}} if verdict else {}
    configuration = settings_of(document).get("configuration", location.OPERATIONAL)
    added = {"origin": origin, "configuration": configuration, "checks": as_plain(list(map(vars, checks)))}
    return dict(document) | {"status": status} | added | new_verdict


def settings_of(document: Mapping) -> Mapping:
    """{setting: value} that a document was made with, also of a discovery; {} without."""
    return document.get("settings") or document.get("provenance", {}).get("settings", {})


def said(check: checking.Check) -> str:
    """Text "name value, limit value unit" of a failed check."""
    return f"{check.name} {check.value:.3g}, limit {check.limit:.3g} {check.unit if check.unit != '1' else ''}".rstrip()
