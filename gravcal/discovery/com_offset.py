"""Discovery in a centre-of-mass calibration: the event's view, the rounds, and what is kept of them."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.discovery_candidates import DAMPING, MODES_HZ, candidates
from gravcal.calibrations.com_offset.discovery_event import event
from gravcal.calibrations.com_offset.discovery_scene import offset_of
from gravcal.calibrations.com_offset.discovery_view import CHANNELS
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.rounds import Choice, search
from gravcal.discovery.schemas import DISCOVERY
from gravcal.discovery.summary import summary

MODE_STEP_HZ = float(np.diff(MODES_HZ).mean())
#: A line or a step that is found along the frequency or time axis, by channel.
STEP = "accelerometer.bias_step"
TONES = {"linear": "accelerometer.stray_tone", "angular": "unknown:time"}


def discover(aligned, field, smoothed, solved, **settings) -> xr.Dataset:
    """What the model of an event gets wrong, and why.

    Parameters
    ----------
    aligned, field, smoothed, solved : Dataset, products of com_offset, solved with variant mtq
    settings : of the stages attitude, noise and solve, with inertia, dipole_per_current, linear_drift_degree,
        angular_drift_degree, mass, discovery_level, tie_chi2, round_limit, segment_s, discovery_seed

    Returns
    -------
    found : Dataset, "com_offset.discovery"; attribute `numbers` holds the summary as JSON
    """
    if not aligned.sizes["manoeuvre"]:
        return _nothing()
    views, blocks, quiet = event(aligned, field, smoothed, solved, **settings)
    found = candidates(views, smoothed, aligned["start"].values)
    limits = (settings["discovery_level"], settings["tie_chi2"], settings["round_limit"])
    choice = Choice(*limits, STEP, TONES, segment_s=settings["segment_s"], quiet=quiet)
    made = [Block(**b) for b in blocks], [Candidate(**c) for c in found]
    result = search(*made, choice, np.random.default_rng(settings["discovery_seed"]))
    numbers = summary(result, choice, ["x", "y", "z"], "um", 1e6, offset_of(solved))
    for finding in numbers["findings"]:
        _physical(finding, views)
    return dataset(result, numbers)


def _nothing():
    """Product of a record without manoeuvre."""
    values = {name: [] for name in DISCOVERY}
    return build(DISCOVERY, values, numbers=json.dumps({"status": "no_manoeuvre"}), channels="", blocks="")


def _physical(finding, views):
    """Parameters as the effect of the catalogue has them, in place."""
    cause, parameters = finding["cause"], finding["parameters"]
    if cause == "torque.saturation":  # found as the dipole that is missing at full current
        full = max(float(np.abs(v.context.dipole_b).max()) for v in views)
        parameters["limit"]["value"] = full - parameters["limit"]["value"]
    if cause == "accelerometer.flexible_mode":
        frequency = float(finding["form"].split()[0])
        parameters["frequency"] = {"value": frequency, "sigma": MODE_STEP_HZ / np.sqrt(12), "unit": "Hz"}
        parameters["damping"] = {"value": DAMPING, "sigma": np.nan, "unit": "1"}
    if "frequency" in parameters and cause in TONES.values():
        finding["parameters"] = _amplitudes(finding, views)


def _amplitudes(finding, views):
    """Amplitude on each axis of a line: rms over the manoeuvres, its whitened size over that of a unit sine."""
    parameters, channel = finding["parameters"], finding["form"].split()[0]
    frequency = parameters["frequency"]["value"]
    unit = {"linear": "m s-2", "angular": "rad s-2"}[channel]
    found = {"frequency": parameters["frequency"]}
    for axis, letter in enumerate("xyz"):
        names = [(f"cosine_{letter}_{i}", f"sine_{letter}_{i}", v) for i, v in enumerate(views)]
        pairs = [(a, b, v) for a, b, v in names if a in parameters and b in parameters]
        sizes = [_size_of(v, channel, axis, frequency) for _, _, v in pairs]
        values = [parameters[n]["value"] ** 2 for a, b, _ in pairs for n in (a, b)]
        errors = [parameters[n]["sigma"] ** 2 for a, b, _ in pairs for n in (a, b)]
        if pairs:
            square = (np.sum(values) - np.sum(errors)) / np.sum(np.square(sizes))
            error = np.sqrt(np.mean(errors) / np.sum(np.square(sizes)))
            found[letter] = {"value": float(np.sqrt(max(square, 0.0))), "sigma": float(error), "unit": unit}
    return found


def _size_of(view, channel, axis, frequency):
    """Whitened amplitude of a sine of unit amplitude on one axis."""
    signal = np.zeros((view.scene.time.size, 3, 1))
    signal[:, axis, 0] = np.sqrt(2) * np.sin(2 * np.pi * frequency * view.scene.time)
    rows = view.rows({channel: signal})[:, 0]
    return float(np.sqrt(np.mean(rows[rows != 0] ** 2)))


def dataset(result, numbers: dict) -> xr.Dataset:
    """Product of a search: residuals before and after, adequacy, and the numbers.

    Parameters
    ----------
    result : rounds.Result
    numbers : of `summary.summary`
    """
    blocks, before, after = result.problem.blocks, result.before, result.after
    rows = before.rows
    names = list(dict.fromkeys([*CHANNELS, *(str(c) for b in blocks for c in b.channel)]))
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
    return build(DISCOVERY, values, numbers=text, channels=" ".join(names), blocks=", ".join(labels))


def _known(value):
    """NaN and infinity become null."""
    if isinstance(value, dict):
        return {k: _known(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_known(v) for v in value]
    if isinstance(value, (np.floating, float)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
