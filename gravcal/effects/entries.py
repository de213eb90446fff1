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


def each_alone(whole: dict) -> list[dict]:
    """Candidate with all its parameters, then with each alone.

    Parameters
    ----------
    whole : fields of `gravcal.discovery.blocks.Candidate`; "columns" (n, q) or None a block
    """
    found = [whole]
    for k, name in enumerate(whole["names"] if len(whole["names"]) > 1 else ()):
        columns = [c if c is None else c[:, k : k + 1] for c in whole["columns"]]
        one = {"names": [name], "units": [whole["units"][k]], "prior": [whole["prior"][k]], "columns": columns}
        found.append(whole | one | {"form": f"{name} alone"})
    return found
