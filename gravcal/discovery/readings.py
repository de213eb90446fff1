"""The channel and block that an extension helps most, in the units of its reading."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gravcal.discovery.rounds import Result

#: Rows of a channel and block below which they are no curve.
CURVE = 60
#: Chi-square that the extension has to gain there to be seen at all.
SEEN = 10.0


def clearest(result: Result, channels: Sequence[str], level: float) -> tuple[str, int] | None:
    """Channel and index of the block to be shown, None where there is nothing to show.

    Where something was named it is that which the extension helps most; where nothing was named and the baseline is
    not adequate, that of the least likely band.

    Parameters
    ----------
    result : Result
    channels : that can be shown
    level : family-wise, of the adequacy
    """
    drops = {}
    for k, block in enumerate(result.problem.blocks):
        drop = result.before.rest[k] ** 2 - result.after.rest[k] ** 2
        here = {c: block.channel == c for c in channels}
        drops |= {(c, k): float(drop[rows].sum()) for c, rows in here.items() if rows.sum() >= CURVE}
    if result.findings:
        best = max(drops, key=drops.get, default=None)
        return best if best and drops[best] >= SEEN else None
    labels = {b.label: k for k, b in enumerate(result.problem.blocks)}
    rows = sorted(result.before.rows, key=lambda r: r["p"]) if result.before.p < level else []
    return next((place for r in rows if (place := (r["channel"], labels[r["block"]])) in drops), None)


def variables(result: Result, place: tuple[str, int] | None, reading_of: Callable) -> dict[str, np.ndarray]:
    """Variables of the product for the channel and block that are shown, less the mean measured; none without them.

    Parameters
    ----------
    result : Result
    place : of `clearest`
    reading_of : (channel, block index, rows (n, 3) 1) -> (time (m,) s, model (m, a), columns (3, m, a)): the reading
        that the observed rows are the difference to, and whitened rows in the unit of the reading
    """
    if place is None:
        return {}
    channel, k = place
    rows = np.stack([result.problem.blocks[k].observed, result.before.rest[k], result.after.rest[k]], axis=1)
    time, model, (observed, before, after) = reading_of(channel, k, rows)
    measured = model + observed
    measured -= np.nanmean(measured, axis=0)
    parts = {"measured": measured, "baseline": measured - before}
    parts |= {"extended": measured - after} if result.findings else {}
    return {"time_reading": time} | {f"{channel}_{name}": values for name, values in parts.items()}
