"""An event looked at again from an extended model, so that strong effects leave no second-order rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_lag, discovery_timing
from gravcal.calibrations.com_offset.discovery_candidates import field_of_delay
from gravcal.calibrations.com_offset.discovery_view import View
from gravcal.calibrations.com_offset.extension import contribution, determined
from gravcal.effects import effect


def with_model(blocks: list[dict], views: list[View], smoothed: xr.Dataset, starts, model: list[Mapping]) -> list[dict]:
    """Blocks of extended records, with the effects of the model added to what was observed.

    The records are those that the extended model describes; adding its effects in their linear form gives an event
    that is linear in every parameter round that model. A search in it finds the whole effects, not corrections.

    Parameters
    ----------
    blocks : fields of `gravcal.discovery.blocks.Block`, one a view and the edge times
    views : of the extended records
    smoothed : Dataset, "com_offset.attitude", of the extended records
    starts : (k,) s, of the manoeuvres
    model : entries {"cause", "form", "parameters"}
    """
    made = []
    for view, block in zip(views, blocks[: len(views)], strict=True):
        rows = sum((_rows(view, entry) for entry in model), start=np.zeros(block["observed"].size))
        made.append(block | {"observed": block["observed"] + rows})
    edges = blocks[len(views)]
    rows = sum((_edges(entry, smoothed, starts) for entry in model), start=np.zeros(edges["observed"].size))
    return [*made, edges | {"observed": edges["observed"] + rows}]


def _rows(view, entry):
    """Whitened rows of an effect in a manoeuvre."""
    added = contribution(view, entry) or _of_delay(view, entry)
    return view.rows({channel: values[..., None] for channel, values in added.items()})[:, 0] if added else 0.0


def _of_delay(view, entry):
    """What a delay adds to the field, where tags were moved instead."""
    signal = field_of_delay(view, entry["cause"])
    if signal is None:
        return {}
    value = effect(entry["cause"]).values(determined(entry))[0]
    return {channel: columns[..., 0] * value for channel, columns in signal.items()}


def _edges(entry, smoothed, starts):
    """Rows of an effect among the edge times; behind a lag the fitted edges stay where they were."""
    if entry["cause"].startswith("unknown:") or entry["cause"] == discovery_lag.CAUSE:
        return 0.0
    column = discovery_timing.columns(entry["cause"], smoothed, starts)
    return 0.0 if column is None else column[:, 0] * effect(entry["cause"]).values(determined(entry))[0]
