"""What a run delivers: the result document, the page, and the line for the sequence-of-events file."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import xarray as xr

from gravcal.data import product
from gravcal.data.schemas import validate
from gravcal.report import com_offset


def report(*products, event, satellite, settings, published):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, combine, four solve, survey, detect, figures
    event : str
    satellite : letter
    settings : mapping of all parameters
    published : {section: list of plain records} of the catalogue, {} where nothing was printed

    Returns
    -------
    dataset : Dataset, "com_offset.report"
    files : {name: text or bytes}
    """
    combined, solved = products[0], products[1:5]
    surveyed, detected, drawn = products[5:]
    provenance = {"products": {name: digest[:12] for name, digest in _digests(products).items()}}
    arguments = {"event": event, "provenance": provenance, "settings": settings}
    instruments = json.loads(drawn.attrs["instruments"])
    document = com_offset.document(combined, solved, instruments, detected, surveyed, **arguments)
    validate(document)
    files = {"result.json": json.dumps(document, indent=1, allow_nan=False) + "\n"}
    line = com_offset.vcm_line(document, satellite)
    if line is not None:
        files["result.vcm"] = line + "\n"
    printed = {section: [SimpleNamespace(**r) for r in records] for section, records in published.items()}
    shown = (solved, drawn, surveyed, detected)
    files["report.html"] = com_offset.page(document, *shown, published=printed, vcm=line)
    return _dataset(document), files


def _digests(products):
    """Digests of what led here, by the stage that made it; the figures know those of the series they show."""
    names = ["combine", *(f"solve.{d.attrs['variant']}" for d in products[1:5])]
    names += ["survey", "detect"]
    known = {f"com_offset.{n}": product.digest_as_read(d) for n, d in zip(names, products[:-1], strict=True)}
    return known | json.loads(products[-1].attrs["drawn_from"])


def _dataset(document):
    """Adopted offset and its errors, NaN where not determined."""
    name = document.get("adopted", {}).get("variant")
    block = document["variants"][name] if name else {}
    number = lambda key: [np.nan if v is None else 1e-6 * v for v in block.get(key, [None] * 3)]  # noqa: E731
    values = {key: np.array(number(f"{key}_um")) for key in ("offset", "sigma", "sigma_total")}
    attrs = {"status": document["status"], "adopted": name or "none", "event": document["event"]}
    columns = {key: xr.Variable("axis", value, fastpath=True) for key, value in values.items()}  # without dask.array
    return xr.Dataset(columns, attrs=attrs)
