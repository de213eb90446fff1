"""Content of the store for the pages, read only: nothing is written, moved to quarantine or made again."""

import functools
from dataclasses import dataclass

from gravcal import catalog
from gravcal.report.documents import WITH_RESULT
from gravcal.store import history, housekeeping, location, product, store
from gravcal.store.product import MEASURED, origins_together

SEARCHES = ("discovery.json", "joint.json")  # documents of an event, and of all events of a satellite together
_json = functools.lru_cache(maxsize=4096)(location.read_json)  # documents of products never change
TRACED = 200  # products of a list whose inputs are looked into
_known = {}  # folder -> record; a product is never changed, so its record is read once


@dataclass(frozen=True)
class Node:
    """One product in the chain of an event, or a stage that failed (then without entry)."""

    stage: str
    key: str  #: "" if it failed
    state: str  #: "made", "reused", "stored" or "failed"
    entry: object  #: housekeeping.Entry or None
    inputs: tuple[str, ...]  #: keys


def entries() -> list[housekeeping.Entry]:
    """[Entry] of all products, those replaced by newer ones included, by event, time and stage."""
    return housekeeping.entries(newest_only=False, record_of=_record)


def entry(key):
    """Entry with this key, None if there is none or the text is no key."""
    if not store.KEY.fullmatch(key):
        return None
    folder = store.folder_of(key)
    if not _inside(folder / "product.nc"):
        return None
    record = _record(folder)
    names = tuple(sorted(housekeeping.linked().get(key, ())))
    return housekeeping.Entry(store.reference(record, folder), record, names) if record else None


def file(entry, name):
    """Path of a file that belongs to a product, or None: only names its record lists, and only inside the store."""
    if name not in entry.record["files"] and name != "product.nc":
        return None
    path = entry.ref.folder / name
    return path if _inside(path) else None


def document(entry):
    """Result document (dict) of the Entry of a report, or None."""
    path = file(entry, "result.json")
    return _json(path) if path else None


@functools.lru_cache(maxsize=4096)
def origin(path):
    """Origin of a product file (path), "" without one; cached, as a product never changes."""
    try:
        with product.opened(path) as file:
            return str(product.attributes(file).get("origin", ""))
    except OSError:
        return ""


def results(configuration=location.OPERATIONAL):
    """[dict] of every event and calibration with its result in a configuration, the newest first.

    Keys: event, calibration, state, mood, said, origin, made, products, report (Entry or None), run, document,
    experiments (names of those with products of this event).
    """
    by_event, tried = {}, {}
    for one in entries():
        if configuration in one.configurations:
            by_event.setdefault(one.ref.event, []).append(one)
        if one.ref.kind != "ingest":
            others = set(one.configurations) - {location.OPERATIONAL}
            tried.setdefault((one.ref.event, one.ref.kind.partition(".")[0]), set()).update(others)
    runs = {(run["event"], run["flow"]): run for run in history.runs() if run["configuration"] == configuration}
    everything = [one for own in by_event.values() for one in own]
    names = {(one.ref.event, one.ref.kind.partition(".")[0]) for one in everything if one.ref.kind != "ingest"}
    if configuration == location.OPERATIONAL:
        names |= {name for name, others in tried.items() if others}
    names |= {name for name, run in runs.items() if run["status"] == "failed"}
    rows = [_result(*name, by_event.get(name[0], []), runs) for name in sorted(names)]
    rows = [row | {"experiments": sorted(tried.get((row["event"], row["calibration"]), ()))} for row in rows]
    return sorted(rows, key=lambda row: row["made"], reverse=True)


def waiting(rows) -> dict[str, list[str]]:
    """{calibration: [event]} of the events of the catalogue that are in no row of ``results``."""
    here, missing = {row["event"] for row in rows}, {}
    for event in catalog.events():
        if event.name not in here:
            missing.setdefault(event.calibration, []).append(event.name)
    return missing


def flows(event, configuration=location.OPERATIONAL) -> list[str]:
    """Names of the flows that were run for an event, the last first."""
    runs = [run for run in history.runs() if (run["event"], run["configuration"]) == (event, configuration)]
    return [run["flow"] for run in sorted(runs, key=lambda run: run["started"], reverse=True)]


def chain(event, configuration=location.OPERATIONAL, flow=None) -> list[Node]:
    """[Node] of the stages of an event: the newest product of each with its inputs, and the stage that failed last.

    With a flow only those of its last run. An input is replaced by the newest product of its stage if both have the
    same content.
    """
    runs = [run for run in history.runs() if (run["event"], run["configuration"]) == (event, configuration)]
    runs = [run for run in runs if flow in (None, run["flow"])]
    stages = {name: one for run in runs for name, one in run["stages"].items()}
    keys = {name: one["key"] for name, one in stages.items()}
    known = {one.ref.key: one for one in entries()}
    waiting = [one for one in known.values() if configuration in one.configurations and one.ref.event == event]
    if flow and set(keys.values()) & set(known):
        waiting = [known[key] for key in keys.values() if key in known]
        known = {one.ref.key: one for one in waiting}
    equal = {(one.ref.stage, one.ref.digest): one for one in waiting}
    nodes = {}
    while waiting:
        one = waiting.pop()
        below = [known[key] for key in (part.get("key") for part in one.record["from"]) if key in known]
        below = [equal.get((part.ref.stage, part.ref.digest), part) for part in below]
        waiting += [part for part in below if part.ref.key not in nodes]
        state = stages[one.ref.stage]["state"] if keys.get(one.ref.stage) == one.ref.key else "stored"
        nodes[one.ref.key] = Node(one.ref.stage, one.ref.key, state, one, tuple(part.ref.key for part in below))
    attempts = [run.get("attempt", run) for run in runs]
    failed = [Node(run["failed"], "", "failed", None, ()) for run in attempts if run.get("failed")]
    return sorted(nodes.values(), key=lambda node: node.stage) + failed


