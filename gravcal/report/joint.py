"""Report of a search over many events: document, page, model of the satellite, and changes since the last search."""

import datetime
import itertools
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np
import xarray as xr

from gravcal import toml
from gravcal.estimation import chi2_tail
from gravcal.estimation.moving import YEAR_S, Moving, moving
from gravcal.report import discovery_words as words
from gravcal.report import documents, pages
from gravcal.report.discovery import parameter_rows
from gravcal.report.figures import COLOURS, mark, over_time
from gravcal.report.pages import Section
from gravcal.report.plain import EPOCH, as_plain, number, plus_minus, probability, quantity, signed
from gravcal.store import product

AHEAD_S, STEP_S = 0.5 * YEAR_S, YEAR_S / 12  # span of the prediction after the last event, and its step
CHANGED = 3.0  # sigma of a change from which it is noted


def _scope(scope):
    """Scope of a law ("constant", "each", name of a quantity ...) in words."""
    return WORDS.notes["scopes"].get(scope, f"follows {scope}")


WORDS = pages.words(__file__, "joint.toml", cause=words.title, scope=_scope)


def report(search, products, *, history, settings, calibration, event, satellite):
    """(Dataset with the calibration's values in each event, {file: text} of document, page and model of the satellite).

    `products` are {event: evidence}, `history` {"trims": [{"date", "axis", "size", "confirmed"}], "printed": [{"time",
    "parameter", "value", "sigma"}]}, `settings` the configuration and the events left out with the reason.
    """
    result, known = search.run(), search.events[0]
    scale, names, unit = np.array(known.scale), list(known.parameters), known.unit
    time = np.array([one.time for one in search.events])
    value, spread = result.offset * scale, result.spread * np.multiply.outer(scale, np.ones((len(time), 1))) * scale
    moves, shared = {}, set.intersection(*(set(one.measured) for one in search.events))
    fuel = {q: np.array([one.measured[q] for one in search.events]) for q in sorted(shared) if q.startswith("fuel")}
    for k, name in enumerate(names):
        steps = sorted(seconds(t["date"]) for t in history["trims"] if t["axis"] == name)
        moves[name] = moving(time, value[:, k], spread[:, k, :, k], steps, fuel)
    left_out, sigma = [one.left_out() for one in moves.values()], np.sqrt(np.einsum("ipip->ip", spread))
    contradicting = [asdict(one) for one in result.contradicting]
    for name, scores in zip(names, left_out, strict=True) if len(time) > 3 else ():  # that the motion does not foretell
        for one, score in zip(search.events, scores, strict=True):
            p_value = float(np.exp(chi2_tail.log_tail(score**2, 1))) * len(time) * len(names)
            about = {"event": one.name, "chi2": float(score**2), "dof": 1, "p": p_value, "parameter": name}
            contradicting += [about] if p_value < search.level else []
    rows = []
    for k, one in enumerate(search.events):
        row = {"event": one.name, "time": one.time, "value": value[k], "sigma": sigma[k]}
        row |= {name: scale * result.alone[k, :, n] for n, name in enumerate(("alone", "sigma_alone"))}
        rows.append(row | {"left_out": [score[k] for score in left_out], "measured": dict(one.measured)})
    common = scale * np.array(known.common)
    body = {
        "status": "delivered",
        "kind": "joint",
        "satellite": satellite,
        "parameters": names,
        "unit": unit,
        "events": rows,
        "causes": as_plain([_cause(search, one) for one in result.named]),
        "covariance": result.covariance,
        "contradicting": contradicting,
        "motion": {name: _motion(one, history["trims"], name, fuel) for name, one in moves.items()},
        "predicted": predicted(moves, np.arange(time[0], time[-1] + AHEAD_S + STEP_S, STEP_S), common),
        "tried": result.tried,
        "followed": search.followed,
        "not_followed": search.not_followed,
        "level": search.level,
        "provenance": {"products": {name: product.digest(one)[:12] for name, one in products.items()}},
    }
    body["verdict"] = {"text": WORDS.note("verdict", **body)}
    document = documents.delivered(calibration, body, products, [], event=event, settings=settings)
    files = {
        "joint.json": documents.text(document),
        "satellite_model.toml": model_text(document, search, result),
        "joint.html": page(document, moves, history),
    }
    dims, attributes = ("event", "parameter"), {"units": "1", "long_name": f"parameters in {unit}"}
    variables = {"time_event": ("event", time, {"units": "s", "long_name": "middle of the manoeuvres, GPS"})}
    variables |= {"value": (dims, value, attributes), "sigma": (dims, sigma, attributes | {"long_name": "errors"})}
    return xr.Dataset(variables, attrs={"status": "delivered"}), files


