"""Discovery in a ranging calibration: the view of its sub-manoeuvres, the rounds, and what is kept of them."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import discovery_candidates as listed
from gravcal.calibrations.kbr_phase_centre.discovery_noise import with_pointing
from gravcal.calibrations.kbr_phase_centre.discovery_view import View, blocks, factors, reading, view, white
from gravcal.calibrations.kbr_phase_centre.schemas import PARAMETERS
from gravcal.discovery import epochs, products, readings, residuals
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.lines import amplitude, lines
from gravcal.discovery.model_average import named_parameters, widened
from gravcal.discovery.rounds import Choice, search
from gravcal.discovery.summary import summary

CHANNELS = ("range",)
LINE = "unknown:time"
SEARCH = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed")
#: Epochs round that of the search at which a phase break is looked for again, s.
FINE_S = np.arange(-40.0, 41.0, 2.0)


def discover(aligned, pointed, equations, measured, solved, **settings) -> xr.Dataset:
    """What the model of a ranging calibration gets wrong, and why.

    Range, range rate and range acceleration of a product come from one phase; the range stands for all three.

    Parameters
    ----------
    aligned, pointed, equations, measured, solved : Dataset, products of kbr_phase_centre, of the range
    settings : of `discovery_view.view`, with discovery_level, tie_chi2, round_limit, segment_s, discovery_seed

    Returns
    -------
    found : Dataset, "kbr_phase_centre.discovery"; attribute `numbers` holds the summary as JSON
    """
    if not pointed.sizes["manoeuvre"]:
        return products.nothing()
    own = {name: value for name, value in settings.items() if name not in SEARCH}
    seen = view(aligned, pointed, equations, measured, solved, **own)
    rows, tried, quiet, scale = made(seen, measured)
    limits = (settings["discovery_level"], settings["tie_chi2"], settings["round_limit"])
    choice = Choice(*limits, listed.BREAK, {}, segment_s=settings["segment_s"], quiet=quiet)
    result, waves = searched(rows, tried, choice, settings["discovery_seed"], seen, scale)
    numbers = summary(widened(result), choice, list(PARAMETERS), "mm", 1e3, seen.centre)
    for position, finding in enumerate(numbers["findings"]):
        if finding["form"] in waves:
            finding["parameters"] = amplitude(waves[finding["form"]], finding["parameters"])
        _physical(finding, position, result, seen, scale)
        finding["heldout"] = "blocks"  # halves of sub-manoeuvres
    place = readings.clearest(result, CHANNELS, choice.level)
    shown = readings.variables(result, place, lambda _, k, part: reading(seen, k, scale[k] @ part))
    return products.dataset(result, epochs.plain(numbers), CHANNELS, shown)


def searched(rows: list[Block], tried: list[Candidate], choice: Choice, seed: int, seen: View, scale) -> tuple:
    """Result of the rounds and lines by their form: rounds, lines in what is left, rounds with these beside all others.

    Parameters
    ----------
    rows, tried : blocks and candidates
    choice : Choice without lines
    seed : of the draws of noise
    seen : View
    scale : factors of its noise
    """

    def wave(k, frequency):
        phase = 2 * np.pi * frequency * (seen.arcs[k].time - seen.context.epoch)
        return white(scale[k], np.stack([np.cos(phase), np.sin(phase)], axis=1))

    result = search(rows, tried, choice, residuals.source(seed, rows))
    groups = [int(arc.label.split()[0]) - 1 for arc in seen.arcs]
    found = lines(result, ("range", -1), wave, groups, (LINE, "m", choice.level))
    broken = [k for k, one in enumerate(result.findings) if one.cause.startswith(listed.BREAK)]
    if found or broken:  # breaks again at the epochs that the data ask for, so that no rest is taken for another
        refined = [_break(result.findings[k], result, seen, scale)["time"]["value"] for k in broken]
        more = [*tried, *(one.candidate for one in found)]
        more += [c for epoch in refined for c in _breaks_at(seen, scale, np.array([epoch]))]
        result = search(rows, more, choice, residuals.source(seed, rows))
    return result, {one.candidate.form: one for one in found}


def made(seen: View, measured: xr.Dataset) -> tuple[list[Block], list[Candidate], dict, list[np.ndarray]]:
    """Blocks and candidates of a view, how well the noise is known, and the factors of the noise.

    Parameters
    ----------
    seen : View
    measured : Dataset, "kbr_phase_centre.noise"
    """
    shapes = listed.shapes(seen)
    columns = listed.table(seen, shapes)
    known = sum(len(s["names"]) for s in shapes if not s["cause"].startswith("unknown:"))
    scale = factors(seen, with_pointing(seen, measured, columns[:, :known]))
    rows = [Block(**b) for b in blocks(seen, scale)]
    tried = [epochs.each_its_own(Candidate(**c), listed.BREAK) for c in listed.candidates(seen, scale, shapes, columns)]
    return rows, tried, {"range": _known(seen, measured)}, scale


def _breaks_at(seen, scale, wanted):
    return [epochs.each_its_own(Candidate(**c), listed.BREAK) for c in listed.breaks(seen, scale, wanted)]


def _known(seen, measured):
    """Samples that the noise is known from: quiet ones for ranging, those of the manoeuvres for star cameras."""
    inside = seen.residual.size
    quiet = float(measured["seconds"]) / seen.step_s if measured.attrs["source_data"] == "quiet" else inside
    return 1 / (1 / max(quiet, 1.0) + 1 / max(inside, 1))


def _physical(finding, position, result, seen, scale):
    """Parameters as the effect of the catalogue has them, in place; those of the form named if others blur all."""
    one = result.findings[position]
    if not np.isfinite(one.value).any():
        finding["parameters"] = named_parameters(result, position)
    if finding["cause"].startswith(listed.BREAK):
        finding["parameters"] = _break(one, result, seen, scale)


def _break(one, result, seen, scale):
    """Size and epoch of a phase break, on a finer grid than that of the search."""
    columns = result.problem.candidates[one.index].columns
    tried, middle = epochs.of(one.form) + FINE_S, int(np.argmin(np.abs(FINE_S)))
    size, right = np.zeros(tried.size), np.zeros(tried.size)
    for k in (i for i, c in enumerate(columns) if c is not None):
        basis = result.problem.bases[k]
        shapes = white(scale[k], listed.steps(seen, seen.arcs[k], tried))
        shapes = shapes - basis @ (basis.T @ shapes)
        size += np.einsum("nk,nk->k", shapes, shapes)
        right += shapes.T @ (result.after.rest[k] + shapes[:, middle] * one.value[0])
    value = right / np.maximum(size, 1e-300)
    weight = np.exp((value**2 * size - np.max(value**2 * size)) / 2)
    weight = weight / weight.sum()
    best, at = int(np.argmax(weight)), float(weight @ tried)
    spread = float(np.sqrt(weight @ (tried - at) ** 2 + (FINE_S[1] - FINE_S[0]) ** 2 / 12))
    sigma = max(float(one.sigma[0]), 1 / float(np.sqrt(size[best])))
    found = {"size": {"value": float(value[best]), "sigma": sigma, "unit": "m"}}
    return found | {"time": {"value": at, "sigma": spread, "unit": "s"}}
