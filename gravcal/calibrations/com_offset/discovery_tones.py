"""Lines that discovery finds: their size and phase in each manoeuvre, in the units of the reading."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def waves(finding: Mapping, views: list, blocks: list) -> list[dict]:
    """Cosine and sine of a line on each axis of each manoeuvre.

    The search fits a sine to whitened rows. A sine of the reading, taken through low-pass and whitening, gives the
    same rows for one size and phase, which are those of the reading.

    Parameters
    ----------
    finding : with parameters frequency, cosine_<axis>_<manoeuvre> and sine_<axis>_<manoeuvre>, whitened
    views : of the event
    blocks : list of Block, one a view and more

    Returns
    -------
    waves : {"start" s, "channel", "x", "y", "z": [cosine, sine]} a manoeuvre; phase zero at its start
    """
    values = {name: p["value"] for name, p in finding["parameters"].items()}
    channel = finding["form"].split()[0]
    found = []
    for number, (view, block) in enumerate(zip(views, blocks[: len(views)], strict=True)):
        one = {"start": float(view.scene.time[0]), "channel": channel}
        for axis, letter in enumerate("xyz"):
            names = (f"cosine_{letter}_{number}", f"sine_{letter}_{number}")
            if all(np.isfinite(values.get(n, np.nan)) for n in names):
                one[letter] = _of_reading(view, block, (channel, axis), values["frequency"], [values[n] for n in names])
        found.append(one)
    return found


def _of_reading(view, block, where, frequency, whitened):
    """Cosine and sine of the reading whose whitened rows are a given sine."""
    channel, axis = where
    rows = (block.channel == channel) & (block.axis == axis)
    phase = 2 * np.pi * frequency * block.time[rows]
    wanted = whitened[0] * np.cos(phase) + whitened[1] * np.sin(phase)
    signal = np.zeros((view.scene.time.size, 3, 2))
    signal[:, axis] = _unit(view.scene.time, view.scene.time[0], frequency)
    columns = view.rows({channel: signal})[rows]
    used = np.any(columns != 0, axis=1)
    return np.linalg.lstsq(columns[used], wanted[used], rcond=None)[0].tolist()


def _unit(time, start, frequency):
    phase = 2 * np.pi * frequency * (time - start)
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


def reading(view, entry: Mapping) -> dict[str, np.ndarray]:
    """What a line adds to the readings of a manoeuvre, {channel: (n, 3)}; nothing where its phase is not known.

    Parameters
    ----------
    view : View
    entry : of a model, with `waves`
    """
    time = view.scene.time
    known = [w for w in entry.get("waves", []) if abs(w["start"] - time[0]) < 5.0]
    if not known:
        return {}
    unit = _unit(time, known[0]["start"], entry["parameters"]["frequency"]["value"])
    return {known[0]["channel"]: np.stack([unit @ np.array(known[0].get(a, (0.0, 0.0))) for a in "xyz"], axis=1)}