def seconds(day: str) -> float:
    """GPS s of the begin of a day YYYY-MM-DD."""
    return (datetime.datetime.fromisoformat(day) - EPOCH).total_seconds()


def date(time: float) -> datetime.datetime:
    """Calendar date and time of GPS s."""
    return EPOCH + datetime.timedelta(seconds=float(time))


def day(time: float) -> str:
    """Day YYYY-MM-DD of GPS s."""
    return date(time).date().isoformat()


def _cause(search, one) -> dict:
    """Document entry of a `joint.Named`: law, values, ties, values by event, and chi-square that these are equal."""
    cause = search.causes[one.law.cause]
    of_event, chi2, dof = one.apart

    def parameters(value, sigma):  # {name: {"value", "sigma", "unit"}} of (q,), (q,)
        columns = zip(cause.names, value, sigma, cause.units, strict=True)
        return {name: {"value": v, "sigma": e, "unit": unit} for name, v, e, unit in columns}

    return {
        "cause": cause.slug,
        "form": cause.form,
        "scope": one.law.scope,
        "values": [
            {"of": label, "parameters": parameters(one.value[k], one.sigma[k])}
            for k, label in enumerate(one.law.labels)
        ],
        "by_event": [
            {"event": event.name, "parameters": parameters(*np.reshape(own, (-1, 2)).T)}
            for event, own in zip(search.events, of_event, strict=True)
        ],
        "repeats": {
            "said": one.law.scope == "constant" and len(one.law.labels) == 1,
            "chi2": chi2,
            "dof": dof,
            "p": float(np.exp(chi2_tail.log_tail(chi2, dof))) if dof else None,
        },
        "gain": one.gain,
        "dof": one.dof,
        "significance": one.significance,
        "evidence": one.score,
        "heldout": number(one.heldout),
        "tied_with": [row.cause for row in one.ties if row.tied],
        "broken": [asdict(row) for row in one.ties if not row.tied],
        "separation": [asdict(row) for row in one.ties],
    }


def _motion(one: Moving, trims, name, fuel):
    """Document entry of a parameter's motion: slope per year, steps, dependence on fuel (or null), random walk."""
    terms, first = [{"value": v, "sigma": s} for v, s in np.transpose(one.terms()).tolist()], 2 + len(one.steps)
    sizes, steps = {seconds(t["date"]): t["size"] for t in trims if t["axis"] == name}, []
    for epoch, term in zip(one.steps, terms[2:first], strict=True):
        steps.append({"date": day(epoch), **term, "found": epoch in one.discovered, "printed": sizes.get(epoch)})
    follows = dict.fromkeys(fuel) | dict(zip(one.follows, terms[first:], strict=True)) or None
    walk = float(np.sqrt(sum(w * q**2 for w, q, _ in one.options())))
    return {"slope_per_year": terms[1], "steps": steps, "follows": follows, "walk_per_root_year": walk}


