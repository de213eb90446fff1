"""Provenance of products: why one has to be made, its inputs down to raw files, and the last run of each event.

    runs/<event>.<flow>.json          one record, replaced by the next run; products do not depend on it
    runs/<event>.<flow>@<NAME>.json   the same of the experiment of that name

The store holds products; only the record of a run says which it reused. ``gravcal browse`` shows both. A run that
fails after one that did not, such as one from a folder without the files, is added to that record as its "attempt".
"""

import collections
import contextlib
import datetime
import os
import statistics
import time
from pathlib import Path

from gravcal.errors import GravcalError, NoDataError
from gravcal.store import configurations, keys, location, store

ABSENT = "(absent)"
REMAKE = "GRAVCAL_REMAKE_VERSIONS"  # "1": products that other versions of these made are made again
NUMERICAL = ("numpy", "scipy", "numba")
SEEN = 25  # products whose computing times give the usual one of a stage
MOVED = "moved_"  # begin of the variant of records less a model moved by its error
AUXILIARY = ("GFC", "TRUTH")  # products of files of an event that are not Level-1 data


def why(recipe, modules):
    """Reasons (list of text) why the product of a recipe has to be made: differences from the newest of its name.

    What an experiment never made is compared with the operational product; an input whose digest is None is not
    known yet. Examples: "lowpass_hz: 0.5 -> 0.7", "input com_offset.align changed", "never made".
    """
    record = store.newest_record(recipe["event"], _name(recipe))
    return compared(record, {"recipe": recipe, "modules": modules}, otherwise=()) if record else ["never made"]


def other_versions(ref):
    """["made by numpy 2.1.0, here 2.2.1"] for each of `NUMERICAL` of which another version made a product (ref)."""
    versions, here = (store.read_record(ref.folder) or {}).get("versions", {}), keys.versions()
    other = [name for name in NUMERICAL if versions.get(name, here[name]) != here[name]]
    return [f"made by {name} {versions[name]}, here {here[name]}" for name in other]


def other_versions_said(reasons):
    """Sentence that counts reused products by their reasons of `other_versions`, "" where there are none."""
    said = "; ".join(f"{count} {reason}" for reason, count in collections.Counter(reasons).items())
    return f"products reused: {said}. {REMAKE}=1 makes them again." if said else ""


def remakes_versions():
    """True if products made by other versions of the numerical libraries are to be made again (`REMAKE`)."""
    return os.environ.get(REMAKE, "0") not in ("", "0")


def compared(old_record, new_record, otherwise=("event or variant",)):
    """["lowpass_hz: 0.5 -> 0.7", ...]: differences of the records of two products of one stage; otherwise if none."""
    old, new = old_record["recipe"], new_record["recipe"]
    reasons = _reasons(old["settings"], new["settings"])
    if old["version"] != new["version"]:
        reasons.append(f"version {old['version']} -> {new['version']}")
    origins = [recipe.get("origin", ABSENT) or "as files say" for recipe in (old, new)]
    if origins[0] != origins[1]:
        reasons.append(f"origin: {origins[0]} -> {origins[1]}")
    before, after = ({item.get("file") or _name(item): item for item in recipe["inputs"]} for recipe in (old, new))
    reasons += [f"input {name} added" for name in after if name not in before]
    reasons += [f"input {name} removed" for name in before if name not in after]
    for name, item in after.items():
        if name in before and item["digest"] is not None and item["digest"] != before[name]["digest"]:
            reasons.append(f"input file {name} changed" if "file" in item else f"input {name} changed")
    return reasons + changed(old_record, new_record) or list(otherwise)


def usual_seconds(stage, event=None):
    """Seconds (float) a stage took for an event, the least of its configurations: a first one compiles kernels.

    Without an event, or where it has none, the median over others; None where the stage never ran.
    """
    of_event = [*store.links(f"{event}/{stage}"), *store.links(f"{event}/as/*/{stage}")] if event else []
    records = [store.read_record(folder) for _, folder in of_event or store.links(f"*/{stage}")[-SEEN:]]
    return (min if of_event else statistics.median)([one["seconds"] for one in records if one] or [None])


def remade(entries, setting):
    """Keys (set) of the entries that a change of a setting remakes: those with the setting, and all made from them."""
    stale = {one.ref.key for one in entries if _takes(one.record["recipe"]["settings"], setting)}
    while more := {one.ref.key for one in entries if stale & {p.get("key") for p in one.record["from"]}} - stale:
        stale |= more
    return stale


def _takes(settings, name):  # True if nested settings have an entry of that name
    return name in settings or any(isinstance(one, dict) and _takes(one, name) for one in settings.values())


