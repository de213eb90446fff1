"""Comparison of two configurations of a calibration: changes of values, verdicts and checks, event by event.

Both solutions are made of the same records, so their errors are not independent. Where one of them is efficient among
the estimators that both belong to (more data or weights of the true noise used by it), its error is uncorrelated with
the difference, and var(b - a) = |var(b) - var(a)| (Hausman 1978); errors by noise are taken, what catalogue and priors
add is common. Where the two variances agree to 1 % the sigma of the difference is not known: null.
"""

import itertools
import json
import math

from gravcal.report import pages
from gravcal.store import configurations, history, housekeeping, location, results
from gravcal.store.schemas import VERSION

ASSUMPTION = (
    "sigma of the difference: sqrt(|sigma_b^2 - sigma_a^2|), errors by noise, as both solutions share their data and "
    "one is taken to be efficient; null where the two variances agree to 1 %"
)
CLOSE = 0.01  # relative difference of two variances that says nothing: they are known no better


def between(calibration, names, wanted=lambda _: True):
    """Document that compares the stored reports of two configurations (names), of events with ``wanted(event)``."""
    promoted, sides = configurations.operational(calibration.name), []
    path = lambda one: one.ref.folder / "result.json"  # noqa: E731
    ran = lambda event: (history.last_run(event, calibration.name) or {"started": ""})["started"]  # noqa: E731
    for name in names:
        known = location.OPERATIONAL if name == configurations.CATALOGUE and not promoted["settings"] else name
        since = promoted["when"] if known == location.OPERATIONAL else ""  # until the next run links stay as before
        entries = housekeeping.entries(kind=f"{calibration.name}.report", configuration=known)
        entries = [one for one in entries if wanted(one.ref.event) and ran(one.ref.event) >= since]
        sides.append({one.ref.event: one for one in entries if path(one).is_file() and not path(one).is_symlink()})
    own, other = sides
    read = lambda one: json.loads(path(one).read_text())  # noqa: E731
    why = lambda one, two: history.why_different(one.ref.key, two.ref.key)  # noqa: E731
    pairs = [(e, read(own[e]), read(other[e]), why(own[e], other[e])) for e in sorted(own.keys() & other.keys())]
    return {
        "schema_version": VERSION,
        "calibration": calibration.name,
        "configurations": list(names),
        "assumption": ASSUMPTION,
        "events": [of_event(calibration, *one) for one in pairs],
        "only_in": {names[0]: sorted(own.keys() - other.keys()), names[1]: sorted(other.keys() - own.keys())},
    }


def of_event(calibration, event, first, second, why=()):
    """Entry of one event: status, settings, verdict, checks and values [first, second] that differ, and reasons."""
    own, other = ({one.label: one for one in calibration.result(document)} for document in (first, second))
    labels = [name for name in dict.fromkeys([*own, *other]) if name in own and name in other]
    return {
        "event": event,
        "origin": first.get("origin", "measured"),
        "status": [first["status"], second["status"]],
        "settings": _changed(first.get("settings"), second.get("settings"), {"configuration"}),
        "verdict": _changed(first.get("verdict"), second.get("verdict"), {"text"}),
        "checks": _changed(_passed(first), _passed(second)),
        "values": [difference(own[name], other[name]) for name in labels],
        "why": list(why),
    }


def moved(event):
    """["name value unit: difference (in sigma of the first)"] of the determined values in an entry of `of_event`."""
    determined = [one for one in event["values"] if one["difference"] is not None]
    return [
        f"{one['name']} {_pair(one['values'][0], one['sigmas'][0])} {one['unit']}: {one['difference']:+.2g}"
        + ("" if one["in_sigma_of_first"] is None else f" ({one['in_sigma_of_first']:+.2f} sigma)")
        for one in determined
    ]


