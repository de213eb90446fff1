"""What all result documents share: origin and configuration of the data, checks, and the status that follows."""

import json
from collections.abc import Mapping, Sequence

from gravcal.calibrations import checks as checking
from gravcal.store import product
from gravcal.store.product import MEASURED, origins_together
from gravcal.store.schemas import validate

#: Statuses of documents that hold a result.
WITH_RESULT = ("delivered", "questionable")
OPERATIONAL = "operational"


def traced(calibration: str, products: Mapping) -> dict:
    """Provenance of a document: digests of its products {stage or "stage.variant": Dataset}, None left out."""
    known = {f"{calibration}.{name}": one for name, one in products.items() if one is not None}
    return {"products": {name: product.digest(one)[:12] for name, one in known.items()}}


def delivered(document: Mapping, products: Sequence, checks: Sequence[checking.Check], schema: str = ""):
    """Document, `judged` and valid, and {"result.json": text}; the schema by its name if not the calibration's."""
    found = judged(document, products, checks)
    validate(found, schema or None)
    return found, {"result.json": json.dumps(found, indent=1, allow_nan=False) + "\n"}


def judged(document: Mapping, products: Sequence, checks: Sequence[checking.Check]) -> dict:
    """New document with origin, configuration and checks; a result with a failed check becomes questionable.

    The document as the calibration made it has "status", "settings" and, if it has one, "verdict" {"text"}; the
    products, Datasets, are those that the report reads.
    """
    origin = origin_of(products)
    failed = [one for one in checks if not one.passed]
    status = "questionable" if failed and document["status"] == "delivered" else document["status"]
    doubt = f"QUESTIONABLE: {'; '.join(map(said, failed))}. " if failed else ""
    verdict = document.get("verdict")
    told = {"verdict": verdict | {"text": foreword(origin) + doubt + verdict["text"]}} if verdict else {}
    configuration = settings_of(document).get("configuration", OPERATIONAL)
    added = {"origin": origin, "configuration": configuration, "checks": checking.plain(checks)}
    return dict(document) | {"status": status} | added | told


def settings_of(document: Mapping) -> Mapping:
    """Settings that a document was made with."""
    return document.get("settings") or document.get("provenance", {}).get("settings", {})


def foreword(origin: str) -> str:
    """What a verdict begins with: the origin of the data where they were not all measured."""
    return "" if origin == MEASURED else f"{origin.upper()}. "


def said(check: checking.Check) -> str:
    """A failed check in words: what was found and its limit."""
    return f"{check.name} {check.value:.3g}, limit {check.limit:.3g} {check.unit if check.unit != '1' else ''}".rstrip()


def origin_of(products: Sequence) -> str:
    """Where the records of some products came from: "measured", "simulated", or "mixed"."""
    return origins_together(one.attrs.get("origin", "") for one in products if one is not None) or MEASURED
