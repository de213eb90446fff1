"""Blocks by their old field names, for calibrations that are not yet on `gravcal.estimation.records`."""

from __future__ import annotations

from gravcal.estimation import records
from gravcal.estimation.records import Candidate, Shape

__all__ = ["Block", "Candidate", "Shape"]


def Block(label, observed, shared, own, channel, axis, time, local=None):  # noqa: N802, D103
    return records.Block(label, observed, shared, own, channel, axis, time, local or {})
