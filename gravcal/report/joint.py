"""What a search over many events delivers: document, page, the model of the satellite, and what a new event changed."""

import datetime
import itertools
import json
from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from gravcal import toml
from gravcal.estimation import chi2_tail
from gravcal.estimation.moving import YEAR_S, Moving, moving
from gravcal.report import discovery_words as words
from gravcal.report import documents, pages
from gravcal.report.figures import COLOURS, grid, legend
from gravcal.report.pages import Figure, Section, Table
from gravcal.report.plain import measured, plus_minus, probability, signed
from gravcal.store import product
from gravcal.store.schemas import VERSION, validate

EPOCH = datetime.datetime(2000, 1, 1, 12)
AHEAD_S, STEP_S = 0.5 * YEAR_S, YEAR_S / 12
CHANGED = 3.0  # errors of a change from which it is worth a note


def report(search, products, *, history, settings, calibration, event, satellite):
    """Product with the calibration's values in each event, and its files: document, page and model of the satellite.

    Parameters
    ----------
    search : of all events; products : {event: evidence}
    history : {"trims": [{"date", "axis", "size", "confirmed"}], "printed": [{"time", "parameter", "value", "sigma"}]}
    settings : configuration, and events left out with the reason; calibration, event, satellite : names
    """
    result, known = search.run(), json.loads(next(iter(products.values())).attrs["numbers"])
    scale, names, unit = np.array(known["scale"]), known["parameters"], known["unit"]
    time = np.array([one.time for one in search.events])
    value, spread = result.offset * scale, result.spread * np.multiply.outer(scale, np.ones((len(time), 1))) * scale
    moves, shared = {}, set.intersection(*(set(one.measured) for one in search.events))
    fuel = {q: np.array([one.measured[q] for one in search.events]) for q in sorted(shared) if q.startswith("fuel")}
    for k, name in enumerate(names):
        steps = sorted(seconds(t["date"]) for t in history["trims"] if t["axis"] == name)
        moves[name] = moving(time, value[:, k], spread[:, k, :, k], steps, fuel)
    left_out, sigma = [one.left_out() for one in moves.values()], np.sqrt(np.einsum("ipip->ip", spread))
    rows = [
        {
            "event": one.name,
            "time": one.time,
            "value": value[k].tolist(),
            "sigma": sigma[k].tolist(),
            "alone": (scale * result.alone[k, :, 0]).tolist(),
            "sigma_alone": (scale * result.alone[k, :, 1]).tolist(),
            "left_out": [float(away[k]) for away in left_out],
            "measured": dict(one.measured),
        }
        for k, one in enumerate(search.events)
    ]
    common = scale * np.array(known["common"])
    document = {
        "schema_version": VERSION,
        "status": "delivered",
        "calibration": calibration,
        "kind": "joint",
        "event": event,
        "satellite": satellite,
        "parameters": names,
        "unit": unit,
        "events": rows,
        "causes": [_cause(search, one) for one in result.named],
        "covariance": result.covariance.tolist(),
        "contradicting": [*result.contradicting, *_strange(search, names, left_out)],
        "motion": {name: _motion(one, history["trims"], name, fuel) for name, one in moves.items()},
        "predicted": predicted(moves, np.arange(time[0], time[-1] + AHEAD_S + STEP_S, STEP_S), common),
        "tried": result.tried,
        "level": search.level,
        "provenance": {
            "settings": settings,
            "products": {n: product.digest(p)[:12] for n, p in products.items()},
        },
    }
    document["verdict"] = {"text": verdict(document)}
    document = documents.judged(document, [*products.values()], [])
    validate(document, "joint")
    files = {
        "joint.json": json.dumps(document, indent=1, allow_nan=False) + "\n",
        "satellite_model.toml": model_text(document, search, result),
        "joint.html": page(document, moves, history),
    }
    of_each, said = ("event", "parameter"), {"units": "1", "long_name": f"parameters in {unit}"}
    kept = {
        "time_event": ("event", time, {"units": "s", "long_name": "middle of the manoeuvres, GPS"}),
        "value": (of_each, value, said),
        "sigma": (of_each, sigma, said | {"long_name": "errors"}),
    }
    return xr.Dataset(kept, attrs={"status": "delivered"}), files


def seconds(day: str) -> float:
    """GPS s of a day."""
    return (datetime.datetime.fromisoformat(day) - EPOCH).total_seconds()


def day(time: float) -> str:
    """Day of GPS s."""
    return (EPOCH + datetime.timedelta(seconds=float(time))).date().isoformat()


