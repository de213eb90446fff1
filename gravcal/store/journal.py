"""What the last run of each event did: which products it reused, which it made, where it failed.

    runs/<event>.<flow>.json          one record, replaced by the next run; products do not depend on it
    runs/<event>.<flow>@<NAME>.json   the same of the experiment of that name

The store says what there is; only the run knows what it found there already. ``gravcal browse`` shows both. A run that
fails after one that did not, such as one from a folder without the files, takes nothing from that: it stands beside it.
"""

import contextlib
import datetime
import json
import time
import uuid

from gravcal.errors import GravcalError, NoDataError
from gravcal.store import explain, location

STATES = {"cached": "reused", "made": "made"}


@contextlib.contextmanager
def recorded(flow, event=None, planned=()):
    """Listener of (call, state, ref) whose run is recorded at the end, also when it fails.

    Parameters
    ----------
    flow : str, name of the flow
    event : str or None, by default that of the first stage
    planned : stages in the order of the flow; where an error does not say its stage, the first not done is named
    """
    record = {"event": event, "flow": flow, "configuration": location.configuration()}
    record |= {"status": "delivered", "started": _now(), "stages": {}}
    begin = time.perf_counter()

    def listener(call, state, ref):
        record["event"] = record["event"] or call.event
        other = explain.other_versions(ref) if state == "cached" else []
        found = {"state": STATES.get(state, state), "key": ref.key}
        record["stages"][call.unmade.stage] = found | ({"other_versions": other} if other else {})

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
        _write(record)


def last(event, flow):
    """Record of the last run of an event in the configuration that is running, or None.

    Parameters
    ----------
    event, flow : str

    Returns
    -------
    record : dict or None: event, flow, configuration, status, started, seconds, stages {stage: {state, key,
        other_versions}}, of the last run that did not fail, and "attempt", the same of one that failed since, with
        failed and error; where all failed, that of the last
    """
    return _read(_path(event, flow, location.configuration()))


def failure(event, flow):
    """Record of the last run in the configuration that is running if it failed, or None.

    Parameters
    ----------
    event, flow : str

    Returns
    -------
    record : dict or None: as of ``last``; "reason" without the kind of the error, "failed_key" of the product that its
        stage would have given, None where no stage is to blame
    """
    record = last(event, flow) or {"status": None}
    record = record.get("attempt", record)
    return {"reason": record.get("error", ""), "failed_key": None} | record if record["status"] == "failed" else None


def runs():
    """Records of the last runs of all events.

    Returns
    -------
    records : list of dict, as ``last`` gives them
    """
    found = [_read(path) for path in sorted((location.folder() / "runs").glob("*.json"))]
    return [record for record in found if record is not None]


def _path(event, flow, configuration):
    """Place of a record; a name that would lead elsewhere has none of its separators left."""
    name = "" if configuration == location.OPERATIONAL else f"@{configuration}"
    return location.folder() / "runs" / f"{event}.{flow}{name}.json".replace("/", "_")


def _read(path):
    """Record at a path, or None where it cannot be read."""
    try:
        record = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    whole = isinstance(record, dict) and {"event", "flow", "status", "stages"} <= set(record)
    return {"configuration": location.OPERATIONAL} | record if whole else None


def _write(record):
    """Write a record in one step; a store that can only be read keeps the old one."""
    if not record["event"]:
        return
    path = _path(record["event"], record["flow"], record.get("configuration", location.OPERATIONAL))
    before = _read(path) if record["status"] != "delivered" else None
    if before and before["status"] == "delivered":
        record = before | {"attempt": record}
    aside = path.with_name(f".{uuid.uuid4().hex}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_text(json.dumps(record, indent=1))
        aside.replace(path)


def _now():
    """Present time as text, UTC."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
