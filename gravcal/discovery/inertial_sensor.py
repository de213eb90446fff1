"""Discovery in a swing of an inertial sensor: the view, the rounds, and what is kept of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import discovery_candidates as listed
from gravcal.calibrations.inertial_sensor.discovery_reading import reading
from gravcal.calibrations.inertial_sensor.discovery_view import CHANNELS, PARAMETERS, View, blocks, view
from gravcal.discovery import attribution, epochs, products, readings, residuals
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.lines import amplitude, lines
from gravcal.discovery.problem import baseline_of
from gravcal.discovery.rounds import Choice, search
from gravcal.discovery.summary import summary
from gravcal.discovery.widening import named_parameters, widened

SEARCH = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed")
PRODUCTS = 3  # of a swing
#: Of the reported parameters: 1e-6 rad s-2 V-1, ms, um.
SCALE = np.array([1e6, 1e6, 1e3, 1e6, 1e6, 1e6])
UNIT = "1e-6 rad s-2 V-1, ms, um"
#: Epochs round that of the search at which a step is looked for again, s.
FINE_S = np.linspace(-listed.STEP_S, listed.STEP_S, 21)


def discover(*swing: xr.Dataset, **settings) -> xr.Dataset:
    """What the model of a swing gets wrong, and why.

    Parameters
    ----------
    *swing : Dataset, "inertial_sensor.align", "inertial_sensor.scale" and "inertial_sensor.offset"; another number of
        them stands for a record without swing
    settings : of `discovery_view.view`, with discovery_level, tie_chi2, round_limit, segment_s, discovery_seed

    Returns
    -------
    found : Dataset, "inertial_sensor.discovery"; attribute `numbers` holds the summary as JSON
    """
    if len(swing) != PRODUCTS:
        return products.nothing()
    own = {name: value for name, value in settings.items() if name not in SEARCH}
    seen = view(*swing, **own)
    rows, tried = made(seen)
    limits = (settings["discovery_level"], settings["tie_chi2"], settings["round_limit"])
    choice = Choice(*limits, listed.STEP, {}, segment_s=settings["segment_s"], quiet=seen.quiet)
    result, waves = searched(rows, tried, choice, settings["discovery_seed"], seen)
    numbers = summary(_reported(widened(result)), choice, list(PARAMETERS), UNIT, 1.0, SCALE * seen.start)
    for position, finding in enumerate(numbers["findings"]):
        if finding["form"] in waves:
            found = amplitude(waves[finding["form"]], finding["parameters"])
            axis = finding["form"].split(",")[0][-1]
            finding["parameters"] = {"frequency": found["frequency"], axis: found["amplitude"]}
        _physical(finding, position, result)
    for one in numbers["indistinguishable_from_calibration"]:
        one["bias"] = (SCALE * np.array(one["bias"])).tolist()
    whole = _joined(result)
    place = readings.clearest(whole, CHANNELS, choice.level)
    place = place if place and place[0] == "linear" else None
    shown = readings.variables(whole, place, lambda *given: reading(seen, given[-1]))
    return products.dataset(whole, epochs.plain(numbers), CHANNELS, shown)


def searched(rows: list[Block], tried: list[Candidate], choice: Choice, seed: int, seen: View) -> tuple:
    """Result of the rounds and lines by their form: rounds, tones in what is left, rounds with these beside all others.

    Steps are looked for again round the epochs found, so that what an epoch half a spacing off leaves gets no name.

    Parameters
    ----------
    rows, tried : blocks and candidates
    choice : Choice without lines
    seed : of the draws of noise
    seen : View
    """
    result = search(rows, tried, choice, residuals.source(seed, rows))
    groups, found = [0] * len(rows), []
    for axis in range(3):
        wave = listed.waves(seen, axis)
        found += lines(result, ("linear", axis), wave, groups, (listed.TONE, "m s-2", choice.level))
    broken = [epochs.of(one.form) for one in result.findings if one.cause.startswith(listed.STEP)]
    if found or broken:
        fine = [c for epoch in broken for c in _steps_at(seen, epoch + FINE_S)]
        more = [*tried, *fine, *(one.candidate for one in found)]
        result = search(rows, more, choice, residuals.source(seed, rows))
    return result, {one.candidate.form: one for one in found}


def made(seen: View) -> tuple[list[Block], list[Candidate]]:
    """Blocks and candidates of a view.

    Parameters
    ----------
    seen : View
    """
    tried = [epochs.each_its_own(Candidate(**c), listed.STEP) for c in listed.candidates(seen)]
    return [Block(**b) for b in blocks(seen)], tried


def _steps_at(seen, at):
    return [epochs.each_its_own(Candidate(**c), listed.STEP) for c in listed.steps(seen, at)]


def _reported(result):
    """Result whose shared parameters are the reported ones, in the units they are reported in."""
    count = SCALE.size
    cut = {n: tuple(SCALE * part[:count] for part in getattr(result, n)) for n in ("shared", "sigma")}
    both = tuple(np.outer(SCALE, SCALE) * part[:count, :count] for part in result.covariance)
    return replace(result, **cut, covariance=both)


def _physical(finding, position, result):
    """Parameters as the effect of the catalogue has them, in place."""
    if not np.isfinite(result.findings[position].value).any():
        finding["parameters"] = named_parameters(result, position)
    if finding["cause"].startswith(listed.STEP):
        finding["parameters"]["time"] = _epoch(result, position)
    finding["heldout"] = "blocks"  # even and odd stretches


def _epoch(result, position):
    """Epoch of a step: mean and spread under the likelihood of the epochs that were tried near it."""
    problem, index = result.problem, result.findings[position].index
    others = [one.index for k, one in enumerate(result.findings) if k != position]
    gram = attribution.projected(problem.total, baseline_of(problem, others))
    middle = epochs.of(problem.candidates[index].form)
    steps = [k for k, one in enumerate(problem.candidates) if one.cause.startswith(listed.STEP)]
    near = {epochs.of(problem.candidates[k].form): k for k in steps}
    near = {at: k for at, k in sorted(near.items()) if abs(at - middle) <= listed.STEP_S}
    at = np.array(list(near))
    gain = np.array([attribution.ratio(gram, problem.places[k], problem.size).gain for k in near.values()])
    weight = np.exp((gain - gain.max()) / 2) * np.gradient(at) if at.size > 1 else np.ones(1)
    mean = float(weight @ at / weight.sum())
    spacing = float(np.diff(at).min()) if at.size > 1 else listed.STEP_S
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
