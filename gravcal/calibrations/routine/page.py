"""Report of a routine day: a section for each instrument with measured and simulated readings, causes, gaps."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gravcal.calibrations import schemas
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.routine.accelerometer import COMPONENTS, PAIRS
from gravcal.calibrations.schemas import build
from gravcal.estimation.outcome import Outcome, outcome_of
from gravcal.estimation.quantities import plain
from gravcal.report import discovery, discovery_words, documents
from gravcal.report.discovery import findings_table, tied_table
from gravcal.report.figures import AXIS, COLOURS, thinned
from gravcal.report.named_parameters import Page, document, parameter_table
from gravcal.report.pages import Section, page, words
from gravcal.report.plain import number

WORDS = words(__file__, "page.toml")
TITLES = {"thrusters": "Star cameras and thrusters"}
PROVEN = WORDS.notes["proven"]
#: Parts whose searches date the records that the accelerometer needs, their delays as causes, largest usual lag s.
HOLDERS, LATE_S = ("magnetometer", "thrusters"), 10.0
HELD = ("timing.star_camera_delay", "timing.magnetometer_delay", "timing.orbit_delay")
#: Variables of the estimate of a part with what was measured and the same as simulated, and their unit.
SERIES = {
    "accelerometer": ("measured", "fitted", ""),
    "magnetometer": ("residual_b", "fitted_b", "T"),
    "ranging": ("residual", "fitted", "m"),
}


def content(products):
    """Facts {name: number} and sections of the accelerometer, from products {stage: Dataset}."""
    estimate, aligned = products["estimate"], products["align"]
    swings, epoch = estimate["transient_swings"].values, estimate["transient"].values
    step, rate = float(aligned["step"]), np.abs(aligned["dipole_rate_b"].values).max(axis=1)
    delay = float(estimate["value"].sel(parameter="delay").fillna(0.0))
    times, fired = estimate["time"].values, aligned["firing"].values - delay
    near = np.searchsorted(aligned["time"].values, estimate["transient"].values - step / 4)
    facts = {
        "seconds": step * estimate.sizes["time"],
        "firings": int(np.sum((fired > times[0]) & (fired < times[-1]))),
        "transients": int(swings.size),
        "transients_that_swing": int(np.sum(swings >= 2)),
        "transients_near_a_firing": int(np.sum([np.any(np.abs(fired - one) < 3 * step) for one in epoch])),
        "transients_at_a_change_of_current": int(np.sum(rate[near] > 3 * np.sqrt(np.mean(rate**2)))),
    }
    facts |= thrust_and_inertia(estimate, aligned)
    return facts, [Section("Accelerometer", figures=[_readings], notes=WORDS.notes["accelerometer"])]


def thrust_and_inertia(estimate, aligned) -> dict:
    """Facts by axis: thrust and torquers over nominal, [ratio, sigma] or None, and what is wrong of thrust and inertia.

    A moment of inertia that is too large by a share makes both larger by it, a thrust the firings alone.
    """
    names = [str(name) for name in estimate["parameter"].values]
    value, sigma = (dict(zip(names, estimate[one].values, strict=True)) for one in ("value", "sigma"))
    facts = {}
    for axis, letter in enumerate("xyz"):
        ratios = []
        for pair, nominal in zip(PAIRS, aligned["nominal_b"].values[:, axis], strict=True):
            name = f"torque_{pair}_{letter}"
            if abs(nominal) > 1e-6 and np.isfinite(value[name]):
                ratios.append((value[name] / nominal, sigma[name] / abs(nominal)))
        thrust = ratios and np.average([r[0] for r in ratios], weights=[r[1] ** -2 for r in ratios])
        error = sum(r[1] ** -2 for r in ratios) ** -0.5 if ratios else None
        torquer = value[f"torquer_{letter}"], sigma[f"torquer_{letter}"]
        facts[f"thrust_over_nominal_{letter}"] = [thrust, error] if ratios else None
        facts[f"torquers_over_nominal_{letter}"] = list(torquer) if np.isfinite(torquer[0]) else None
        if ratios and np.isfinite(torquer[0]):
            score = (thrust - torquer[0]) / np.hypot(error, torquer[1])  # in sigma
            off = abs(torquer[0] - 1) > 3 * torquer[1]
            text = "thrust" if abs(score) > 3 and not off else "thrust and inertia or dipole" if abs(score) > 3 else ""
            text = text or ("inertia (or angular scale): both are off alike" if off else "")
            text = text or ("thrust or inertia" if abs(thrust - 1) > 3 * error else "none is seen to be wrong")
            facts[f"wrong_about_{letter}"] = text
    return facts


def report(
    *datasets,
    names: Sequence[str],
    missing: Mapping[str, str],
    pages: Mapping[str, Page],
    event: str,
    settings: Mapping,
):
    """Report product of a day and its files {name: text}; names "part.stage" of datasets, missing {part: reason}."""
    products = dict(zip(names, datasets, strict=True))
    searches = {part: products[f"{part}.discovery"] for part in pages if f"{part}.discovery" in products}
    if _of_other_times({part: outcome_of(one) for part, one in searches.items()}):
        products.pop("accelerometer.discovery", None)  # void: it is held against records of other times
    instruments, sections, parameters, checked = {}, [], {}, []
    for part, layout in pages.items():
        if f"{part}.estimate" not in products:
            why = missing.get(part, "not asked for")
            instruments[part] = {"status": "missing", "said": why, "proven_on": PROVEN[part]}
            sections.append(Section(title(part), notes=(f"Not simulated: {why}. Proven on {PROVEN[part]}.",)))
            continue
        mine = {name.partition(".")[2]: one for name, one in products.items() if name.startswith(f"{part}.")}
        instruments[part], shown = _instrument(part, layout, mine)
        sections.append(shown)
        parameters |= {f"{part}_{name}": one for name, one in instruments[part]["parameters"].items()}
        checked += [replace(one, name=f"{part}: {one.name}") for one in of_product(mine["checks"])]
    fitted = [one["said"] for one in instruments.values() if one["status"] == "fitted"]
    absent = [f"{part}: {one['said']}" for part, one in instruments.items() if one["status"] == "missing"]
    text = f"{'; '.join(fitted)}."
    text += f" Missing: {'; '.join(absent)}." if absent else ""
    body = {"status": "delivered", "verdict": {"text": text}, "instruments": instruments, "parameters": parameters}
    made = documents.delivered("routine", body, products, checked, event=event, settings=settings)
    files = {"result.json": documents.text(made)}
    files["report.html"] = page(made, sections, products, heading="Routine day", subtitle=event)
    return build(schemas.of("shared.toml")["report"], {"delivered": 1}, event=event), files


def _instrument(part, layout, products):
    """Entry of the document, and section, of one instrument, from its Page and its products {stage: Dataset}."""
    facts, sections = layout.content(products)
    extra, _ = layout.more(products)
    known = document(products["estimate"])
    outcome = outcome_of(products["discovery"]) if "discovery" in products else None
    findings, statistics = outcome.findings if outcome else (), _statistics(part, products)
    named = [{n: plain(f)[n] for n in ("cause", "form", "parameters", "tied_with", "significance")} for f in findings]
    verdict = ", ".join(discovery_words.title(one.cause) for one in findings) or "nothing is named"
    verdict = verdict if outcome else "not searched"
    summary = f"{part}: {verdict}" + (", and more is left than noise" if outcome and not outcome.adequate_after else "")
    result = {"status": "fitted", "said": summary, "proven_on": PROVEN[part], "statistics": statistics, "causes": named}
    numbers = {"adequate": "adequate_after", "p_before": "p_before", "p_after": "p_after"}
    result |= {name: getattr(outcome, field, None) for name, field in numbers.items()}
    tables = [WORDS.table("statistics", statistics)]
    tables += [findings_table(findings), tied_table(findings)] if findings else []
    tables += [parameter_table(known["parameters"], f"{part}.estimate"), *_placed(part, sections, "tables")]
    notes = [*(note for one in sections for note in one.notes), f"Proven on {PROVEN[part]}."]
    section = Section(title(part), tables, _placed(part, sections, "figures"), notes)
    return result | known | extra | {"facts": facts}, section


def _placed(part, sections, kind):
    """Tables or figures (`kind`) of sections, their `reads` prefixed by the part so that they find its products."""
    every = [one for section in sections for one in getattr(section, kind)]
    return [replace(one, reads=[f"{part}.{name}" for name in one.reads]) for one in every]


def _of_other_times(searches: Mapping[str, Outcome | None]) -> str:
    """Why the search of the accelerometer is void, "" if not: HOLDERS have tags more than LATE_S off."""
    lags = []
    for outcome in filter(None, map(searches.get, HOLDERS)):
        for one in outcome.findings:
            delay = one.parameters["delay"].value if one.cause in HELD and "delay" in one.parameters else None
            if delay is not None and abs(delay) > LATE_S:
                lags.append(f"{discovery_words.title(one.cause)} {delay:.0f} s")
    return f"its records are of different times ({', '.join(lags)})" if lags else ""


def title(part: str) -> str:
    """Heading of a part, by its name."""
    return TITLES.get(part, part.capitalize())


def discovered(*searches, parts: Mapping, missing: Mapping[str, str], reported: Mapping, event: str, settings: Mapping):
    """Report product of the searches of all parts, and its files: document, page, and a model of each that takes one.

    Parts are {part: calibration, event and settings}, missing {part: why it has none}, reported {part: Reported}.
    """
    void = _of_other_times({p: outcome_of(one) for p, one in zip(parts, searches, strict=True)})
    searched = {part: (known, one) for (part, known), one in zip(parts.items(), searches, strict=True)}
    if void and searched.pop("accelerometer", None):
        missing = {**missing, "accelerometer": void}
    state = {part: {"status": "no_data", "said": why} for part, why in missing.items()}
    sections, files, findings, products = [], {}, [], {}
    for part, (known, one) in searched.items():
        judged, outcome = discovery.judged(one, **known, reported=reported[part])
        state[part] = judged | {"proven_on": PROVEN[part]}
        findings += [finding | {"part": part} for finding in judged["findings"]]
        shown = discovery.sections(one, outcome, reported[part])
        notes = [judged["verdict"]["text"], reported[part].note, f"Proven on {PROVEN[part]}."]
        sections.append(Section(title(part), _placed(part, shown, "tables"), _placed(part, shown, "figures"), notes))
        products[f"{part}.discovery"] = one
        if outcome.findings and "model" in known["settings"]:
            text = discovery.model_text(outcome.findings, known["event"])
            files |= {f"{part}.toml": text} if text else {}
    sections += [Section(title(part), notes=[f"Not searched: {why}."]) for part, why in missing.items()]
    results = {part: one for part, one in state.items() if part in searched}
    sentences = [f"{title(part)}: {one['verdict']['text']}" for part, one in results.items()]
    sentences += [f"{title(part)}: not searched, {why}." for part, why in missing.items()]
    body = {
        "status": max(one["status"] for one in results.values()),  # questionable if one is
        "kind": "discovery",
        "verdict": {"text": " ".join(sentences)},
        "findings": findings,
        **{when: all(one[when] for one in results.values()) for when in ("adequate_before", "adequate_after")},
        "parts": state,
        "gain": {part: one["gain"] for part, one in results.items()},
        "unexplained": {part: one["unexplained"] for part, one in results.items() if one["unexplained"]},
        "indistinguishable_from_calibration": [],
        "calibration_change": {},
    }
    result = documents.delivered("routine", body, products, [], event=event, settings=settings)
    heading, subtitle = "What the models of a routine day get wrong", f"{len(parts)} of {len(state)} parts have records"
    files["discovery.json"] = documents.text(result)
    files["discovery.html"] = page(result, sections, products, heading=heading, subtitle=subtitle)
    return build(schemas.of("shared.toml")["report"], {"delivered": 1}, event=event), files


def _statistics(part, products):
    """Rows {"what", "measured_rms", "residual_rms", "unit"}: rms of what is fitted and left; thrusters: noise alone."""
    if part == "thrusters":  # noise of each head about each axis, from stretches without firings
        noise, rows = products["noise"], []
        for head, factor in zip(noise["head"].values, noise["factor"].values, strict=True):
            sigma = np.sqrt(np.diag(np.linalg.inv(factor.T @ factor)))
            rows += [(f"head {int(head)} {axis}", None, float(v), "rad") for axis, v in zip("xyz", sigma, strict=True)]
    else:
        measured, fitted, unit = SERIES[part]
        series = [np.atleast_2d(products["estimate"][name].values.T) for name in (measured, fitted)]
        labels = COMPONENTS if part == "accelerometer" else ["range"] if part == "ranging" else "xyz"
        rms = [[number(np.sqrt(np.nanmean(one**2))) for one in both] for both in (series[0], series[0] - series[1])]
        units = [unit if part != "accelerometer" else "m s-2" if c < 3 else "rad s-2" for c in range(len(rms[0]))]
        rows = zip(labels, *rms, units, strict=True)
    return [dict(zip(("what", "measured_rms", "residual_rms", "unit"), row, strict=True)) for row in rows]


@WORDS.figure("estimate")
def _readings(panels, estimate):  # measured and simulated readings, nm s-2 and urad s-2, of each component
    minutes = (estimate["time"].values - estimate["time"].values[0]) / 60
    black = {"color": COLOURS["black"], "linewidth": 0.5, "label": "simulated"}
    for c, panel in enumerate(panels):
        factor = 1e9 if c < 3 else 1e6
        own = AXIS["xyz"[c % 3]] | {"linewidth": 0.5, "label": "xyz"[c % 3]}
        panel.plot(*thinned(minutes, factor * estimate["measured"].values[:, c]), **own)
        panel.plot(*thinned(minutes, factor * estimate["fitted"].values[:, c]), **black)


PAGE = Page("routine", "Accelerometer", "Accelerometer", ("estimate", "align", "checks"), content)