def _strange(search, names, left_out):
    """Events whose value the motion of the others does not foretell."""
    count, found = len(search.events) * len(names), []
    for name, scores in zip(names, left_out, strict=True):
        for event, away in zip(search.events, scores, strict=True):
            chance = float(np.exp(chi2_tail.log_tail(away**2, 1))) * count
            if chance < search.level and len(search.events) > 3:
                found.append({"event": event.name, "chi2": float(away**2), "dof": 1, "p": chance, "parameter": name})
    return found


def _cause(search, one) -> dict:
    """A cause with its law, values and ties."""
    cause = search.causes[one.law.cause]
    row = lambda k: zip(cause.names, one.value[k], one.sigma[k], cause.units, strict=True)  # noqa: E731
    values = [
        {"of": label, "parameters": {n: {"value": float(v), "sigma": float(s), "unit": u} for n, v, s, u in row(k)}}
        for k, label in enumerate(one.law.labels)
    ]
    held = one.heldout if np.isfinite(one.heldout) else None
    numbers = {"gain": one.gain, "dof": one.dof, "significance": one.significance, "evidence": one.score}
    said = {"cause": cause.slug, "form": cause.form, "scope": one.law.scope, "values": values}
    tied = [row["cause"] for row in one.ties if row["tied"]]
    broken = [row for row in one.ties if not row["tied"]]
    said |= _apart(search, one, cause)
    return said | numbers | {"heldout": held, "tied_with": tied, "broken": broken, "separation": list(one.ties)}


def _apart(search, one, cause):
    """Values of a cause in each event by itself, and whether it repeats: with the chi-square of one value for all."""
    of_event, chi2, dof = one.apart
    known = lambda v: float(v) if np.isfinite(v) else None  # noqa: E731
    row = lambda shown: zip(cause.names, shown, cause.units, strict=True)  # noqa: E731
    values = ({n: {"value": known(v), "sigma": known(e), "unit": u} for n, (v, e), u in row(k)} for k in of_event)
    own = [{"event": event.name, "parameters": one} for event, one in zip(search.events, values, strict=True)]
    p = float(np.exp(chi2_tail.log_tail(chi2, dof))) if dof else None
    return {"by_event": own, "repeats": {"said": one.law.scope == "constant", "chi2": chi2, "dof": dof, "p": p}}


def _motion(one: Moving, trims, name, fuel):
    """Slope per year, steps, change with fuel (null where it follows none) and size of the walk of a parameter."""
    value, sigma = one.terms()
    first = 2 + len(one.steps)
    follows = dict.fromkeys(fuel) | {
        quantity: {"value": v, "sigma": s}
        for quantity, v, s in zip(one.follows, value[first:].tolist(), sigma[first:].tolist(), strict=True)
    }
    printed = {seconds(t["date"]): t for t in trims if t["axis"] == name}
    steps = [
        {"date": day(at), "value": v, "sigma": s, "found": at in one.found, "printed": printed.get(at, {}).get("size")}
        for at, v, s in zip(one.steps, value[2:first].tolist(), sigma[2:first].tolist(), strict=True)
    ]
    walk = float(np.sqrt(sum(w * (q * one.scale) ** 2 for w, q, _ in one.options())))
    return {
        "slope_per_year": {"value": float(value[1]), "sigma": float(sigma[1])},
        "steps": steps,
        "follows": follows or None,
        "walk_per_root_year": walk,
    }


def predicted(moves, times, common=None) -> list[dict]:
    """Value and error of each parameter at times, one row each; `common` (p,) is an error that all events share."""
    if not moves:
        return []
    value, sigma = np.transpose([one.predicted(np.asarray(times)) for one in moves.values()], (1, 2, 0))
    sigma = np.hypot(sigma, 0.0 if common is None else common)
    return [
        {"date": day(t), "value": v.tolist(), "sigma": e.tolist()} for t, v, e in zip(times, value, sigma, strict=True)
    ]


def verdict(document) -> str:
    """What was found, in a sentence or two."""
    count = len(document["events"])
    said = []
    for one in document["causes"]:
        tied = f" (tied with {', '.join(map(words.title, one['tied_with']))})" if one["tied_with"] else ""
        again, repeats = one["repeats"], ""
        if count < 4:
            word = "repeats" if again["said"] else "does not repeat"
            repeats = f", {word} (chi-square of one value for all {again['chi2']:.1f} of {again['dof']})"
        scope = SCOPES.get(one["scope"], "follows " + one["scope"])
        said.append(f"{words.title(one['cause'])}, {scope}{repeats}{tied}")
    broken = sorted({row["event"] for one in document["causes"] for row in one["broken"]})
    text = f"{count} events: " + ("; ".join(said) if said else "no cause that they share") + "."
    text += f" Ties broken by {', '.join(broken)}." if broken else ""
    names = sorted({one["event"] for one in document["contradicting"]})
    return text + (f" Contradicted by {', '.join(names)}." if names else "")