def relatives(entry) -> list[tuple[housekeeping.Entry, list[str]]]:
    """[(Entry, reasons)] of other products of the same stage: of this event, then of others; newest first."""
    others = [one for one in entries() if one.ref.stage == entry.ref.stage and one.ref.key != entry.ref.key]
    of_event = [one for one in others if one.ref.event == entry.ref.event]
    of_others = [one for one in others if one.ref.event != entry.ref.event and one.newest]
    rows = [(one, history.why_different(one.ref.key, entry.ref.key) or ["another run"]) for one in of_event]
    return rows[::-1] + [(one, [f"event {one.ref.event}"]) for one in of_others[::-1]]


def differing(products) -> dict[str, list[str]]:
    """{key: reasons} why products ([Entry]) differ from the newest operational one of stage and event, [] for that.

    For the last `TRACED` that differ in inputs: why these differ. Where the stage was never delivered: the model.
    """
    newest = {(one.ref.event, one.ref.stage): one for one in products if one.newest}
    modelled = {one.ref.event for one in products if history.model_of(one.record)}
    reasons, traced = {one.ref.key: [] for one in products}, 0
    for one in reversed(products):
        delivered, key = newest.get((one.ref.event, one.ref.stage)), one.ref.key
        if delivered is one:
            continue
        reasons[key] = history.compared(delivered.record, one.record, ("made again",)) if delivered else []
        is_open = any(why.startswith("input ") for why in reasons[key]) if delivered else one.ref.event in modelled
        if traced < TRACED and is_open:
            reasons[key] = history.why_different(delivered and delivered.ref.key, key) or reasons[key]
            traced += 1
    return reasons


def searches(event, configuration=location.OPERATIONAL) -> list[tuple[housekeeping.Entry, dict]]:
    """[(Entry, document)] of discoveries of an event, or of a joint search; those with detection limits first."""
    own = [one for one in entries() if one.ref.event == event and configuration in one.configurations]
    pairs = [(one, _json(path)) for one in own for name in SEARCHES if (path := file(one, name))]
    return sorted(pairs, key=lambda pair: "limits" not in pair[1])


def proposed() -> list[dict]:
    """[document] of the designs that `gravcal design` wrote into this store, the last day first."""
    designs = [location.read_json(path) for path in (location.folder() / "designs").glob("*.json")]
    return sorted((one for one in designs if one), key=lambda one: one["date"], reverse=True)


def siblings(entry):
    """[Entry] of the newest products of the same kind and event with another variant."""
    same = [one for one in entries() if (one.ref.event, one.ref.kind) == (entry.ref.event, entry.ref.kind)]
    return [one for one in same if one.newest and one.ref.variant != entry.ref.variant]


def _record(folder):
    """Record (cached) of a product folder, None if that or product.nc is missing."""
    if folder not in _known and (record := store.read_record(folder)):
        _known[folder] = record
    return _known.get(folder) if (folder / "product.nc").is_file() else None


def _inside(path):
    """True if a path, links followed, is a file in the objects of the store."""
    try:
        return path.is_file() and path.resolve().is_relative_to((location.folder() / "objects").resolve())
    except OSError:
        return False


def _result(event, calibration, own, runs):
    """Row as of `results` of one event and calibration; own: [Entry] of the event, runs {(event, flow): record}."""
    own = [one for one in own if one.ref.kind.startswith(f"{calibration}.") or one.ref.kind == "ingest"]
    report = next((one for one in own if one.ref.stage == f"{calibration}.report"), None)
    run = runs.get((event, calibration))
    body = document(report) if report else None
    if run and run["status"] == "failed":
        state, mood, said = "failed", "bad", run.get("error", "")
    elif body is None:
        state, mood, said = "no report", "plain", "no report of this configuration is in the store"
    else:  # a verdict is good, bad, or says nothing of the kind: accuracy, consistency, and the requirement
        verdict, state = body.get("verdict") or {}, str(body.get("status", "")).replace("_", " ")
        marks = [verdict.get(name) for name in ("accuracy_met", "consistent")]
        is_bad = state == "questionable" or False in marks or "exceeds" in (verdict.get("requirement") or ())
        mood = "plain" if state not in WITH_RESULT else "bad" if is_bad else "good" if True in marks else "plain"
        said = verdict.get("text", "")
    joint_files = [path for one in own if (path := file(one, "joint.json"))]
    if joint_files and not report:
        state, said = "all events", _json(joint_files[-1])["verdict"]["text"]
    made_of = [one for one in own if one.ref.kind != "ingest"] or own  # files may have been read for others only
    stated = body["origin"] if body and "origin" in body else origins_together(origin(one.ref.path) for one in made_of)
    made = max([one.record["made"] for one in own] + ([run["started"]] if run else []), default="")
    names = {"event": event, "calibration": calibration, "state": state, "mood": mood, "said": said, "made": made}
    names |= {"origin": stated or MEASURED, "products": len(own), "report": report, "run": run, "document": body}
    return names | {"fails": [one for one in (body or {}).get("checks") or () if not one["passed"]]}
