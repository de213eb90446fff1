"""One discovery for all calibrations: search, lines and epochs a second time, averaged covariance; what it delivers.

A calibration hands over `gravcal.estimation.records.Observations`; nothing here knows which one it is.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import xarray as xr

from gravcal.discovery import DISCOVERY, attribution
from gravcal.discovery.attribution import ROUNDING, UNSEEN, beside_calibration
from gravcal.discovery.limits import detection_limits
from gravcal.discovery.model_average import delivered, named_parameters
from gravcal.discovery.problem import (
    Problem,
    baseline_of,
    inverse_of_baseline,
    observed_rows,
    random_source,
    residuals_of,
    root_of,
)
from gravcal.discovery.rounds import Choice, Finding, Result, begun, concluded
from gravcal.discovery.scan import offered, side_by_side
from gravcal.discovery.trials import EXCESS, SHARES
from gravcal.errors import CatalogError
from gravcal.estimation import chi2_tail
from gravcal.estimation.quantities import SCHEMA, result_of, tabled
from gravcal.estimation.records import (
    Block,
    Candidate,
    Entry,
    Fitted,
    LineSearch,
    Observations,
    Parameter,
    entries,
    epoch_of,
    slug_of,
)

TIED_ODDS = 100.0  # of evidence, below which two causes are tied
BIASED = 0.1  # of the error of a result, from which a bias is worth a word


@dataclass(frozen=True)
class Limits:
    """Settings of a search: family-wise level, chi-square of a tie, rounds, stretch left out s, seed of the draws."""

    level: float
    tie: float
    rounds: int
    segment_s: float
    seed: int


def discover(observed: Observations | None, limits: Limits) -> xr.Dataset:
    """What the model of an event gets wrong, and why: Dataset of kind discovery, its summary as quantities."""
    if observed is None:
        values = {name: [] for name, stated in DISCOVERY.items() if not stated.get("optional") and name not in SCHEMA}
        return tabled(_dataset(values, channels="", blocks=""), {"status": "no_manoeuvre"})
    result, numbers = _searched(observed, limits, ())
    return _product(observed, limits, result, numbers)


def discover_again(observed: Observations | None, limits: Limits, first: xr.Dataset, model: Sequence[Entry]):
    """The search anew, in records without what a first search has found, so that second order is left by none of it.

    The effects are added to the rows again in their linear form, so that the search finds them whole, with their errors
    by the noise that is left. What describes the record worse than the first search is not taken.

    Parameters
    ----------
    observed : Observations of the records without the effects that were found
    limits : Limits
    first : Dataset of kind discovery
    model : what it found
    """
    before = result_of(first)
    gains = [(one["cause"], one["heldout_gain"]["in_sample_chi2"]) for one in before.get("findings", [])]
    if observed is None or not observed.worth_another(gains, before.get("adequate_after", True)):
        return first
    result, numbers = _searched(observed, limits, model, before["calibration_change"]["before"])
    if not numbers["adequate_after"] and numbers["p_after"] < before["p_after"]:
        return first
    numbers |= {name: before[name] for name in ("adequate_before", "p_before", "p_quiet_before", "tried")}
    return _product(observed, limits, result, numbers).assign_attrs(rebuilt="yes")


def check_causes(observed: Observations | None, model: Sequence[Entry]) -> None:
    """Raise CatalogError if an entry in no list names no driver of this calibration: its effect would stay unseen."""
    strange = {entry.cause for entry in model if not entry.listed}
    if observed is None or not strange:
        return
    known = {slug_of(one.cause) for one in observed.candidates} | {line.cause for line in observed.lines}
    known |= set(observed.tones.values())
    if strange - known:
        drivers = sorted(cause for cause in known if cause.startswith("unknown:"))
        raise CatalogError(
            f"model: found {', '.join(sorted(strange - known))}, expected some of the catalogue or of {observed.name}: "
            f"{', '.join(drivers)}. Write the model with gravcal discover of this calibration."
        )


def with_limits(found: xr.Dataset, observed: Observations | None, limits: Limits, say: Callable):
    """Product of a search, with the detection limits of its event among its numbers; `say` is told how far it is."""
    if observed is None:
        return found
    left = np.column_stack([found["residual_after"].values, found["found_columns"].values])
    if observed.interleaved:  # rows of a product, as they are in each block
        left = left[np.argsort(_order(observed.blocks)[2])]
    left = np.split(left, np.cumsum([block.observed.size for block in observed.blocks])[:-1])
    rows = detection_limits(observed, left, _choice(observed, limits), say)
    return tabled(found, result_of(found) | {"limits": rows})


def _choice(observed, limits):
    """Settings of the rounds in the observations."""
    fixed = {"quiet": observed.quiet, "order": observed.noise_order, "segment_s": limits.segment_s}
    fixed["periods"] = observed.periods
    return Choice(limits.level, limits.tie, limits.rounds, observed.step, observed.tones, **fixed)


def _searched(observed, limits, model, before=None):
    """Result of a search in the observations with the effects of a model added, and its numbers.

    A strong effect added in its linear form is not quite what the records hold: the calibration of the records as they
    are, which stays where nothing is adopted, is given from the first search.
    """
    added, choice = [observed.response(entry) for entry in model], _choice(observed, limits)
    rows = [replace(b, observed=b.observed + sum(one[k] for one in added)) for k, b in enumerate(observed.blocks)]
    result, waves = rounds_and_lines(observed, rows, choice, limits.seed)
    count, whole = observed.scale.size, result
    if before is not None:
        shared = np.append(np.array(before) / observed.scale - observed.start, result.shared[0][count:])
        whole = replace(result, shared=(shared, result.shared[1]))
    averaged = delivered(whole, choice, count)
    numbers = summary(averaged, choice, observed)
    for one in numbers["indistinguishable_from_calibration"]:
        if one["cause"] in averaged.unseen:
            one["bias_in_error"] = (observed.scale * averaged.unseen[one["cause"]][:count]).tolist()
    for position, finding in enumerate(numbers["findings"]):
        _described(finding, result, position, observed, waves)
    _without_epochs(numbers)
    numbers |= _weighed(observed, numbers["findings"])
    change = numbers["calibration_change"]
    change |= {} if observed.epoch is None else {"epoch": observed.epoch}
    numbers["expected"] = {name: list(known) for name, known in observed.expected.items()}
    calibrated = observed.scale * (observed.start + _without_model(result, observed, numbers["findings"]))
    if before is not None and not any(one["adopted"] for one in numbers["findings"]):
        calibrated = np.array(before)  # of the records as they are
    change["correction"] = (np.array(change["after"]) - calibrated).tolist()
    named = {slug_of(one.cause) for one in result.findings}
    rows = _beside(result.problem, observed, count)
    numbers["indistinguishable_from_calibration"] += [one for one in rows if one["cause"] not in named]
    return result, numbers


def _weighed(observed, findings):
    """Evidence of each cause alone; those that it does not set apart are tied with the first finding, in place."""
    rows = observed.weighed()
    odds = {row["cause"]: row["log_odds"] for row in rows}
    for one in (one for one in findings[:1] if one["cause"] in odds):
        own = one["cause"]
        near = [c for c, other in odds.items() if c != own and other > max(odds[own] - np.log(TIED_ODDS), 0.0)]
        one["tied_with"] = [*dict.fromkeys([*one["tied_with"], *near])]
    return {"weighed": rows} if rows else {}


def _without_model(result, observed, findings):
    """Shared parameters (p,) from the rows less what a model of the adopted findings takes out of the records.

    What was named between the forms and epochs of the search is taken as it was fitted; lines stay in the records.
    """
    problem, columns = result.problem, baseline_of(result.problem, ())
    lines = {*observed.tones.values(), *(one.cause for one in observed.lines)}
    added = [np.zeros(block.observed.size) for block in problem.blocks]
    for finding, one in zip(findings, result.findings, strict=True):
        effects = [observed.response(entry) for entry in entries([finding])] if finding["adopted"] else []
        mine = problem.candidates[one.index]
        between = (mine.shape is not None or mine.cause != slug_of(mine.cause)) and slug_of(mine.cause) not in lines
        if effects and between and not any(np.any(rows) for effect in effects for rows in effect):
            value = np.nan_to_num(one.value)
            effects = [[0.0 if c is None else c @ value for c in mine.columns]]
        added = [sum(rows) for rows in zip(added, *effects, strict=True)]
    right = sum(c.of(columns).T @ row for c, row in zip(problem.columns, added, strict=True))
    return (result.shared[0] - inverse_of_baseline(problem, columns) @ right)[: observed.scale.size]


def rounds_and_lines(observed: Observations, rows: list[Block], choice: Choice, seed: int) -> tuple[Result, set]:
    """Result of the rounds in the blocks of the observations, and the forms of lines.

    Lines are looked for in what the rounds leave before any of it is called an excess, and what happens at an epoch
    again near it, so that what an epoch half a spacing off leaves gets no name; both are tried beside all others in
    rounds that begin anew, if there is any.
    """
    state = begun(rows, observed.candidates, choice, random_source(seed, rows))
    result = concluded(state, replace(choice, excess=False))
    each = replace(choice, level=choice.level / max(len(observed.lines), 1))
    found = [line for one in observed.lines for line in joint_lines(result, observed, one, each)]
    steps = [k for k, one in enumerate(result.findings) if "@" in one.cause or one.cause == choice.step_cause]
    if found or steps or result.after.excess_p < choice.excess_level:
        near = [candidate for k in steps for candidate in observed.near(_fitted(result, k))]
        if more := [*near, *found]:
            state = begun(rows, [*observed.candidates, *more], choice, random_source(seed, rows))
        result = concluded(state, choice)
    return result, {one.form for one in found}


def _fitted(result, position):
    """A finding in the form that was named, as the calibration is asked about it."""
    one = result.findings[position]
    candidate = result.problem.candidates[one.index]
    return Fitted(candidate, one.value, one.sigma, result.after.rest, result.problem.bases)


def _described(finding: dict, result: Result, position: int, observed, waves):
    """Parameters of a finding as the effect of the catalogue has them, in place."""
    one: Finding = result.findings[position]
    fitted = _fitted(result, position)
    if one.cause == EXCESS:  # which no model takes out
        shape = fitted.candidate.shape
        values = shape.names, shape.value.tolist(), np.sqrt(np.diag(shape.covariance)).tolist(), shape.units
        rows = {n: {"value": v, "sigma": s or None, "unit": u} for n, v, s, u in zip(*values, strict=True)}
        finding |= {"parameters": rows, "model": {}}
        return
    if one.form in waves:
        words = one.form.partition(",")[0].split()  # "<channel> reading <axis>"
        frequency = finding["parameters"]["frequency"]
        known = one.value[np.isfinite(one.value)], one.sigma[np.isfinite(one.value)]
        size = float(np.sqrt(max(2 * np.mean(known[0] ** 2 - known[1] ** 2), 0.0)))  # less what noise adds
        sigma = float(np.sqrt(np.mean(known[1] ** 2) / max(known[0].size / 2, 1)))
        amplitude = {"value": size, "sigma": sigma, "unit": one.units[0]}
        finding["parameters"] = {"frequency": frequency, words[2] if len(words) > 2 else "amplitude": amplitude}
    elif not np.isfinite(one.value).any():
        finding["parameters"] = named_parameters(result, position)
    spacing = observed.spacing(epoch_of(one.cause)) if "@" in one.cause else None
    if spacing is not None:
        finding["parameters"]["time"] = _epoch(result, position, spacing)
    where = {n: p for n, p in finding["parameters"].items() if n in ("time", "frequency")}
    finding["model"] = named_parameters(result, position) | where
    for field in ("parameters", "model"):
        rows = finding[field].items()
        known = {n: Parameter(p["value"], p["sigma"], p["unit"], p.get("correlation", {})) for n, p in rows}
        entry = observed.physical(Entry(slug_of(one.cause), one.form, known), fitted)
        finding[field] = {n: _plain(p) for n, p in entry.parameters.items()}
        for name in ("waves", "leads"):
            if getattr(entry, name):
                finding[name] = [_plain(each) for each in getattr(entry, name)]
    if not observed.whole_manoeuvres:
        finding["heldout"] = "blocks"


def _plain(record):
    """Fields of a record but those that are empty."""
    rows = asdict(record).items()
    return {n: v for n, v in rows if n in ("value", "sigma") or v not in (None, {})}


def _epoch(result, position, width):
    """Epoch of a step: mean and spread under the likelihood of the epochs that were tried near it."""
    problem, index = result.problem, result.findings[position].index
    others = [one.index for k, one in enumerate(result.findings) if k != position]
    gram = attribution.projected(problem.total, baseline_of(problem, others))
    slug, _, middle = problem.candidates[index].cause.partition("@")
    places = {epoch_of(c.cause): k for k, c in enumerate(problem.candidates) if c.cause.startswith(f"{slug}@")}
    at = np.array(sorted(epoch for epoch in places if abs(epoch - float(middle)) <= width))
    gain = np.array([attribution.ratio(gram, problem.places[places[k]], problem.size).gain for k in at.tolist()])
    share, spacing = (2 * np.log(np.gradient(at)), np.diff(at).min()) if at.size > 1 else (0.0, width)
    mean, spread = attribution.likely(at, gain + share, spacing)
    return {"value": mean, "sigma": spread, "unit": "s"}


def _without_epochs(numbers: dict) -> None:
    """Give causes the slugs of the catalogue, in place; a cause is not tied with itself at another epoch."""
    for one in numbers["findings"]:
        one["cause"] = slug_of(one["cause"])
        one["tied_with"] = [n for n in dict.fromkeys(map(slug_of, one["tied_with"])) if n != one["cause"]]
        rows = {slug_of(row["cause"]): row | {"cause": slug_of(row["cause"])} for row in one["separation"]}
        one["separation"] = [row for name, row in rows.items() if name != one["cause"]]
    rows: dict[str, dict] = {}
    for row in numbers["tried"]:
        rows.setdefault(slug_of(row["cause"]), row | {"cause": slug_of(row["cause"])})
    numbers["tried"] = list(rows.values())


def _beside(problem: Problem, observed: Observations, count: int) -> list[dict]:
    """Effects that these data do not show at a plausible size, and that move a result beside the parameters."""
    gram, rows = attribution.projected(problem.total, baseline_of(problem, ())), []
    places = [((c.cause, *c.names), place.start) for c, place in zip(problem.candidates, problem.places, strict=True)]
    for one in observed.biased():
        k = next((start for names, start in places if names == (one.cause, one.parameter)), None)
        seen = k is not None and gram[k, k] > ROUNDING * problem.total[k, k]
        ratio = one.prior * np.sqrt(gram[k, k]) if seen else 0.0
        if ratio < UNSEEN and one.in_sigma > BIASED:
            words = {"cause": one.cause, "direction": {one.parameter: 1.0}, "signal_to_noise": float(ratio)}
            numbers = {"bias": [0.0] * count, "bias_in_sigma": one.in_sigma, one.name: one.rms.tolist()}
            rows.append(words | numbers)
    return rows


def _product(observed, limits, result, numbers):
    """Product of a search, with the reading that each finding helps most and the columns of what was found."""
    without, rows = [], observed_rows(result.problem)
    for one in result.findings:
        others = [other.index for other in result.findings if other is not one]
        rest = residuals_of(result.problem, baseline_of(result.problem, others), rows)
        without.append([part[:, 0] for part in rest])
    columns = [part.of(result.baseline[result.problem.shared.stop - 1 :]) for part in result.problem.columns]
    given = [*without, columns]
    whole, given = _joined(result, given) if observed.interleaved else (result, given)
    *without, columns = given
    channels = observed.readable or observed.channels
    ends = np.cumsum([len(result.problem.candidates[one.index].names) for one in result.findings])
    acts = list(zip(*([bool(c.any()) for c in np.split(part, ends[:-1], axis=1)] for part in columns), strict=True))
    places = clearest(whole, channels, limits.level, without, acts)
    shown = variables(whole, places, observed.reading, without, observed.contiguous)
    shown["found_columns"] = np.concatenate(columns)
    return dataset(whole, numbers, observed.channels, shown, places, observed.periods)


def _order(blocks: list[Block]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Records that interleaved blocks are stretches of, number of it (n,), and the rows (n,) by record, axis, time."""
    names = [block.label.split()[0] for block in blocks]
    records = list(dict.fromkeys(names))
    number = np.repeat([records.index(name) for name in names], [block.time.size for block in blocks])
    time, axis = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("time", "axis"))
    return records, number, np.lexsort([time, axis, number])