def why_different(old_key, new_key):
    """Reasons (list of text) why two products (keys) of one stage differ, from settings, code, files of all ancestors.

    Settings that a report repeats from the stages before it count once. Of models only that of the nearest ancestor
    with one is compared: products "moved_*" and the settings "added" and "configuration" follow from it. An old key of
    None is a run without a model, of which nothing else is known.
    """
    sides = [[one for one in store.ancestry(*[key] * bool(key)).values() if one] for key in (old_key, new_key)]
    is_moved = lambda one: one["recipe"]["variant"].startswith(MOVED)  # noqa: E731
    models = [next(filter(None, map(model_of, sorted(side, key=is_moved))), "") for side in sides]
    old, new = ({(_name(one["recipe"]), one["stage"]): one for one in side[::-1]} for side in sides)
    before, after = ({_name(one["recipe"]): one for one in side[::-1]} for side in sides)
    pairs = [(old[key], new[key]) for key in reversed(new) if key in old]  # as two stages may write one kind
    paired = {_name(one["recipe"]) for one, _ in pairs}
    pairs += [(before[name], after[name]) for name in reversed(after) if name in before and name not in paired]
    reasons = [one.removeprefix("settings.") for pair in pairs for one in compared(*pair, otherwise=())]
    names = {_name(one["recipe"]) for side in sides for one in side}
    of_inputs = {f"input {name} {word}" for name in names for word in ("changed", "added", "removed")}
    implied = ("configuration: ", *(("model: ", "added: ") if any(models) else ()))
    reasons = [one for one in dict.fromkeys(reasons) if one not in of_inputs and not one.startswith(implied)]
    return _reasons(*({"model": one} for one in models)) + reasons


def model_of(record):
    """Extended model (JSON) in the settings of a product's record, or of those that a report repeats; "" without."""
    settings = record["recipe"]["settings"]
    known = settings.get("settings")
    return _model(settings.get("model")) or _model(known.get("model") if isinstance(known, dict) else "")


def _model(value):  # setting if it is the JSON text of a model, else ""
    return value if isinstance(value, str) and value.startswith("[{") else ""


def changed(old_record, new_record):
    """["code changed: names", "data changed: files"] of modules and data files that differ between two records."""
    if old_record["recipe"]["code"] == new_record["recipe"]["code"]:
        return []
    old, new = old_record["modules"], new_record["modules"]
    names = sorted(name for name in set(old) | set(new) if old.get(name) != new.get(name)) or ["(unknown)"]
    parts = {"code": [name for name in names if "/" not in name], "data": [name for name in names if "/" in name]}
    return [f"{label} changed: {', '.join(changed_names)}" for label, changed_names in parts.items() if changed_names]


