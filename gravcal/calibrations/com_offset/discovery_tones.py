"""Lines that discovery finds: their size and phase in each manoeuvre, in the units of the reading."""

from __future__ import annotations

import numpy as np

from gravcal.estimation.records import Entry, Parameter, Wave

UNITS = {"linear": "m s-2", "angular": "rad s-2"}


def waves(entry: Entry, views: list, blocks: list) -> tuple[Wave, ...]:
    """Cosine and sine of a line on each axis of each manoeuvre.

    The search fits a sine to whitened rows. A sine of the reading, taken through low-pass and whitening, gives the
    same rows for one size and phase, which are those of the reading.

    Parameters
    ----------
    entry : with parameters frequency, cosine_<axis>_<manoeuvre> and sine_<axis>_<manoeuvre>, whitened
    views : of the event
    blocks : list of Block, one a view and more
    """
    values, channel, found = entry.values, entry.form.split()[0], []
    for number, (view, block) in enumerate(zip(views, blocks[: len(views)], strict=True)):
        axes = {}
        for axis, letter in enumerate("xyz"):
            names = (f"cosine_{letter}_{number}", f"sine_{letter}_{number}")
            if all(n in values for n in names):
                axes[letter] = _of_reading(
                    view, block, (channel, axis), values["frequency"], [values[n] for n in names]
                )
        found.append(Wave(float(view.scene.time[0]), channel, axes.get("x"), axes.get("y"), axes.get("z")))
    return tuple(found)


def amplitudes(entry: Entry, views: list) -> dict[str, Parameter]:
    """Frequency, and amplitude on each axis: rms over the manoeuvres, its whitened size over that of a unit sine.

    Parameters
    ----------
    entry : as of `waves`
    views : of the event
    """
    parameters, channel = entry.parameters, entry.form.split()[0]
    found = {"frequency": parameters["frequency"]}
    for axis, letter in enumerate("xyz"):
        names = [(f"cosine_{letter}_{i}", f"sine_{letter}_{i}", v) for i, v in enumerate(views)]
        pairs = [(a, b, v) for a, b, v in names if a in parameters and b in parameters]
        sizes = [_size_of(v, channel, axis, parameters["frequency"].value) for _, _, v in pairs]
        values = [parameters[n].value ** 2 for a, b, _ in pairs for n in (a, b)]
        errors = [parameters[n].sigma ** 2 for a, b, _ in pairs for n in (a, b)]
        if pairs:
            square = (np.sum(values) - np.sum(errors)) / np.sum(np.square(sizes))
            error = np.sqrt(np.mean(errors) / np.sum(np.square(sizes)))
            found[letter] = Parameter(float(np.sqrt(max(square, 0.0))), float(error), UNITS[channel])
    return found


def _size_of(view, channel, axis, frequency):
    """Whitened amplitude of a sine of unit amplitude on one axis."""
    signal = np.zeros((view.scene.time.size, 3, 1))
    signal[:, axis, 0] = np.sqrt(2) * np.sin(2 * np.pi * frequency * view.scene.time)
    rows = view.rows({channel: signal})[:, 0]
    return float(np.sqrt(np.mean(rows[rows != 0] ** 2)))


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


def reading(view, entry: Entry) -> dict[str, np.ndarray]:
    """What a line adds to the readings of a manoeuvre, {channel: (n, 3)}; nothing where its phase is not known.

    Parameters
    ----------
    view : View
    entry : of a model, with `waves`
    """
    time = view.scene.time
    known = [w for w in entry.waves if abs(w.start - time[0]) < 5.0]
    if not known:
        return {}
    unit = _unit(time, known[0].start, entry.values["frequency"])
    axes = [np.zeros(2) if one is None else np.array(one) for one in (known[0].x, known[0].y, known[0].z)]
    return {known[0].channel: np.stack([unit @ one for one in axes], axis=1)}