def predicted(moves, times, common=None) -> list[dict]:
    """[{"date", "value", "sigma"}] of p parameters at times, GPS s; `common` (p,) is an error that all events share."""
    if not moves:
        return []
    value, sigma = np.transpose([one.predicted(np.asarray(times)) for one in moves.values()], (1, 2, 0))
    sigma = np.hypot(sigma, 0.0 if common is None else common)
    return [
        {"date": day(t), "value": v.tolist(), "sigma": e.tolist()} for t, v, e in zip(times, value, sigma, strict=True)
    ]


def model_text(document, search, result) -> str:
    """TOML of the model of a satellite: effects with the days for which they hold, as `--model` reads them; motion."""
    effects, first = [], 0
    for one, entry in zip(result.named, document["causes"], strict=True):
        many, count = one.value.shape if one.value.size else (0, 0)
        names, units = search.causes[one.law.cause].names, search.causes[one.law.cause].units
        covariance = result.covariance[first : first + many * count, first : first + many * count]
        first += many * count
        for begin, end, weights in _spans(search, one.law):
            weighting = np.kron(weights, np.eye(count))
            spread = weighting @ covariance @ weighting.T
            sigma = np.sqrt(np.diag(spread))
            effect = {name: entry[name] for name in ("cause", "form", "scope", "tied_with")}
            effect |= {"from": begin or None, "to": end or None, "parameters": {}}
            for k, (name, v) in enumerate(zip(names, weighting @ one.value.ravel(), strict=True)):
                others = {names[j]: round(float(spread[k, j] / sigma[k] / sigma[j]), 6) for j in range(count) if j != k}
                row = {"value": float(v), "sigma": float(sigma[k]), "unit": units[k], "correlation": others}
                effect["parameters"][name] = row
            effects.append(effect)
    model = {name: document[name] for name in ("satellite", "calibration")} | {"effect": effects}
    model["motion"] = {name: document[name] for name in ("unit", "parameters", "covariance")} | document["motion"]
    model["predicted"] = document["predicted"]
    count = len(document["events"])
    note = f"Found by gravcal discover --joint in {count} events; gravcal run takes it with --model."
    return toml.text({name: one for name, one in model.items() if one}, note)


def _spans(search, law):
    """[(first day, day after last, "" if open; weights (1, k))] of spans of equal values of a Law, [] for "each".

    A span begins after the last day of that before. What holds for one event alone has its day, also beside others.
    """
    days = [(day(one.time), day(one.time + 86400.0)) for one in search.events]
    if law.scope not in ("constant", "epochs"):  # it follows what was measured: event by event
        return [(*d, w[None]) for d, w in zip(days, law.weights, strict=True) if w.any()]
    plain = search.plain(law).weights
    weights = np.pad(plain, [(0, 0), (0, law.weights.shape[1] - plain.shape[1])])  # sets of single events are last
    cuts = [0, *(np.flatnonzero(np.any(np.diff(weights, axis=0), axis=1)) + 1), len(days)]
    middles = [max(day((search.events[k - 1].time + search.events[k].time) / 2), days[k - 1][1]) for k in cuts[1:-1]]
    bounds = ["", *middles, ""]
    spans = list(zip(bounds[:-1], bounds[1:], (weights[k][None] for k in cuts[:-1]), strict=True))
    for (first, last), own, other in zip(days, law.weights, weights, strict=True):
        if (own != other).any():
            before = [(a, min(b or first, first), w) for a, b, w in spans if a < first]
            after = [(max(a, last), b, w) for a, b, w in spans if not b or last < b]
            spans = [*before, (first, last, own[None]), *after]
    return [span for span in spans if span[2].any()]


