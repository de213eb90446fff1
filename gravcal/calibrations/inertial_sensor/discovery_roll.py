"""A roll as discovery sees it: whitened linear readings of each segment, and the wander of the bias between them.

Bias and offset are shared by all segments. A segment has the amplitudes of its own that the calibration gives it, and a
constant that wanders about the bias; a row for each axis says by how much. The noise is that of a fit which is wider
than the baseline, with every form that is tried, and what such a fit takes is put back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import bias as roll_segments
from gravcal.calibrations.inertial_sensor.bias import ENOUGH, sensor_of
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.base import Context
from gravcal.estimation import noise
from gravcal.estimation.noise import fit_detrended, without_lines

CHANNEL, CONSTANT = "roll", "constant"
PARAMETERS = ("bias_x", "bias_y", "bias_z")
MOST = 48  # segments, evenly taken: columns of more take memory and add little
ALIKE = 0.9  # correlation of the bias of neighbouring segments, at most
UNKNOWN_M = 1e-3  # how far the offset may be from one that was assumed
STEP_EVERY_S = 20.0
EDGE_S = 200.0  # from the ends of a segment, where its trend follows a step


@dataclass(frozen=True)
class Roll:
    """Segments of a roll, their fits and their noise.

    Attributes
    ----------
    time : (s, b) s
    reading, fitted : (s, b, 3) m s-2, k V as measured and as the baseline describes it
    steady : (s, b, 3) m s-2, k V without wander: what the sensor feels by rolling, about the mean bias
    tensor : (s, b, 3, 3) s-2, of the offset
    cosine, sine : (s, b) of the roll angle
    rate_b : (s, b, 3) rad s-1; gradient_b : (s, b, 3, 3) s-2
    own : of each segment a design (b, p) for each axis, the constant first
    noise : model of each axis; wander : (3,) m s-2 of the constants
    start : (6,) m s-2 and m: bias and offset that residuals are formed with
    k : (3,) m s-2 V-1
    """

    time: np.ndarray
    reading: np.ndarray
    fitted: np.ndarray
    steady: np.ndarray
    tensor: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray
    rate_b: np.ndarray
    gradient_b: np.ndarray
    own: list[list[np.ndarray]]
    noise: list[noise.NoiseModel]
    wander: np.ndarray
    start: np.ndarray
    k: np.ndarray


def roll(segmented: xr.Dataset, biased: xr.Dataset, *swing: xr.Dataset, **settings) -> Roll | None:
    """View of a roll, with its noise; None where fewer than three segments can be used.

    Parameters
    ----------
    segmented, biased : Dataset, "inertial_sensor.segment" and "inertial_sensor.bias"
    swing : Dataset, "inertial_sensor.scale" and "inertial_sensor.offset", or none
    settings : segment_s s; trend_degree, amplitude_degree, amplitude_harmonics; assumed, as of `bias.bias`
    """
    used = np.flatnonzero(biased["used"].values)
    if used.size < ENOUGH or not np.isfinite(biased["bias"].values).all():
        return None
    used = used[np.unique(np.linspace(0, used.size - 1, min(MOST, used.size)).round().astype(int))]
    seen = fitted(segmented, biased, *swing, used=used, **settings)
    return replace(seen, noise=_noise(seen, float(seen.time[0, 1] - seen.time[0, 0])), wander=_wander(biased))


def spans(segmented: xr.Dataset, segment_s: float) -> tuple[float, list[slice]]:
    """Length of a bin, s, and the bins of each segment.

    Parameters
    ----------
    segmented : Dataset, "inertial_sensor.segment"
    segment_s : s
    """
    time = segmented["time"].values
    step = roll_segments.bin_length(time, segment_s)
    return step, roll_segments.cut(time, step, segment_s)


def fitted(segmented: xr.Dataset, biased: xr.Dataset, *swing: xr.Dataset, used, **settings) -> Roll:
    """View of some segments without noise; arguments as of `roll`, `used` their numbers."""
    sensor = sensor_of(swing, settings["assumed"])
    step, parts = spans(segmented, settings["segment_s"])
    model = roll_segments.Model(*(settings[n] for n in ("trend_degree", "amplitude_degree", "amplitude_harmonics")))
    bins = {n: np.stack([segmented[n].values[parts[k]] for k in used]) for n in segmented.variables}
    tensor = np.stack([
        roll_segments.offset_terms(r, g, step) for r, g in zip(bins["rate_b"], bins["gradient_b"], strict=True)
    ])  # fmt: skip
    own = [_designs(R, g, model, step) for R, g in zip(bins["R_bo"], bins["gradient_b"], strict=True)]
    reading, felt = sensor.k * bins["linear_volt"], np.matvec(tensor, sensor.offset)
    both = [_fitted(r - f, d, model.trend_degree + 1) for r, f, d in zip(reading, felt, own, strict=True)]
    slow, turning = (felt + np.stack(part) for part in zip(*both, strict=True))
    angle = bins["R_bo"][:, :, 0, 0], bins["R_bo"][:, :, 0, 2]
    start = np.concatenate([biased["bias"].values, sensor.offset])
    about = (bins["time"], reading, slow, turning - start[:3], tensor, *angle, bins["rate_b"], bins["gradient_b"], own)
    return Roll(*about, [], np.zeros(3), start, sensor.k)


def _designs(R_bo, gradient_b, model, step):
    """Design of each axis of a segment."""
    phase = roll_segments.orbital_phase(gradient_b, step)
    return [roll_segments.design(axis, R_bo, model, phase) for axis in range(3)]


def _fitted(values, designs, trend):
    """Values (b, 3) as their own columns describe them, and as all but the first do, which are the trend."""
    size = [np.linalg.lstsq(d, values[:, a], rcond=None)[0] for a, d in enumerate(designs)]
    whole = [d @ s for d, s in zip(designs, size, strict=True)]
    turning = [d[:, trend:] @ s[trend:] for d, s in zip(designs, size, strict=True)]
    return np.stack(whole, axis=1), np.stack(turning, axis=1)


def _wander(biased):
    """Standard deviation (3,) m s-2 of the constants about a straight line, as large as it may be.

    The bias remembers hours, so that a dozen segments show less of its wander than there is, and more of a slope.
    """
    used = biased["used"].values.astype(bool)
    values, time = biased["segment_bias"].values[used], biased["time_segment"].values[used]
    line = np.stack([np.ones_like(time), time - time.mean()], axis=1)
    rest = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
    seen = np.sum(rest**2, axis=0) / max(time.size - 2, 1) * (1 + ALIKE) / (1 - ALIKE)
    return np.sqrt(np.maximum(seen, np.mean(biased["segment_sigma"].values[used] ** 2, axis=0)))


def _noise(seen, step):
    """Noise of each axis from the residuals of a fit with every form that is tried; sharp lines are no noise."""
    count = seen.time.shape[0]
    forms = np.stack([shape for _, _, shape in series(seen)] + list(np.moveaxis(_squares(seen), 2, 0)), axis=2)
    wide = [[np.concatenate([seen.own[s][a], forms[s]], axis=1) for a in range(3)] for s in range(count)]
    basis = [[np.linalg.svd(d / np.linalg.norm(d, axis=0), full_matrices=False) for d in one] for one in wide]
    basis = [[u[:, s > 1e-6 * s[0]] for u, s, _ in one] for one in basis]

    def clean(segment, index):
        return np.stack([segment[:, a] - q @ (q.T @ segment[:, a]) for a, q in enumerate(basis[index])], axis=1)

    pieces = [clean(one, s) for s, one in enumerate(seen.reading - seen.fitted)]
    pieces, _ = without_lines(pieces, step)
    return fit_detrended(pieces, clean, roll_segments.MEMORY, step)


def _squares(seen):
    """Squares of the readings as fitted (s, b, 3), of a size near one."""
    size = np.abs(seen.steady).max(axis=(0, 1))
    return (seen.steady / size) ** 2


def context(seen: Roll) -> Context:
    """What effects of the sensor look at, all segments one after the other, from the readings as fitted.

    A regressor that holds the wander of the bias would explain it. Drifts count from the middle, so that the bias stays
    that of the middle whether they are taken out or not.

    Parameters
    ----------
    seen : Roll
    """
    flat = lambda values: values.reshape(-1, *values.shape[2:])  # noqa: E731
    force = flat(seen.steady) + seen.start[:3]  # f = b + k V
    extra = {"linear_volt": flat(seen.steady) / seen.k, "displacement_b": -force / electrodes.LOOP**2}
    rate = flat(seen.rate_b)
    still = {"rate_dot_b": np.zeros_like(rate), "angular_b": np.zeros_like(rate)}
    known = {"rate_b": rate, "gradient_b": flat(seen.gradient_b), "linear_b": force} | still
    return Context(flat(seen.time), epoch=float(seen.time.mean()), extra=extra, **known)


def rows(seen: Roll, added: np.ndarray) -> list[np.ndarray]:
    """Whitened rows (3 b + 3, q) of each segment, of what is added to the linear readings; nothing in the last three.

    Parameters
    ----------
    seen : Roll
    added : (s, b, 3, q) m s-2
    """
    whole = np.ones(added.shape[1], dtype=bool)
    nothing = np.zeros((3, added.shape[3]))
    axes = [[noise.whiten(seen.noise[a], np.ascontiguousarray(one[:, a]), whole) for a in range(3)] for one in added]
    return [np.concatenate([*one, nothing]) for one in axes]


def blocks(seen: Roll, *, alone: bool) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Block` of each segment; shared are bias and offset.

    Parameters
    ----------
    seen : Roll
    alone : there is no swing in the search that knows the offset: one block more
    """
    count, bins = seen.time.shape
    felt = np.matvec(seen.tensor, seen.start[3:])
    left = seen.reading - felt + seen.start[:3]
    shared = np.concatenate([np.broadcast_to(-np.eye(3), (count, bins, 3, 3)), seen.tensor], axis=3)
    both = rows(seen, np.concatenate([left[..., None], shared], axis=3))
    found = []
    for s, one in enumerate(both):
        words = {"channel": np.array([CHANNEL] * 3 * bins + [CONSTANT] * 3)}
        words |= {"axis": np.append(np.repeat([0, 1, 2], bins), [0, 1, 2])}
        words |= {"time": np.append(np.tile(seen.time[s], 3), np.full(3, seen.time[s, 0]))}
        words |= {"label": f"roll {s + 1}", "observed": one[:, 0], "shared": one[:, 1:], "own": _own(seen, s)}
        found.append(words | {"local": _steps(seen, s)})
    return [*found, _known(seen)] if alone else found


