"""Products of a discovery, the same for every calibration."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.discovery.rounds import Result
from gravcal.discovery.schemas import DISCOVERY


def nothing() -> xr.Dataset:
    """Product of a record without manoeuvre."""
    values = {name: [] for name, stated in DISCOVERY.items() if not stated.get("optional")}
    return build(DISCOVERY, values, numbers=json.dumps({"status": "no_manoeuvre"}), channels="", blocks="")


def dataset(result: Result, numbers: dict, channels: Sequence[str], reading: Mapping | None = None) -> xr.Dataset:
    """Product of a search: residuals before and after, adequacy, and the numbers.

    Parameters
    ----------
    result : Result
    numbers : of `summary.summary`
    channels : names in the order of the pages
    reading : of `readings.variables`
    """
    blocks, before, after = result.problem.blocks, result.before, result.after
    rows = before.rows
    names = list(dict.fromkeys([*channels, *(str(c) for b in blocks for c in b.channel)]))
    place = {name: k for k, name in enumerate(names)}
    labels = {b.label: k for k, b in enumerate(blocks)}
    values = {
        "time_row": np.concatenate([b.time for b in blocks]),
        "channel": np.concatenate([[place[str(c)] for c in b.channel] for b in blocks]),
        "component": np.concatenate([b.axis for b in blocks]),
        "block": np.concatenate([np.full(b.time.size, k) for k, b in enumerate(blocks)]),
        "observed": np.concatenate([b.observed for b in blocks]),
        "residual_before": np.concatenate(before.rest),
        "residual_after": np.concatenate(after.rest),
        "test_block": [labels[r["block"]] for r in rows],
        "test_channel": [place[r["channel"]] for r in rows],
        "test_band": [r["band"] for r in rows],
        "power_before": [r["ratio"] for r in rows],
        "power_after": [r["ratio"] for r in after.rows],
        "p_band_before": [r["p"] for r in rows],
        "p_band_after": [r["p"] for r in after.rows],
    }
    text = json.dumps(_known(numbers), allow_nan=False, sort_keys=True)
    words = {"numbers": text, "channels": " ".join(names), "blocks": ", ".join(labels)}
    return build(DISCOVERY, values | (reading or {}), **words)


def _known(value):
    """NaN and infinity become null."""
    if isinstance(value, dict):
        return {k: _known(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_known(v) for v in value]
    if isinstance(value, (np.floating, float)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
