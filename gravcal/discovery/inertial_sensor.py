"""Discovery in a swing and a roll of an inertial sensor: the views, the rounds, and what is kept of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import discovery_candidates as listed
from gravcal.calibrations.inertial_sensor.discovery_roll import CHANNEL as ROLL
from gravcal.calibrations.inertial_sensor.discovery_roll import roll
from gravcal.calibrations.inertial_sensor.discovery_view import view
from gravcal.discovery import attribution, epochs, inertial_sensor_parts, products, readings, residuals
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.inertial_sensor_parts import Parts, made, parts_of
from gravcal.discovery.lines import amplitude, lines
from gravcal.discovery.model_average import named_parameters, widened
from gravcal.discovery.problem import baseline_of
from gravcal.discovery.rounds import Choice, search
from gravcal.discovery.summary import summary

SWING = ("align", "scale", "offset")
#: Epochs round that of the search at which a step is looked for again, in spacings of the search.
NEAR = np.linspace(-1.0, 1.0, 21)


def discover(*given: xr.Dataset, parts, scene, rolling, segment_s, discovery_seed, **limits) -> xr.Dataset:
    """What the model of a swing and of a roll gets wrong, and why.

    Parameters
    ----------
    *given : Dataset; parts : their names: "align", "scale" and "offset" of a swing, "segment" and "bias" of a roll
    scene : of `discovery_view.view`; rolling : of `discovery_roll.roll`
    segment_s : s, stretch left out; discovery_seed : of the draws of noise
    limits : discovery_level, tie_chi2, round_limit

    Returns
    -------
    found : Dataset, "inertial_sensor.discovery"; attribute `numbers` holds the summary as JSON
    """
    seen = _seen(dict(zip(parts, given, strict=True)), scene, rolling)
    if seen is None:
        return products.nothing()
    rows, tried = made(seen)
    order = (limits["discovery_level"], limits["tie_chi2"], limits["round_limit"])
    choice = Choice(*order, listed.STEP, {}, segment_s=segment_s, quiet=seen.quiet)
    result, waves = searched(rows, tried, choice, discovery_seed, seen)
    reported, start = _reported(widened(result), seen), seen.scale * seen.start
    numbers = summary(reported, choice, list(seen.names), seen.unit, 1.0, start)
    for position, finding in enumerate(numbers["findings"]):
        if finding["form"] in waves:
            found = amplitude(waves[finding["form"]], finding["parameters"])
            axis = finding["form"].split(",")[0][-1]
            finding["parameters"] = {"frequency": found["frequency"], axis: found["amplitude"]}
        _physical(finding, position, result, seen)
    for one in numbers["indistinguishable_from_calibration"]:
        one["bias"] = (seen.scale * np.array(one["bias"])).tolist()
    whole = _joined(result)
    place = readings.clearest(whole, ("linear", ROLL), choice.level)
    told = lambda channel, k, part: inertial_sensor_parts.shown(seen, whole.problem.blocks[k], channel, part)  # noqa: E731
    return products.dataset(whole, epochs.plain(numbers), seen.channels, readings.variables(whole, place, told))


def _seen(given, scene, rolling):
    """Views of what was recorded, None without swing and roll."""
    swing = [given[name] for name in SWING if name in given]
    turned = view(*swing, **scene) if len(swing) == len(SWING) else None
    known = [given[name] for name in SWING[1:] if name in given]
    rolled = roll(given["segment"], given["bias"], *known, **rolling) if "bias" in given else None
    return parts_of(turned, rolled) if turned or rolled else None


def searched(rows: list[Block], tried: list[Candidate], choice: Choice, seed: int, seen: Parts) -> tuple:
    """Result of the rounds and lines by their form: rounds, tones in what is left, rounds with these beside all others.

    Steps are looked for again round the epochs found, so that what an epoch half a spacing off leaves gets no name.

    Parameters
    ----------
    rows, tried : blocks and candidates
    choice : Choice without lines
    seed : of the draws of noise
    seen : Parts
    """
    result = search(rows, tried, choice, residuals.source(seed, rows))
    groups, found = inertial_sensor_parts.groups(rows), []
    for channel in [c for c in ("linear", ROLL) if c in seen.channels]:
        for axis in range(3):
            wave = inertial_sensor_parts.waves(seen, rows, channel, axis)
            found += lines(result, (channel, axis), wave, groups, (listed.TONE, "m s-2", choice.level))
    broken = [epochs.of(one.form) for one in result.findings if one.cause.startswith(listed.STEP)]
    if found or broken:
        fine = [c for epoch in broken for c in inertial_sensor_parts.steps(seen, rows, epoch, NEAR)]
        more = [*tried, *fine, *(one.candidate for one in found)]
        result = search(rows, more, choice, residuals.source(seed, rows))
    return result, {one.candidate.form: one for one in found}


def _reported(result, seen):
    """Result whose shared parameters are the reported ones, in the units they are reported in."""
    scale, count = seen.scale, seen.scale.size
    cut = {n: tuple(scale * part[:count] for part in getattr(result, n)) for n in ("shared", "sigma")}
    both = tuple(np.outer(scale, scale) * part[:count, :count] for part in result.covariance)
    return replace(result, **cut, covariance=both)


def _physical(finding, position, result, seen):
    """Parameters as the effect of the catalogue has them, in place."""
    if not np.isfinite(result.findings[position].value).any():
        finding["parameters"] = named_parameters(result, position)
    if finding["cause"].startswith(f"{listed.STEP}@"):
        finding["parameters"]["time"] = _epoch(result, position, seen)
    finding["heldout"] = "blocks"  # even and odd stretches


def _epoch(result, position, seen):
    """Epoch of a step: mean and spread under the likelihood of the epochs that were tried near it."""
    problem, index = result.problem, result.findings[position].index
    others = [one.index for k, one in enumerate(result.findings) if k != position]
    gram = attribution.projected(problem.total, baseline_of(problem, others))
    middle = epochs.of(problem.candidates[index].form)
    width = inertial_sensor_parts.spacing(seen, middle)
    steps = [k for k, one in enumerate(problem.candidates) if one.cause.startswith(f"{listed.STEP}@")]
    near = {epochs.of(problem.candidates[k].form): k for k in steps}
    near = {at: k for at, k in sorted(near.items()) if abs(at - middle) <= width}
    at = np.array(list(near))
    gain = np.array([attribution.ratio(gram, problem.places[k], problem.size).gain for k in near.values()])
    weight = np.exp((gain - gain.max()) / 2) * np.gradient(at) if at.size > 1 else np.ones(1)
    mean = float(weight @ at / weight.sum())
    spacing = float(np.diff(at).min()) if at.size > 1 else width
    spread = float(np.sqrt(weight @ (at - mean) ** 2 / weight.sum() + spacing**2 / 12))
    return {"value": mean, "sigma": spread, "unit": "s"}


def _joined(result):
    """Result with the even and the odd stretches of each channel as one block, for the product."""
    groups, parts = {}, result.problem.blocks
    for k, block in enumerate(parts):
        groups.setdefault(block.label.split()[0], []).append(k)
    blocks, before, after = [], [], []
    for name, members in groups.items():
        whole = {n: np.concatenate([getattr(parts[k], n) for k in members]) for n in ("observed", "channel", "axis")}
        time = np.concatenate([parts[k].time for k in members])
        order = np.lexsort((time, whole["axis"]))
        nothing = np.zeros((time.size, 0))
        rows = {n: values[order] for n, values in whole.items()} | {"time": time[order]}
        blocks.append(Block(name, shared=nothing, own=nothing, **rows))
        for rest, test in ((before, result.before), (after, result.after)):
            rest.append(np.concatenate([test.rest[k] for k in members])[order])
    tests = [
        replace(test, rest=rest, rows=[r | {"block": r["block"].split()[0]} for r in test.rows])
        for test, rest in ((result.before, before), (result.after, after))
    ]
    return replace(result, problem=replace(result.problem, blocks=blocks), before=tests[0], after=tests[1])