def _own(seen, index):
    """Whitened own columns of a segment, and the rows that hold its constants."""
    bins, width = seen.time.shape[1], sum(d.shape[1] for d in seen.own[index])
    columns, place = np.zeros((bins, 3, width)), 0
    held = np.zeros((3, width))
    for axis, design in enumerate(seen.own[index]):
        columns[:, axis, place : place + design.shape[1]] = design
        held[axis, place] = 1 / seen.wander[axis]
        place += design.shape[1]
    (found,) = rows(seen, columns[None])
    found[-3:] = held
    return found


def _steps(seen, index):
    """Steps of the linear readings at the epochs that are searched, {epoch: whitened rows (3 b + 3, 3)}."""
    time = seen.time[index]
    return steps(seen, index, np.arange(time[0] + EDGE_S, time[-1] - EDGE_S, STEP_EVERY_S))


def steps(seen: Roll, index: int, epochs: np.ndarray) -> dict[float, np.ndarray]:
    """Whitened rows (3 b + 3, 3) of a step of the linear readings at each of some epochs.

    Parameters
    ----------
    seen : Roll; index : of the segment; epochs : (k,) s
    """
    time = seen.time[index]
    width = time[1] - time[0]
    shapes = np.clip((time[:, None] + width / 2 - epochs) / width, 0, 1)
    added = np.einsum("bk,ac->bakc", shapes, np.eye(3)).reshape(time.size, 3, -1)
    (found,) = rows(seen, added[None])
    return {float(t): found[:, 3 * k : 3 * k + 3] for k, t in enumerate(epochs)}


