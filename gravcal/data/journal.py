"""What the last run of each event did: which products it reused, which it made, where it failed.

    runs/<event>.<flow>.json     one record, replaced by the next run; products do not depend on it

The store says what there is; only the run knows what it found there already. ``gravcal browse`` shows both.
"""

import contextlib
import datetime
import json
import time
import uuid

from gravcal.data import location

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
    record = {"event": event, "flow": flow, "status": "delivered", "started": _now(), "stages": {}}
    begin = time.perf_counter()

    def listener(call, state, ref):
        record["event"] = record["event"] or call.event
        record["stages"][call.unmade.stage] = {"state": STATES.get(state, state), "key": ref.key}

    try:
        yield listener
    except BaseException as error:
        missing = next((stage for stage in planned if stage not in record["stages"]), None)
        failed = getattr(error, "facts", {}).get("stage") or missing
        record |= {"status": "failed", "failed": failed, "error": f"{type(error).__name__}: {error}"}
        raise
    finally:
        record["seconds"] = round(time.perf_counter() - begin, 3)
        _write(record)


def last(event, flow):
    """Record of the last run of an event, or None.

    Parameters
    ----------
    event, flow : str

    Returns
    -------
    record : dict or None: event, flow, status, started, seconds, stages {stage: {state, key}}, failed, error
    """
    return _read(_path(event, flow))


def runs():
    """Records of the last runs of all events.

    Returns
    -------
    records : list of dict, as ``last`` gives them
    """
    found = [_read(path) for path in sorted((location.folder() / "runs").glob("*.json"))]
    return [record for record in found if record is not None]


def _path(event, flow):
    """Place of a record; a name that would lead elsewhere has none of its separators left."""
    return location.folder() / "runs" / f"{event}.{flow}.json".replace("/", "_")


def _read(path):
    """Record at a path, or None where it cannot be read."""
    try:
        record = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and {"event", "flow", "status", "stages"} <= set(record) else None


def _write(record):
    """Write a record in one step; a store that can only be read keeps the old one."""
    if not record["event"]:
        return
    path = _path(record["event"], record["flow"])
    aside = path.with_name(f".{uuid.uuid4().hex}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_text(json.dumps(record, indent=1))
        aside.replace(path)


def _now():
    """Present time as text, UTC."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