def changes(before: dict, after: dict) -> list[str]:
    """Lines on changes beyond their error from one joint document to the next; [] where the first is empty."""
    if not before:
        return []
    lines, unit = [], after["unit"]
    old, new = ({(c["cause"], c["scope"]) for c in one["causes"]} for one in (before, after))
    for word, causes in (("new", new - old), ("no longer named", old - new)):
        lines += [f"{word}: {words.title(cause)}, {_scope(scope)}" for cause, scope in sorted(causes)]
    known = {one["event"] for one in before["events"]}
    new_events = [one for one in after["events"] if one["event"] not in known]
    for k, name in enumerate(after["parameters"]):
        for one in new_events:
            last = max((e for e in before["events"] if e["time"] < one["time"]), default=None, key=lambda e: e["time"])
            if last is None:
                continue
            move, error = one["value"][k] - last["value"][k], np.hypot(one["sigma"][k], last["sigma"][k])
            if abs(move) > CHANGED * error:
                motion = after["motion"][name]
                reasons = [
                    f"{'step found about' if s['found'] else 'trim of'} {s['date']} explains {signed(s['value'], 0)}"
                    for s in motion["steps"]
                    if last["time"] < seconds(s["date"]) <= one["time"]
                ]
                slope, sigma = (v * (one["time"] - last["time"]) / YEAR_S for v in motion["slope_per_year"].values())
                reasons += [f"its slope explains {signed(slope, 0)}"] * bool(abs(slope) > max(error, CHANGED * sigma))
                text = (
                    f"{after['calibration']} {name} moved by {plus_minus(move, error)} {unit} since {day(last['time'])}"
                )
                lines.append(f"{text}: {'; '.join(reasons) or 'neither trim nor slope explains it'}")
    earlier = {one["event"] for one in before["contradicting"]}
    lines += [f"{one['event']} contradicts the others" for one in after["contradicting"] if one["event"] not in earlier]
    return lines


def shared(documents: Sequence[dict]) -> list[str]:
    """Causes that the models of several satellites have in common, and whether their values agree, one line each."""
    lines = []
    for one, other in itertools.combinations(documents, 2):
        for (a, value, spread), (b, known, error) in itertools.product(_values(one), _values(other)):
            names = {a["cause"], *a["tied_with"]} & {b["cause"], *b["tied_with"]}
            text = f"{one['satellite']} and {other['satellite']}: {', '.join(map(words.title, sorted(names)))} in both"
            laws = [(one["cause"], one["form"], [v["of"] for v in one["values"]]) for one in (a, b)]
            if laws[0] == laws[1]:
                difference = value - known
                chi2 = float(difference @ np.linalg.solve(spread + error, difference))
                p_value = float(np.exp(chi2_tail.log_tail(chi2, difference.size)))
                agree = "agree" if p_value > one["level"] else "differ"
                text += f", values {agree} (chi-square {chi2:.1f} of {difference.size})"
            lines += [text] * bool(names)
    return lines


def _values(document):
    """(cause, values (r,), covariance (r, r)) of each cause with values of its own."""
    first = 0
    for one in document["causes"]:
        value = np.array([p["value"] for v in one["values"] for p in v["parameters"].values()])
        own = slice(first, first + value.size)
        first = own.stop
        if value.size:
            yield one, value, np.array(document["covariance"])[own, own]