def _known(seen):
    """Block of what is known of an assumed offset, which may be that of another year: little."""
    nothing = {"observed": np.zeros(3), "own": np.zeros((3, 0)), "local": {}}
    words = {"label": "offset", "channel": np.array(["offset"] * 3), "axis": np.arange(3)}
    shared = np.hstack([np.zeros((3, 3)), np.eye(3) / UNKNOWN_M])
    return words | nothing | {"time": np.full(3, seen.time[0, 0]), "shared": shared}


def series(seen: Roll) -> list[tuple[str, str, np.ndarray]]:
    """Driver, form and values (s, b) 1 of what the readings may follow, each of a size near one.

    Parameters
    ----------
    seen : Roll
    """
    c, s = seen.cosine, seen.sine
    found = [("attitude", "cosine of the roll angle", c), ("attitude", "sine of the roll angle", s)]
    turn = c + 1j * s
    for n, name in ((2, "twice"), (3, "three times")):
        found.append(("attitude", f"cosine of {name} the roll angle", (turn**n).real))
        found.append(("attitude", f"sine of {name} the roll angle", (turn**n).imag))
    rate = seen.rate_b[:, :, 1] - seen.rate_b[:, :, 1].mean()
    rate = rate / max(np.abs(rate).max(), 1e-30)
    found += [("rate", "component y", rate), ("rate", "square of y", rate**2)]
    return found