def _joined(result: Result, given: Sequence) -> tuple[Result, list]:
    """Result with the stretches of each record as one block, for the product, and what is given by block likewise."""
    parts = result.problem.blocks
    records, number, order = _order(parts)
    cuts = np.flatnonzero(np.diff(number[order])) + 1
    joined = lambda rows: np.split(np.concatenate(rows)[order], cuts)  # noqa: E731
    rows = (joined([getattr(part, name) for part in parts]) for name in ("observed", "channel", "axis", "time"))
    blocks = []
    for name, own, *about in zip(records, *rows, strict=True):
        nothing = np.zeros((own.size, 0))
        blocks.append(Block(name, own, nothing, nothing, *about))
    tests = [
        replace(test, rest=joined(test.rest), rows=[r | {"block": r["block"].split()[0]} for r in test.rows])
        for test in (result.before, result.after)
    ]
    whole = replace(result, problem=replace(result.problem, blocks=blocks), before=tests[0], after=tests[1])
    return whole, [joined(one) for one in given]


AXES = "xyz"
PEAKS = 4
#: Frequencies tried round a peak, in steps of the scan.
FINE = np.arange(-1.0, 1.01, 1 / 16)


def joint_lines(result: Result, observed: Observations, search: LineSearch, choice: Choice) -> list[Candidate]:
    """Lines in what a search without them has left, those that are significant by themselves."""
    groups, wave = observed.groups, observed.wave(search)
    shape = lambda hertz: side_by_side([wave(k, hertz) for k in range(len(groups))], groups)  # noqa: E731
    found = next((s for s in result.after.scans if s.kind == "line" and s.channel == search.channel), None)
    if found is None:
        return []
    joint = np.flatnonzero((found.place == search.axis) & offered(found, choice.periods))
    at, score = found.at[joint], (found.gain[:, 0] - 2 * found.dof)[joint]
    step, peaks, kept = float(np.median(np.diff(at))), [], []
    for k in np.argsort(-score):  # the best, apart from each other by more than a few steps
        if len(peaks) < PEAKS and all(abs(at[k] - other) > 4 * step for other in peaks):
            peaks.append(float(at[k]))
    for peak in peaks:
        grid = peak + step * FINE
        gains = [_gain(result, shape(one)[0]) for one in grid]
        chance = chi2_tail.log_tail(*max(gains)) + np.log(at.size / SHARES["line"])
        if chance < np.log(choice.level):
            kept.append(_line(grid, np.array([g for g, _ in gains]), shape, search))
    return kept


