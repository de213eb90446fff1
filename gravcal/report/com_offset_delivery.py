"""What a run delivers: the result document, the page, and the line for the sequence-of-events file."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import xarray as xr

from gravcal.calibrations import checks as checking
from gravcal.report import com_offset, com_offset_verdict, documents
from gravcal.store import product
from gravcal.store.schemas import validate


def report(*products, event, satellite, settings, published):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, combine; solve and angular_acceleration, four each; attitude, field, survey, detect, align,
        checks
    event : str
    satellite : letter
    settings : mapping of all parameters
    published : {section: list of plain records} of the catalogue, {} where nothing was printed

    Returns
    -------
    dataset : Dataset, "com_offset.report"
    files : {name: text or bytes}
    """
    named = {name: one for name, one in zip(com_offset.SINGLE, (products[0], *products[9:]), strict=True)}
    each = {"solve": products[1:5], "angular_acceleration": products[5:9]}
    by_variant = {kind: {one.attrs["variant"]: one for one in own} for kind, own in each.items()}
    flat = named | {f"{kind}.{name}": one for kind, own in by_variant.items() for name, one in own.items()}
    labels = {f"com_offset.{name}": product.digest_as_read(one)[:12] for name, one in flat.items()}
    arguments = {"event": event, "provenance": {"products": labels}, "settings": settings}
    document = com_offset.document(named | by_variant, **arguments)
    found = checking.of_product(named["checks"])
    if "consistency" in document:
        found += com_offset_verdict.checks(named["combine"], document["consistency"], settings)
    document = documents.judged(document, products, found)
    validate(document)
    files = {"result.json": json.dumps(document, indent=1, allow_nan=False) + "\n"}
    line = com_offset.vcm_line(document, satellite)
    if line is not None:
        files["result.vcm"] = line + "\n"
    printed = {section: [SimpleNamespace(**r) for r in records] for section, records in published.items()}
    files["report.html"] = com_offset.page(document, named | by_variant, published=printed, vcm=line)
    return _dataset(document), files


def _dataset(document):
    """Adopted offset and its errors, NaN where not determined."""
    name = document.get("adopted", {}).get("variant")
    block = document["variants"][name] if name else {}
    number = lambda key: [np.nan if v is None else 1e-6 * v for v in block.get(key, [None] * 3)]  # noqa: E731
    values = {key: np.array(number(f"{key}_um")) for key in ("offset", "sigma", "sigma_total")}
    attrs = {"status": document["status"], "adopted": name or "none", "event": document["event"]}
    columns = {key: xr.Variable("axis", value, fastpath=True) for key, value in values.items()}  # without dask.array
    return xr.Dataset(columns, attrs=attrs)