def page(document, moves, history) -> str:
    """HTML page of a joint search; moves {parameter: Moving}, no section of them if empty; history as of `report`."""
    drawn = replace(_motion_figure, arguments=(document, moves, history))
    ties = [{"named": one["cause"]} | tie for one in document["causes"] for tie in one["separation"]]
    shared_by, by_event = [], []
    for one in document["causes"]:
        heldout, repeats = "" if one["heldout"] is None else f"{one['heldout']:.0f}", one["repeats"]
        cells = _scope(one["scope"]), f"{one['gain']:.0f}", heldout, probability(one["significance"]), "", ""
        shared_by.append([words.title(one["cause"]), *cells])
        for values in one["values"]:
            shared_by += parameter_rows((f"{n}, {values['of']}", *p.values()) for n, p in values["parameters"].items())
        repetition = "repeats" if repeats["said"] else "does not repeat"
        by_event.append([words.title(one["cause"]), "", repetition, f"{repeats['chi2']:.1f} of {repeats['dof']}"])
        for own in one["by_event"]:
            known = [(name, quantity(**p)) for name, p in own["parameters"].items() if p["value"] is not None]
            by_event += [[None, f"{own['event']} {name}", text, ""] for name, text in known]
    causes = [WORDS.table("causes", shared_by, tried=document["tried"]), WORDS.table("apart", by_event)]
    sections = [
        Section("How the calibration moves", [_motion_table(document), _event_table(document)], [drawn]),
        Section("Causes that events share", causes),
        Section("Ties", [WORDS.table("ties", ties)], notes=[WORDS.note("ties")]),
        Section("Contradictions", [WORDS.table("contradictions", document)], notes=[WORDS.note("alone")]),
    ]
    sections = [one for one in sections[0 if moves else 1 :] if any(table.rows for table in one.tables)]
    subtitle = WORDS.note("subtitle", **document)
    return pages.page(document, sections, {}, heading="What many events say together", subtitle=subtitle)


@WORDS.figure()
def _motion_figure(document, moves, history):  # Figure: values of events, prediction, printed values, steps
    events, printed = document["events"], history["printed"]
    known = [one["time"] for one in (*events, *printed)]
    times = np.linspace(min(known), max([events[-1]["time"] + AHEAD_S, *known]), 400)
    drawn, panels = over_time([f"{name} ({document['unit'].replace('um', 'µm')})" for name in moves])
    for k, (panel, (name, one)) in enumerate(zip(panels, moves.items(), strict=True)):
        mean, sigma = one.predicted(times)
        dates, band = [date(t) for t in times], {"color": COLOURS["sky"], "alpha": 0.3, "linewidth": 0}
        panel.fill_between(dates, mean - sigma, mean + sigma, label="predicted", **band)
        panel.plot(dates, mean, color=COLOURS["sky"], linewidth=0.8)
        mark(
            panel, "measured", [(date(e["time"]), e["value"][k], e["sigma"][k]) for e in events], "all events together"
        )
        mark(panel, "printed", [(date(p["time"]), p["value"], p["sigma"]) for p in printed if p["parameter"] == name])
        for step in document["motion"][name]["steps"]:
            look = {"color": COLOURS["black"], "linewidth": 0.8, "linestyle": ":" if step["found"] else "--"}
            panel.axvline(date(seconds(step["date"])), **look)
    return drawn


def _event_table(document):  # Table: values of each event, jointly and alone, and left-out residual over sigma
    rows = []
    for one in document["events"]:
        pairs = zip(one["value"], one["sigma"], one["alone"], one["sigma_alone"], strict=True)
        cells = [text for v, s, a, b in pairs for text in (plus_minus(v, s), plus_minus(a, b))]
        rows.append([day(one["time"]), one["event"], *cells, ", ".join(signed(v, 1) for v in one["left_out"])])
    names = [f"{name}{which}" for name in document["parameters"] for which in ("", ", alone")]
    heads = ["date", "event", *names, "over error, left out"]
    return WORDS.table("events", rows, heads=heads, unit=document["unit"])


def _motion_table(document):  # Table: slope, random walk, steps and dependence on fuel of each parameter
    rows = []
    for name, one in document["motion"].items():
        slope, walk = one["slope_per_year"], one["walk_per_root_year"]
        rows.append([name, "slope per year", "", plus_minus(slope["value"], slope["sigma"]), f"{walk:.2g}"])
        for s in one["steps"]:
            what = "step that was found" if s["found"] else f"trim, printed {signed(s['printed'], 0)}"
            rows.append([None, what, s["date"], plus_minus(s["value"], s["sigma"]), ""])
        for cause, v in (one["follows"] or {}).items():
            rows.append([None, f"per unit of {cause}", "", plus_minus(**v) if v else "none seen", ""])
    return WORDS.table("motion", rows, unit=document["unit"])