def differences(old, new, name=""):
    """(dotted name, parameter of a model or "", old text, new text) of each difference of two nested settings."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(set(old) | set(new)):
            yield from differences(old.get(key, ABSENT), new.get(key, ABSENT), f"{name}.{key}" if name else key)
    elif old != new or type(old) is not type(new):
        models = [_model(one) if name.rpartition(".")[2] == "model" else "" for one in (old, new)]
        if any(models):
            yield from ((name, *one) for one in configurations.models_apart(*models))
            return
        texts = [str(old), str(new)]  # long ones from shortly before they differ
        begin = max(len(os.path.commonprefix(texts)) - 20, 0) if max(map(len, texts)) > 60 else 0
        tails = ["..." * bool(begin) + text[begin:] for text in texts]
        yield (name, "", *(text if len(text) <= 60 else text[:57] + "..." for text in tails))


def _reasons(old, new):  # ["name: old -> new"] of two settings
    return [f"{name}: {of}{a} -> {b}" for name, of, a, b in differences(old, new)]


def _name(recipe):  # "kind.variant" of a recipe
    return ".".join(part for part in (recipe["kind"], recipe["variant"]) if part)


def tree(entry):
    """Provenance tree of an Entry: node of the product with all it was made of, down to the raw files.

    A node has "name", "record" (None for a raw file or a product that is gone) and "inputs", a list of the same.
    """
    records, known = store.ancestry(entry.ref.key), {}
    for key, record in records.items():
        name = store.reference(record, store.folder_of(key)).name if record else key[:12]
        known[key] = {"name": name, "record": record, "inputs": []} | ({} if record else {"gone": True})
    for key, record in records.items():
        for part, label in store.inputs(record) if record else ():
            if "path" in part:
                place = f"{part['path']}:{part['member']}" if part["member"] else part["path"]
                known[key]["inputs"].append({"name": place, "record": None, "inputs": [], "digest": label["digest"]})
            else:
                known[key]["inputs"].append(known[part["key"]])
    return known[entry.ref.key]


def raw_files(key):
    """Raw files below a product, each once: list of dict with path, member, product, satellite, date, digest."""
    records = filter(None, store.ancestry(key).values())
    pairs = [pair for record in records for pair in store.inputs(record) if "path" in pair[0]]
    return list({(part["path"], part["member"]): part | label for part, label in pairs}.values())


def level_one_folders(calibration):
    """[(event, folder, satellite, date)] of the Level-1 files from which the events of the store were made.

    The date is None for an event of several days; of a pair the satellite is its first letter.
    """
    by_event, sources, latest = {}, [], location.folder() / "latest"
    for link, folder in (*store.links(f"*/{calibration}.*"), *store.links(f"*/as/*/{calibration}.*")):
        by_event.setdefault(link.relative_to(latest).parts[0], []).append((link.name, folder.name))
    for event, products in by_event.items():
        reports = [key for stage, key in products if stage.endswith(".report")]
        if not reports and last_run(event, calibration) is None:  # another calibration uses some of its stages
            continue
        files = [one for key in reports[:1] or [key for _, key in products] for one in raw_files(key)]
        files = [one for one in files if one["product"] not in AUXILIARY]
        if files:
            folder = Path(os.path.commonpath([Path(one["path"]).parent for one in files]))
            dates = sorted({one["date"] for one in files})
            letters = sorted({one["satellite"] for one in files} - set("XY")) or [files[0]["satellite"]]
            sources.append((event, folder, letters[0], dates[0] if len(dates) == 1 else None))
    return sources


@contextlib.contextmanager
def recorded(flow, event=None, planned=()):
    """Context with a listener (call, state, ref) of stages, which writes the record of the run at its end or failure.

    The event is by default that of the first stage. Where an error does not say its stage, the first of the planned
    ones that is not done is named.
    """
    started = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    record = {"event": event, "flow": flow, "configuration": location.configuration()}
    record |= {"status": "delivered", "started": started, "stages": {}}
    begin = time.perf_counter()

    def listener(_call, state, ref):  # adds a stage, "cached" or "made", to the record
        record["event"] = record["event"] or ref.event
        other = other_versions(ref) if state == "cached" else []
        stage = {"state": "reused" if state == "cached" else state, "key": ref.key}
        record["stages"][ref.stage] = stage | ({"other_versions": other} if other else {})

    listener.stages = record["stages"]
    try:
        yield listener
    except BaseException as error:
        missing = next((stage for stage in planned if stage not in record["stages"]), None)
        failed = getattr(error, "facts", {}).get("stage") or missing
        record |= {"status": "failed", "failed": failed, "error": f"{type(error).__name__}: {error}"}
        if isinstance(error, NoDataError):
            record |= {"status": "no_data", "failed": None}
        record["reason"] = str(error) if isinstance(error, GravcalError) else record["error"]
        record["failed_key"] = getattr(error, "failed_key", None)
        raise
    finally:
        record["seconds"] = round(time.perf_counter() - begin, 3)
        write_run(record)


def last_run(event, flow):
    """Record of the last run of an event in the configuration that is running, or None.

    It has event, flow, configuration, status, started, seconds and stages {stage: {state, key, other_versions}} of the
    last run that did not fail, "attempt" that of one that failed since, with failed and error; or of the last failure.
    """
    return _read_run(_path_of_run(event, flow, location.configuration()))


def failure(event, flow):
    """Record of the last run in the configuration that is running if it failed, or None, as of `last_run`.

    With "reason", the message without the kind of error, and "failed_key", key of the product that failed, or None.
    """
    record = last_run(event, flow) or {"status": None}
    record = record.get("attempt", record)
    return {"reason": record.get("error", ""), "failed_key": None} | record if record["status"] == "failed" else None


def runs():
    """Records of the last runs of all events, list of dict as `last_run` gives them."""
    records = (_read_run(path) for path in sorted((location.folder() / "runs").glob("*.json")))
    return [record for record in records if record is not None]


def write_run(record):
    """Write the record of a run in one step; a store that can only be read keeps the old one."""
    if not record["event"]:
        return
    path = _path_of_run(record["event"], record["flow"], record.get("configuration", location.OPERATIONAL))
    before = _read_run(path) if record["status"] != "delivered" else None
    with contextlib.suppress(OSError):
        delivered = before and before["status"] == "delivered"
        location.write_json(path, before | {"attempt": record} if delivered else record, indent=1)


def _path_of_run(event, flow, configuration):
    """Path of the record of a run; "/" in names becomes "_", so that none leads out of the folder."""
    name = "" if configuration == location.OPERATIONAL else f"@{configuration}"
    return location.folder() / "runs" / f"{event}.{flow}{name}.json".replace("/", "_")


def _read_run(path):  # record of a run, None if there is none or it is not whole
    record = location.read_json(path)
    whole = isinstance(record, dict) and {"event", "flow", "status", "stages"} <= set(record)
    return {"configuration": location.OPERATIONAL} | record if whole else None