def difference(first, second):
    """Dict on two `results.Value`: second less first in their unit, over its own sigma, and over that of the first."""
    known = None not in (first.value, second.value)
    moved = second.value - first.value if known else None
    sigma = None
    if known and None not in (first.sigma, second.sigma):
        variances = first.sigma**2, second.sigma**2
        variance = abs(variances[1] - variances[0])
        sigma = math.sqrt(variance) if variance > CLOSE * max(variances) else None
    return {
        "name": first.label,
        "unit": first.unit,
        "values": [first.value, second.value],
        "sigmas": [first.sigma, second.sigma],
        "difference": moved,
        "sigma": sigma,
        "in_sigma": None if sigma is None else moved / sigma,
        "in_sigma_of_first": moved / first.sigma if known and first.sigma else None,
    }


def _word(value):
    """Text of an entry of a document: yes or no, a list with commas, a dash for None."""
    if isinstance(value, list):
        return ", ".join(map(_word, value))
    return "yes" if value is True else "no" if value is False else "–" if value is None else str(value)


def tables(document):
    """[(heads, rows)] of a comparison document: settings that differ, values, and all other changes."""
    first, second = document["configurations"]
    heads = ["event", "value", first, second, "difference", "in its sigma", f"in sigma of {first}", "unit"]
    rows, other = [], []
    for event in document["events"]:
        mark = "" if event["origin"] == "measured" else f" ({event['origin']})"
        for one in event["values"]:
            estimates = [_pair(v, s) for v, s in zip(one["values"], one["sigmas"], strict=True)]
            moved = [
                "" if one[n] is None else f"{one[n]:+.3g}" for n in ("difference", "in_sigma", "in_sigma_of_first")
            ]
            rows.append([event["event"] + mark, one["name"], *estimates, *moved, one["unit"]])
        status = dict(status=event["status"]) if len(set(event["status"])) > 1 else {}
        other += [[event["event"] + mark, "reason", "", why] for why in event["why"]]
        parts = {"": status, "verdict ": event["verdict"], "check ": event["checks"]}
        for kind, changed in parts.items():
            other += [[event["event"] + mark, kind + n, _word(a), _word(b)] for n, (a, b) in changed.items()]
    sides = [{n: pair[side] for n, pair in one["settings"].items()} for one in document["events"] for side in (0, 1)]
    changes = itertools.chain(*map(history.differences, sides[::2], sides[1::2]))
    settings = {(name, of + a, of + b) for name, of, a, b in changes}
    return [
        (["setting", first, second], [list(row) for row in sorted(settings)]),
        (heads, rows),
        (["event", "changed", first, second], other),
    ]


def page(document):
    """HTML page of a comparison document."""
    first, second = document["configurations"]
    captions = ("Settings that differ.", f"Values of {first} and {second} with their errors by noise.", "What changed.")
    shown = [
        pages.Table(caption, heads, rows, words=(0, 1), wide=len(heads) > 4)
        for caption, (heads, rows) in zip(captions, tables(document), strict=True)
        if rows
    ]
    alone = [f"Only in {name}: {', '.join(events)}." for name, events in document["only_in"].items() if events]
    title = f"{document['calibration']}: {second} against {first}"
    count = len(document["events"])
    subtitle = f"{count} event{'s' if count != 1 else ''} in both configurations"
    notes = [f"Assumed for the {ASSUMPTION}.", *alone]
    return pages.render("comparison.html", title=title, subtitle=subtitle, tables=shown, notes=notes)


def _changed(first, second, without=frozenset()):
    """{name: [first, second]} of the entries of two dicts (or None) that differ, but those of ``without``."""
    first, second = first or {}, second or {}
    names = sorted((set(first) | set(second)) - without)
    return {n: [first.get(n), second.get(n)] for n in names if first.get(n) != second.get(n)}


def _passed(document):
    """{name of check: True if passed} of a result document."""
    return {one["name"]: one["passed"] for one in document.get("checks") or ()}


def _pair(value, sigma):
    """Text "value +- sigma", "undetermined" for None."""
    return "undetermined" if value is None else results.rounded(value, sigma)
