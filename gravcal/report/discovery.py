"""Report of a discovery: result document with verdict, page, and the extended model as a file."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import xarray as xr

from gravcal import toml
from gravcal.calibrations.checks import at_most
from gravcal.estimation.outcome import Gain, NamedCause, Outcome, Shown, outcome_of
from gravcal.estimation.quantities import plain as tables_of
from gravcal.estimation.records import Reported
from gravcal.report import discovery_words as words
from gravcal.report import documents, pages, plain
from gravcal.report.figures import bars, grid, thinned
from gravcal.report.pages import Figure, Section, Table
from gravcal.report.plain import NOT_DETERMINED, decimals, probability, signed
from gravcal.store.results import units

WORDS = pages.words(__file__, "discovery.toml", cause=words.title, units=units)
WIDE = 3.0  # errors within which a result agrees with the known value
STYLES = WORDS.styles
LINES, NOISE = STYLES["lines"], STYLES["noise"]
SIDES = ("measured", "simulated", "extended")
BINS = 24  # frequency bins of a spectrum
PHASES, STRETCHES = 40, 90  # phase bins of a period, time bins of a record, at most
SLOW = 0.02  # share of the variance of the effect added, below which it does not change within a period
KEPT = 0.5  # share of the sum of squares of the effect added that its means over bins have to keep


def report(
    search: xr.Dataset, *combined, calibration: str, event: str, satellite: str, records: str, settings: dict, reported
) -> tuple[xr.Dataset, dict[str, str]]:
    """Report product of a discovery with the probabilities of adequacy, and its files {name: text}.

    Datasets: the discovery and, if the calibration has such, its combined results before, after, and before with
    correction and errors of the initial model; `reported` reads results of these. Records: digest of their product.
    """
    document, outcome = judged(
        search, *combined, calibration=calibration, event=event, settings=settings, reported=reported
    )
    files = {"discovery.json": documents.text(document)}
    if outcome and outcome.findings and "model" in settings:  # a calibration that takes one
        change, added = outcome.calibration_change, None
        known = lambda one: np.nan_to_num(np.array(one, dtype=float)).tolist()  # noqa: E731 - null: no correction
        if combined:
            added = {"calibration": calibration, "records": records, "unit": change.unit}
            added |= {"correction": known(change.correction), "covariance": known(change.covariance_of_findings)}
        extended = model_text(outcome.findings, event, settings["model"], added)
        files |= {"model.toml": extended} if extended else {}
    files["discovery.html"] = pages.page(
        document,
        sections(search, outcome, reported) if outcome else [],
        {"discovery": search},
        heading="What the model gets wrong",
        subtitle=f"satellite {satellite}, level {outcome.level if outcome else ''} for everything tried together",
    )
    said = {f"p_{w}": f"probability of the {n} by chance" for w, n in zip(("before", "after"), LINES, strict=True)}
    kept = {name: ((), getattr(outcome, name, 1.0), {"units": "1", "long_name": text}) for name, text in said.items()}
    return xr.Dataset(kept, attrs={"status": document["status"], "event": event}), files


def judged(search: xr.Dataset, *combined: xr.Dataset, calibration: str, event: str, settings: dict, reported) -> tuple:
    """(result document of a discovery, judged and valid; its Outcome or None without); arguments as of `report`.

    The change of the result is that of the calibration itself where `combined` has it, else of the joint fit; checks
    compare parameters whose true value is known: they agree within the larger of its limit and `WIDE` sigma.
    """
    outcome, body, checks = outcome_of(search), {}, []
    if outcome:
        joint = outcome.calibration_change
        known = [bool(a and b) for a, b in zip(joint.sigma_before, joint.sigma_after, strict=True)]  # by these rows
        numbers = ("before", "sigma_before", "after", "sigma_after", "change", "change_in_old_sigma")
        numbers = {n: [v if k else None for v, k in zip(vars(joint)[n], known, strict=True)] for n in numbers}
        joint = change = replace(joint, **numbers)
        if combined:
            name, old, covariance = reported.result(combined[0])
            (_, new, new_covariance), *modelled = (reported.result(one, name) for one in combined[1:])
            _, start, spread = modelled[0] if modelled else (name, old, covariance)
            correction = start - old + np.array(joint.correction, dtype=float)
            added = spread - covariance + np.array(joint.covariance_of_findings, dtype=float)
            old, new, sigma = start, new + correction, [np.sqrt(np.diag(c)) for c in (spread, new_covariance + added)]
            sigma = [one + 0 * value for one, value in zip(sigma, (old, new), strict=True)]  # NaN: not determined
            own = {"before": old, "sigma_before": sigma[0], "after": new, "sigma_after": sigma[1], "change": new - old}
            own |= {"change_in_old_sigma": (new - old) / sigma[0], "correction": correction}
            own |= {"covariance_of_findings": added}
            change = replace(joint, variant=name, **plain.as_plain(own))
        rows = change.names, units(change.unit, change.names), change.after, change.sigma_after
        for name, unit, value, sigma in zip(*rows, strict=True):
            if name in outcome.expected and value is not None and sigma is not None:
                known, limit = outcome.expected[name]
                off = abs(value - known), max(limit, WIDE * sigma)
                checks.append(at_most(f"{name} against the catalogue", *off, unit))
        outcome = replace(outcome, calibration_change=change)
        body = {name: one for name, one in tables_of(outcome).items() if name not in ("readings", "expected")}
        body["calibration_change"] |= {"joint_fit": tables_of(joint)} if combined else {}
    status = "delivered" if outcome else "no_manoeuvre"
    body = {"status": status, "kind": "discovery", "verdict": {"text": words.verdict(outcome)}} | body
    about = {"event": event, "settings": settings}
    return documents.delivered(calibration, body, {"discovery": search}, checks, **about), outcome


def sections(search: xr.Dataset, outcome: Outcome, reported: Reported) -> list[Section]:
    """Sections of the page of a discovery: cause, result, detection limits, residuals, what was tried."""
    readings = [
        Figure(partial(reading, number=k), ("discovery",), caption(search, k, reported.readings))
        for k in range(len(outcome.findings)) or (-1,)  # of the least likely band
    ]
    numbers = vars(outcome)
    causes = [findings_table(outcome.findings), tied_table(outcome.findings), WORDS.table("weighed", numbers)]
    cause = Section("The cause", causes, notes=[WORDS.note("cause")])
    not_shown = [unobservable_table(outcome), WORDS.table("limits", numbers)]
    notes = [f"{WORDS.note('wrong')} {reported.note}".strip()]
    return [
        *([Section("What was found", figures=readings)] if any(one.caption for one in readings) else []),
        *([cause] if outcome.findings else []),
        Section("The result", [WORDS.table("change", numbers), gain_table(outcome.gain)], notes=[WORDS.note("gain")]),
        Section("What this event could not have shown", not_shown, notes=WORDS.said("not_shown", **numbers)),
        Section("What is left", [WORDS.table("outliers", numbers)], [_power, _spectra], notes),
        Section("What was tried", [WORDS.table("tried", numbers)]),
    ]


def findings_table(findings: Sequence[NamedCause]) -> Table:
    """Table of the findings: chi-square gained in sample and on held-out data, significance, parameters."""
    rows = []
    for one in findings:
        held = f"{one.heldout_gain.chi2:.0f} ({one.heldout})"
        gained = f"{one.heldout_gain.in_sample_chi2:.0f}", held, probability(one.significance)
        own = [*one.model.values()] if set(one.model) < set(one.parameters) else []
        alone = plain.measured(own[0].value, own[0].sigma, own[0].unit) if len(own) == 1 else ("", "")
        rows.append([words.title(one.cause), one.form or "all parameters", *gained, *alone])
        rows += parameter_rows((name, p.value, p.sigma, p.unit) for name, p in one.parameters.items())
    return WORDS.table("findings", rows)


def parameter_rows(parameters: Iterable[tuple]) -> list[list]:
    """Rows of the determined parameters (name, value, sigma, unit) of a cause, to follow the row of the cause."""
    return [[None, name, "", "", "", *plain.measured(*one)] for name, *one in parameters if one[0] is not None]


def tied_table(findings: Sequence[NamedCause]) -> Table:
    """Table of causes that the data cannot separate: expected chi-square, best block, number of events needed."""
    rows = []
    for one in findings:
        for other in one.separation:
            more = f"{other.events_needed} events like this one" if other.events_needed else "no such data would"
            separation = f"{other.expected_chi2:.1f}", other.best_block or NOT_DETERMINED, more
            rows.append([words.title(one.cause), words.title(other.cause), *separation])
        for other in one.imitators:
            imitator = f"{words.title(other.cause)}: {other.form}", f"{other.expected_chi2:.1f}", NOT_DETERMINED, ""
            rows.append([words.title(one.cause), *imitator])
    return WORDS.table("tied", rows)


def gain_table(gain: Gain) -> Table:
    """Whitened residual rms by channel and chi-square, before and after findings; held-out gain, change of BIC."""
    rms = [(name, one, gain.rms_after[name]) for name, one in gain.rms_before.items() if one is not None]
    rows = [[name, f"{before:.3f}", f"{after:.3f}"] for name, before, after in rms]
    pair = f"{gain.chi2_before:.0f} / {gain.dof_before}", f"{gain.chi2_after:.0f} / {gain.dof_after}"
    rows.append(["chi-square / degrees of freedom", *pair])
    rows.append(["held-out chi-square gained", "", f"{gain.heldout_chi2:.0f}"])
    rows.append(["change of BIC, negative is better", "", signed(gain.bic_change, 0)])
    return WORDS.table("gain", rows)


def unobservable_table(outcome: Outcome) -> Table:
    """Table of the 12 causes that bias the calibration most, inseparable from it; last what its errors hold of that."""
    rows, change = [], outcome.calibration_change
    about = list(zip(change.names, change.sigma_before, units(change.unit, change.names), strict=True))
    for one in sorted(outcome.indistinguishable_from_calibration, key=lambda r: -r.bias_in_sigma)[:12]:
        where = ", ".join(f"{signed(v, 2)} {n}" for n, v in one.direction.items())
        drag, errors = one.drag_bias_m_s2, one.bias_in_error or [None] * len(about)
        each = zip(one.bias, errors, about, strict=True)
        each = sorted(each, key=lambda row: -abs(row[0]) / (row[2][1] or np.inf))[:3]
        biases = ", ".join(f"{name} {signed(v, decimals(max(abs(v), 1e-3)))} {unit}" for v, _, (name, _, unit) in each)
        bias = f"drag {plain.quantity(max(drag), None, 'm s-2')}" if drag else biases
        in_errors = ", ".join(f"{v:.2g} {unit}" for _, v, (_, _, unit) in each if v is not None)
        rows.append([words.title(one.cause), where, f"{one.signal_to_noise:.1f}", bias, in_errors])
    return WORDS.table("unobservable", rows)


def model_text(findings: Sequence[NamedCause], event: str, initial: str = "", result: dict | None = None) -> str:
    """Extended model as TOML, as `--model` reads it; empty if no cause has a parameter that is determined.

    It also holds the entries of the model that the search began with (initial, JSON text), and the correction and its
    covariance of the result (result). Without findings it is the model of a run, with its own "result".
    """
    effects = []
    for entry in [*json.loads(initial or "[]"), *map(tables_of, findings)]:
        determined = {n: p for n, p in entry.get("model", entry["parameters"]).items() if p["value"] is not None}
        if determined and entry.get("adopted", True):
            parameters = {}
            for name, parameter in determined.items():
                related = {n: r for n, r in parameter.get("correlation", {}).items() if n in determined}
                parameters[name] = {n: parameter.get(n) for n in ("value", "sigma", "unit")} | {"correlation": related}
            effect = {"cause": entry["cause"], "form": entry["form"], "tied_with": entry.get("tied_with", [])}
            shape = {name: entry.get(name) or None for name in ("waves", "leads")}
            days = {name: entry.get(name) for name in ("from", "to")}
            effects.append(effect | days | {"parameters": parameters} | shape)
    if not findings and effects and (own := json.loads(initial)[0].get("result")):
        result = own | {"unit": "m"}
    model = {"event": event, "effect": effects, "result": result}
    said = "Found by gravcal discover in" if findings else "Taken out of the records of"
    return toml.text(model, f"{said} {event}; give it to gravcal run with --model.") if effects else ""


@WORDS.figure("discovery")
def _power(search):  # Figure: power over noise of each channel by block and band, before and after; or None
    names = search.attrs["channels"].split()
    tested = [k for k in range(len(names)) if np.any(search["test_channel"].values == k)]
    if not tested:
        return None
    blocks, bands = search["test_block"].values, search["test_band"].values
    each, size = (1, 3.6) if blocks.max() < 40 else (10, 2.0)  # block that is numbered, size of the points
    part = "manoeuvre" if search.attrs["blocks"].startswith("manoeuvre ") else "part of the record"
    look = {"xlabel": f"{part}, four bands from low to high frequency", "ylabels": [names[k] for k in tested]}
    drawn, panels = grid(len(tested), 1, 0.7 + 0.95 * len(tested), sharex=True, margins={"hspace": 0.16}, **look)
    for (panel,), k in zip(panels, tested, strict=True):
        of_channel = search["test_channel"].values == k
        place = blocks[of_channel] + 1 + (bands[of_channel] - 1.5) * 0.18
        panel.axhline(1.0, label="noise", **NOISE)
        for which, (name, style) in zip(("before", "after"), STYLES["points"].items(), strict=True):
            panel.plot(place, search[f"power_{which}"].values[of_channel], label=name, markersize=size, **style)
        _wide(panel)
    labels = enumerate(search.attrs["blocks"].split(", ")[: int(blocks.max()) + 1], start=1)  # that have bands
    labels = {k: name.removeprefix("manoeuvre ") if name.startswith("manoeuvre ") else str(k) for k, name in labels}
    panel.set_xticks([*labels][each - 1 :: each], [*labels.values()][each - 1 :: each])
    return drawn


def _wide(panel):
    """Set a logarithmic power axis where values exceed 30."""
    if panel.get_ylim()[1] > 30:
        panel.set_yscale("log")


@WORDS.figure("discovery")
def _spectra(search):  # Figure: whitened residual spectrum of each channel, before and after; None without
    names = search.attrs["channels"].split()
    curves = {name: one for k, name in enumerate(names) if (one := _spectrum(search, k)) is not None}
    if not curves:
        return None
    rows, margins = (len(curves) + 1) // 2, {"wspace": 0.16, "hspace": 0.5}
    drawn, panels = grid(rows, 2, 0.6 + 1.35 * rows, titles=curves, margins=margins)
    for panel in panels.ravel()[len(curves) :]:
        panel.set_visible(False)
    for (frequency, powers), panel in zip(curves.values(), panels.ravel(), strict=False):
        panel.axhline(1.0, label="noise", **NOISE)
        for values, (label, style) in zip(powers, LINES.items(), strict=True):
            panel.plot(frequency, values, label=label, **style)
        panel.set(xlabel="frequency (Hz)", ylabel="power over noise")
        _wide(panel)
    return drawn


def _spectrum(search, channel):
    """Frequencies (n,) Hz, and mean periodogram (2, n) of the whitened residual before and after; None if too short."""
    of_channel = search["channel"].values == channel
    pairs = [(b, axis) for b in np.unique(search["block"].values[of_channel]) for axis in range(3)]
    rows = [of_channel & (search["block"].values == b) & (search["component"].values == axis) for b, axis in pairs]
    longest = max((r.sum() for r in rows), default=0)
    bins = next((n for n in (BINS, BINS // 2) if longest >= 4 * n), None)
    if bins is None:
        return None
    rows = [r for r in rows if r.sum() >= 4 * bins]
    residual = np.stack([search[name].values for name in ("residual_before", "residual_after")])
    powers = [np.abs(np.fft.rfft(residual[:, used])[:, 1:]) ** 2 / used.sum() for used in rows]
    means = [[part.mean(axis=1) for part in np.array_split(periodogram, bins, axis=1)] for periodogram in powers]
    step = float(np.median(np.diff(search["time_row"].values[rows[-1]])))
    return (np.arange(bins) + 0.5) / (2 * step * bins), np.mean(means, axis=0).T


def shown(search, number: int) -> tuple[Shown, np.ndarray, dict[str, np.ndarray]] | None:
    """(Shown of a finding, time (n,) s from its first, {side of `SIDES`: reading (n,)}); None where none is shown."""
    rows = (one for one in outcome_of(search).readings.shown if one.finding == number)
    one = next((one for one in rows if f"{one.channel}_measured" in search), None)  # not that of a plugin
    if one is None:
        return None
    channel = one.channel
    here = search[f"{channel}_finding"].values == number
    axis = min(one.axis, search[f"{channel}_measured"].shape[1] - 1)
    time = search[f"{channel}_time"].values[here]
    return one, time - time[0], {side: search[f"{channel}_{side}"].values[here, axis] for side in SIDES}


def _kept(values, index):
    """Share (0 to 1) of the variance of values (n,) kept by their means over bins, index (n,) of the bin of each."""
    series = pd.Series(values - np.nanmean(values) if np.isfinite(values).any() else values).dropna()
    means = series.groupby(index[series.index]).transform("mean")
    return float((means**2).sum() / (series**2).sum()) if series.any() else 0.0


def fold(search, number: int) -> float | None:
    """Period s over which the effect of a finding on its reading repeats, fitted or of the manoeuvre, or None."""
    view, known = shown(search, number), outcome_of(search)
    if view is None or not 0 <= number < len(known.findings):
        return None
    _, time, curves = view
    frequency = known.findings[number].parameters.get("frequency")
    periods = [*([1 / frequency.value] if frequency and frequency.value else []), *known.readings.periods]
    added = curves["extended"] - curves["simulated"]
    fast = {p: _quick(time, added, p) for p in periods if 3 * p < time[-1]}
    kept = {p: _kept(v, _bins(time, p)) for p, v in fast.items() if np.nanvar(v) > SLOW * np.nanvar(added)}
    best = max(kept, key=kept.get, default=None)
    return best if best is not None and kept[best] > KEPT else None


def _quick(time, values, period):
    """High-passed values (n,): less their running mean over a period s, NaN where the window is not complete."""
    window = max(1, round(period / float(np.median(np.diff(time)))))
    fast = values - pd.Series(values).rolling(window, center=True, min_periods=1).mean().to_numpy()
    fast[: window // 2] = fast[values.size - window // 2 :] = np.nan
    return fast


def _bins(time, period):
    """Phase bin (n,) of each epoch s in a period s; the most bins, up to `PHASES`, that all have a sample."""
    for count in range(PHASES, 1, -1):
        index = np.minimum((time % period * (count / period)).astype(int), count - 1)
        if np.unique(index).size == count:
            break
    return index


def reading(search, number: int):
    """Figure of the reading that a finding (-1: least likely band) explains most, and its residual by both models."""
    view, period = shown(search, number), fold(search, number)
    if view is None:
        return None
    place_shown, time, curves = view
    curves = {side: _quick(time, v, period) for side, v in curves.items()} if period else curves
    measured = curves["measured"]
    models = [(curves["simulated"], STYLES["simulated"]), (curves["extended"], STYLES["extended"])]
    models = [model for model in models if np.isfinite(model[0]).any()]
    place, index = _places(time, models[-1][0] - (models[0][0] if len(models) > 1 else measured), period)
    whole = search[f"{place_shown.channel}_measured"]
    axis = f" {'xyz'[place_shown.axis]}" if whole.shape[1] > 1 else ""
    rows = {
        f"{place_shown.channel}{axis}": [*models, (measured, STYLES["measured"])],
        "difference": [(measured - values, style) for values, style in models],
    }
    along = "time from the first sample (s)" if period is None else "phase (s)"
    drawn, panels = grid(2, 1, 3.0, xlabel=along, sharex=True, margins={"hspace": 0.12, "left": 0.1})
    for (panel,), (label, series) in zip(panels, rows.items(), strict=True):
        means = [(pd.Series(values).groupby(index).agg(["mean", "sem"]), style) for values, style in series]
        factor, unit = plain.prefixed(max(float(mean["mean"].abs().max()) for mean, _ in means), whole.attrs["units"])
        for mean, style in means:
            value, error = (factor * mean[name].to_numpy() for name in ("mean", "sem"))
            if place.size < time.size and (label == "difference" or style is STYLES["measured"]):
                small = {"marker": ".", "markersize": 3.5, "elinewidth": 0.6, "capsize": 0}
                bars(panel, place, value, None if style is STYLES["measured"] else error, **style, **small)
            else:
                panel.plot(*thinned(place, value), **style)
        panel.set_ylabel(f"{label} ({unit})")
    panels[1, 0].axhline(0.0, **NOISE)
    return drawn


def _places(time, added, period):
    """Abscissae (m,) s of bins, and bin (n,) of each sample: phases of a period, parts of the record, or samples."""
    if period is not None:
        count = max(index := _bins(time, period)) + 1
        return (np.arange(count) + 0.5) * period / count, index
    index = np.minimum((time / time[-1] * STRETCHES).astype(int), STRETCHES - 1)
    if time.size > 4 * STRETCHES and _kept(added, index) > KEPT:
        return (np.unique(index) + 0.5) * time[-1] / STRETCHES, index
    return time, np.arange(time.size)


def caption(search, number: int, readings_of: Mapping[str, str]) -> str:
    """Caption of the figure of a finding, "" if none is shown; `readings_of` {channel: sentence on its readings}."""
    view, period = shown(search, number), fold(search, number)
    if view is None:
        return ""
    subject = f"Finding {number + 1}" if number >= 0 else "The least likely band"
    folded = f" Folded over {period:.4g} s, without what changes in longer times." if period else ""
    details = readings_of.get(view[0].channel, " Its mean is left out.")
    details += WORDS.note("rebuilt") if "rebuilt" in search.attrs else ""
    return WORDS.note("reading", what=subject, folded=folded, own=details, **vars(view[0]))
