"""Discovery in a centre-of-mass calibration: the event's view, the rounds, and what is kept of them."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_lag, discovery_tones
from gravcal.calibrations.com_offset.discovery_again import with_model
from gravcal.calibrations.com_offset.discovery_candidates import candidates
from gravcal.calibrations.com_offset.discovery_event import event
from gravcal.calibrations.com_offset.discovery_reading import reading
from gravcal.calibrations.com_offset.discovery_scene import offset_of
from gravcal.calibrations.com_offset.discovery_view import CHANNELS
from gravcal.discovery import products, readings, residuals
from gravcal.discovery.blocks import Block, Candidate, Shape
from gravcal.discovery.model_average import named_parameters, with_ties
from gravcal.discovery.rounds import Choice, search
from gravcal.discovery.summary import summary

LARGE = 400.0  # chi-square of an effect whose second order may be seen
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
        return products.nothing()
    result, numbers, shown = _searched(aligned, field, smoothed, solved, (), settings)
    return products.dataset(result, numbers, CHANNELS, shown)


def discover_again(aligned, field, smoothed, solved, first, **settings) -> xr.Dataset:
    """The search anew, round the extended model that a first search has found.

    What was found is left as it is where a single cause of less than 20 sigma that moves no tag describes the data, and
    where the search anew describes them worse.

    Parameters
    ----------
    aligned, field, smoothed, solved : Dataset, of the records without the effects that were found
    first : Dataset, "com_offset.discovery"
    settings : as of `discover`

    Returns
    -------
    found : Dataset, "com_offset.discovery"
    """
    numbers = json.loads(first.attrs["numbers"])
    if not _worth_another(numbers):
        return first
    result, again, shown = _searched(aligned, field, smoothed, solved, numbers["findings"], settings)
    if not again["adequate_after"] and again["p_after"] < numbers["p_after"]:
        return first
    again |= {name: numbers[name] for name in ("adequate_before", "p_before", "tried")}
    return products.dataset(result, again, CHANNELS, shown).assign_attrs(rebuilt="yes")


def _worth_another(numbers):
    """Whether the effects are so large, or so many, that their second order may matter."""
    findings = numbers.get("findings", [])
    if len(findings) != 1:
        return bool(findings)
    (found,) = findings
    large = found["heldout_gain"]["in_sample_chi2"] > LARGE
    return large or found["cause"].startswith("timing.") or not numbers["adequate_after"]


def _searched(aligned, field, smoothed, solved, model, settings):
    """Result of a search, its numbers, and the reading that it helps most."""
    views, blocks, quiet = event(aligned, field, smoothed, solved, **settings)
    starts = aligned["start"].values
    blocks = with_model(blocks, views, smoothed, starts, model) if model else blocks
    found = candidates(views, smoothed, starts)
    limits = (settings["discovery_level"], settings["tie_chi2"], settings["round_limit"])
    order = dict.fromkeys(("linear", "angular"), settings["noise_order"])
    order["magnetometer"] = settings["attitude_noise_order"]
    choice = Choice(*limits, STEP, TONES, segment_s=settings["segment_s"], quiet=quiet, order=order)
    made = [Block(**b) for b in blocks], [_candidate(**c) for c in found]
    result = search(*made, choice, residuals.source(settings["discovery_seed"], made[0]))
    numbers = summary(with_ties(result), choice, ["x", "y", "z"], "um", 1e6, offset_of(solved))
    for position, finding in enumerate(numbers["findings"]):
        where = {n: p for n, p in finding["parameters"].items() if n in ("time", "frequency")}
        finding["model"] = named_parameters(result, position) | where
        shape = result.problem.candidates[result.findings[position].index].shape
        _physical(finding, views, made[0], shape)
        if shape is not None and shape.chosen is not None:
            finding["leads"] = discovery_lag.leads(views, shape.chosen)
    place = readings.clearest(result, CHANNELS, choice.level)
    return result, numbers, readings.variables(result, place, lambda name, k, rows: reading(views[k], name, rows))


def _candidate(shape=None, **fields):
    """Candidate of its fields."""
    return Candidate(**fields, shape=shape and Shape(**shape))


def _physical(finding, views, blocks, shape):
    """Parameters as the effect of the catalogue has them, in place."""
    cause = finding["cause"]
    if "frequency" in finding["parameters"] and cause in TONES.values():
        finding["waves"] = discovery_tones.waves(finding, views, blocks)
        finding["parameters"] = finding["model"] = _amplitudes(finding, views)
    for parameters in (finding["parameters"], finding["model"]):
        if cause == "torque.saturation":  # found as the dipole that is missing at full current
            full = max(float(np.abs(v.context.dipole_b).max()) for v in views)
            parameters["limit"]["value"] = full - parameters["limit"]["value"]
        if shape is not None:
            errors = np.sqrt(np.diag(shape.covariance)) if shape.covariance is not None else shape.value * np.nan
            rows = zip(shape.names, shape.value.tolist(), errors.tolist(), shape.units, strict=True)
            parameters |= {n: {"value": v, "sigma": s, "unit": u} for n, v, s, u in rows}


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
