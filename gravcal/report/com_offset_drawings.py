"""What no solution of a centre-of-mass event changes: figures and parts of the document, kept as a product."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import FIGURES
from gravcal.data import product
from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_parts as parts


def drawings(
    angular: Mapping[str, xr.Dataset],
    smoothed: xr.Dataset,
    field: xr.Dataset,
    aligned: xr.Dataset,
    detected: xr.Dataset,
    settings: Mapping,
) -> xr.Dataset:
    """Figures of what leads to a solution: angular acceleration, torquers, attitude, field; and what these say.

    Parameters
    ----------
    angular : {variant: Dataset, "com_offset.angular_acceleration"}
    smoothed : Dataset, "com_offset.attitude"
    field : Dataset, "com_offset.field"
    aligned : Dataset, "align"
    detected : Dataset, "com_offset.detect"; what is missing may be None and leaves out its figures
    settings : mapping with the priors that `com_offset_parts.instruments` names

    Returns
    -------
    drawn : Dataset, "com_offset.figures"; its attribute ``drawn_from`` is JSON of the digest of each product,
        ``instruments`` that of `com_offset_parts.instruments`
    """
    wanted = {"attitude": (figures.attitude, smoothed), "field": (figures.field, field, aligned)}
    if detected is not None and detected.sizes["manoeuvre"]:
        wanted |= {"angular": (figures.angular_accelerations, angular, detected)}
        wanted |= {"torquers": (figures.torquers, aligned, smoothed, detected)}
    found = {name: draw(*given) for name, (draw, *given) in wanted.items() if all(one is not None for one in given)}
    texts = {name: text.encode() for name, text in found.items() if text is not None}
    values = {"name": np.array(list(texts), dtype=object), "stop": np.cumsum([len(text) for text in texts.values()])}
    origins = {f"angular_acceleration.{variant}": one for variant, one in (angular or {}).items()}
    origins |= {"attitude": smoothed, "field": field, "align": aligned, "detect": detected}
    origins = {f"com_offset.{n}": product.digest_as_read(d) for n, d in origins.items() if d is not None}
    values["svg"] = np.frombuffer(b"".join(texts.values()), np.uint8)
    given = smoothed, field, detected
    told = None if any(one is None for one in given) else parts.instruments(*given, settings)
    return build(FIGURES, values, drawn_from=json.dumps(origins), instruments=json.dumps(told))


def texts(drawn: xr.Dataset | None) -> dict[str, str]:
    """SVG text of every figure of a product, by name; empty without product.

    Parameters
    ----------
    drawn : Dataset, "com_offset.figures", or None
    """
    if drawn is None:
        return {}
    parts = np.split(drawn["svg"].values, drawn["stop"].values)
    return {name: part.tobytes().decode() for name, part in zip(drawn["name"].values, parts, strict=False)}
