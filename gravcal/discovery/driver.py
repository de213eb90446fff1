"""One discovery for all calibrations: search, lines and epochs a second time, averaged covariance; what it delivers.

A calibration hands over `gravcal.estimation.records.Observations`; nothing here knows which one it is.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.discovery import DISCOVERY, attribution
from gravcal.discovery.limits import detection_limits
from gravcal.discovery.model_average import delivered, named_parameters
from gravcal.discovery.problem import (
    Problem,
    baseline_of,
    inverse_of_baseline,
    less_calibration,
    observed_rows,
    random_source,
    residuals_of,
    root_of,
)
from gravcal.discovery.rounds import Choice, Result, begun, concluded
from gravcal.discovery.scan import offered, side_by_side
from gravcal.discovery.trials import AXES, COST, EXCESS, SHARES
from gravcal.errors import CatalogError
from gravcal.estimation import chi2_tail, outcome
from gravcal.estimation.quantities import SCHEMA, tabled
from gravcal.estimation.records import (
    Block,
    Candidate,
    Entry,
    Fitted,
    LineSearch,
    Observations,
    Parameter,
    Unobservable,
    epoch_of,
    slug_of,
)

TIED_ODDS = 100.0  # of evidence, below which two causes are tied
BIASED = 0.1  # of the error of a result, from which a bias is reported


@dataclass(frozen=True)
class Limits:
    """Settings of a search: family-wise level, chi-square of a tie, rounds, stretch left out s, seed of the draws."""

    level: float
    tie: float
    rounds: int
    segment_s: float
    seed: int


def discover(observed: Observations | None, limits: Limits) -> xr.Dataset:
    """Dataset of kind discovery: residuals, adequacy and named causes of an event, the outcome as quantities."""
    if observed is None:
        values = {name: [] for name, spec in DISCOVERY.items() if not spec.get("optional") and name not in SCHEMA}
        return tabled(_dataset(values, channels="", blocks=""), {"status": "no_manoeuvre"})
    return _product(observed, limits, *_searched(observed, limits, ()))


def discover_again(observed: Observations | None, limits: Limits, first: xr.Dataset, model: Sequence[Entry]):
    """Dataset of a second search, in records without the effects that the first found: no second-order rest of them.

    The effects are added to the rows again in their linear form, so that the search finds them whole, with their errors
    by the noise that is left. The model is that of the first search, whose Dataset is kept if the second fits worse.
    """
    before = outcome.outcome_of(first)
    gains = [(one.cause, one.heldout_gain.in_sample_chi2) for one in before.findings] if before else []
    if observed is None or not observed.worth_another(gains, before is None or before.adequate_after):
        return first
    result, second_outcome = _searched(observed, limits, model, before)
    if not second_outcome.adequate_after and second_outcome.p_after < before.p_after:
        return first.assign_attrs(believed="first")
    known = {"p_before": before.p_before, "p_quiet_before": before.p_quiet_before, "tried": before.tried}
    second_outcome = replace(second_outcome, adequate_before=before.adequate_before, **known)
    rebuilt = first.attrs.get("rebuilt", 0) + 1 + ("believed" in first.attrs)  # one set of records was passed over
    return _product(observed, limits, result, second_outcome).assign_attrs(rebuilt=rebuilt)


def check_causes(observed: Observations | None, model: Sequence[Entry]) -> None:
    """Raise CatalogError if an entry names no driver of this calibration, or a sensor that it has not."""
    strange = {entry.cause for entry in model if not entry.listed}
    strange |= {f"{one.cause}.{n}" for one in model if one.listed for n in one.values if n.endswith(("_1", "_2"))}
    if observed is None or not strange:
        return
    known = {slug_of(one.cause) for one in observed.candidates} | {line.cause for line in observed.lines}
    known |= {*observed.tones.values(), *(f"{one.cause}.{name}" for one in observed.candidates for name in one.names)}
    if strange - known:
        drivers = sorted(cause for cause in known if cause.startswith("unknown:") and "." not in cause)
        raise CatalogError(
            f"model: found {', '.join(sorted(strange - known))}, expected some of the catalogue or of {observed.name}: "
            f"{', '.join(drivers)}. Write the model with gravcal discover of this calibration."
        )


def with_limits(search: xr.Dataset, observed: Observations | None, limits: Limits, say: Callable):
    """Product of a search, with the detection limits of its event as quantities; `say` is called with progress."""
    if observed is None:
        return search
    parts = np.column_stack([search["residual_after"].values, search["found_columns"].values])
    parts = np.split(parts, np.cumsum([block.observed.size for block in observed.blocks])[:-1])
    rows = detection_limits(observed, parts, _choice(observed, limits), say)
    return tabled(search, replace(outcome.outcome_of(search), limits=tuple(rows)))


def _choice(observed, limits):
    """Choice, settings of the rounds, from the Observations of a calibration and the Limits."""
    settings = limits.level, limits.tie, limits.rounds, observed.step, observed.tones, limits.segment_s
    known = observed.quiet, observed.noise_order, observed.spectra, observed.periods
    return Choice(*settings, *known, floored=observed.floored)


def _searched(observed, limits, model, first=None):
    """Result of a search in the observations with the effects of a model added, and its Outcome.

    A strong effect added in its linear form is not quite what the records hold: the calibration of the records as they
    are, which stays where nothing is adopted, and the causes they separate, are those of the first search.
    """
    added, choice = [observed.response(entry) for entry in model], _choice(observed, limits)
    rows = [replace(b, observed=b.observed + sum(one[k] for one in added)) for k, b in enumerate(observed.blocks)]
    reduced, explained = less_calibration(rows)
    result, waves = rounds_and_lines(observed, reduced, choice, limits.seed)
    blocks = [replace(b, observed=row.observed) for b, row in zip(result.problem.blocks, rows, strict=True)]
    result = replace(result, problem=replace(result.problem, blocks=blocks))
    result = _told_apart(result, first) if first and first.adequate_after else result
    count, whole = observed.scale.size, result
    if first:
        before = np.array(first.calibration_change.before)
        shared = np.append(before / observed.scale - observed.start - explained[:count], result.shared[0][count:])
        whole = replace(result, shared=(shared, result.shared[1]))
    averaged = delivered(whole, choice, count)
    averaged, result = (replace(r, shared=tuple(one + explained for one in r.shared)) for r in (averaged, result))
    search_outcome, evidence = summary(averaged, choice, observed, waves), observed.weighed()
    odds = {row.cause: row.log_odds for row in evidence}
    findings = [*(_tied(one, odds) for one in search_outcome.findings[:1]), *search_outcome.findings[1:]]
    calibrated = observed.scale * (observed.start + _without_model(result, observed, findings))
    if first and not any(one.adopted for one in findings):
        calibrated = before  # of the records as they are
    correction = (np.array(search_outcome.calibration_change.after) - calibrated).tolist()
    change = replace(search_outcome.calibration_change, epoch=observed.epoch, correction=correction)
    named = {one.cause for one in findings}
    hidden = [one for one in _beside(result.problem, observed, count) if one.cause not in named]
    hidden = [*search_outcome.indistinguishable_from_calibration, *hidden]
    changes = {"findings": findings, "weighed": tuple(evidence), "indistinguishable_from_calibration": hidden}
    return result, replace(search_outcome, calibration_change=change, **changes)


def _told_apart(result, first):
    """Result whose findings keep only the ties that a first search, an Outcome, had for the same cause."""
    findings, ties = [], {one.cause: {*one.tied_with} for one in first.findings}
    for one in result.findings:
        near = ties.get(slug_of(one.cause), {*map(slug_of, one.tied), *(slug_of(row.cause) for row in one.imitators)})
        rows = [[row for row in rows if slug_of(row.cause) in near] for rows in (one.imitators, one.separation)]
        tied = [cause for cause in one.tied if slug_of(cause) in near]
        findings.append(replace(one, tied=tied, imitators=rows[0], separation=rows[1]))
    return replace(result, findings=findings)


def _tied(finding, odds):
    """NamedCause, tied also with causes whose evidence {cause: log odds} is within TIED_ODDS of its own."""
    log_odds = odds.get(finding.cause, np.inf)
    close = [c for c, other in odds.items() if c != finding.cause and other > max(log_odds - np.log(TIED_ODDS), 0.0)]
    return replace(finding, tied_with=[*dict.fromkeys([*finding.tied_with, *close])])


def _without_model(result, observed, findings):
    """Calibration parameters (p,) from the rows less what a model of the adopted findings removes from the records.

    A finding between the forms and epochs of the candidates is removed as it was fitted; lines stay in the records.
    """
    problem, columns = result.problem, baseline_of(result.problem, ())
    lines = {*observed.tones.values(), *(one.cause for one in observed.lines)}
    added = [np.zeros(block.observed.size) for block in problem.blocks]
    for finding, one in zip(findings, result.findings, strict=True):
        effects = [observed.response(entry) for entry in finding.entries if finding.adopted]
        named = problem.candidates[one.index]
        between = (named.shape is not None or named.cause != slug_of(named.cause)) and slug_of(named.cause) not in lines
        if effects and between and not any(np.any(rows) for effect in effects for rows in effect):
            value = np.nan_to_num(one.value)
            effects = [[0.0 if c is None else c @ value for c in named.columns]]
        added = [sum(rows) for rows in zip(added, *effects, strict=True)]
    right = sum(c.of(columns).T @ row for c, row in zip(problem.columns, added, strict=True))
    return (result.shared[0] - inverse_of_baseline(problem, columns) @ right)[: observed.scale.size]


def rounds_and_lines(observed: Observations, rows: list[Block], choice: Choice, seed: int) -> tuple[Result, set]:
    """Result of the rounds in whitened rows, as blocks, and the set of the forms of the lines that were tried.

    Lines are looked for in what the rounds leave before any of it is called an excess, those that gain more than what
    was named first in what there was before, and what happens at an epoch again near it and near what stands out, so
    that an epoch half a spacing off hides nothing; all are tried beside all others in rounds that begin anew, if any.
    """
    state = begun(rows, observed.candidates, choice, random_source(seed, rows))
    result = concluded(state, replace(choice, excess=False))
    split = replace(choice, level=choice.level / max(len(observed.lines), 1))
    lines = [line for one in observed.lines for line in joint_lines(result, observed, one, split)]
    if result.findings:
        unnamed = replace(result, after=result.before, baseline=baseline_of(result.problem, ()))
        stronger = [joint_lines(unnamed, observed, one, split, result.first[0].score) for one in observed.lines]
        lines += [line for some in stronger for line in some if line.form not in {one.form for one in lines}]
    steps = [k for k, one in enumerate(result.findings) if "@" in one.cause or one.cause == choice.step_cause]
    edges = [] if len(steps) < len(result.findings) else [c for c in observed.candidates if "@" in c.cause]
    steps = [_fitted(result, k) for k in steps]
    rests = [(b.time, np.abs(r)) for b, r in zip(rows, result.before.rest, strict=True) if edges and r.size]
    far = [(r.max(), t[np.argmax(r)]) for t, r in rests] + [(abs(one.sigma), one.time) for one in result.outliers]
    standing = [at for sigma, at in sorted(far, reverse=True)[:STANDING] if edges and sigma > FAR]
    closest = [(min((abs(epoch_of(one.cause) - at), k) for k, one in enumerate(edges)), at) for at in standing]
    steps += [Fitted(edges[k], [], [], [], []) for (away, k), at in closest if away <= observed.spacing(at)]
    if lines or steps or result.after.excess_p < choice.excess_level:
        near = {c.cause: c for one in steps for c in observed.near(one)}.values()
        if added := [*near, *lines]:
            state = begun(rows, [*observed.candidates, *added], choice, random_source(seed, rows), result.before)
        result = concluded(state, choice)
    return result, {one.form for one in lines}


def _fitted(result, position):
    """Fitted cause of the finding at a position, as `Observations.near` and `Observations.physical` take it."""
    one = result.findings[position]
    candidate = result.problem.candidates[one.index]
    return Fitted(candidate, one.value, one.sigma, result.after.rest, result.problem.bases)


def _entries(result: Result, position: int, observed, waves) -> tuple[Entry, Entry]:
    """Entry of a finding with catalogue parameters, as reported and as a model takes it out; waves: forms of lines."""
    one, fitted = result.findings[position], _fitted(result, position)
    values = zip(one.names, one.value.tolist(), one.sigma.tolist(), one.units, strict=True)
    parameters, entry = {n: Parameter(v, s, u) for n, v, s, u in values}, Entry(slug_of(one.cause), one.form, {})
    if one.cause == EXCESS:  # which no model takes out
        known = fitted.candidate.shape.parameters.items()
        return replace(entry, parameters={n: replace(p, sigma=p.sigma or None) for n, p in known}), entry
    if np.isfinite(one.at):
        name, unit = ("time", "s") if "time" in one.form else ("frequency", "Hz")
        parameters[name] = Parameter(one.at, one.at_sigma, unit)
    if one.form in waves:
        words = one.form.partition(",")[0].split()  # "<channel> reading <axis>"
        known = one.value[np.isfinite(one.value)], one.sigma[np.isfinite(one.value)]
        size = float(np.sqrt(max(2 * np.mean(known[0] ** 2 - known[1] ** 2), 0.0)))  # less what noise adds
        sigma = float(np.sqrt(np.mean(known[1] ** 2) / max(known[0].size / 2, 1)))
        parameters = {"frequency": parameters["frequency"]}
        parameters[words[2] if len(words) > 2 else "amplitude"] = Parameter(size, sigma, one.units[0])
    elif not np.isfinite(one.value).any():
        parameters = named_parameters(result, position)
    spacing = observed.spacing(epoch_of(one.cause)) if "@" in one.cause else None
    if spacing is not None:
        parameters["time"] = _epoch(result, position, spacing)
    where = {n: p for n, p in parameters.items() if n in ("time", "frequency")}
    variants = parameters, named_parameters(result, position) | where
    return tuple(observed.physical(replace(entry, parameters=known), fitted) for known in variants)


def _epoch(result, position, width):
    """Epoch Parameter s of a step: mean and sigma under the likelihood of the epochs tried within width s of it."""
    problem, index = result.problem, result.findings[position].index
    others = [one.index for k, one in enumerate(result.findings) if k != position]
    gram = attribution.projected(problem.total, baseline_of(problem, others))
    slug, _, middle = problem.candidates[index].cause.partition("@")
    places = {epoch_of(c.cause): k for k, c in enumerate(problem.candidates) if c.cause.startswith(f"{slug}@")}
    at = np.array(sorted(epoch for epoch in places if abs(epoch - float(middle)) <= width))
    gain = np.array([attribution.ratio(gram, problem.places[places[k]], problem.size).gain for k in at.tolist()])
    share, spacing = (2 * np.log(np.gradient(at)), np.diff(at).min()) if at.size > 1 else (0.0, width)
    mean, spread = attribution.likely(at, gain + share, spacing)
    return Parameter(mean, spread, "s")


def _beside(problem: Problem, observed: Observations, count: int) -> list[Unobservable]:
    """[Unobservable] effects that bias a result beside the parameters and, at plausible size, have no clear S/N."""
    gram, rows = attribution.projected(problem.total, baseline_of(problem, ())), []
    starts = [(c, place.start) for c, place in zip(problem.candidates, problem.places, strict=True)]
    for one in observed.biased():
        known = (pair for pair in starts if [pair[0].cause, *pair[0].names] == [one.cause, *one.direction])
        candidate, k = next(known, (None, 0))
        observable = candidate and gram[k, k] > attribution.ROUNDING * problem.total[k, k]
        ratio = float(candidate.prior[0] * np.sqrt(gram[k, k])) if observable else 0.0
        if ratio < attribution.UNSEEN and one.bias_in_sigma > BIASED:
            rows.append(replace(one, signal_to_noise=ratio, bias=[0.0] * count))
    return rows


def _product(observed, limits, result, search_outcome):
    """Dataset of a search, with the reading that each finding helps most and the columns (n, q) of what was found."""
    without, rows = [], observed_rows(result.problem)
    for one in result.findings:
        others = [other.index for other in result.findings if other is not one]
        residuals = residuals_of(result.problem, baseline_of(result.problem, others), rows)
        without.append([part[:, 0] for part in residuals])
    columns = [part.of(result.baseline[result.problem.shared.stop - 1 :]) for part in result.problem.columns]
    channels = observed.readable or observed.channels
    ends = np.cumsum([len(result.problem.candidates[one.index].names) for one in result.findings])
    acts = list(zip(*([bool(c.any()) for c in np.split(part, ends[:-1], axis=1)] for part in columns), strict=True))
    places = clearest(result, channels, limits.level, without, acts)
    shown = variables(result, places, observed.reading, without, observed.contiguous)
    shown["found_columns"] = np.concatenate(columns)
    search_outcome = replace(search_outcome, readings=outcome.Readings(places, [*observed.periods]))
    return dataset(result, search_outcome, observed.channels, shown)


FAR, STANDING = 6.0, 4  # sigma of a reading from which on more epochs about it are tried, about so many at most
#: Frequencies tried round a peak, in quarters of what the longest record tells apart; how much more than at the first
#: of them a line may gain between them; share of its power that local columns leave of it at least, or it is none.
PEAKS, FINE, BETWEEN, LEFT = 4, np.arange(-1.0, 1.01, 1 / 16), 1.5, 0.5


def joint_lines(result: Result, observed: Observations, search: LineSearch, choice, least=0.0) -> list[Candidate]:
    """Candidates of lines in the residual of a search, significant by themselves and of a score above least.

    A line has one phase in all blocks of a group: with free phases any slow shape is one. What local columns leave of a
    slow line is no line any more, and the same as they leave of any other.
    """
    groups, wave = observed.groups, observed.wave(search)
    shape = lambda hertz: side_by_side([wave(k, hertz) for k in range(len(groups))], groups)  # noqa: E731
    spectrum = next((s for s in result.after.scans if s.kind == "line" and s.channel == search.channel), None)
    if spectrum is None:
        return []
    joint = np.flatnonzero((spectrum.place == search.axis) & offered(spectrum, choice.periods))
    at, score = spectrum.at[joint], (spectrum.gain[:, 0] - 2 * spectrum.dof)[joint]
    step, kept, padded = np.median(np.diff(np.unique(spectrum.at))), [], np.pad(score, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((score > padded[:-2]) & (score > padded[2:]))  # a slow line has few cycles, others beside it
    times = [block.time[block.channel == search.channel] for block in observed.blocks]
    whole = [np.concatenate([t for t, g in zip(times, groups, strict=True) if g == group]) for group in set(groups)]
    spacing = 1 / (4 * max(np.ptp(one) for one in whole if one.size))

    def counts(gain, dof):  # True if significant after correction for the frequencies tried
        chance = chi2_tail.log_tail(gain, dof, choice.freedom) + np.log(at.size * step / (2 * spacing * SHARES["line"]))
        return chance < np.log(choice.level) and gain - COST * dof > least

    gained = lambda hertz: _gain(result, shape(hertz)[0], [time.size > 0 for time in times])  # noqa: E731
    for peak in at[peaks[np.argsort(-score[peaks])[:PEAKS]]]:
        gain, dof, best = max((*gained(one), one) for one in np.arange(peak - step, peak + 1.01 * step, spacing))
        if counts(BETWEEN * gain, dof):
            grid = best + spacing * FINE
            gains = [gained(one) for one in grid]
            if counts(*max(gains)):
                kept.append(_line(grid, np.array([g for g, _ in gains]), shape, search))
    return kept


def _gain(result, columns, here):
    """Chi-square gain and dof of columns [(n, q)], baseline free; 0, 1 if little is left in blocks here (b,)."""
    problem, baseline = result.problem, result.baseline
    clean = [c - q @ (q.T @ c) for c, q in zip(columns, problem.bases, strict=True)]
    size, remaining = (sum(np.sum(c**2) for c in itertools.compress(part, here)) for part in (columns, clean))
    if remaining <= LEFT * size:
        return 0.0, 1
    cross = sum(b.of(baseline).T @ c for b, c in zip(problem.columns, clean, strict=True))
    inner = sum(c.T @ c for c in clean) - cross.T @ inverse_of_baseline(problem, baseline) @ cross
    right = sum(c.T @ r for c, r in zip(clean, result.after.rest, strict=True))
    root = root_of(inner, lambda values: 1e-6 * max(values[-1], 1e-300), np.ones(len(inner)))
    return float(np.sum((root.T @ right) ** 2)), root.shape[1]


def _line(grid, gains, shape, search):
    """Candidate of a line at the mean frequency under the likelihood of gains (k,) on grid (k,) Hz, channel unit."""
    at, sigma = attribution.likely(grid, gains, grid[1] - grid[0])
    columns, used = shape(at)
    names = [f"{part}_{k}" for k in range(used.size // 2) for part in ("cosine", "sine")]
    names = list(itertools.compress(names, used))
    form = f"{search.channel} reading{f' {AXES[search.axis]}' if search.axis >= 0 else ''}, {at:.5f} Hz"
    units, columns = [search.unit] * len(names), [c[:, used] for c in columns]
    return Candidate(search.cause, form, names, units, columns, at=at, at_sigma=sigma, apart=True)


def _dataset(values, **attrs):
    """Dataset of {variable: values}, with dims, dtype and labels of the schema DISCOVERY."""
    arrays = {}
    for name in (name for name in DISCOVERY if name in values):
        spec = DISCOVERY[name]
        labels = {label: spec[label] for label in ("units", "long_name") if label in spec}
        arrays[name] = (spec["dims"].split(), np.asarray(values[name], dtype=spec.get("dtype", "f8")), labels)
    return xr.Dataset(arrays, attrs={"time_scale": "GPS"} | attrs)


def dataset(result: Result, search_outcome: outcome.Outcome, channels: Sequence[str], reading: Mapping) -> xr.Dataset:
    """Product of a search: residuals, adequacy, its outcome, readings of `variables`."""
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
        "test_block": [labels[r.block] for r in rows],
        "test_channel": [place[r.channel] for r in rows],
        "test_band": [r.band for r in rows],
        "power_before": [r.ratio for r in rows],
        "power_after": [r.ratio for r in after.rows],
        "p_band_before": [r.p for r in rows],
        "p_band_after": [r.p for r in after.rows],
    }
    return tabled(_dataset(values | reading, channels=" ".join(names), blocks=", ".join(labels)), search_outcome)


def summary(result: Result, choice: Choice, observed: Observations, waves=()) -> outcome.Outcome:
    """Outcome of a search; waves are the forms of its lines; NaN where not determined, causes without epochs."""
    before, after, tried = result.before, result.after, {}
    for one in result.first:
        cause = slug_of(one.cause)
        tried.setdefault(cause, outcome.Tried(cause, one.form, one.gain, one.dof, one.significance))
    hidden = attribution.beside_calibration(result.problem, baseline_of(result.problem, ()), observed.scale)
    errors = {cause: (observed.scale * one[: observed.scale.size]).tolist() for cause, one in result.unseen.items()}
    hidden = [replace(one, bias_in_error=errors.get(one.cause, ())) for one in hidden]
    adequate = before.adequate(choice.level), after.adequate(choice.level)
    chances = before.p, after.p, before.quiet, after.quiet, choice.level
    findings = [_named(result, k, choice, observed, waves) for k in range(len(result.findings))]
    unexplained = _unexplained(after) if after.p < choice.level else outcome.Unexplained()
    moved = _change(result, observed), _gained(result)
    named = result.outliers, findings, hidden, unexplained, *moved, [*tried.values()], observed.expected
    return outcome.Outcome(*adequate, *chances, *named)


def _named(result: Result, position: int, choice: Choice, observed, waves) -> outcome.NamedCause:
    """NamedCause of a finding: entries in physical units for the report, as fitted for the model that takes it out."""
    finding, (report, model) = result.findings[position], _entries(result, position, observed, waves)
    tied = dict.fromkeys(map(slug_of, [*finding.tied, *(one.cause for one in finding.imitators)]))
    separations = {slug_of(one.cause): replace(one, cause=slug_of(one.cause)) for one in finding.separation}
    entry = report.cause, report.form, report.parameters, model.waves or report.waves, model.leads or report.leads
    return outcome.NamedCause(
        *entry,
        tied_with=[one for one in tied if one != report.cause],
        adopted=result.adopted[position] if result.adopted else True,
        in_catalogue=report.listed,
        model=model.parameters,
        significance=finding.significance,
        level=choice.level,
        heldout=finding.kind if observed.whole_manoeuvres or finding.cause == EXCESS else "blocks",
        heldout_gain=outcome.HeldoutGain(finding.heldout, finding.gain, finding.dof),
        separation=[one for name, one in separations.items() if name != report.cause],
        imitators=finding.imitators,
    )


def _unexplained(after):
    """Unexplained part of a Test: its five least likely bands, and the best line or step of each scan."""
    scans = []
    for one in after.scans:
        best = int(np.argmax(one.gain[:, 0] - one.dof))
        where = {"frequency_hz" if one.kind == "line" else "time": float(one.at[best])}
        scans.append(outcome.Peak(one.kind, one.channel, float(one.gain[best, 0]), int(one.dof[best]), **where))
    return outcome.Unexplained(after.p, sorted(after.rows, key=lambda r: r.p)[:5], scans)


def _change(result, observed):
    """Change of the calibration parameters by a search, in their reported unit."""
    scale, start, count = observed.scale, observed.start, observed.scale.size
    (before, after), (old, new) = ([part[:count] for part in pair] for pair in (result.shared, result.sigma))
    increase = (result.covariance[1] - result.covariance[0])[:count, :count]
    rows = [scale * row for row in (start + before, old, start + after, new, after - before)]
    rows += [(after - before) / np.where(old > 0, old, np.inf), np.outer(scale, scale) * increase]
    words = observed.parameters, observed.unit, "joint fit"
    return outcome.Change(*words, *(row.tolist() for row in rows), correction=())


def _gained(result):
    """Gain: chi-square, log likelihood, whitened residual rms by channel, before and after; change of BIC."""
    (before, after), count = result.chi2, result.problem.samples.sum()
    extra = result.baseline.size - (result.problem.shared.stop - result.problem.shared.start)
    heldout, bic = float(sum(f.heldout for f in result.findings)), after - before + extra * float(np.log(max(count, 1)))
    rms = [_rms(result.problem.blocks, test.rest) for test in (result.before, result.after)]
    return outcome.Gain(before, after, result.dof, result.dof - extra, heldout, -before / 2, -after / 2, bic, *rms)


def _rms(blocks, residuals):
    """{channel: rms} of the whitened residual over the rows that carry weight; one is the noise."""
    rms = {}
    for channel in dict.fromkeys(str(c) for b in blocks for c in b.channel):
        values = np.concatenate([r[b.channel == channel] for b, r in zip(blocks, residuals, strict=True)])
        values = values[values != 0]
        rms[channel] = float(np.sqrt(np.mean(values**2))) if values.size else np.nan
    return rms


#: Number of rows of a channel in a block, below which they are not plotted as a curve.
CURVE = 60
#: Chi-square that a finding has to gain there to be visible in a plot.
CLEAR = 10.0


def clearest(
    result: Result, channels: Sequence[str], level: float, without: Sequence, acts: Sequence = ()
) -> list[outcome.Shown]:
    """Channel, block and axis whose chi-square each finding lowers most, none where that is not CLEAR.

    `without`: for each finding, the residuals (n,) of each block by the extended model without it; `acts`: True if it
    acts there. Where nothing was named and the baseline is not adequate, the place of the least likely
    band.
    """
    places = []
    for number, residuals in enumerate(without):
        drops = {}
        for k, block in enumerate(result.problem.blocks):
            drop = residuals[k] ** 2 - result.after.rest[k] ** 2
            drop = drop if not acts or acts[number][k] else np.zeros_like(drop)
            for channel in (c for c in channels if np.sum(block.channel == c) >= CURVE):
                size = np.bincount(block.axis, np.where(block.channel == channel, drop, 0.0))
                drops[size.sum(), channel, k] = int(size.argmax())
        gain, channel, k = max(drops, default=(0.0, "", 0))
        place = outcome.Shown(number, channel, result.problem.blocks[k].label, drops.get((gain, channel, k), 0))
        places += [place] if gain >= CLEAR else []
    if without or result.before.p >= level:
        return places
    labels = {b.label: k for k, b in enumerate(result.problem.blocks)}
    for row in sorted(result.before.rows, key=lambda r: r.p):
        k = labels[row.block]
        rows_here = result.problem.blocks[k].channel == row.channel
        if row.channel in channels and rows_here.sum() >= CURVE:
            size = np.bincount(result.problem.blocks[k].axis, np.where(rows_here, result.before.rest[k] ** 2, 0.0))
            return [outcome.Shown(-1, row.channel, row.block, int(size.argmax()))]
    return []


def variables(
    result: Result, places: Sequence[outcome.Shown], reading_of: Callable, without: Sequence, contiguous: bool = False
) -> dict[str, np.ndarray]:
    """{variable: values} of the product by channel for the places shown, in order of findings, less the mean measured.

    `reading_of` takes channel, block number and rows (n, 3), of all blocks if contiguous, to time (m,) s, reading
    (m, a) that the baseline predicts, and the rows (3, m, a) in its unit.
    """
    made: dict[str, list[np.ndarray]] = {}
    observed = [block.observed for block in result.problem.blocks]
    labels = {block.label: k for k, block in enumerate(result.problem.blocks)}
    for one in places:
        parts = observed, without[one.finding] if without else result.before.rest, result.after.rest
        rows = np.stack([np.concatenate(p if contiguous else [p[labels[one.block]]]) for p in parts], axis=1)
        time, model, (rest, before, after) = reading_of(one.channel, labels[one.block], rows)
        measured = model + rest
        measured -= np.nanmean(measured, axis=0)
        after = after if without else np.full_like(after, np.nan)
        series = {"time": time, "finding": np.full(time.size, one.finding), "measured": measured}
        series |= {"simulated": measured - before, "extended": measured - after}
        for name, values in series.items():
            made.setdefault(f"{one.channel}_{name}", []).append(values)
    return {name: np.concatenate(parts) for name, parts in made.items()}
