"""Entries of an extended model: a cause and the values of its parameters, as discovery writes them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def determined(entry: Mapping) -> dict[str, float]:
    """Values by parameter, none where not determined.

    Parameters
    ----------
    entry : {"parameters": {name: {"value"}}}; "model" goes before, where a cause was named by a few of its parameters
    """
    values = {n: p["value"] for n, p in entry.get("model", entry["parameters"]).items()}
    return {n: v for n, v in values.items() if v is not None and np.isfinite(v)}