SCOPES = {
    "constant": "the same in all events",
    "epochs": "another value after a change",
    "event": "in one event alone",
    "each": "different in each event",
}


def model_text(document, search, result) -> str:
    """Model of the satellite as TOML: effects with the days that they hold for, as `--model` reads them; motion."""
    comment = (
        f"Found by gravcal discover --joint in {len(document['events'])} events; gravcal run takes it with --model."
    )
    content = {name: document[name] for name in ("satellite", "calibration")} | {"effect": []}
    place = 0
    for one, said in zip(result.named, document["causes"], strict=True):
        many, count = one.value.shape if one.value.size else (0, 0)
        names, units = search.causes[one.law.cause].names, search.causes[one.law.cause].units
        covariance = result.covariance[place : place + many * count, place : place + many * count]
        place += many * count
        for begin, end, weights in _spans(search, one.law):
            turn = np.kron(weights, np.eye(count))
            spread = turn @ covariance @ turn.T
            sigma = np.sqrt(np.diag(spread))
            row = {name: said[name] for name in ("cause", "form", "scope", "tied_with")}
            row |= {"from": str(begin) if begin else None, "to": str(end) if end else None, "parameters": {}}
            for k, (name, v) in enumerate(zip(names, turn @ one.value.ravel(), strict=True)):
                others = {names[j]: round(float(spread[k, j] / sigma[k] / sigma[j]), 6) for j in range(count) if j != k}
                numbers = {"value": float(v), "sigma": float(sigma[k]), "unit": units[k], "correlation": others}
                row["parameters"][name] = numbers
            content["effect"].append(row)
    content["motion"] = {name: document[name] for name in ("unit", "parameters", "covariance")} | document["motion"]
    content["predicted"] = document["predicted"]
    return toml.text({name: one for name, one in content.items() if one}, comment)


def _spans(search, law):
    """First day, day after the last, and weights (1, k) of each stretch of time with one value; none of "each"."""
    weights, days = law.weights, [day(one.time) for one in search.events]
    if law.scope not in ("constant", "epochs", "event"):  # known where it was measured only
        after = [str(datetime.date.fromisoformat(d) + datetime.timedelta(1)) for d in days]
        return [(a, b, w[None]) for a, b, w in zip(days, after, weights, strict=True) if w.any()]
    cuts = [0, *(np.flatnonzero(np.any(np.diff(weights, axis=0), axis=1)) + 1), len(days)]
    middle = [day((search.events[k - 1].time + search.events[k].time) / 2) if 0 < k < len(days) else "" for k in cuts]
    spans = zip(middle[:-1], middle[1:], (weights[k][None] for k in cuts[:-1]), strict=True)
    return [span for span in spans if span[2].any()]


def changes(before: dict, after: dict) -> list[str]:
    """What a new event changed beyond its error, one line each; none where there was nothing before."""
    if not before:
        return []
    lines, unit = [], after["unit"]
    old, new = ({(c["cause"], c["scope"]) for c in one["causes"]} for one in (before, after))
    lines += [f"new: {words.title(c)}, {SCOPES.get(s, 'follows ' + s)}" for c, s in sorted(new - old)]
    lines += [f"no longer named: {words.title(c)}, {SCOPES.get(s, 'follows ' + s)}" for c, s in sorted(old - new)]
    known = {one["event"] for one in before["events"]}
    fresh = [one for one in after["events"] if one["event"] not in known]
    for k, name in enumerate(after["parameters"]):
        for one in fresh:
            last = max((e for e in before["events"] if e["time"] < one["time"]), default=None, key=lambda e: e["time"])
            if last is None:
                continue
            move, error = one["value"][k] - last["value"][k], np.hypot(one["sigma"][k], last["sigma"][k])
            if abs(move) > CHANGED * error:
                told = [
                    f"{'step found about' if s['found'] else 'trim of'} {s['date']} explains {signed(s['value'], 0)}"
                    for s in after["motion"][name]["steps"]
                    if last["time"] < seconds(s["date"]) <= one["time"]
                ]
                text = f"{name} moved by {plus_minus(move, error)} {unit} since {day(last['time'])}"
                lines.append(f"{text}: {'; '.join(told) or 'no trim explains it'}")
    was = {one["event"] for one in before["contradicting"]}
    lines += [f"{one['event']} contradicts the others" for one in after["contradicting"] if one["event"] not in was]
    return lines


