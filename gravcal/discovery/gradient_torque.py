"""Discovery in a day of S-GRS: the view, the rounds, and what is kept of them."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from gravcal.calibrations.gradient_torque import discovery_candidates as listed
from gravcal.calibrations.gradient_torque.discovery_reading import reading
from gravcal.calibrations.gradient_torque.discovery_view import CHANNELS, PARAMETERS, View, blocks, places, view
from gravcal.discovery import attribution, product
from gravcal.discovery.attribution import ROUNDING, UNSEEN
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.model_average import named_parameters, widened
from gravcal.discovery.problem import Problem, baseline_of, random_source
from gravcal.discovery.product import summary
from gravcal.discovery.rounds import Choice, search
from gravcal.effects.entries import determined
from gravcal.effects.gradient import EFFECTS

SEARCH = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed")
BIASED = 0.1  # of the error of the drag, from which a bias is worth a word


def discover(observed: xr.Dataset, modelled: xr.Dataset, found: xr.Dataset, **settings) -> xr.Dataset:
    """What the model of a day gets wrong, and why.

    Parameters
    ----------
    observed, modelled, found : Dataset, "ingest", "gradient_torque.gradient", "gradient_torque.drag" by one sensor
    settings : of `discovery_view.view`, with discovery_level, tie_chi2, round_limit, segment_s, discovery_seed

    Returns
    -------
    found : Dataset, "gradient_torque.discovery"; attribute `numbers` holds the summary as JSON
    """
    return product.dataset(*_searched((observed, modelled, found), (), settings))


def discover_again(observed, modelled, found, first, **settings) -> xr.Dataset:
    """The search anew in records without what was found, whose noise it was part of.

    The effects are added to the rows again in their linear form, so that the search finds them whole, with their errors
    by the noise that is left. What describes the record worse than the first search is not taken.

    Parameters
    ----------
    observed, modelled, found : Dataset, of the records without the effects that were found
    first : Dataset, "gradient_torque.discovery"
    settings : as of `discover`

    Returns
    -------
    found : Dataset, "gradient_torque.discovery"
    """
    numbers = json.loads(first.attrs["numbers"])
    if not numbers["findings"]:
        return first
    result, again, *rest = _searched((observed, modelled, found), numbers["findings"], settings)
    if not again["adequate_after"] and again["p_after"] < numbers["p_after"]:
        return first
    again |= {name: numbers[name] for name in ("adequate_before", "p_before", "tried")}
    return product.dataset(result, again, *rest).assign_attrs(rebuilt="yes")


def _searched(given, model, settings):
    """Result of a search, its numbers, names of the channels, and the reading that the extension helps most."""
    seen = view(*given, **{n: v for n, v in settings.items() if n not in SEARCH})
    rows, tried = blocks(seen), [Candidate(**c) for c in listed.candidates(seen)]
    rows = [Block(**_with(b, k, tried, model)) for k, b in enumerate(rows)]
    limits = (settings["discovery_level"], settings["tie_chi2"], settings["round_limit"])
    order = {"linear": settings["noise_order"], "torque": settings["torque_noise_order"]}
    choice = Choice(*limits, "", {}, segment_s=settings["segment_s"], order=order)
    result = search(rows, tried, choice, random_source(settings["discovery_seed"], rows))
    numbers = summary(widened(result), choice, list(PARAMETERS), "mm", 1e3, np.append(seen.start, np.zeros(6)))
    numbers["calibration_change"] = {n: _reported(v) for n, v in numbers["calibration_change"].items()}
    for position, finding in enumerate(numbers["findings"]):
        finding["model"] = named_parameters(result, position)
    named = {one.cause for one in result.findings}
    numbers["indistinguishable_from_calibration"] += [
        one for one in beside_drag(result.problem, seen) if one["cause"] not in named
    ]
    place = product.clearest(result, ("linear",), choice.level)
    shown = product.variables(result, place, lambda _, k, __: _reading(result, seen, k))
    return result, numbers, CHANNELS, shown


def _with(block, number, tried, model):
    """Block with the effects of a model added to what was observed."""
    added = np.zeros(block["observed"].size)
    for entry in model:
        for one in tried:
            columns = one.columns[number] if (one.cause, one.form) == (entry["cause"], entry["form"]) else None
            if columns is not None:
                known = determined(entry)
                added += columns @ np.array([known.get(name, 0.0) for name in one.names])
    return block | {"observed": block["observed"] + added}


def _reading(result, seen, index):
    """Time, model and rows of a block in the unit of the reading; the noise remembers what was before the block."""
    part = [place["linear"] for place in places(seen)]
    rows = np.zeros((sum(p.size for p in part), 3))
    for k, place in enumerate(part):
        here = result.problem.blocks[k].channel == "linear"
        both = (result.problem.blocks[k].observed, result.before.rest[k], result.after.rest[k])
        rows[place] = np.stack(both, axis=1)[here]
    time, model, columns = reading(seen, rows)
    inside = np.unique(part[index] % time.size)
    return time[inside], model[inside], columns[:, inside]


def _reported(values):
    """Entries of the centre of pressure, without those of the constant torque and the distance of the sensors."""
    count = len(PARAMETERS)
    if not isinstance(values, list):
        return values
    return [row[:count] if isinstance(row, list) else row for row in values[:count]]


def beside_drag(problem: Problem, seen: View) -> list[dict]:
    """Listed effects on the readings that no difference shows at a plausible size, with the bias of the drag.

    Parameters
    ----------
    problem : Problem
    seen : View
    """
    gram = attribution.projected(problem.total, baseline_of(problem, ()))
    rows = []
    for entry in (one for one in EFFECTS if one.channel == "linear_each_b"):
        felt = entry.columns(seen.fine).mean(axis=1)
        for k, parameter in enumerate(entry.parameters):
            name = entry.slug if len(entry.parameters) == 1 else parameter.name
            ratio = parameter.prior_sigma * np.sqrt(_seen(problem, gram, entry.slug, name))
            bias = parameter.prior_sigma * felt[:, :, k]
            size = float(np.sqrt(np.mean(bias**2))) / seen.drag_sigma
            if ratio < UNSEEN and size > BIASED:
                one = {"cause": entry.slug, "direction": {parameter.name: 1.0}, "signal_to_noise": float(ratio)}
                drag = {"drag_bias_m_s2": np.sqrt(np.mean(bias**2, axis=0)).tolist()}
                rows.append(one | {"bias": [0.0] * len(PARAMETERS), "bias_in_sigma": size} | drag)
    return rows


def _seen(problem, gram, cause, name):
    """Square of the signal-to-noise ratio of one parameter at unit size, all baseline parameters free."""
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        if candidate.cause == cause and (candidate.form == f"{name} alone" or len(candidate.names) == 1):
            left, whole = (float(products[place.start, place.start]) for products in (gram, problem.total))
            return left if left > ROUNDING * whole else 0.0
    return 0.0