def _gain(result, columns):
    """Chi-square gained, and how many parameters gain it, with own and baseline columns free."""
    problem, baseline = result.problem, result.baseline
    clean = [c - q @ (q.T @ c) for c, q in zip(columns, problem.bases, strict=True)]
    cross = sum(b.of(baseline).T @ c for b, c in zip(problem.columns, clean, strict=True))
    inner = sum(c.T @ c for c in clean) - cross.T @ inverse_of_baseline(problem, baseline) @ cross
    right = sum(c.T @ r for c, r in zip(clean, result.after.rest, strict=True))
    root = root_of(inner, lambda values: 1e-6 * max(values[-1], 1e-300), np.ones(len(inner)))
    return float(np.sum((root.T @ right) ** 2)), root.shape[1]


def _line(grid, gains, shape, search):
    """Line at the mean frequency under the likelihood of the grid; its parameters have the unit of the channel."""
    at, sigma = attribution.likely(grid, gains, grid[1] - grid[0])
    columns, used = shape(at)
    names = [f"{part}_{k}" for k in range(used.size // 2) for part in ("cosine", "sine")]
    names = list(itertools.compress(names, used))
    form = f"{search.channel} reading{f' {AXES[search.axis]}' if search.axis >= 0 else ''}, {at:.5f} Hz"
    units, columns = [search.unit] * len(names), [c[:, used] for c in columns]
    return Candidate(search.cause, form, names, units, columns, at=at, at_sigma=sigma, apart=True)


def _dataset(values, **attrs):
    """Dataset with the variables of the schema that have values."""
    made = {}
    for name in (name for name in DISCOVERY if name in values):
        stated = DISCOVERY[name]
        labels = {label: stated[label] for label in ("units", "long_name") if label in stated}
        made[name] = (stated["dims"].split(), np.asarray(values[name], dtype=stated.get("dtype", "f8")), labels)
    return xr.Dataset(made, attrs={"time_scale": "GPS"} | attrs)


def dataset(
    result: Result, numbers: dict, channels: Sequence[str], reading: Mapping, places: Sequence, periods: Iterable
) -> xr.Dataset:
    """Product of a search: residuals, adequacy, numbers of `summary`, readings of `variables` at `places`."""
    blocks, before, after = result.problem.blocks, result.before, result.after
    rows = before.rows
    names = list(dict.fromkeys([*channels, *(str(c) for b in blocks for c in b.channel)]))
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
    shown = [asdict(one) | {"block": blocks[one.block].label} for one in places]
    made = _dataset(values | reading, channels=" ".join(names), blocks=", ".join(labels))
    return tabled(made, numbers | {"readings": {"shown": shown, "periods": list(periods)}})


def summary(result: Result, choice: Choice, observed: Observations) -> dict:
    """Numbers of a discovery as plain lists and floats, NaN where not determined, in the unit that is reported."""
    rows = {}
    for trial in result.first:
        one = {"cause": trial.cause, "form": trial.form, "chi2": trial.gain, "parameters": trial.dof}
        rows.setdefault(trial.cause, one | {"significance": trial.significance})
    return {
        "adequate_before": result.before.adequate(choice.level),
        "adequate_after": result.after.adequate(choice.level),
        "p_before": result.before.p,
        "p_after": result.after.p,
        "p_quiet_before": result.before.quiet,
        "p_quiet_after": result.after.quiet,
        "level": choice.level,
        "outliers": result.outliers,
        "findings": [_finding(one, choice, k, result.adopted) for k, one in enumerate(result.findings)],
        "indistinguishable_from_calibration": beside_calibration(
            result.problem, baseline_of(result.problem, ()), observed.scale
        ),
        "unexplained": _unexplained(result, choice),
        "calibration_change": _change(result, observed),
        "gain": _gained(result),
        "tried": list(rows.values()),
    }


def _finding(found: Finding, choice, position, adopted):
    values = zip(found.names, found.value.tolist(), found.sigma.tolist(), found.units, strict=True)
    parameters = {n: {"value": v, "sigma": s, "unit": u} for n, v, s, u in values}
    if np.isfinite(found.at):
        name, unit = ("time", "s") if "time" in found.form else ("frequency", "Hz")
        parameters[name] = {"value": found.at, "sigma": found.at_sigma, "unit": unit}
    return {
        "cause": found.cause,
        "form": found.form,
        "tied_with": [*found.tied, *(one["cause"] for one in found.imitators)],
        "adopted": adopted[position] if adopted else True,
        "in_catalogue": not found.cause.startswith("unknown:"),
        "parameters": parameters,
        "significance": found.significance,
        "level": choice.level,
        "heldout": found.kind,
        "heldout_gain": {"chi2": found.heldout, "in_sample_chi2": found.gain, "parameters": found.dof},
        "separation": found.separation,
        "imitators": found.imitators,
    }


def _unexplained(result, choice):
    """What is left where the extended model is not adequate: worst bands, lines and steps."""
    if result.after.p >= choice.level:
        return {}
    rows = sorted(result.after.rows, key=lambda r: r["p"])[:5]
    scans = []
    for one in result.after.scans:
        best = int(np.argmax(one.gain[:, 0] - one.dof))
        name = "frequency_hz" if one.kind == "line" else "time"
        scans.append({"kind": one.kind, "channel": one.channel, name: float(one.at[best])})
        scans[-1] |= {"chi2": float(one.gain[best, 0]), "parameters": int(one.dof[best])}
    return {"p": result.after.p, "bands": rows, "scans": scans}


def _change(result, observed):
    """Parameters of the calibration before and after, in their reported unit."""
    scale, start, count = observed.scale, observed.start, observed.scale.size
    (before, after), (old, new) = ([part[:count] for part in both] for both in (result.shared, result.sigma))
    extra = (result.covariance[1] - result.covariance[0])[:count, :count]
    return {
        "names": list(observed.parameters),
        "unit": observed.unit,
        "before": (scale * (start + before)).tolist(),
        "sigma_before": (scale * old).tolist(),
        "after": (scale * (start + after)).tolist(),
        "sigma_after": (scale * new).tolist(),
        "variant": "joint fit",
        "covariance_of_findings": (np.outer(scale, scale) * extra).tolist(),
        "change": (scale * (after - before)).tolist(),
        "change_in_old_sigma": ((after - before) / np.where(old > 0, old, np.inf)).tolist(),
    }


def _gained(result):
    """Chi-square, likelihood and criterion before and after, rms of the whitened residuals by channel."""
    (before, after), count = result.chi2, result.problem.samples.sum()
    more = result.baseline.size - (result.problem.shared.stop - result.problem.shared.start)
    return {
        "chi2_before": before,
        "chi2_after": after,
        "dof_before": result.dof,
        "dof_after": result.dof - more,
        "heldout_chi2": float(sum(f.heldout for f in result.findings)),
        "log_likelihood_before": -before / 2,
        "log_likelihood_after": -after / 2,
        "bic_change": after - before + more * float(np.log(max(count, 1))),
        "rms_before": _rms(result.problem.blocks, result.before.rest),
        "rms_after": _rms(result.problem.blocks, result.after.rest),
    }


def _rms(blocks, rest):
    """Rms of the whitened residual of each channel over the rows that carry weight; one is the noise."""
    found = {}
    for channel in dict.fromkeys(str(c) for b in blocks for c in b.channel):
        values = np.concatenate([r[b.channel == channel] for b, r in zip(blocks, rest, strict=True)])
        values = values[values != 0]
        found[channel] = float(np.sqrt(np.mean(values**2))) if values.size else np.nan
    return found


#: Rows of a channel and block below which they are no curve.
CURVE = 60
#: Chi-square that a finding has to gain there to be seen at all.
CLEAR = 10.0


@dataclass(frozen=True)
class Shown:
    """Where a finding is shown."""

    finding: int  #: its number, -1 where none was named
    channel: str
    block: int  #: number
    axis: int


def clearest(
    result: Result, channels: Sequence[str], level: float, without: Sequence, acts: Sequence = ()
) -> list[Shown]:
    """For each finding the channel, block and axis whose rows it helps most; none where it helps no curve.

    `without` are, for each finding, the residuals (n,) that the extended model without it leaves of each block; `acts`
    says whether it acts there. Where nothing was named and the baseline is not adequate, the place of the least likely
    band.
    """
    found = []
    for number, rest in enumerate(without):
        drops = {}
        for k, block in enumerate(result.problem.blocks):
            drop = rest[k] ** 2 - result.after.rest[k] ** 2
            drop = drop if not acts or acts[number][k] else np.zeros_like(drop)
            for channel in (c for c in channels if np.sum(block.channel == c) >= CURVE):
                size = np.bincount(block.axis, np.where(block.channel == channel, drop, 0.0))
                drops[size.sum(), channel, k] = int(size.argmax())
        gain, channel, k = max(drops, default=(0.0, "", 0))
        found += [Shown(number, channel, k, drops[gain, channel, k])] if gain >= CLEAR else []
    if without or result.before.p >= level:
        return found
    labels = {b.label: k for k, b in enumerate(result.problem.blocks)}
    for row in sorted(result.before.rows, key=lambda r: r["p"]):
        k = labels[row["block"]]
        here = result.problem.blocks[k].channel == row["channel"]
        if row["channel"] in channels and here.sum() >= CURVE:
            size = np.bincount(result.problem.blocks[k].axis, np.where(here, result.before.rest[k] ** 2, 0.0))
            return [Shown(-1, row["channel"], k, int(size.argmax()))]
    return []


def variables(
    result: Result, places: Sequence[Shown], reading_of: Callable, without: Sequence, contiguous: bool = False
) -> dict[str, np.ndarray]:
    """Variables of the product by channel for what is shown, one finding after the other, less the mean measured.

    `reading_of` gives, of a channel, the number of a block and rows (n, 3), the time (m,) s, the reading (m, a) that
    the observed rows are the difference to, and the rows (3, m, a) in its unit; of the rows of all blocks if
    `contiguous`.
    """
    made: dict[str, list[np.ndarray]] = {}
    observed = [block.observed for block in result.problem.blocks]
    for one in places:
        parts = observed, without[one.finding] if without else result.before.rest, result.after.rest
        rows = np.stack([np.concatenate(p if contiguous else [p[one.block]]) for p in parts], axis=1)
        time, model, (rest, before, after) = reading_of(one.channel, one.block, rows)
        measured = model + rest
        measured -= np.nanmean(measured, axis=0)
        after = after if without else np.full_like(after, np.nan)
        series = {"time": time, "finding": np.full(time.size, one.finding), "measured": measured}
        series |= {"simulated": measured - before, "extended": measured - after}
        for name, values in series.items():
            made.setdefault(f"{one.channel}_{name}", []).append(values)
    return {name: np.concatenate(parts) for name, parts in made.items()}