def shared(documents: Sequence[dict]) -> list[str]:
    """Causes that the models of several satellites have in common, and whether their values agree, one line each."""
    lines = []
    for one, other in itertools.combinations(documents, 2):
        for (a, value, spread), (b, known, error) in itertools.product(_values(one), _values(other)):
            names = {a["cause"], *a["tied_with"]} & {b["cause"], *b["tied_with"]}
            text = f"{one['satellite']} and {other['satellite']}: {', '.join(map(words.title, sorted(names)))} in both"
            if a["cause"] == b["cause"] and a["form"] == b["form"] and value.size == known.size:
                away = value - known
                chi2 = float(away @ np.linalg.solve(spread + error, away))
                chance = float(np.exp(chi2_tail.log_tail(chi2, away.size)))
                agree = "agree" if chance > one["level"] else "differ"
                text += f", values {agree} (chi-square {chi2:.1f} of {away.size})"
            lines += [text] * bool(names)
    return lines


def _values(document):
    """(cause, values (r,), covariance (r, r)) of each cause with values of its own."""
    place = 0
    for one in document["causes"]:
        value = np.array([p["value"] for v in one["values"] for p in v["parameters"].values()])
        own = slice(place, place + value.size)
        place = own.stop
        if value.size:
            yield one, value, np.array(document["covariance"])[own, own]


def page(document, moves, history) -> str:
    """Page of a joint search."""
    drawn = Figure(partial(_draw, document, moves, history), (), FIGURE, arguments=())
    made = [
        Section("How the calibration moves", [_motion_table(document), _event_table(document)], [drawn]),
        Section("Causes that events share", [_cause_table(document), _apart_table(document)]),
        Section("Ties", [_tie_table(document)], notes=[TIES]),
        Section("Contradictions", [_contradiction_table(document)], notes=[ALONE]),
    ]
    made = [one for one in made[0 if moves else 1 :] if any(t is not None for t in one.tables) or one.figures]
    count = f"{len(document['events'])} events of satellite {document['satellite']}, level {document['level']}"
    return pages.page(document, made, {}, heading="What many events say together", subtitle=count)


def _draw(document, moves, history):
    """A panel for each parameter: values of events, prediction with its error, printed values, trims."""
    names = list(moves)
    first = min([one["time"] for one in document["events"]] + [p["time"] for p in history["printed"]])
    last = max(one["time"] for one in document["events"]) + AHEAD_S
    grid_time = np.linspace(first, max([last, *(p["time"] for p in history["printed"])]), 400)
    figure, panels = grid(len(names), 1, 0.6 + 1.6 * len(names), sharex=True, margins={"hspace": 0.12, "left": 0.11})
    date = lambda t: EPOCH + datetime.timedelta(seconds=float(t))  # noqa: E731
    dates = [date(t) for t in grid_time]
    for k, (panel, name) in enumerate(zip(panels[:, 0], names, strict=True)):
        mean, sigma = moves[name].predicted(grid_time)
        band = {"color": COLOURS["sky"], "alpha": 0.3, "linewidth": 0, "label": "predicted"}
        panel.fill_between(dates, mean - sigma, mean + sigma, **band)
        panel.plot(dates, mean, color=COLOURS["sky"], linewidth=0.8)
        look = {"linestyle": "none", "capsize": 2, "markersize": 3.8, "elinewidth": 0.9}
        own = zip(*((date(e["time"]), e["value"][k], e["sigma"][k]) for e in document["events"]), strict=True)
        panel.errorbar(*own, marker="s", color=COLOURS["vermilion"], label="all events together", **look)
        points = [p for p in history["printed"] if p["parameter"] == name]
        printed = [(date(p["time"]), p["value"], p["sigma"] or 0.0) for p in points]
        if printed:
            hollow = look | {"markerfacecolor": "white"}
            panel.errorbar(*zip(*printed, strict=True), marker="o", color=COLOURS["blue"], label="printed", **hollow)
        for step in document["motion"][name]["steps"]:
            look = {"color": COLOURS["black"], "linewidth": 0.8, "linestyle": ":" if step["found"] else "--"}
            panel.axvline(date(seconds(step["date"])), **look)
        panel.set_ylabel(f"{name} ({document['unit'].replace('um', 'µm')})")
        panel.margins(y=0.1)
    legend(figure, panels[0, 0], 3)
    return figure


def _event_table(document):
    """Values of each event, alone and with all others."""
    heads = [
        "date",
        "event",
        *(f"{n}{w}" for n in document["parameters"] for w in ("", ", alone")),
        "over error, left out",
    ]
    rows = []
    for one in document["events"]:
        pairs = zip(one["value"], one["sigma"], one["alone"], one["sigma_alone"], strict=True)
        cells = [text for v, s, a, b in pairs for text in (plus_minus(v, s), plus_minus(a, b))]
        rows.append([day(one["time"]), one["event"], *cells, ", ".join(signed(v, 1) for v in one["left_out"])])
    caption = f"Values in {document['unit']} with the causes below, and alone without any. Left out: by all others."
    return Table(caption, heads, rows, words=(0, 1), wide=True)


def _motion_table(document):
    """Slope, walk and steps of each parameter."""
    rows = []
    for name, one in document["motion"].items():
        slope, walk = one["slope_per_year"], one["walk_per_root_year"]
        rows.append([name, "slope per year", "", plus_minus(slope["value"], slope["sigma"]), f"{walk:.2g}"])
        for s in one["steps"]:
            what = "step that was found" if s["found"] else f"trim, printed {signed(s['printed'], 0)}"
            rows.append([None, what, s["date"], plus_minus(s["value"], s["sigma"]), ""])
        for quantity, v in (one["follows"] or {}).items():
            text = plus_minus(v["value"], v["sigma"]) if v else "none seen"
            rows.append([None, f"per unit of {quantity}", "", text, ""])
    heads = ["parameter", "", "date", f"value ({document['unit']})", "walk in a root of a year"]
    return Table("How the calibration moves from event to event.", heads, rows, words=(0, 1, 2), wide=True)


def _cause_table(document):
    """Each cause with its law and its values."""
    rows = []
    for one in document["causes"]:
        held = "" if one["heldout"] is None else f"{one['heldout']:.0f}"
        scope = SCOPES.get(one["scope"], f"follows {one['scope']}")
        told = scope, f"{one['gain']:.0f}", held, probability(one["significance"]), "", ""
        rows.append([words.title(one["cause"]), *told])
        for values in one["values"]:
            for name, p in values["parameters"].items():
                rows.append([None, f"{name}, {values['of']}", "", "", "", *measured(p["value"], p["sigma"], p["unit"])])
    heads = ["cause", "scope, parameter", "chi-square gained", "events left out", "chance", "value", "unit"]
    caption = f"Causes as they were named; {document['tried']} laws were tried in a round."
    return Table(caption, heads, rows, words=(0, 1, 5, 6), wide=True) if rows else None


def _apart_table(document):
    """Values of each cause in each event by itself."""
    rows = []
    for one in document["causes"]:
        chi2 = f"{one['repeats']['chi2']:.1f} of {one['repeats']['dof']}"
        rows.append([words.title(one["cause"]), "", "repeats" if one["repeats"]["said"] else "does not repeat", chi2])
        for own in one["by_event"]:
            for name, p in own["parameters"].items():
                if p["value"] is not None:
                    value, unit = measured(p["value"], p["sigma"], p["unit"])
                    rows.append([None, f"{own['event']} {name}", f"{value} {unit}", ""])
    heads = ["cause", "event by itself", "value", "chi-square of one value for all"]
    caption = "Each cause in each event by itself, beside the others."
    return Table(caption, heads, rows, words=(0, 1, 2), wide=True) if rows else None


def _tie_table(document):
    """Pairs of causes that single events tie."""
    rows = [
        [words.title(one["cause"]), words.title(t["cause"]), f"{t['single']:.1f}", f"{t['expected_chi2']:.1f}",
         f"{t['observed']:.1f}", "tied" if t["tied"] else f"broken by {t['event']}"]
        for one in document["causes"] for t in one["separation"]
    ]  # fmt: skip
    heads = ["named", "beside", "best single event", "all events", "odds", ""]
    return Table("Expected chi-square between two causes.", heads, rows, words=(0, 1, 5), wide=True) if rows else None


def _contradiction_table(document):
    """Events that the others do not foretell."""
    rows = [
        [one["event"], one.get("parameter", "causes"), f"{one['chi2']:.1f}", str(one["dof"]), probability(one["p"])]
        for one in document["contradicting"]
    ]
    heads = ["event", "of", "chi-square", "degrees of freedom", "chance"]
    return Table("Events that all others do not foretell.", heads, rows, words=(0, 1), wide=True) if rows else None


FIGURE = "Values of all events, prediction and printed values. Dashed: trims; dotted: steps that were found."
TIES = (
    "Two causes are told apart if the chi-square expected between them and twice the logarithm of their odds in these "
    "data both exceed the limit of ties. The event named preferred the one to the other most."
)
ALONE = "Such an event has values of its own for every cause, so that it moves none of the others."
